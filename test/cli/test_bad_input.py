"""Bad input: its own exit status, one sentence that names field and value, and nothing else."""

import io
import json
import os
import re
import shlex
import subprocess
import sys
import time
import zipfile

import numpy as np
import pytest
import yaml
from example_scenes import CONTENTS, examples
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from unc_physics import ErrorCode, UncPhysicsError, load_model, load_scene, predict
from unc_physics.__main__ import main
from unc_physics.cli.schema_command import schema_text
from unc_physics.scene.scene_file import scene_from_dict

NAN, INF = float("nan"), float("inf")
FLOOR = {"plane": {"normal": [0, 0, 1]}}


def with_entry(place, value, name="two_bodies"):
    """The content of a scene file with one entry changed; ``place`` is a path like ("bodies", 0, "mass")."""
    content = inner = CONTENTS[name]()
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    return content


def without(place):
    content = inner = CONTENTS["two_bodies"]()
    for key in place[:-1]:
        inner = inner[key]
    del inner[place[-1]]
    return content


def matrix(*entries, diagonal=0.01):
    """12 x 12 rows with some entries (row, column, value)."""
    P = (diagonal * np.eye(12)).tolist()
    for row, column, value in entries:
        P[row][column] = value
    return P


def body_with_covariance(P):
    content = CONTENTS["two_bodies"]()
    body = content["bodies"][1]
    del body["position_std"], body["orientation_std"]
    body["covariance"] = P
    return content


def in_body(key, value):
    return with_entry(("bodies", 1, key), value)


def in_environment(element):
    return CONTENTS["two_bodies"]() | {"environment": [element]}


def at_rest(gravity=(0, 0, -9.81), **entries):
    """A scene whose second body is at rest."""
    content = CONTENTS["everyday"]() | {"gravity": gravity and list(gravity)}
    content["bodies"][1] |= {"at_rest": True, "linear_velocity": [0, 0, 0]} | entries
    return content


def moving_at_rest(key, value, words):
    return at_rest(**{key: value}), "INVALID_REQUEST", f"{key} of body 'right'", f"at_rest.*{words}"


def common_error(**entries):
    shared = {"common_pose_std": [0.01] * 6, "common_pose_origin": [0, 0, 1]}
    return CONTENTS["two_bodies"]() | shared | entries


# rows of CASES: a content, the name of the error's code, a pattern of the field and one of the value


def entry(key, value, code, words):
    return with_entry((key,), value), code, key, words


def body(key, value, code, words):
    return in_body(key, value), code, rf"bodies\[1\].{key}", words


def fixed_body(key, value, words="zero or absent: the body is fixed"):
    place = ("bodies", 1, key)
    return with_entry(place, value, "three_bodies"), "INVALID_REQUEST", rf"bodies\[1\].{key}", words


def covariance(P, code, words, place=""):
    return body_with_covariance(P), code, rf"bodies\[1\].covariance{place}", words


def element(kind, entries, place, code, words):
    return in_environment({kind: entries}), code, rf"environment\[0\].{kind}{place}", words


def rounded(kind, key, value, code="INVALID_ENVIRONMENT", place=None, words=""):
    good = {"radius": 0.1} | ({} if kind == "sphere" else {"length": 0.2})
    return element(kind, good | {key: value}, f".{key}" if place is None else place, code, words)


FINITE = []  # each number of a scene file, as the place that a message must name
for place, name in [
    (("dt",), "dt"),
    (("horizon",), "horizon"),
    (("stiffness",), "stiffness"),
    (("damping",), "damping"),
    (("friction",), "friction"),
    (("restitution",), "restitution"),
    (("stiffness_std",), "stiffness_std"),
    (("gravity_direction_std",), "gravity_direction_std"),
    (("bodies", 0, "mass_std"), r"bodies\[0\].mass_std"),
    (("bodies", 0, "center_of_mass_std"), r"bodies\[0\].center_of_mass_std"),
    (("bodies", 0, "mass"), r"bodies\[0\].mass"),
    (("bodies", 0, "scale"), r"bodies\[0\].scale"),
    (("bodies", 0, "position", 1), r"bodies\[0\].position\[1\]"),
    (("bodies", 1, "orientation", 3), r"bodies\[1\].orientation\[3\]"),
    (("bodies", 0, "linear_velocity", 2), r"bodies\[0\].linear_velocity\[2\]"),
    (("bodies", 0, "angular_velocity", 0), r"bodies\[0\].angular_velocity\[0\]"),
    (("bodies", 0, "position_std"), r"bodies\[0\].position_std"),
    (("bodies", 1, "position_std", 2), r"bodies\[1\].position_std\[2\]"),
    (("bodies", 1, "orientation_std"), r"bodies\[1\].orientation_std"),
]:
    for value in (NAN, INF, -INF, "nan", "Infinity"):
        FINITE.append((with_entry(place, value), "NOT_FINITE", name, "nan|inf|Infinity"))
