"""The JSON schemas say what scene files and predictions are."""

import dataclasses
import json
from pathlib import Path

import jsonschema
import pytest
import yaml
from example_scenes import two_bodies

from unc_physics import PROPAGATORS, UncPhysicsError
from unc_physics.__main__ import main
from unc_physics.cli.schema_command import SCHEMAS, schema_text
from unc_physics.scene import scene_file
from unc_physics.scene.environment import ELEMENTS, quantities

ROOT = Path(__file__).resolve().parents[2]
SCENE_FILES = sorted((ROOT / "examples" / "scenes").glob("*.yaml"))


def schema(what):
    return json.loads(schema_text(what))


def validator(what):
    return jsonschema.Draft202012Validator(schema(what))


def problems(what, content):
    return [error.message for error in validator(what).iter_errors(content)]


def properties(node):
    """All properties anywhere in a schema, each with its name."""
    if isinstance(node, dict):
        for name, value in node.get("properties", {}).items():
            yield name, value
        for value in node.values():
            yield from properties(value)
    elif isinstance(node, list):
        for value in node:
            yield from properties(value)


@pytest.mark.parametrize("what", SCHEMAS)
def test_a_schema_is_one_and_describes_every_key(what, capsys):
    jsonschema.Draft202012Validator.check_schema(schema(what))
    bare = [name for name, value in properties(schema(what)) if not value.get("description")]
    assert not bare
    assert main(["schema", what]) == 0
    assert json.loads(capsys.readouterr().out) == schema(what)


def test_the_scene_schema_has_the_reader_s_keys():
    found = schema("scene")
    assert set(found["properties"]) == set(scene_file._SCENE_KEYS)
    parts = found["$defs"]
    assert set(parts["body"]["properties"]) == set(scene_file._BODY_KEYS)
    element = parts["element"]["properties"]
    assert set(element) == {*ELEMENTS, *scene_file._ELEMENT_KEYS}
    for name, kind in ELEMENTS.items():
        defaults = {spec.name: spec.default for spec in dataclasses.fields(kind)}
        known = quantities(kind)
        turned = {"roll_pitch_yaw"} if "orientation" in known else set()
        assert set(element[name]["properties"]) == {*known, *turned}
        needed = {key for key in known if defaults[key] is dataclasses.MISSING}
        assert set(element[name].get("required", ())) == needed


@pytest.mark.parametrize("path", SCENE_FILES, ids=lambda path: path.stem)
def test_scene_files_fit_the_schema(path):
    assert not problems("scene", yaml.safe_load(path.read_text()))


def in_body(**entries):
    content = two_bodies()
    content["bodies"][0] |= entries
    return content


@pytest.mark.parametrize(
    "content",
    [
        two_bodies() | {"gravty": [0, 0, 0]},
        two_bodies() | {"common_pose_origin": [0, 0, 0]},
        two_bodies() | {"environment": [{"cone": {"radius": 1}}]},
        two_bodies() | {"environment": [{"plane": {"normal": [0, 0, 1]}, "sphere": {"radius": 1}}]},
        two_bodies() | {"environment": [{"box": {"position": [0, 0, 1]}}]},
        in_body(colour="red"),
        in_body(position=["1e-2", 0, 0]),
    ],
)
def test_schema_and_reader_refuse_alike(content):
    """Of the values of keys, test_bad_input.py compares them."""
    assert problems("scene", content)
    with pytest.raises(UncPhysicsError):
        scene_file.scene_from_dict(content)


@pytest.mark.parametrize(
    "content",
    [
        two_bodies() | {"dt": 1e-2, "gravity": None, "stiffness": "auto"},
        two_bodies() | {"physics": None, "exact": True, "stiffness": None, "damping": None},
        two_bodies()
        | {"gravity": None, "environment": [{"plane": {"normal": [0, 0, 1e0]}, "friction": None}]},
        in_body(spheres=None, scale=None, orientation=None, at_rest=None),
    ],
)
def test_schema_and_reader_take_alike(content):
    assert not problems("scene", content)
    scene_file.scene_from_dict(content)


@pytest.mark.parametrize("name", sorted(PROPAGATORS))
def test_predictions_fit_the_schema(name, tmp_path, capsys):
    content = two_bodies()
    content["bodies"].append(
        {"name": "post", "model": "bunny", "spheres": 10, "fixed": True, "position": [9, 9, 9]}
    )
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(content))
    few = ["--samples", "5"] if "samples" in PROPAGATORS[name].options() else []
    for more in ([], ["--probabilities", "--period", "0.5", "--samples-out", "3", "--status-rollouts", "0"]):
        assert main(["predict", str(path), "--json", "--propagator", name, *few, *more]) == 0
        result = json.loads(capsys.readouterr().out)
        assert not problems("prediction", result)
        assert set(result) == {
            key
            for key in schema("prediction")["properties"]
            if more or key not in ("trajectory", "probabilities")
        }
    fixed = result["bodies"][-1]
    assert fixed["covariance"] is None and len(fixed["samples"]) == 3


def test_the_schema_knows_all_that_physics_may_say(tmp_path, capsys):
    path, found = tmp_path / "scene.yaml", set()
    paper = two_bodies() | {"stiffness_std": 10.0, "horizon": 0.1}
    names = [body["name"] for body in paper["bodies"]]
    surface = {"friction": 0.3, "restitution": 0.2, "rolling_friction": 1e-4}
    everyday = {
        "horizon": 0.1,
        "gravity_direction_std": 0.01,
        "pairs": [{"between": names, "friction": 0.3}],
        "bodies": [paper["bodies"][0] | surface, paper["bodies"][1]],
    }
    for scene in (paper, everyday):
        path.write_text(yaml.safe_dump(scene))
        assert not problems("scene", scene)
        assert main(["predict", str(path), "--json", "--propagator", "monte_carlo", "--samples", "3"]) == 0
        result = json.loads(capsys.readouterr().out)
        assert not problems("prediction", result)
        found |= set(result["physics"])
    assert found == set(schema("prediction")["$defs"]["physics"]["properties"])
