"""The interfaces agree with each other and with the library's error codes."""

import re

import pytest
from building import ROOT

from unc_physics.checks.errors import ErrorCode

action = pytest.importorskip("unc_physics_msgs.action", reason="unc_physics_msgs is not built")
msg = pytest.importorskip("unc_physics_msgs.msg")
srv = pytest.importorskip("unc_physics_msgs.srv")


def constants(interface):
    """Names and values of the constants of an interface's class."""
    names = (name for name in dir(type(interface)) if re.fullmatch(r"[A-Z][A-Z0-9_]*", name))
    return {name: getattr(interface, name) for name in names}


def test_a_result_knows_every_error_code():
    assert constants(msg.Result) == {code.name: int(code) for code in ErrorCode}


def test_error_codes_are_exit_statuses():
    assert all(code == ErrorCode.NONE or 2 < code < 126 for code in ErrorCode)


@pytest.mark.parametrize(
    "file",
    sorted(
        path.relative_to(ROOT)
        for kind in ("msg", "srv", "action")
        for path in (ROOT / "unc_physics_msgs").glob(f"{kind}/*")
    ),
    ids=lambda path: path.stem,
)
def test_interface_is_listed_and_explained(file):
    text = (ROOT / file).read_text()
    assert text.startswith("# ")
    listed = (ROOT / "unc_physics_msgs" / "CMakeLists.txt").read_text()
    assert f"{file.parent.name}/{file.name}\n" in listed
    for block in re.split(r"\n\n|\n---\n", text):
        numbers = re.findall(r"^float64(?:\[[\d<=]*\])? .*", block, re.MULTILINE)
        assert not numbers or "#" in block, f"{numbers}: no word on units"
