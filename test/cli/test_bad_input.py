"""Bad input: its own exit status, one sentence that names field and value, and nothing else."""

import copy
import io
import json
import os
import re
import shlex
import subprocess
import sys
import zipfile
from datetime import date

import jsonschema
import numpy as np
import pytest
import yaml
from example_scenes import CONTENTS, examples
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from unc_physics import ErrorCode, UncPhysicsError, load_model, load_scene, predict
from unc_physics.__main__ import main
from unc_physics.cli.schema_command import schema_text
from unc_physics.scene.scene_file import scene_from_dict

NAN, INF = float("nan"), float("inf")
SCHEMA = json.loads(schema_text("scene"))
PARTS = SCHEMA["$defs"]
BODY, ELEMENT = PARTS["body"]["properties"], PARTS["element"]["properties"]
SHAPES = [key for key, entry in ELEMENT.items() if "properties" in entry]

# -- each key, with values of other types and ranges ----------------------------------------------------

SIZES = {"radius": 0.1, "length": 0.2, "size": [1, 1, 1]}
POSES = [{"time": t, "position": [t, 0, 0]} for t in (0, 1)]
WRONG = ("text", "", True, 7, -1, [], [1.0, 2.0], [1, 2, "x"], {"x": 1}, {1: 2}, b"x", date(2001, 1, 1))
RIGHT = (0.5, [0.5] * 3, [0, 0, 0, 1], [0.5] * 6, np.eye(12).tolist())
#: Codes of keys that have one of their own.
CODES = dict.fromkeys(("dt", "horizon"), "INVALID_HORIZON") | {
    **dict.fromkeys(("integrator", "overlap", "physics"), "INVALID_OPTION"),
    **dict.fromkeys(("spheres", "scale"), "INVALID_MODEL"),
    **dict.fromkeys(("mass", "mass_std"), "INVALID_MASS"),
    **dict.fromkeys(("covariance", "pose_covariance", "common_pose_std"), "INVALID_COVARIANCE"),
    "bodies": "INVALID_REQUEST|NO_OBJECTS",
    "environment": "INVALID_ENVIRONMENT",
}


def sized(kind, entry):
    return {kind: {key: SIZES[key] for key in entry.get("required", ())}}


def places():
    """The place of each key of a scene file, with its schema, and entries of the scene that it stands in."""
    yield from (((key,), entry, {}) for key, entry in SCHEMA["properties"].items())
    other = {"name": "other", "mass": 1.0}
    for key, entry in BODY.items():
        alone = {one: {"model": "pin"} for one in ("trajectory", "covariance", "pose_covariance")}
        beside = (alone | {"shape": {}}).get(key, CONTENTS["two_bodies"]()["bodies"][1])
        yield ("bodies", 0, key), entry, {"bodies": [other | beside]}
    for kind, entry in BODY["shape"]["properties"].items():
        body = other | {"shape": sized(kind, entry)}
        for key, inner in entry["properties"].items():
            yield ("bodies", 0, "shape", kind, key), inner, {"bodies": [body]}
    for part, entries in (("pose_at_a_time", {"trajectory": POSES}), ("wrench", {"wrenches": [{}, {}]})):
        (key,) = entries
        for inner, entry in PARTS[part]["properties"].items():
            yield ("bodies", 0, key, 1, inner), entry, {"bodies": [other | {"model": "pin"} | entries]}
    for key, entry in ELEMENT.items():
        yield ("environment", 0, key), entry, {"environment": [{} if key in SHAPES else {"plane": {}}]}
        for inner, of in entry.get("properties", {}).items():
            yield ("environment", 0, key, inner), of, {"environment": [sized(key, entry)]}


def named(place):
    """A place as messages name it."""
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in place).lstrip(".")


PLACES = {named(place): (place, *others) for place, *others in places()}


