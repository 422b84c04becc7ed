"""Copies of the package that hold two small modules of compiled functions, run in processes of their own."""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

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


class Run:
    """A program that runs in a process of its own, forked from one that has imported numba."""

    def __init__(self, server, folder, program, env):
        self._files = {name: Path(tempfile.mkstemp()[1]) for name in ("out", "err", "status")}
        request = {"folder": str(folder), "program": program, "env": env}
        server.stdin.write(json.dumps(request | {k: str(v) for k, v in self._files.items()}) + "\n")
        server.stdin.flush()
        self._pid = int(server.stdout.readline())

    def ended(self, timeout=3000.0):
        """What it printed, and what it wrote to standard error; TimeoutError if it still runs then."""
        deadline = time.monotonic() + timeout
        while not (status := self._files["status"].read_text()):
            if time.monotonic() > deadline:
                raise TimeoutError
            time.sleep(0.01)
        out, err = (self._files[name].read_text() for name in ("out", "err"))
        for path in self._files.values():
            path.unlink()
        assert status == "0", err
        return out.strip(), err

    def kill(self):
        """End it at once."""
        os.kill(self._pid, signal.SIGKILL)


@pytest.fixture(scope="session")
def server():
    """A process that has imported numba, and forks for each program (`compiler_server`)."""
    command = [sys.executable, str(Path(__file__).with_name("compiler_server.py"))]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.stdin.close()


def copy_of(server, folder, tmp_path):
    """Function that runs a program on a copy of a folder, with environment variables of its own."""
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    env = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}

    def start(program=CALL, **others):
        return Run(server, tmp_path, program, env | others)

    start.package = tmp_path / "unc_physics"
    return start


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


@pytest.fixture
def copy(server, sources, tmp_path):
    """Function that runs a program on a copy of the package without compiled kernels."""
    return copy_of(server, sources, tmp_path)