for value in (NAN, INF):
    FINITE.append((with_entry(("gravity",), [0, 0, value]), "NOT_FINITE", r"gravity\[2\]", "nan|inf"))
    FINITE.append(covariance(matrix((4, 7, value)), "NOT_FINITE", "nan|inf", r"\[4\]\[7\]"))
    FINITE.append(
        (in_body("angular_velocity_std", [0, value, 0]), "NOT_FINITE", "angular_velocity_std", "nan|inf")
    )

CASES = FINITE + [
    body("model", "unicorn", "UNKNOWN_MODEL", "unicorn"),
    body("model", "salt_bx", "UNKNOWN_MODEL", "did you mean 'salt_box'.*salt_bx"),
    body("model", "no/such/file.npz", "UNKNOWN_MODEL", "no/such/file.npz"),
    body("model", "", "INVALID_REQUEST", "''"),
    body("model", 7, "INVALID_REQUEST", "7"),
    body("model", "x" * 5000, "UNKNOWN_MODEL", "xxx"),
    body("model", "x" * 5000 + ".npz", "UNKNOWN_MODEL", "xxx"),
    body("model", "~nobody_of_that_name/a.npz", "UNKNOWN_MODEL", "nobody"),
    body("model", "a\0b.npz", "UNKNOWN_MODEL", "b.npz"),
    entry("bodies", [], "NO_OBJECTS", ""),
    entry("bodies", None, "NO_OBJECTS", ""),
    (without(("bodies",)), "NO_OBJECTS", "bodies", ""),
    body("name", "left", "DUPLICATE_ID", "left"),
    body("orientation", [0, 0, 0, 0], "INVALID_ORIENTATION", r"\[0.0, 0.0, 0.0, 0.0\]"),
    body("orientation", [0, 0, 0, 1.01], "INVALID_ORIENTATION", "1.01"),
    body("orientation", [0, 0, 1], "INVALID_REQUEST", r"\[0, 0, 1\]"),
    covariance(matrix((2, 5, 0.001)), "INVALID_COVARIANCE", "0.001", r".*\[2\]\[5\]"),
    covariance(matrix((3, 3, -0.01)), "INVALID_COVARIANCE", "-0.01", r".*\[3\]"),
    covariance(matrix((0, 1, 0.02), (1, 0, 0.02)), "INVALID_COVARIANCE", "-0.01"),
    covariance(matrix()[:11], "INVALID_REQUEST", "0.01"),
    covariance(matrix((0, 0, "x")), "INVALID_REQUEST", "'x'", r"\[0\]\[0\]"),
    covariance(0.1, "INVALID_REQUEST", "0.1"),
    body("covariance", matrix(), "INVALID_REQUEST", "position_std"),
    body("position_std", -0.1, "INVALID_REQUEST", "-0.1"),
    body("position_std", [0.1, -0.2, 0.1], "INVALID_REQUEST", "-0.2"),
    body("position_std", [0.1, 0.1], "INVALID_REQUEST", r"\[0.1, 0.1\]"),
    body("position_std", "wide", "INVALID_REQUEST", "wide"),
    body("position_std", 1e200, "NOT_FINITE", "1e\\+200"),
    entry("horizon", 0, "INVALID_HORIZON", "0"),
    entry("horizon", -1.0, "INVALID_HORIZON", "-1.0"),
    entry("horizon", 0.001, "INVALID_HORIZON", "0.001"),
    entry("horizon", "long", "INVALID_HORIZON", "long"),
    (without(("horizon",)), "INVALID_HORIZON", "horizon", "must be given.*'horizon: 1.0'.*--horizon"),
    entry("horizon", 1e12, "LIMIT_EXCEEDED", "1000000000000.0|1e\\+12"),
    entry("dt", 0, "INVALID_HORIZON", "0"),
    entry("dt", -0.01, "INVALID_HORIZON", "-0.01"),
    entry("stiffness", -1, "INVALID_REQUEST", "-1"),
    entry("stiffness", True, "INVALID_REQUEST", "True"),
    entry("damping", -0.5, "INVALID_REQUEST", "-0.5"),
    entry("damping", [0.5], "INVALID_REQUEST", r"\[0.5\]"),
    entry("gravity", 9.81, "INVALID_REQUEST", "9.81"),
    (with_entry(("gravity",), [0, 0, "down"]), "INVALID_REQUEST", r"gravity\[2\]", "down"),
    entry("gravity", [0, 0, -1e20], "LIMIT_EXCEEDED", "at most 1000000 m/s"),
    body("mass", 1e-320, "INVALID_MASS", "between 1e-50 and 1e\\+50 kg.*1e-320"),
    body("position", [1e13, 0, 0], "LIMIT_EXCEEDED", "1e\\+12 m.*1000000"),
    element("box", {"size": [1e13, 1, 1]}, r".size\[0\]", "LIMIT_EXCEEDED", "1e\\+12 m"),
    body("model", "/etc/passwd", "UNKNOWN_MODEL", ".npz.*/etc/passwd"),
    body("mass", 0, "INVALID_MASS", "0"),
    body("mass", -2.0, "INVALID_MASS", "-2.0"),
    body("mass", "heavy", "INVALID_MASS", "heavy"),
    body("spheres", 0, "INVALID_MODEL", "0"),
    body("spheres", 2.5, "INVALID_MODEL", "2.5"),
    body("spheres", 10**9, "INVALID_MODEL", "1000000000"),
    body("scale", 0, "INVALID_MODEL", "0"),
    body("scale", -1, "INVALID_MODEL", "-1"),
    body("fixed", "yes", "INVALID_REQUEST", "yes"),
    body("fixed", None, "INVALID_REQUEST", ""),
    fixed_body("linear_velocity", [0, 0, 1]),
    fixed_body("angular_velocity", [0, 1, 0]),
    fixed_body("position_std", 0.1),
    fixed_body("covariance", matrix()),
    body("name", "", "INVALID_REQUEST", "''"),
    body("name", 5, "INVALID_REQUEST", "5"),
    (without(("bodies", 1, "name")), "INVALID_REQUEST", r"bodies\[1\].name", ""),
    (in_body("masss", 1.0), "INVALID_REQUEST", r"bodies\[1\]", "masss.*mass"),
    (with_entry(("stifness",), 1.0), "INVALID_REQUEST", "scene", "stifness.*stiffness"),
    (with_entry((3,), 1.0), "INVALID_REQUEST", "scene", "3"),
    entry("bodies", {"name": "a"}, "INVALID_REQUEST", "'name': 'a'"),
    entry("bodies", "left", "INVALID_REQUEST", "'left'"),
    (with_entry(("bodies", 1), None), "INVALID_REQUEST", r"bodies\[1\]", ""),
    (with_entry(("bodies", 1), ["name"]), "INVALID_REQUEST", r"bodies\[1\]", r"\['name'\]"),
    entry("integrator", "magic", "INVALID_OPTION", "magic"),
    entry("islands", True, "INVALID_REQUEST", "'islands', which was removed in version 0.3: leave it out"),
    entry("environment", "floor", "INVALID_ENVIRONMENT", "floor"),
    entry("friction", "rough", "INVALID_REQUEST", "rough"),
    entry("friction", -0.5, "INVALID_REQUEST", "-0.5"),
    entry("friction", False, "INVALID_REQUEST", "False"),
    entry("restitution", 1.5, "INVALID_REQUEST", "1.5"),
    entry("restitution", -0.1, "INVALID_REQUEST", "-0.1"),
    entry("gyroscopic", "yes", "INVALID_REQUEST", "yes"),
    entry("gyroscopic", 1, "INVALID_REQUEST", "1"),
    entry("integrator", ["explicit"], "INVALID_OPTION", "explicit"),
    entry("integrator", "robust", "INVALID_OPTION", "'implicit' .*robust"),
    entry("sleep", 1, "INVALID_REQUEST", "1"),
    entry("physics", "lunar", "INVALID_OPTION", "paper, everyday.*lunar"),
    entry("physics", "everday", "INVALID_OPTION", "did you mean 'everyday'.*everday"),
    entry("friction", "0.4", "INVALID_REQUEST", "not a text.*'0.4'"),
    body("restitution", "0.4", "INVALID_REQUEST", "not a text.*'0.4'"),
    (in_body("mu", 0.4), "INVALID_REQUEST", r"bodies\[1\]", "mu.*did you mean 'friction'"),
    entry("physics", True, "INVALID_OPTION", "True"),
    entry("stiffness", "automatic", "INVALID_REQUEST", "automatic"),
    entry("friction_std", 0.1, "INVALID_REQUEST", "0.1"),
    entry("gravity_direction_std", 0.1, "INVALID_REQUEST", "0.1"),
    entry("gravity_direction_std", 7.0, "INVALID_REQUEST", "7.0"),
    entry("stiffness_std", -1.0, "INVALID_REQUEST", "-1.0"),
    entry("restitution_std", "some", "INVALID_REQUEST", "some"),
    body("mass_std", -0.1, "INVALID_REQUEST", "-0.1"),
    body("mass_std", 5.0, "INVALID_MASS", "5.0"),
    body("mass_std", "some", "INVALID_REQUEST", "some"),
    body("center_of_mass_std", [0, 0, -1], "INVALID_REQUEST", "-1.0"),
    body("center_of_mass_std", [0, 0], "INVALID_REQUEST", r"\[0, 0\]"),
    fixed_body("mass_std", 0.1),
    entry("overlap", "push", "INVALID_OPTION", "project, reject, keep.*push"),
    entry("overlap", None, "INVALID_OPTION", "reject, keep; leave it out.*null"),
    entry("overlap", True, "INVALID_OPTION", "True"),
    entry("overlap", "project", "INVALID_OPTION", "'integrator: implicit'.*keep.*project"),
    entry("overlap", "reject", "INVALID_OPTION", "implicit.*reject"),
    body("at_rest", "yes", "INVALID_REQUEST", "yes"),
    body("at_rest", 1, "INVALID_REQUEST", "1"),
    body("at_rest", True, "INVALID_OPTION", "implicit.*True"),
    fixed_body("at_rest", True, "fixed"),
    (at_rest(gravity=None), "INVALID_REQUEST", r"bodies\[1\].at_rest", "gravity"),
    moving_at_rest("linear_velocity", [0, 0, 0.1], "0.1"),
    moving_at_rest("angular_velocity", [0.2, 0, 0], "0.2"),
    entry("common_pose_std", 0.01, "INVALID_REQUEST", "6 numbers.*0.01"),
    entry("common_pose_std", [0.01] * 3, "INVALID_REQUEST", "6 numbers"),
    (with_entry(("common_pose_std",), [0] * 5 + ["far"]), "INVALID_REQUEST", r"common_pose_std\[5\]", "far"),
    (common_error(common_pose_std=[0] * 5 + [-0.1]), "INVALID_COVARIANCE", r"common_pose_std\[5\]", "-0.1"),
    (with_entry(("common_pose_std",), [0] * 5 + [NAN]), "NOT_FINITE", r"common_pose_std\[5\]", "nan"),
    entry("common_pose_std", [1e200] * 6, "NOT_FINITE", "1e\\+200"),
    (common_error(common_pose_origin=[0, 0]), "INVALID_REQUEST", "common_pose_origin", r"\[0, 0\]"),
    (common_error(common_pose_origin=[0, 0, INF]), "NOT_FINITE", r"common_pose_origin\[2\]", "inf"),
    (
        common_error(common_pose_std=None),
        "INVALID_REQUEST",
        "common_pose_origin",
        r"common_pose_std.*\[0, 0, 1\]",
    ),
    (in_environment("floor"), "INVALID_ENVIRONMENT", r"environment\[0\]", "floor"),
    (in_environment({}), "INVALID_ENVIRONMENT", r"environment\[0\]", "shapes are plane, box, sphere"),
    (in_environment({"plane": {}, "box": {}}), "INVALID_ENVIRONMENT", r"environment\[0\]", "exactly one"),
    (
        in_environment({"cone": {}}),
        "INVALID_ENVIRONMENT",
        r"environment\[0\]",
        "no shape 'cone'; the shapes are",
    ),
    (in_environment({"plane": [0, 0, 1]}), "INVALID_ENVIRONMENT", r"environment\[0\].plane", r"\[0, 0, 1\]"),
    element("plane", {"normal": [0, 0, 0]}, r".normal", "INVALID_ENVIRONMENT", r"\[0.0, 0.0, 0.0\]"),
    element("plane", {"normal": [0, 1]}, r".normal", "INVALID_ENVIRONMENT", r"\[0, 1\]"),
    element("plane", {"normal": [0, 0, "up"]}, r".normal\[2\]", "INVALID_ENVIRONMENT", "up"),
    element("plane", {"normal": [0, 0, INF]}, r".normal\[2\]", "NOT_FINITE", "inf"),
    element("plane", {"normal": [0, 0, 1], "offset": "low"}, r".offset", "INVALID_ENVIRONMENT", "low"),
    element("plane", {"normal": [0, 0, 1], "offset": NAN}, r".offset", "NOT_FINITE", "nan"),
    element("plane", {"normal": [0, 0, 1], "ofset": 0}, r"", "INVALID_ENVIRONMENT", "offset"),
    element("box", {}, r".size", "INVALID_ENVIRONMENT", "given"),
    element("box", {"size": [1, 0, 1]}, r".size\[1\]", "INVALID_ENVIRONMENT", "0.0"),
    element("box", {"size": [1, -2, 1]}, r".size\[1\]", "INVALID_ENVIRONMENT", "-2.0"),
    element("box", {"size": 2.0}, r".size", "INVALID_ENVIRONMENT", "2.0"),
    element("box", {"size": [1, 1, 1], "position": [0, 0]}, r".position", "INVALID_ENVIRONMENT", r"\[0, 0\]"),
    element("box", {"size": [1, 1, 1], "position": [0, NAN, 0]}, r".position\[1\]", "NOT_FINITE", "nan"),
    element(
        "box", {"size": [1, 1, 1], "orientation": [1, 1, 0, 0]}, r".orientation", "INVALID_ORIENTATION", "1.0"
    ),
    element("sphere", {}, ".radius", "INVALID_ENVIRONMENT", "given"),
    element("cylinder", {"radius": 1}, ".length", "INVALID_ENVIRONMENT", "given"),
    element("capsule", {"length": 1}, ".radius", "INVALID_ENVIRONMENT", "given"),
    rounded("sphere", "orientation", [0, 0, 0, 1], place="", words="orientation"),
    *(
        case
        for kind in ("sphere", "cylinder", "capsule")
        for case in (
            rounded(kind, "radius", 0, words="0.0"),
            rounded(kind, "radius", [1], words=r"\[1\]"),
            rounded(kind, "radius", NAN, "NOT_FINITE", words="nan"),
            rounded(kind, "position", [0, 0], words=r"\[0, 0\]"),
            rounded(kind, "size", [1, 1, 1], place="", words="size"),
        )
    ),
    *(
        case
        for kind in ("cylinder", "capsule")
        for case in (
            rounded(kind, "length", -1, words="-1.0"),
            rounded(kind, "length", "long", words="long"),
            rounded(kind, "orientation", [1, 1, 0, 0], "INVALID_ORIENTATION", words="1.0"),
        )
    ),
    (in_environment(FLOOR | {"name": 3}), "INVALID_ENVIRONMENT", r"environment\[0\].name", "3"),
    (in_environment(FLOOR | {"name": "left"}), "DUPLICATE_ID", r"environment\[0\].name", "left"),
    ([], "INVALID_REQUEST", "scene", r"\[\]"),
    ("text", "INVALID_REQUEST", "scene", "text"),
    (None, "INVALID_REQUEST", "scene", ""),
]