@pytest.mark.parametrize("name", PLACES)
def test_what_the_schema_refuses_at_a_key_is_refused_by_its_place(name):
    """And numbers that are not finite, for which JSON has no words."""
    place, entry, beside = PLACES[name]
    fits = jsonschema.Draft202012Validator({"$defs": PARTS, **entry}).is_valid
    wrong = [(value, None) for value in (*WRONG, None) if not fits(value)]
    good = next(filter(fits, RIGHT), None)
    if isinstance(good, float):
        wrong += [(10**400, None), *((value, "NOT_FINITE") for value in (NAN, INF, -INF))]
    elif good is not None:
        numbers = np.array(good, float)
        numbers.flat[-2] = NAN
        wrong.append((numbers.tolist(), "NOT_FINITE"))
    assert wrong
    bodies = CONTENTS["two_bodies"]()["bodies"]
    everyday = {"physics": "everyday", "bodies": bodies, "common_pose_std": [0.01] * 6}
    for value, code in wrong:
        inner = content = copy.deepcopy(everyday | beside)
        for key in place[:-1]:
            inner = inner[key]
        inner[place[-1]] = value
        with pytest.raises(UncPhysicsError, match=rf"{re.escape(name)}|^{place[-1]} of body") as caught:
            scene_from_dict(content)
        own = CODES.get(place[-1], CODES.get(place[0], "INVALID_REQUEST"))
        own = "INVALID_REQUEST|INVALID_MODEL" if "shape" in place else own
        assert caught.value.code.name in (code or own).split("|"), (value, caught.value)


# -- what the schema does not say ------------------------------------------------------------------------


def scene(**entries):
    return CONTENTS["two_bodies"]() | entries


def with_body(of="two_bodies", /, **entries):
    """The content of a scene with other entries of its second body; None leaves one out."""
    content = CONTENTS[of]()
    body = content["bodies"][1] | entries
    content["bodies"][1] = {key: value for key, value in body.items() if value is not None}
    return content


def without(key):
    content = CONTENTS["two_bodies"]()
    del content[key]
    return content


def covariance(*entries, rows=12):
    """A scene whose second body has a covariance with some entries (row, column, value)."""
    P = (0.01 * np.eye(12)).tolist()
    for row, column, value in entries:
        P[row][column] = value
    return with_body(covariance=P[:rows], position_std=None, orientation_std=None)


def at_rest(gravity=(0, 0, -9.81), **entries):
    """A scene whose second body is at rest."""
    entries = {"at_rest": True, "linear_velocity": [0, 0, 0]} | entries
    return with_body("everyday", **entries) | {"gravity": gravity and list(gravity)}


def common_error(**entries):
    return scene(**{"common_pose_std": [0.01] * 6, "common_pose_origin": [0, 0, 1]} | entries)


def around(element):
    return scene(environment=[element])


