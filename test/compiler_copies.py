"""Copies of the package that hold two small modules of compiled functions, run in processes of their own."""

import functools
import os
import shutil
import subprocess
import sys

import pytest

from unc_physics.compiler.cache_folder import PACKAGE

CALLEE = """
from typing import NamedTuple

from . import inner, stage

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
from . import kernel


@kernel
def called(x):
    return twice(x)


@kernel
def staged(method):
    return start(method)


def both():
    print(called(1.0), staged(Method(2.0)))
"""
CALL = "from unc_physics.compiler.caller import both; both()"


def started(folder, program=CALL, **others):
    """Start Python on the copy of the package in a folder."""
    env = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    return subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
        env=env | {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"} | others,
    )


def ended(process):
    """What it printed, and what it said on standard error."""
    out, err = process.communicate(timeout=300.0)
    assert process.returncode == 0, err
    return out.strip(), err


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    """A folder with a copy of the package in which kernels call one of another file, and without a cache."""
    folder = tmp_path_factory.mktemp("sources")
    package = folder / "unc_physics"
    for part in ("", "compiler", "compiler/tuned"):
        shutil.copytree(
            PACKAGE / part,
            package / part,
            dirs_exist_ok=True,
            ignore=lambda _, names: [name for name in names if not name.endswith((".py", ".pyi"))],
        )
    (package / "compiler" / "caller.py").write_text(CALLER)
    (package / "compiler" / "callee.py").write_text(CALLEE)
    return folder


def copy_of(folder, tmp_path):
    """Function that runs Python on a copy of a folder."""
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    start = functools.partial(started, tmp_path)
    start.package = tmp_path / "unc_physics"
    return start


@pytest.fixture
def copy(sources, tmp_path):
    """Function that runs Python on a copy of the package without compiled kernels."""
    return copy_of(sources, tmp_path)
