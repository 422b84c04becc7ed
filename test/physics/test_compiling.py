"""Compiled kernels: kept where something can be written, never stale, said once, and no prediction's time."""

import os
import shutil
import subprocess
import sys
import time

import numba
import numpy as np
import pytest

from unc_physics import Belief, RigidBody, Scene, load_model, predict
from unc_physics.physics import compile_cache
from unc_physics.physics.compile_time import clock, seconds_compiling
from unc_physics.physics.threads import in_threads
from unc_physics.propagators.monte_carlo import MonteCarlo

NOTICE = "Compiling the simulation's kernels"
CALLEE = "from .compiled import inner\n\n\n@inner\ndef twice(x):\n    return {} * x\n"
CALLER = """
from .callee import twice
from .compiled import kernel


@kernel
def called(x):
    return twice(x)


@kernel
def also_called(x):
    return twice(x) + 1.0
"""
CALL = "from unc_physics.physics.caller import also_called, called; print(called(1.0), also_called(1.0))"
NOWHERE = "/dev/null/nothing"


@pytest.fixture
def copy(tmp_path):
    """Function that runs Python on a copy of the package, in which kernels call one of another file."""
    package = tmp_path / "unc_physics"
    for folder in ("", "physics"):
        shutil.copytree(
            compile_cache.PACKAGE / folder,
            package / folder,
            dirs_exist_ok=True,
            ignore=lambda _, names: [name for name in names if not name.endswith((".py", ".pyi"))],
        )
    (package / "physics" / "caller.py").write_text(CALLER)
    (package / "physics" / "callee.py").write_text(CALLEE.format("2.0"))

    def start(program=CALL, **others):
        env = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
        return subprocess.Popen(
            [sys.executable, "-c", program],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=tmp_path,
            env=env | {"PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"} | others,
        )

    start.package = package
    return start


def ended(process):
    """What it printed, and what it said on standard error."""
    out, err = process.communicate(timeout=300.0)
    assert process.returncode == 0, err
    return out.strip(), err


def test_an_edit_of_a_callee_counts_and_all_else_is_loaded(copy):
    out, err = ended(copy())
    assert out == "2.0 3.0"
    assert err.count("\n") == 1 and err.startswith(NOTICE), "one line for all kernels"
    assert ended(copy()) == ("2.0 3.0", ""), "loaded"
    (copy.package / "physics" / "callee.py").write_text(CALLEE.format("5.0"))
    assert ended(copy())[0] == "5.0 6.0"
    kept = list((copy.package / "__pycache__").glob("kernels-*"))
    assert len(kept) == 2
    for path in kept:
        for file in path.iterdir():
            file.write_bytes(b"")
    assert ended(copy())[0] == "5.0 6.0", "a damaged cache is compiled anew"


def test_first_starts_at_once(copy):
    for process in [copy(), copy()]:
        assert ended(process)[0] == "2.0 3.0"
    assert ended(copy()) == ("2.0 3.0", "")


def test_places_where_nothing_can_be_written(copy, tmp_path):
    (copy.package / "__pycache__").write_text("")  # a file: permissions do not bind everybody
    cache = tmp_path / "home" / ".cache" / "unc_physics"
    homeless = {"XDG_CACHE_HOME": NOWHERE, "NUMBA_CACHE_DIR": NOWHERE}
    assert ended(copy(HOME=str(tmp_path / "home"), **homeless))[0] == "2.0 3.0"
    assert len(list(cache.glob("kernels-*"))) == 1, "the user's"
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    assert ended(copy(HOME=NOWHERE, TMPDIR=str(temporary), **homeless))[0] == "2.0 3.0"
    assert len(list(temporary.glob("unc_physics-*/kernels-*"))) == 1
    program = f"import tempfile; tempfile.tempdir = {NOWHERE!r}; {CALL}"
    for _ in range(2):
        out, err = ended(copy(program, HOME=NOWHERE, **homeless))
        assert out == "2.0 3.0"
        assert err.count(NOTICE) == 1 and "no folder can be written" in err


def test_a_folder_of_the_users_choice(copy, tmp_path):
    """Also where numba was imported before, and its setting made at run time."""
    program = f"import numba; numba.config.CACHE_DIR = {str(tmp_path / 'own')!r}; {CALL}"
    assert ended(copy(program))[0] == "2.0 3.0"
    assert len(list((tmp_path / "own").glob("kernels-*/caller.*.nbc"))) == 2
    assert not (copy.package / "__pycache__").exists()


def test_what_is_long_unused_is_removed(tmp_path):
    now = time.time()
    for k in range(8):
        folder = tmp_path / f"kernels-{k:016x}"
        (folder / "inside").mkdir(parents=True)
        os.utime(folder, (now - k * 10 * 3600.0,) * 2)
    others = tmp_path / "kernels-of-mine"
    others.mkdir()
    os.utime(others, (0.0, 0.0))
    compile_cache._clean(tmp_path)
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == [*(f"kernels-{k:016x}" for k in range(3)), "kernels-of-mine"]


def fresh():
    """Compile something."""
    return numba.njit(lambda x: np.sort(x).sum())(np.arange(3.0))


@pytest.mark.parametrize("count", [1, 8])
def test_the_clock_stands_still(count):
    """Also while this thread waits for others that compile."""
    began, started, spent = time.perf_counter(), clock(), seconds_compiling()
    in_threads(count, lambda some: fresh())
    passed, took = time.perf_counter() - began, clock() - started
    assert seconds_compiling() - spent == pytest.approx(passed - took, abs=1e-3)
    assert 0.0 <= took < 0.3 * passed


def test_compiling_is_no_predictions_time():
    class Compiling(MonteCarlo):
        def advance(self, carry, scene, steps):
            fresh()
            return super().advance(carry, scene, steps)

    mean = np.zeros((1, 13))
    mean[:, 9] = 1.0
    scene = Scene([RigidBody("pin", load_model("pin").prefix(10), 1.0)], dt=0.01, stiffness=1e4)
    belief = Belief.exact(mean)
    predict(scene, belief, MonteCarlo(samples=2), 0.5)
    began = time.perf_counter()
    prediction = predict(scene, belief, Compiling(samples=2), 0.5, max_computation_time=0.5)
    passed = time.perf_counter() - began
    assert prediction.wall_time < 0.5 * passed