#: Contents with the code of their error, and a pattern of its message.
CASES = [
    *(
        (with_body(model=model), "UNKNOWN_MODEL", rf"bodies\[1\].model.*{words}")
        for model, words in (
            ("salt_bx", "did you mean 'salt_box'.*salt_bx"),
            ("no/such/file.npz", "no/such/file.npz"),
            ("x" * 5000, "xxx"),
            ("x" * 5000 + ".npz", "xxx"),
            ("~nobody_of_that_name/a.npz", "nobody"),
            ("a\0b.npz", "b.npz"),
            ("/etc/passwd", ".npz.*/etc/passwd"),
        )
    ),
    *(
        (with_body("three_bodies", **entry), "INVALID_REQUEST", rf"bodies\[1\].{key} .*{words}")
        for key, entry, words in (
            ("linear_velocity", {"linear_velocity": [0, 0, 1]}, "zero or absent: the body is fixed"),
            ("angular_velocity", {"angular_velocity": [0, 1, 0]}, "zero or absent: the body is fixed"),
            ("position_std", {"position_std": 0.1}, "zero or absent: the body is fixed"),
            ("covariance", {"covariance": np.eye(12).tolist()}, "zero or absent: the body is fixed"),
            ("mass_std", {"mass_std": 0.1}, "zero or absent: the body is fixed"),
            ("center_of_mass_std", {"center_of_mass_std": [0, 0, 0.01]}, "zero or absent: the body is fixed"),
            ("at_rest", {"at_rest": True}, "fixed"),
        )
    ),
    (without("bodies"), "NO_OBJECTS", "bodies"),
    (without("horizon"), "INVALID_HORIZON", "horizon must be given.*'horizon: 1.0'.*--horizon"),
    (scene(horizon=0.001), "INVALID_HORIZON", "horizon.*0.001"),
    (scene(horizon=1e12), "LIMIT_EXCEEDED", "horizon.*1000000000000.0|1e\\+12"),
    (scene(friction="0.4"), "INVALID_REQUEST", "friction must be a number, not a text.*'0.4'"),
    (scene(friction_std=0.1), "INVALID_REQUEST", "friction_std.*0.1"),
    (scene(gravity_direction_std=0.1), "INVALID_REQUEST", "gravity_direction_std.*0.1"),
    (scene(gravity=[0, 0, -1e20]), "LIMIT_EXCEEDED", "gravity must be at most 1000000 m/s"),
    (scene(integrator="robust"), "INVALID_OPTION", "must be 'implicit' now"),
    (scene(physics="everday"), "INVALID_OPTION", "did you mean 'everyday'.*everday"),
    (scene(overlap=None), "INVALID_OPTION", "project, reject, keep; leave it out.*null"),
    (scene(overlap="project"), "INVALID_OPTION", "'integrator: implicit'.*keep.*project"),
    (scene(overlap="reject"), "INVALID_OPTION", "implicit.*reject"),
    (scene(islands=True), "INVALID_REQUEST", "'islands', which was removed in version 0.3: leave it out"),
    (scene(stifness=1.0), "INVALID_REQUEST", "scene has no key 'stifness'.*stiffness"),
    (CONTENTS["two_bodies"]() | {3: 1.0}, "INVALID_REQUEST", "scene has a key that is no text.*3"),
    (scene(bodies=[CONTENTS["two_bodies"]()["bodies"][0], None]), "INVALID_REQUEST", r"bodies\[1\]"),
    (scene(bodies=[["name"]]), "INVALID_REQUEST", r"bodies\[0\].*\['name'\]"),
    (with_body(masss=1.0), "INVALID_REQUEST", r"bodies\[1\] has no key 'masss'.*'mass'"),
    (with_body(mu=0.4), "INVALID_REQUEST", r"bodies\[1\] has no key 'mu'.*did you mean 'friction'"),
    (
        with_body(sphere={"radius": 0.05}),
        "INVALID_REQUEST",
        r"bodies\[1\] has no key 'sphere'; did you mean 'shape'",
    ),
    (with_body(name="left"), "DUPLICATE_ID", r"bodies\[1\].name.*left"),
    (with_body(name=None), "INVALID_REQUEST", r"bodies\[1\].name"),
    (
        with_body(model=None),
        "INVALID_REQUEST",
        r"bodies\[1\].model must be a non-empty text, or give a shape",
    ),
    (with_body(mass=1e-320), "INVALID_MASS", r"bodies\[1\].mass.*between 1e-50 and 1e\+50 kg.*1e-320"),
    (with_body(friction_std=0.1), "INVALID_REQUEST", r"bodies\[1\].friction_std.*0.1"),
    (with_body(position=[1e13, 0, 0]), "LIMIT_EXCEEDED", r"bodies\[1\].position.*1e\+12 m.*1000000"),
    (with_body(position_std=1e200), "NOT_FINITE", r"bodies\[1\].position_std.*1e\+200"),
    (with_body(orientation=[0, 0, 0, 0]), "INVALID_ORIENTATION", r"bodies\[1\].orientation.*\[0.0, 0.0, 0"),
    (with_body(orientation=[0, 0, 0, 1.01]), "INVALID_ORIENTATION", r"bodies\[1\].orientation.*1.01"),
    (with_body(covariance=np.eye(12).tolist()), "INVALID_REQUEST", r"bodies\[1\].covariance.*position_std"),
    (covariance((2, 5, 0.001)), "INVALID_COVARIANCE", r"bodies\[1\].covariance.*\[2\]\[5\].*0.001"),
    (covariance((3, 3, -0.01)), "INVALID_COVARIANCE", r"bodies\[1\].covariance.*\[3\].*-0.01"),
    (covariance((0, 1, 0.02), (1, 0, 0.02)), "INVALID_COVARIANCE", r"bodies\[1\].covariance.*-0.01"),
    (covariance((0, 0, "x")), "INVALID_COVARIANCE", r"bodies\[1\].covariance must be an array .*'x'"),
    (covariance(rows=6), "INVALID_COVARIANCE", "12 rows, three each for position, .* angular velocity"),
    (with_body(at_rest=True), "INVALID_OPTION", r"bodies\[1\].at_rest.*implicit.*True"),
    (at_rest(gravity=None), "INVALID_REQUEST", r"bodies\[1\].at_rest.*gravity"),
    (
        at_rest(linear_velocity=[0, 0, 0.1]),
        "INVALID_REQUEST",
        "linear_velocity of body 'right'.*at_rest.*0.1",
    ),
    (at_rest(angular_velocity=[0.2, 0, 0]), "INVALID_REQUEST", "angular_velocity of body 'right'.*rest.*0.2"),
    (common_error(common_pose_std=[0] * 5 + [-0.1]), "INVALID_COVARIANCE", r"common_pose_std\[5\].*-0.1"),
    (common_error(common_pose_std=[1e200] * 6), "NOT_FINITE", "common_pose_std.*1e\\+200"),
    (common_error(common_pose_std=None), "INVALID_REQUEST", r"_origin.*common_pose_std.*\[0, 0, 1\]"),
    (around("floor"), "INVALID_ENVIRONMENT", r"environment\[0\].*floor"),
    (around({}), "INVALID_ENVIRONMENT", r"environment\[0\].*shapes are plane, box, sphere"),
    (around({"plane": {}, "box": {}}), "INVALID_ENVIRONMENT", r"environment\[0\].*exactly one"),
    (around({"cone": {}}), "INVALID_ENVIRONMENT", r"environment\[0\] has no shape 'cone'; the shapes are"),
    (around({"plane": {"normal": [0, 0, 0]}}), "INVALID_ENVIRONMENT", r"\[0\].plane.normal.*\[0.0, 0.0, 0.0"),
    (around({"plane": {"ofset": 0}}), "INVALID_ENVIRONMENT", r"environment\[0\].plane.*offset"),
    (around({"box": {"size": [1, 0, 1]}}), "INVALID_ENVIRONMENT", r"\[0\].box.size\[1\].*0.0"),
    (around({"box": {"size": [1e13, 1, 1]}}), "LIMIT_EXCEEDED", r"\[0\].box.size\[0\].*1e\+12 m"),
    (around({"sphere": {"radius": 1, "size": 1}}), "INVALID_ENVIRONMENT", r"\[0\].sphere has no key 'size'"),
    *(
        (around({kind: {}}), "INVALID_ENVIRONMENT", rf"environment\[0\].{kind}.{key} must be given")
        for kind, key in (
            ("box", "size"),
            ("sphere", "radius"),
            ("cylinder", "radius"),
            ("capsule", "radius"),
        )
    ),
    (
        around({"capsule": {"radius": 1, "length": 1, "orientation": [1, 1, 0, 0]}}),
        "INVALID_ORIENTATION",
        r"environment\[0\].capsule.orientation.*1.0",
    ),
    (
        around({"plane": {}, "restitution_std": 0.1}),
        "INVALID_ENVIRONMENT",
        r"environment\[0\].restitution_std",
    ),
    (around({"plane": {}, "name": "left"}), "DUPLICATE_ID", r"environment\[0\].name.*left"),
    (with_body(linear_velocity=[1e308, 0, 0]), "DIVERGED", "diverged"),
    ([], "INVALID_REQUEST", r"scene.*\[\]"),
    ("text", "INVALID_REQUEST", "scene.*text"),
    (None, "INVALID_REQUEST", "scene"),
]