def assert_refused(code, out, err, codes, *patterns):
    """Exit status, nothing on standard output, and one line on standard error with the patterns in it."""
    assert ErrorCode(code).name in codes.split("|"), err
    assert out == ""
    assert err.count("\n") == 1 and err.endswith("\n"), err
    assert err.startswith("unc_physics: ") and len(err) < 2000, err
    assert "Traceback" not in err
    for pattern in patterns:
        assert re.search(pattern, err), err


def case_id(case):
    return f"{case[1]}-{case[2]}"


@pytest.mark.parametrize("content, codes, field, value", CASES, ids=map(case_id, CASES))
def test_a_bad_scene_is_refused(tmp_path, recwarn, content, codes, field, value):
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(UncPhysicsError) as caught:
        scene, belief, horizon = load_scene(path)
        predict(scene, belief, horizon=horizon)
    assert_refused(caught.value.code, "", f"unc_physics: {caught.value}\n", codes, field, value)
    assert not recwarn.list, "a warning would be printed beside the sentence"


@pytest.mark.parametrize("content, codes, field, value", CASES[::20], ids=map(case_id, CASES[::20]))
def test_the_command_says_so_and_ends_with_the_code(tmp_path, capsys, content, codes, field, value):
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(content))
    code = main(["predict", str(path), "--json"])
    assert_refused(code, *capsys.readouterr(), codes, field, value)


