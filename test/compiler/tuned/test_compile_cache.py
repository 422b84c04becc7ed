"""The cache of compiled kernels: kept where something can be written, and never stale."""

import os
import platform
import time

import pytest
from compiler_copies import CALL, CALLEE, copy_of

from unc_physics.compiler.tuned import compile_cache, target
from unc_physics.compiler.tuned.target import SHIPPED

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
        before = set(kept.glob("kernels-*/*caller.*.kernel"))
        text = text.replace(old, new)
        (compiled_copy.package / "compiler" / "callee.py").write_text(text)
        assert compiled_copy().ended()[0] == answer
        assert len(set(kept.glob("kernels-*/*caller.*.kernel")) - before) == compiled, new


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


@pytest.mark.parametrize("damage", ["emptied", "cut", "flipped", "swapped"])
def test_a_damaged_cache_is_compiled_anew(damage, compiled_copy):
    files = sorted((compiled_copy.package / "__pycache__").glob("kernels-*/*.kernel"))
    contents = [file.read_bytes() for file in files]
    for file, content, other in zip(files, contents, contents[1:] + contents[:1], strict=True):
        half = len(content) // 2
        flipped = content[:half] + bytes([content[half] ^ 1]) + content[half + 1 :]
        damaged = {"emptied": b"", "cut": content[:half], "flipped": flipped, "swapped": other}
        assert damaged[damage] != content
        file.write_bytes(damaged[damage])
    out, err = compiled_copy().ended()
    assert out == "2.0 3.0" and NOTICE in err


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
    assert len(list((tmp_path / "own").glob("kernels-*/*caller.*.kernel"))) == 2
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


@pytest.fixture
def shipped_copy(copy):
    """Function that runs a program on a copy with kernels for the least processor, as a wheel has them."""
    targets = SHIPPED[platform.machine()]
    (target,) = targets
    settings = {"NUMBA_CPU_NAME": target.processor, "NUMBA_CPU_FEATURES": target.features}
    assert copy(**settings).ended()[0] == "2.0 3.0"
    (folder,) = (copy.package / "__pycache__").iterdir()
    (copy.package / "kernels").mkdir()
    folder.rename(copy.package / "kernels" / folder.name.removeprefix("kernels-"))
    return copy


def test_shipped_kernels_run_without_compiling(shipped_copy):
    assert shipped_copy(UNC_PHYSICS_COMPILER="off").ended() == ("2.0 3.0", "")
    cached = list((shipped_copy.package / "__pycache__").glob("kernels-*/*"))
    assert not cached


def test_what_is_not_shipped_is_compiled_beside_it(shipped_copy):
    (shipped,) = (shipped_copy.package / "kernels").iterdir()
    for file in shipped.glob("*caller.called-*"):
        file.unlink()
    with pytest.raises(AssertionError, match="called .*is not compiled for"):
        shipped_copy(UNC_PHYSICS_COMPILER="off").ended()
    out, err = shipped_copy().ended()
    assert out == "2.0 3.0" and NOTICE in err
    (own,) = (shipped_copy.package / "__pycache__").glob("kernels-*/*.kernel")
    assert "caller.called-" in own.name


def test_shipped_kernels_of_other_sources_or_other_numba_do_not_load(shipped_copy):
    (shipped,) = (shipped_copy.package / "kernels").iterdir()
    callee = shipped_copy.package / "compiler" / "callee.py"
    callee.write_text(CALLEE.replace("FACTOR = 2.0", "FACTOR = 5.0"))
    assert shipped_copy().ended()[0] == "5.0 3.0"
    callee.write_text(CALLEE)
    program = f"import llvmlite; llvmlite.__version__ = 'other'\n{CALL}"
    with pytest.raises(AssertionError, match="is not compiled for"):
        shipped_copy(program, UNC_PHYSICS_COMPILER="off").ended()
    shipped.rename(shipped.with_name(_other_fingerprint(shipped_copy)))
    with pytest.raises(AssertionError, match="is not compiled for"):
        shipped_copy(program, UNC_PHYSICS_COMPILER="off").ended()


def _other_fingerprint(copy):
    """The name of the shipped folder for another llvmlite."""
    program = """
import llvmlite; llvmlite.__version__ = 'other'
from unc_physics.compiler.tuned import compile_cache, target
print(compile_cache.fingerprint(target.supported_targets()[0]))"""
    return copy(program).ended()[0]


def test_shipped_kernels_are_for_processors_that_have_the_instructions(monkeypatch):
    assert target.supported_targets() == list(SHIPPED[platform.machine()])
    monkeypatch.setattr(platform, "machine", lambda: "riscv64")
    assert target.supported_targets() == []
    monkeypatch.undo()
    monkeypatch.setitem(SHIPPED, platform.machine(), {target.Target("future", ""): {"teleportation"}})
    assert target.supported_targets() == []


def test_settings_of_numba_exclude_shipped_kernels(monkeypatch):
    monkeypatch.setattr("numba.config.CPU_NAME", "generic")
    assert target.supported_targets() == []


def test_what_is_long_unused_is_removed(tmp_path):
    now = time.time()
    for kernel in ("a.step", "a-b.step"):
        for k in range(3):
            path = tmp_path / f"{kernel}-01234567-{k:016x}.kernel"
            path.touch()
            os.utime(path, (now - k * 20 * 3600.0,) * 2)
    compile_cache._clean(tmp_path)
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == [
        f"{kernel}-01234567-{k:016x}.kernel" for kernel in ("a-b.step", "a.step") for k in range(2)
    ]