def assert_refused(code, out, err, codes, words=""):
    """Exit status, nothing on standard output, and one line on standard error with the words in it."""
    assert ErrorCode(code).name in codes.split("|"), err
    assert out == ""
    assert err.count("\n") == 1 and err.endswith("\n"), err
    assert err.startswith("unc_physics: ") and len(err) < 2000, err
    assert "Traceback" not in err
    assert re.search(words, err), err


def by_index(text, content):
    """An error of a file without the file's name, with indices for names."""
    text = text.removeprefix("scene.yaml: ")
    for key in ("bodies", "environment"):
        entries = content.get(key) if isinstance(content, dict) else None
        for k, entry in enumerate(entries if isinstance(entries, list) else ()):
            if isinstance(entry, dict) and isinstance(entry.get("name"), str):
                text = text.replace(f"{key}[{entry['name']}]", f"{key}[{k}]")
    return text


def test_an_error_names_the_file_the_body_and_the_field(tmp_path):
    path = tmp_path / "table.yaml"
    content = CONTENTS["two_bodies"]() | {"environment": [{"name": "shelf", "box": {"size": [1, 1, -1]}}]}
    for change, place in (
        ({}, r"environment\[shelf\]\.box\.size\[2\]"),
        (
            {"environment": []} | {"bodies": [CONTENTS["two_bodies"]()["bodies"][0] | {"mass": -1}]},
            r"bodies\[left\]\.mass",
        ),
        (
            {"environment": [], "bodies": [CONTENTS["two_bodies"]()["bodies"][0] | {"name": 3}]},
            r"bodies\[0\]\.name",
        ),
        ({"horizon": -1, "environment": []}, "horizon"),
    ):
        path.write_text(yaml.safe_dump(content | change))
        with pytest.raises(UncPhysicsError, match=rf"^table\.yaml: {place} "):
            load_scene(path)