TEXTS = {
    "binary": bytes(range(256)),
    "zip": b"PK\x03\x04" + bytes(100),
    "utf16": "dt: 0.01".encode("utf-16"),
    "control": b"dt: \x01\n",
    "python_tag": b"!!python/object/apply:os.system ['true']",
    "unhashable_key": b"{[1, 2]: 3}",
    "recursive_key": b"&a {bodies: *a}",
    "empty": b"",
    "huge_hex_integer": b"bodies: [{name: a, model: pin, mass: 0x" + b"f" * 6000 + b"}]",
    "huge_key": b"? " + b"k" * 5000 + b"\n: 1\n",
    "newline_in_key": b'"a\\nb": 1\nbodies: []\n',
    "bytes_value": b"bodies: [{name: a, model: pin, mass: !!binary aGVsbG8=}]",
    "set_value": b"bodies: !!set {a, b}",
    "date_value": b"bodies: [{name: a, model: pin, mass: 2001-01-01}]",
}


@pytest.mark.parametrize("name", TEXTS)
def test_bad_text(tmp_path, capsys, name):
    path = tmp_path / "scene.yaml"
    path.write_bytes(TEXTS[name])
    code = main(["predict", str(path)])
    assert_refused(code, *capsys.readouterr(), "INVALID_REQUEST|NO_OBJECTS|INVALID_MASS|INVALID_HORIZON")


