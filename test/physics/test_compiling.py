"""Compiled kernels: kept where something can be written, never stale, said once, and no prediction's time."""

import gc
import os
import re
import shutil
import subprocess
import sys
import time

import numba
import numpy as np
import pytest
from numba.core import event

from unc_physics import Belief, RigidBody, Scene, load_model, predict
from unc_physics.physics import compile_cache
from unc_physics.physics.compile_time import clock, seconds_compiling
from unc_physics.physics.threads import in_threads
from unc_physics.propagators.monte_carlo import MonteCarlo

NOTICE = "Compiling the simulation's kernels"
CALLEE = """
from typing import NamedTuple

from .compiled import inner, stage

FACTOR = 2.0


class Method(NamedTuple):
    x: float


@inner
def twice(x):
    return FACTOR * x


@stage
def start(method):
    return 0.0


@start.of(Method)
def work(method):
    return method.x + 1.0
"""
CALLER = """
from .callee import Method, start, twice
from .compiled import kernel


@kernel
def called(x):
    return twice(x)


@kernel
def staged(method):
    return start(method)


def both():
    print(called(1.0), staged(Method(2.0)))
"""
CALL = "from unc_physics.physics.caller import both; both()"
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
    (package / "physics" / "callee.py").write_text(CALLEE)

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


@pytest.mark.parametrize(
    "edit, answer, compiled",
    [
        pytest.param(("FACTOR * x", "x * FACTOR + FACTOR"), "4.0 3.0", 1, id="a callee"),
        pytest.param(("FACTOR = 2.0", "FACTOR = 5.0"), "5.0 3.0", 1, id="a constant"),
        pytest.param(("+ 1.0", "+ 2.0"), "2.0 4.0", 1, id="what a stage does for a method"),
        pytest.param(("@stage", "# a comment\n@stage"), "2.0 3.0", 0, id="a comment"),
    ],
)
def test_an_edit_compiles_what_depends_on_it(copy, edit, answer, compiled):
    out, err = ended(copy())
    assert out == "2.0 3.0"
    assert err.count("\n") == 1 and err.startswith(NOTICE), "one line for all kernels"
    assert ended(copy()) == ("2.0 3.0", ""), "loaded"
    kept = copy.package / "__pycache__"
    before = set(kept.glob("kernels-*/*caller.*.nbi"))
    (copy.package / "physics" / "callee.py").write_text(CALLEE.replace(*edit))
    assert ended(copy())[0] == answer
    assert len(set(kept.glob("kernels-*/*caller.*.nbi")) - before) == compiled


def test_what_was_kept_in_another_way_is_compiled_anew(copy):
    ended(copy())
    path = copy.package / "physics" / "compile_cache.py"
    text = path.read_text()
    for before, after in (
        ("needed, apart, data = data", "_, needed, apart, data = data"),
        ("saved = ", "saved = 0, "),
    ):
        assert before in text
        text = text.replace(before, after)
    path.write_text(text)
    assert ended(copy())[0] == "2.0 3.0"


def test_a_damaged_cache_is_compiled_anew(copy):
    ended(copy())
    for file in (copy.package / "__pycache__").glob("kernels-*/*"):
        file.write_bytes(b"")
    assert ended(copy())[0] == "2.0 3.0"


def test_a_callee_that_stays_apart_is_loaded_before_its_caller(copy):
    calls = copy.package / "physics" / "calls.py"
    calls.write_text(re.sub("^LONG = .*$", "LONG = 0", calls.read_text(), flags=re.MULTILINE))
    assert ended(copy())[0] == "2.0 3.0"
    assert ended(copy()) == ("2.0 3.0", ""), "loaded"
    for file in (copy.package / "__pycache__").glob("kernels-*/*callee.*"):
        file.unlink()
    out, err = ended(copy())
    assert out == "2.0 3.0" and NOTICE in err
    assert ended(copy()) == ("2.0 3.0", "")


def test_first_starts_at_once(copy):
    for process in [copy(), copy()]:
        assert ended(process)[0] == "2.0 3.0"
    assert ended(copy()) == ("2.0 3.0", "")
    assert not list(copy.package.glob("__pycache__/kernels-*/*.lock"))


def test_a_process_waits_for_what_another_one_compiles(copy):
    """And for no longer than that one lives."""
    hold = """
import time
from unc_physics.physics import caller, compile_cache
compile_cache._KernelCache._save_overload = lambda *_: time.sleep(1000.0)
caller.both()
"""
    first = copy(hold)
    kernels = copy.package / "__pycache__"
    while not list(kernels.glob("kernels-*/*.lock")):
        time.sleep(0.05)
    second = copy()
    with pytest.raises(subprocess.TimeoutExpired):
        second.communicate(timeout=6.0)
    first.kill()
    first.communicate()
    assert ended(second)[0] == "2.0 3.0"


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
    assert len(list((tmp_path / "own").glob("kernels-*/*caller.*.nbc"))) == 2
    assert not (copy.package / "__pycache__").exists()


def test_what_was_compiled_ahead_loads_where_nothing_can_be_written(copy, tmp_path):
    """The package's own folder, of a user who may not write there."""
    ended(copy())
    program = f"""
import tempfile
write = tempfile.TemporaryFile
def refuse(dir, **others):
    if str(dir).startswith({str(copy.package)!r}):
        raise PermissionError("read-only")
    return write(dir=dir, **others)
tempfile.TemporaryFile = refuse
{CALL}"""
    assert ended(copy(program, HOME=str(tmp_path / "home"), XDG_CACHE_HOME="")) == ("2.0 3.0", "")


def test_what_is_long_unused_is_removed(tmp_path):
    now = time.time()
    for kernel in ("a.step", "a-b.step"):
        for k in range(3):
            for end in ("nbi", "1.nbc", "2.nbc"):
                path = tmp_path / f"{kernel}-{k:016x}.{end}"
                path.touch()
                os.utime(path, (now - k * 20 * 3600.0,) * 2)
    compile_cache._clean(tmp_path)
    left = sorted(path.name for path in tmp_path.glob("*.nbi"))
    assert left == [f"{kernel}-{k:016x}.nbi" for kernel in ("a-b.step", "a.step") for k in range(2)]
    assert len(list(tmp_path.glob("*.nbc"))) == 8


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


def test_the_garbage_collector_is_the_users_again_after_compiling():
    meanwhile, before = [], gc.get_threshold()

    class _Look(event.Listener):
        def on_start(self, event):
            meanwhile.append(gc.get_threshold())

        def on_end(self, event):
            pass

    for often in (before, (0, 10, 10)):  # by default, and off
        gc.set_threshold(*often)
        with event.install_listener("numba:compile", _Look()), pytest.raises(numba.TypingError):
            numba.njit(lambda x: x.no_such_attribute)(1.0)  # compiling that fails, too
        assert gc.get_threshold() == often
    gc.set_threshold(*before)
    assert meanwhile[0][0] > before[0] and meanwhile[1] == (0, 10, 10)