@pytest.mark.parametrize(
    "content, codes, words", CASES, ids=[f"{k}-{case[1]}" for k, case in enumerate(CASES)]
)
def test_a_bad_scene_is_refused(tmp_path, recwarn, content, codes, words):
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(UncPhysicsError) as caught:
        scene, belief, horizon = load_scene(path)
        predict(scene, belief, horizon=horizon)
    text = by_index(str(caught.value), content)
    assert_refused(caught.value.code, "", f"unc_physics: {text}\n", codes, words)
    assert not recwarn.list, "a warning would be printed beside the sentence"


def nested_aliases(levels=12):
    """Lists of ten of the list before, by aliases: a few hundred bytes."""
    lines = ["a: &l0 [x, x, x, x, x, x, x, x, x, x]"]
    for k in range(levels):
        lines.append(f"k{k}: &l{k + 1} [{', '.join([f'*l{k}'] * 10)}]")
    return "\n".join(lines)


def nested_merges(levels=9):
    """Mappings that merge the one before nine times."""
    lines = ["a: &m0 {k: 1}"]
    for k in range(levels):
        lines.append(f"x{k}: &m{k + 1} {{<<: [{', '.join([f'*m{k}'] * 9)}]}}")
    return "\n".join(lines)


TEXTS = [
    (bytes(range(256)), ""),
    (b"PK\x03\x04" + bytes(100), ""),
    ("dt: 0.01".encode("utf-16"), ""),
    ("dt: \x01\n", ""),
    ("!!python/object/apply:os.system ['true']", ""),
    ("{[1, 2]: 3}", ""),
    ("&a {bodies: *a}", ""),
    ("", "scene must be a mapping"),
    ("bodies: [{name: a, model: pin, mass: 0x" + "f" * 6000 + "}]", "mass"),
    ("? " + "k" * 5000 + "\n: 1\n", "scene has no key 'kkk"),
    ('"a\\nb": 1\nbodies: []\n', "scene has no key"),
    ("bodies: [{name: a, model: pin, mass: !!binary aGVsbG8=}]", "mass"),
    ("bodies: !!set {a, b}", "bodies must be a list"),
    ("bodies: !!set [{a: 1}]", "line 1: expected a mapping node"),
    ("bodies: !!omap {a: 1}", "line 1: expected a sequence"),
    (
        "bodies:\n  - name: a\n    mass: 1\n    name: b\n",
        "line 4: the key 'name' is given twice, first in line 2",
    ),
    (nested_aliases(), "line 6: it has more than 300000 entries, those of aliases counted"),
    (nested_merges(), "it has more than 300000 entries, those of aliases counted"),
    ("bodies: [" + "{}," * 300_000 + "]", "it has more than 300000 entries"),
    ("bodies: " + "[" * 100_000, "line 1: it is nested more than 50 levels deep"),
    ("bodies: " + "[" * 50 + "]" * 50, "line 1: it is nested more than 50 levels deep"),
    ("bodies: " + "[" * 49 + "]" * 49, r"bodies\[0\] must be a mapping"),
    ("bodies:\n  - {name: a, model: pin, mass: 1:30}", "line 2: 1:30 is a number of base 60"),
    ("horizon: 1:30.5\nbodies: []", "line 1: 1:30.5 is a number of base 60"),
    ("horizon: 010\nbodies: []", "line 1: 010 is a number of base 8"),
    ("horizon: 2020-13-45", "line 1: '2020-13-45' has a value that cannot be read"),
    ("horizon: 9" + "9" * 5000, "line 1: '9999.* has a value that cannot be read"),
    *(
        (f"horizon: !!{kind} x", "line 1: 'x' has a value that cannot")
        for kind in ("timestamp", "float", "bool")
    ),
    ("horizon: !!int [1]", "line 1: int has a value that cannot be read"),
    ("horizon: 1\n---\nhorizon: 1", "expected a single document in the stream, but found another"),
    ("horizon: *a", "line 1: found undefined alias 'a'"),
    ("bodies: &a [*a]", r"bodies\[0\]"),
    ("a: 1\nb: [1, 2\nc: 3\n", r"in line 3: .*the fault may stand above, where the \[ of line 2"),
    ("a: {b: 1\nc: 3\n", r"in line 2: .*where the \{ of line 1 is not closed"),
    ("a: 'b\nc: 1\n", r"where the quote of line 1 is not closed"),
    ("a:\n  - b\n - c\n", r"in line 3: .*where line 1 begins what goes on here"),
    ("a:\n\t- 1\n", r"in line 2: it has a tab; indent with spaces"),
    ("a: b: c\n", r"in line 1: there is a ':' where none can be$"),
]