def test_a_repeated_key_is_found_by_its_line(tmp_path, capsys):
    path = tmp_path / "scene.yaml"
    path.write_text("dt: 0.01\nhorizon: 1.0\nbodies:\n  - name: a\n    mass: 1\n    name: b\n")
    code = main(["predict", str(path)])
    words = "in line 6: the key 'name' is given twice, first in line 4"
    assert_refused(code, *capsys.readouterr(), "INVALID_REQUEST", words)


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
#: Those whose arrays make no model are in test/geometry/test_packing_file.py.
MODELS = {
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
    content = in_body("model", "broken.npz")
    del content["bodies"][1]["spheres"]
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(content))
    code = main(["predict", str(tmp_path / "scene.yaml")])
    assert_refused(code, *capsys.readouterr(), "INVALID_MODEL", r"bodies\[1\].*broken.npz")


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
    content = in_body("model", "good.npz")
    del content["bodies"][1]["spheres"]
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(content))
    assert main(["predict", str(tmp_path / "scene.yaml"), "--horizon", "0.01"]) == 0
    assert "right" in capsys.readouterr().out


# -- the command's own options ---------------------------------------------------------------------


@pytest.mark.parametrize(
    "options, codes, words",
    [
        ("--propagator kalman", "UNKNOWN_PROPAGATOR", "propagator.*kalman"),
        ("--propagator ''", "UNKNOWN_PROPAGATOR", "propagator"),
        ("--option points=many", "INVALID_OPTION", "points.*many"),
        ("--option colour=red", "INVALID_OPTION", "colour.*red"),
        ("--option name=x", "INVALID_OPTION", "name is no option of auto; its options are"),
        (
            "--option points=full --option points=minimal",
            "INVALID_OPTION",
            "--option is given twice.*'points'",
        ),
        ("--propagator monte_carlo --samples 0", "INVALID_OPTION", "samples.*0"),
        ("--propagator monte_carlo --samples -3", "INVALID_OPTION", "samples.*-3"),
        ("--propagator monte_carlo --option samples=many", "INVALID_OPTION", "samples.*many"),
        (
            "--propagator monte_carlo --samples 5 --option samples=7",
            "INVALID_OPTION",
            "samples is given twice",
        ),
        ("--propagator monte_carlo --seed 5 --option seed=7", "INVALID_OPTION", "seed is given twice"),
        ("--propagator monte_carlo --samples 1000000000000", "LIMIT_EXCEEDED", "samples.*1000000000000"),
        (
            "--propagator sigma_points --samples 5",
            "INVALID_OPTION",
            "--samples is for a propagator that draws samples, .*monte_carlo.*; sigma_points draws none",
        ),
        ("--propagator monte_carlo --seed -1", "INVALID_OPTION", "seed.*-1"),
        ("--propagator surrogate --option k_sigma=wide", "INVALID_OPTION", "k_sigma.*wide"),
        ("--samples-out 10000000000", "LIMIT_EXCEEDED", "--samples-out must be less: what is shown of them"),
        ("--status-rollouts 1", "INVALID_OPTION", "--status-rollouts must be 0, or at least 2 .got 1"),
        ("--propagator surrogate --status-rollouts 1000000000", "LIMIT_EXCEEDED", "must be at most 10000000"),
        ("--horizon 0", "INVALID_HORIZON", "horizon.*0"),
        ("--horizon -1", "INVALID_HORIZON", "horizon.*-1"),
        ("--horizon nan", "NOT_FINITE", "horizon.*nan"),
        ("--horizon soon", "INVALID_HORIZON", "horizon.*soon"),
        ("--horizon 1e15", "LIMIT_EXCEEDED", "horizon.*1000000000000000"),
        ("--horizon 0.012", "INVALID_HORIZON", "horizon is no multiple of dt = 0.01 s, and the explicit"),
        ("--period 0", "INVALID_HORIZON", "period.*0"),
        ("--period often", "INVALID_HORIZON", "period.*often"),
        ("--period 0.0034", "INVALID_HORIZON", "period is no multiple of dt = 0.01 s, and the explicit"),
        ("--period 1e-9", "LIMIT_EXCEEDED|INVALID_HORIZON", "period|times"),
        (
            "--models /no/such/folder",
            "UNKNOWN_MODEL",
            "model cannot be looked up: /no/such/folder is no folder",
        ),
    ],
)
def test_bad_options(tmp_path, capsys, options, codes, words):
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(CONTENTS["two_bodies"]() | {"horizon": 0.02}))
    code = main(["predict", str(path), "--json", *shlex.split(options)])
    assert_refused(code, *capsys.readouterr(), codes, words)


