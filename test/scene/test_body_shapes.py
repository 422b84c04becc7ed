"""Bodies of simple shapes in scene files: a ball is exact, others are packed once."""

import json
import pickle

import jsonschema
import numpy as np
import pytest

from unc_physics import UncPhysicsError, primitive_model
from unc_physics.cli.schema_command import schema_text
from unc_physics.prediction.answer_store import fingerprint
from unc_physics.scene.scene_file import scene_from_dict
from unc_physics.shapes import packing, primitive_models

RADIUS = 0.02
BALL = {
    "name": "ball",
    "shape": {"sphere": {"radius": RADIUS}},
    "mass": 0.1,
    "position": [0.3, -0.1, RADIUS + 0.05],
}


def scene(**body):
    return {"physics": "everyday", "environment": [{"plane": {}}], "bodies": [BALL | body]}


@pytest.fixture
def few_spheres(monkeypatch, tmp_path):
    """Packings of few spheres, in a cache folder of the test's own; returns the list of packings made."""
    monkeypatch.setattr(primitive_models, "SPHERES", 60)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    primitive_models._packed.cache_clear()
    primitive_models._primitive.cache_clear()
    made, pack = [], packing.pack_solid

    def packed(*given, **options):
        made.append(given)
        return pack(*given, **options)

    monkeypatch.setattr(packing, "pack_solid", packed)
    yield made
    primitive_models._packed.cache_clear()
    primitive_models._primitive.cache_clear()


@pytest.mark.parametrize("origin", ["center_of_mass", "model"])
def test_a_ball_is_one_sphere_about_its_position(origin):
    loaded = scene_from_dict(scene(origin=origin))
    (body,) = loaded.scene.bodies
    assert len(body.model) == 1 and body.model.radii[0] == RADIUS and not body.model.centers.any()
    np.testing.assert_array_equal(loaded.belief.mean[0, :3], BALL["position"])
    np.testing.assert_allclose(body.unit_inertia, 0.4 * RADIUS**2 * np.eye(3), rtol=1e-12)


@pytest.mark.parametrize(
    ("kind", "sizes", "volume", "inertia"),
    [
        ("box", {"size": [0.06, 0.08, 0.1]}, 0.06 * 0.08 * 0.1, (0.08**2 + 0.1**2) / 12.0),
        ("cylinder", {"radius": 0.03, "length": 0.1}, np.pi * 0.03**2 * 0.1, 0.03**2 / 4.0 + 0.1**2 / 12.0),
    ],
)
def test_other_shapes_are_packed_once(kind, sizes, volume, inertia, few_spheres):
    model = scene_from_dict(scene(shape={kind: sizes})).scene.bodies[0].model
    assert model.volume == pytest.approx(volume, rel=1e-12)
    assert model.inertia[0, 0] == pytest.approx(inertia, rel=1e-12)
    other = pickle.loads(pickle.dumps(model.named("crate")))
    assert (
        other.name == "crate" and len(fingerprint(other)) == 32 and fingerprint(other) != fingerprint(model)
    )
    assert not few_spheres, "nothing asks for spheres"
    assert len(model.centers) and len(few_spheres) == 1
    primitive_models._packed.cache_clear()  # as in another process
    again = primitive_model(kind, **sizes)
    assert len(again.centers) and len(few_spheres) == 1
    np.testing.assert_array_equal(again.centers[: len(model)], model.centers)


@pytest.mark.parametrize(
    ("entries", "sentence"),
    [
        ({"model": "pin"}, "bodies[0].model must be absent beside shape"),
        ({"scale": 2.0}, "bodies[0].scale must be absent beside shape"),
        (
            {"shape": {"sphere": {"radius": 1}, "box": {"size": [1, 1, 1]}}},
            "bodies[0].shape must be a mapping",
        ),
        ({"shape": {"spere": {"radius": 1}}}, "bodies[0].shape has no key 'spere'; did you mean 'sphere'?"),
        ({"shape": {"sphere": {}}}, "bodies[0].shape.sphere.radius must be given"),
        ({"shape": {"sphere": {"size": 1}}}, "bodies[0].shape.sphere has no key 'size'"),
        ({"shape": {"box": {"size": [1, 0, 1]}}}, "bodies[0].shape.box.size[1] must be positive"),
    ],
)
def test_a_wrong_shape_is_told_in_a_sentence(entries, sentence):
    """The wrong values of keys are in test/cli/test_bad_input.py."""
    with pytest.raises(UncPhysicsError) as caught:
        scene_from_dict(scene(**entries))
    assert str(caught.value).startswith(sentence)
    schema = jsonschema.Draft202012Validator(json.loads(schema_text("scene")))
    assert schema.is_valid(scene())
    assert schema.is_valid(scene(**entries)) == ("scale" in entries)  # which the schema does not say


def test_a_shape_without_a_mass_is_refused_before_it_is_packed(monkeypatch):
    monkeypatch.setattr(
        "unc_physics.scene.scene_file.primitive_model", lambda *_, **__: pytest.fail("packed")
    )
    with pytest.raises(UncPhysicsError, match=r"^bodies\[0\]\.mass must be given for a body with a shape"):
        scene_from_dict(scene(shape={"cylinder": {"radius": 0.03, "length": 0.1}}, mass=None))