@pytest.mark.parametrize(("text", "words"), TEXTS, ids=range(len(TEXTS)))
def test_a_text_that_is_no_scene_is_refused(tmp_path, capsys, text, words):
    """At once, also where reading would take minutes and all memory."""
    path = tmp_path / "scene.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    code = main(["predict", str(path)])
    assert_refused(
        code, *capsys.readouterr(), "INVALID_REQUEST|NO_OBJECTS|INVALID_MASS|INVALID_HORIZON", words
    )


def test_no_such_file_and_a_folder(tmp_path, capsys):
    for path in (tmp_path / "nothing.yaml", tmp_path, tmp_path / ("x" * 300), "a\0b"):
        code = main(["predict", str(path)])
        assert_refused(code, *capsys.readouterr(), "INVALID_REQUEST", "scene file")


# -- model files -----------------------------------------------------------------------------------

GOOD = {
    "centers": np.array([[0.0, 0, 0.1], [0, 0, -0.1]]),
    "radii": np.array([0.2, 0.2]),
    "inertia": np.diag([2.0, 2.0, 1.0]),
}


def npz(**changes):
    stream = io.BytesIO()
    np.savez(stream, **{key: value for key, value in (GOOD | changes).items() if value is not None})
    return stream.getvalue()


def with_byte(value, offsets):
    """A good archive, with a byte of the headers of all entries changed."""
    data = bytearray(npz())
    for signature, offset in zip((b"PK\x03\x04", b"PK\x01\x02"), offsets, strict=True):
        for found in re.finditer(re.escape(signature), npz()):
            data[found.start() + offset] = value
    return bytes(data)


def with_header(start):
    """Arrays of a header, and of no numbers."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name in ("centers.npy", "radii.npy"):
            archive.writestr(name, npy(start))
    return stream.getvalue()


def npy(start):
    """What a file of an array begins with."""
    return b"\x93NUMPY\x01\x00" + (118).to_bytes(2, "little") + start.ljust(117) + b"\n"


FLOATS = b"{'descr': '<f8', 'fortran_order': False, "
#: Those whose arrays make no model are in test/shapes/test_packing_file.py.
MODELS = {
    "empty": b"",
    "text": b"spheres",
    "cut_off": npz()[:-200],
    "single_array": npy(FLOATS + b"'shape': (3,), }") + bytes(24),
    "objects": npz(centers=np.array([None])),
    "unfinished_header": with_header(FLOATS + b"'shape': (2, 3), (((("),
    "unfinished_text": with_header(b'"""{'),
    "name_of_numbers": npz(name=np.arange(3.0)),
    "encrypted": with_byte(1, (6, 8)),
    "odd_compression": with_byte(97, (8, 10)),
    "huge_header": with_header(FLOATS + b"'shape': (100000000000, 3), }"),
    "negative_radius": npz(radii=np.array([-0.2, 0.1])),
    "complex": npz(radii=np.array([0.2, 0.1j])),
}