def test_what_argparse_refuses(tmp_path, capsys):
    for arguments in (
        ["predict"],
        ["predict", "a.yaml", "--samples", "x"],
        ["predict", "a.yaml", "--option", "points"],
        ["fly"],
        [],
    ):
        with pytest.raises(SystemExit) as caught:
            main(arguments)
        assert caught.value.code == 2
        out, err = capsys.readouterr()
        assert out == "" and len(err.splitlines()) == 1 and err.startswith("unc_physics")


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


@pytest.mark.parametrize(
    "text, words",
    [
        (nested_aliases(), "line 6: it has more than 300000 entries, those of aliases counted"),
        (nested_merges(), "it has more than 300000 entries, those of aliases counted"),
        ("bodies: " + "[" * 100_000, "line 1: it is nested more than 50 levels deep"),
        ("bodies: " + "[" * 60 + "]" * 60, "line 1: it is nested more than 50 levels deep"),
        ("bodies:\n  - {name: a, model: pin, mass: 1:30}", "line 2: 1:30 is a number of base 60"),
        ("horizon: 1:30.5\nbodies: []", "line 1: 1:30.5 is a number of base 60"),
        ("horizon: 010\nbodies: []", "line 1: 010 is a number of base 8"),
        ("horizon: 2020-13-45", "line 1: '2020-13-45' has a value that cannot be read"),
        ("horizon: 9" + "9" * 5000, "line 1: '9999.* has a value that cannot be read"),
        ("horizon: 1\n---\nhorizon: 1", "expected a single document in the stream, but found another"),
        ("horizon: *a", "line 1: found undefined alias 'a'"),
        ("bodies: [" + "{}," * 300_000 + "]", "it has more than 300000 entries"),
        ("bodies: !!set [{a: 1}]", "line 1: expected a mapping node"),
        ("bodies: !!omap {a: 1}", "line 1: expected a sequence"),
        ("horizon: !!int [1]", "line 1: int has a value that cannot be read"),
        ("horizon: !!timestamp x", "line 1: 'x' has a value that cannot be read"),
        ("horizon: !!float ''", "line 1: '' has a value that cannot be read"),
        ("horizon: !!bool x", "line 1: 'x' has a value that cannot be read"),
        ("bodies: &a [*a]", "bodies|recursive|scene"),
    ],
    ids=lambda value: value[:20],
)
def test_a_bomb_is_refused_at_once(tmp_path, capsys, text, words):
    path = tmp_path / "bomb.yaml"
    path.write_text(text)
    started = time.process_time()
    code = main(["predict", str(path)])
    assert time.process_time() - started < 3.0  # without a limit, minutes and all memory
    assert code != 0
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(words, line), line


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: 1\nb: [1, 2\nc: 3\n", r"in line 3: .*the fault may stand above, where the \[ of line 2"),
        ("a: {b: 1\nc: 3\n", r"in line 2: .*where the \{ of line 1 is not closed"),
        ("a: 'b\nc: 1\n", r"where the quote of line 1 is not closed"),
        ("a:\n  - b\n - c\n", r"in line 3: .*where line 1 begins what goes on here"),
        ("a:\n\t- 1\n", r"in line 2: it has a tab; indent with spaces"),
        ("a: b: c\n", r"in line 1: there is a ':' where none can be$"),
    ],
)
def test_bad_yaml_is_told_with_what_is_not_closed(tmp_path, capsys, text, words):
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    assert main(["predict", str(path)]) == ErrorCode.INVALID_REQUEST
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(words, line), line


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


