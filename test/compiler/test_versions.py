"""The choice between tuned and plain compilation, and agreement on the versions of numba."""

import re
from pathlib import Path

import pytest
from compiler_copies import CALL, CALLEE
from packaging.specifiers import SpecifierSet

from unc_physics.compiler import versions

ROOT = Path(__file__).resolve().parents[2]
BACKEND = """
import sys
print(sorted(name for name in sys.modules if name.startswith("unc_physics.compiler.tuned")))
"""


def test_the_variable_selects_plain_compilation_which_notices_an_edit_of_a_callee(copy):
    program = "import numba; before = numba.config.CACHE_DIR\n" + CALL + BACKEND
    program += "print(numba.config.CACHE_DIR == before)"
    out, err = copy(program, UNC_PHYSICS_COMPILER="plain").ended()
    assert out == "2.0 3.0\n[]\nTrue", "compiled, without the tuned modules and with numba's own setting"
    assert "not tested" not in err
    assert copy(UNC_PHYSICS_COMPILER="plain").ended() == ("2.0 3.0", ""), "loaded from the cache"
    callee = copy.package / "compiler" / "callee.py"
    callee.write_text(CALLEE.replace("FACTOR = 2.0", "FACTOR = 5.0").replace("+ 1.0", "+ 2.0"))
    assert copy(UNC_PHYSICS_COMPILER="plain").ended()[0] == "5.0 4.0"


def test_an_untested_numba_selects_plain_compilation_with_one_warning(copy):
    program = "import numba; numba.__version__ = '0.67.9'\n" + CALL + BACKEND
    out, err = copy(program, UNC_PHYSICS_COMPILER="").ended()
    assert out == "2.0 3.0\n[]"
    assert err.count("numba 0.67.9 is not tested") == 1
    assert f"tested: {', '.join(versions.TESTED)}" in err


def test_a_tested_numba_is_tuned(monkeypatch):
    monkeypatch.delenv(versions.VARIABLE, raising=False)
    monkeypatch.setattr("numba.__version__", versions.TESTED[-1])
    assert versions.choose_tuned()


def test_another_value_of_the_variable_is_an_error(monkeypatch):
    monkeypatch.setenv(versions.VARIABLE, "fast")
    with pytest.raises(ValueError, match="UNC_PHYSICS_COMPILER: 'fast' is not 'plain'"):
        versions.choose_tuned()


def test_without_compiler_numba_must_be_tested(monkeypatch):
    monkeypatch.setenv(versions.VARIABLE, "off")
    monkeypatch.setattr("numba.__version__", versions.TESTED[-1])
    assert versions.choose_tuned() and versions.is_off()
    monkeypatch.setattr("numba.__version__", "0.67.9")
    with pytest.raises(ValueError, match=re.escape(f"'off' needs numba {versions.TESTED[0]}")):
        versions.choose_tuned()


def test_requirements_agree_with_the_tested_versions():
    pinned = re.search(r"^numba==(\S+)$", (ROOT / "requirements/constraints.txt").read_text(), re.MULTILINE)
    assert pinned and pinned[1] in versions.TESTED
    wanted = re.search(r'"numba([<>=.,\d]+)"', (ROOT / "setup.py").read_text())
    assert wanted and all(tested in SpecifierSet(wanted[1]) for tested in versions.TESTED)