@pytest.mark.parametrize("name", MODELS)
def test_bad_model_file(tmp_path, capsys, name):
    (tmp_path / "broken.npz").write_bytes(MODELS[name])
    content = with_body(model="broken.npz", spheres=None)
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(content))
    code = main(["predict", str(tmp_path / "scene.yaml")])
    assert_refused(code, *capsys.readouterr(), "INVALID_MODEL", r"scene.yaml: bodies\[right\].*broken.npz")


def test_a_zip_bomb_is_refused_before_it_is_unpacked(tmp_path, capsys):
    path = tmp_path / "bomb.npz"
    size = 2_000_000_000
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("centers.npy", "w") as entry,
    ):
        entry.write(npy(FLOATS + b"'shape': (250000000,), }"))
        for _ in range(8):
            entry.write(bytes(1 << 22))
    data = path.read_bytes()  # its directory may say anything
    told = zipfile.ZipFile(path).infolist()[0].file_size
    path.write_bytes(data.replace(told.to_bytes(4, "little"), size.to_bytes(4, "little")))
    assert main(["show", str(path), "-o", str(tmp_path / "x.png")]) == ErrorCode.LIMIT_EXCEEDED
    (line,) = capsys.readouterr().err.splitlines()
    assert "bytes must be at most 240010000, and centers is larger" in line and str(size) in line


def test_the_good_model_of_these_tests_is_good(tmp_path, capsys):
    (tmp_path / "good.npz").write_bytes(npz())
    content = with_body(model="good.npz", spheres=None)
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(content))
    assert main(["predict", str(tmp_path / "scene.yaml"), "--horizon", "0.01"]) == 0
    assert "right" in capsys.readouterr().out


# -- the command's own options ---------------------------------------------------------------------


@pytest.mark.parametrize(
    "options, codes, words",
    [
        ("--propagator kalman", "UNKNOWN_PROPAGATOR", "propagator.*kalman"),
        ("--option points=many", "INVALID_OPTION", "points.*many"),
        ("--option colour=red", "INVALID_OPTION", "colour.*red"),
        ("--option name=x", "INVALID_OPTION", "name is no option of auto; its options are"),
        (
            "--option points=full --option points=minimal",
            "INVALID_OPTION",
            "--option is given twice.*'points'",
        ),
        ("--propagator monte_carlo --samples 0", "INVALID_OPTION", "samples.*0"),
        ("--propagator cloud --samples 5 --option samples=7", "INVALID_OPTION", "samples is given twice"),
        ("--propagator monte_carlo --seed 5 --option seed=7", "INVALID_OPTION", "seed is given twice"),
        ("--propagator monte_carlo --samples 1000000000000", "LIMIT_EXCEEDED", "samples.*1000000000000"),
        (
            "--propagator sigma_points --samples 5",
            "INVALID_OPTION",
            "--samples is for a propagator that draws",
        ),
        ("--propagator monte_carlo --seed -1", "INVALID_OPTION", "seed.*-1"),
        ("--samples-out 10000000000", "LIMIT_EXCEEDED", "--samples-out must be less: what is shown of them"),
        ("--samples-out 0", "INVALID_REQUEST", "--samples-out must be at least 1"),
        (
            "--propagator monte_carlo --samples 4 --samples-out 9",
            "LIMIT_EXCEEDED",
            "--samples-out .* 4 samples",
        ),
        ("--status-rollouts 1", "INVALID_OPTION", "--status-rollouts must be 0, or at least 2 .got 1"),
        ("--propagator surrogate --status-rollouts 1000000000", "LIMIT_EXCEEDED", "must be at most 10000000"),
        ("--horizon 0", "INVALID_HORIZON", "horizon.*0"),
        ("--horizon nan", "NOT_FINITE", "horizon.*nan"),
        ("--horizon soon", "INVALID_HORIZON", "horizon.*soon"),
        ("--horizon 1e15", "LIMIT_EXCEEDED", "horizon.*1000000000000000"),
        ("--horizon 0.012", "INVALID_HORIZON", "horizon is no multiple of dt = 0.01 s, and the explicit"),
        ("--period 0", "INVALID_HORIZON", "period.*0"),
        ("--period 0.0034", "INVALID_HORIZON", "period is no multiple of dt = 0.01 s, and the explicit"),
        ("--period 1e-9", "LIMIT_EXCEEDED|INVALID_HORIZON", "period|times"),
        ("--models /no/such/folder", "UNKNOWN_MODEL", "cannot be looked up: /no/such/folder is no folder"),
    ],
)
def test_bad_options(tmp_path, capsys, options, codes, words):
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(CONTENTS["two_bodies"]() | {"horizon": 0.02}))
    code = main(["predict", str(path), "--json", *shlex.split(options)])
    assert_refused(code, *capsys.readouterr(), codes, words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("predict", ""),
        ("predict a.yaml --samples x", ""),
        ("predict a.yaml --option points", ""),
        ("fly", ""),
        ("", ""),
        ("show pin --levels 5", "was removed in version 0.3: "),
        ("show pin --levels=5", "was removed in version 0.3: "),
    ],
)
def test_what_argparse_refuses(capsys, arguments, words):
    with pytest.raises(SystemExit) as caught:
        main(arguments.split())
    out, err = capsys.readouterr()
    assert (caught.value.code, out) == (2, "")
    assert len(err.splitlines()) == 1 and err.startswith("unc_physics") and words in err