def test_a_simulation_that_diverges(tmp_path, capsys):
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(in_body("linear_velocity", [1e308, 0, 0])))
    code = main(["predict", str(path), "--json"])
    assert_refused(code, *capsys.readouterr(), "DIVERGED", "diverged")


def test_a_real_process_exits_with_the_code(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(in_body("position_std", 1e200)))
    run = subprocess.run(
        [sys.executable, "-m", "unc_physics", "predict", str(path), "--json"],
        env=dict(os.environ),
        capture_output=True,
        text=True,
        check=False,
    )
    assert_refused(run.returncode, run.stdout, run.stderr, "NOT_FINITE", "position_std")


# -- anything at all -------------------------------------------------------------------------------

scalars = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.integers(-(10**400), 10**400),
    st.floats(),
    st.text(max_size=8),
    st.dates(),
    st.binary(max_size=4),
    st.sampled_from(["bunny", "pin", "1e-3", "nan", "models/pin.npz", "/dev/null", "~x/a.npz", "\0.npz"]),
)
values = st.recursive(
    scalars,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(st.one_of(st.text(max_size=5), st.integers()), inner, max_size=4),
        st.lists(inner, min_size=3, max_size=3),
        st.lists(inner, min_size=4, max_size=4),
    ),
    max_leaves=12,
)

