"""The cache of compiled kernels: kept where something can be written, and never stale."""

import os
import time

import pytest
from compiler_copies import CALL, CALLEE, copy_of

from unc_physics.compiler.tuned import compile_cache

NOTICE = "Compiling the simulation's kernels"
NOWHERE = "/dev/null/nothing"


@pytest.fixture(scope="module")
def kernels(server, sources, tmp_path_factory):
    """The same folder, with compiled kernels."""
    folder = tmp_path_factory.mktemp("kernels") / "copy"
    out, err = copy_of(server, sources, folder)().ended()
    assert out == "2.0 3.0"
    assert err.count("\n") == 1 and err.startswith(NOTICE), "one line for all kernels"
    return folder


@pytest.fixture
def compiled_copy(server, kernels, tmp_path):
    """Function that runs a program on a copy of the package with compiled kernels."""
    return copy_of(server, kernels, tmp_path)


def test_an_edit_compiles_what_depends_on_it(compiled_copy):
    assert compiled_copy().ended() == ("2.0 3.0", ""), "loaded"
    kept, text = compiled_copy.package / "__pycache__", CALLEE
    for old, new, answer, compiled in (
        ("@stage", "# a comment\n@stage", "2.0 3.0", 0),
        ("FACTOR * x", "x * FACTOR + FACTOR", "4.0 3.0", 1),  # a callee
        ("FACTOR = 2.0", "FACTOR = 5.0", "10.0 3.0", 1),  # a constant
        ("+ 1.0", "+ 2.0", "10.0 4.0", 1),  # what a stage does for a method
    ):
        before = set(kept.glob("kernels-*/*caller.*.nbi"))
        text = text.replace(old, new)
        (compiled_copy.package / "compiler" / "callee.py").write_text(text)
        assert compiled_copy().ended()[0] == answer
        assert len(set(kept.glob("kernels-*/*caller.*.nbi")) - before) == compiled, new


def test_what_was_kept_in_another_way_is_compiled_anew(compiled_copy):
    path = compiled_copy.package / "compiler" / "tuned" / "compile_cache.py"
    text = path.read_text()
    for before, after in (
        ("needed, callee, data = data", "_, needed, callee, data = data"),
        ("saved = ", "saved = 0, "),
    ):
        assert before in text
        text = text.replace(before, after)
    path.write_text(text)
    assert compiled_copy().ended()[0] == "2.0 3.0"


def test_a_damaged_cache_is_compiled_anew(compiled_copy):
    for file in (compiled_copy.package / "__pycache__").glob("kernels-*/*"):
        file.write_bytes(b"")
    assert compiled_copy().ended()[0] == "2.0 3.0"


def test_a_callee_that_is_not_inlined_is_loaded_before_its_caller(copy):
    callee = copy.package / "compiler" / "callee.py"
    callee.write_text(CALLEE.replace("@inner", "@inner(noinline=True)"))
    assert copy().ended()[0] == "2.0 3.0"
    assert copy().ended() == ("2.0 3.0", ""), "loaded"
    for file in (copy.package / "__pycache__").glob("kernels-*/*callee.*"):
        file.unlink()
    out, err = copy().ended()
    assert out == "2.0 3.0" and NOTICE in err
    assert copy().ended() == ("2.0 3.0", "")
    callee.write_text(CALLEE.replace("@inner", "@inner(noinline=True)").replace("2.0", "3.0"))
    assert copy().ended()[0] == "3.0 3.0", "an edit of the callee"


def test_first_starts_at_once(copy):
    for run in [copy(), copy()]:
        assert run.ended()[0] == "2.0 3.0"
    assert copy().ended() == ("2.0 3.0", "")
    assert not list(copy.package.glob("__pycache__/kernels-*/*.lock"))


def test_a_process_waits_for_what_another_one_compiles(copy):
    """And for no longer than that one lives."""
    hold = """
import time
from unc_physics.compiler import caller
from unc_physics.compiler.tuned import compile_cache
compile_cache._KernelCache._save_overload = lambda *_: time.sleep(1000.0)
caller.both()
"""
    first = copy(hold)
    kernels = copy.package / "__pycache__"
    while not list(kernels.glob("kernels-*/*.lock")):
        time.sleep(0.05)
    second = copy()
    with pytest.raises(TimeoutError):
        second.ended(timeout=4.0)
    first.kill()
    assert second.ended()[0] == "2.0 3.0"


def test_places_where_nothing_can_be_written(copy, tmp_path):
    (copy.package / "__pycache__").write_text("")  # a file: permissions do not bind everybody
    cache = tmp_path / "home" / ".cache" / "unc_physics"
    homeless = {"XDG_CACHE_HOME": NOWHERE, "NUMBA_CACHE_DIR": NOWHERE}
    assert copy(HOME=str(tmp_path / "home"), **homeless).ended()[0] == "2.0 3.0"
    assert len(list(cache.glob("kernels-*"))) == 1, "the user's"
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    assert copy(HOME=NOWHERE, TMPDIR=str(temporary), **homeless).ended()[0] == "2.0 3.0"
    assert len(list(temporary.glob("unc_physics-*/kernels-*"))) == 1
    program = f"import tempfile; tempfile.tempdir = {NOWHERE!r}; {CALL}"
    out, err = copy(program, HOME=NOWHERE, **homeless).ended()
    assert out == "2.0 3.0"
    assert err.count(NOTICE) == 1 and "no folder can be written" in err


def test_a_folder_of_the_users_choice(copy, tmp_path):
    """Also where numba was imported before, and its setting made at run time."""
    program = f"import numba; numba.config.CACHE_DIR = {str(tmp_path / 'own')!r}; {CALL}"
    assert copy(program).ended()[0] == "2.0 3.0"
    assert len(list((tmp_path / "own").glob("kernels-*/*caller.*.nbc"))) == 2
    assert not (copy.package / "__pycache__").exists()


def test_what_was_compiled_ahead_loads_where_nothing_can_be_written(compiled_copy, tmp_path):
    """The package's own folder, of a user who may not write there."""
    program = f"""
import tempfile
write = tempfile.TemporaryFile
def refuse(dir, **others):
    if str(dir).startswith({str(compiled_copy.package)!r}):
        raise PermissionError("read-only")
    return write(dir=dir, **others)
tempfile.TemporaryFile = refuse
{CALL}"""
    assert compiled_copy(program, HOME=str(tmp_path / "home"), XDG_CACHE_HOME="").ended() == ("2.0 3.0", "")


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