def test_a_scene_file_without_an_end(capsys):
    assert main(["predict", "/dev/zero"]) == ErrorCode.LIMIT_EXCEEDED
    assert "must have at most 20000000 characters" in capsys.readouterr().err


def test_anchors_and_texts_that_look_like_times_are_fine(tmp_path):
    content = yaml.safe_dump(CONTENTS["two_bodies"]())
    path = tmp_path / "scene.yaml"
    path.write_text(content.replace("name: left", "name: '12:30'").replace("damping: 0.5", "damping: &d 0.5"))
    assert load_scene(path).scene.bodies[0].name == "12:30"


@pytest.mark.parametrize("text, value", [("1e-2", 0.01), ("2E3", 2000.0), (".5e+1", 5.0), ("'1e-2'", None)])
def test_numbers_of_json_are_numbers_and_texts_in_quotes_are_none(tmp_path, text, value):
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(CONTENTS["two_bodies"]()).replace("damping: 0.5", f"damping: {text}"))
    if value is None:
        with pytest.raises(UncPhysicsError, match=f"damping must be a number, not a text .got {text}"):
            load_scene(path)
    else:
        assert load_scene(path).scene.damping == value


def test_a_real_process_exits_with_the_code(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(with_body(position_std=1e200)))
    run = subprocess.run(
        [sys.executable, "-m", "unc_physics", "predict", str(path), "--json"],
        env=dict(os.environ),
        capture_output=True,
        text=True,
        check=False,
    )
    assert_refused(run.returncode, run.stdout, run.stderr, "NOT_FINITE", "position_std")


# -- anything at all -------------------------------------------------------------------------------


@settings(max_examples=examples(200), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.one_of(
        st.binary(max_size=200), st.text(max_size=200).map(lambda t: t.encode("utf-8", "surrogatepass"))
    )
)
def test_any_bytes_load_or_are_refused(tmp_path, content):
    path = tmp_path / "scene.yaml"
    path.write_bytes(content)
    with pytest.raises(UncPhysicsError):
        load_scene(path)


@settings(max_examples=examples(200), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 2**32 - 1))
def test_a_damaged_model_file_loads_or_is_refused(tmp_path, seed):
    """Some bytes of a good file changed, or its end cut off."""
    rng = np.random.default_rng(seed)
    data = bytearray(npz())
    for _ in range(rng.integers(1, 20)):
        data[rng.integers(len(data))] = rng.integers(256)
    if rng.random() < 0.3:
        del data[rng.integers(len(data)) :]
    path = tmp_path / "damaged.npz"
    path.write_bytes(data)
    try:
        model = load_model(path)
    except UncPhysicsError:
        return
    assert np.isfinite(model.centers).all() and (model.radii > 0).all()