SCHEMA = json.loads(schema_text("scene"))
SCENE_KEYS = [*SCHEMA["properties"], "unknown"]
BODY_KEYS = [*SCHEMA["$defs"]["body"]["properties"], "x"]


@st.composite
def spoiled_scenes(draw):
    """A good scene with some entries replaced by anything."""
    content = CONTENTS[draw(st.sampled_from(["two_bodies", "three_bodies"]))]()
    for _ in range(draw(st.integers(1, 3))):
        value = draw(values)
        if draw(st.booleans()) or not isinstance(content["bodies"], list) or not content["bodies"]:
            content[draw(st.sampled_from(SCENE_KEYS))] = value
        else:
            body = content["bodies"][draw(st.integers(0, len(content["bodies"]) - 1))]
            if isinstance(body, dict):
                body[draw(st.sampled_from(BODY_KEYS))] = value
    return content


def load_or_refuse(content):
    try:
        scene, belief, horizon = scene_from_dict(content)
    except UncPhysicsError as error:
        assert str(error) and "\n" not in str(error)
        return
    assert np.isfinite(belief.mean).all() and np.isfinite(belief.covariance).all()
    assert scene.dt > 0 and (horizon is None or horizon > 0)
    np.testing.assert_allclose(np.linalg.norm(belief.mean[:, 6:10], axis=1), 1.0)
    assert belief.root().shape[0] == 12 * len(scene.moving)


@settings(max_examples=examples(400), suppress_health_check=[HealthCheck.too_slow])
@given(spoiled_scenes())
@example({"bodies": [{"name": "a", "model": "pin", "mass": 16**6000}]})
def test_a_spoiled_scene_loads_or_is_refused(content):
    load_or_refuse(content)


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


@pytest.mark.parametrize("options", ["show pin --levels 5", "show pin --levels=5"])
def test_an_option_of_an_earlier_version_is_refused(capsys, options):
    with pytest.raises(SystemExit) as ended:
        main(options.split())
    assert ended.value.code == 2 and "was removed in version 0.3: " in capsys.readouterr().err
