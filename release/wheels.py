"""Make wheels with compiled kernels, and one without: ``python release/wheels.py [--python PYTHON ...]``.

For each Python an environment with the pinned dependencies compiles the kernels of `kinds` for the target of
wheels (`unc_physics.compiler.tuned.target`), not for this processor. A second run compiles only what changed.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
#: Shipped kernels hold no symbols of the C library of their own; numba's wheels need this version, too.
MANYLINUX = "manylinux_2_17"
#: Kinds of `kinds.py` need these besides the dependencies of the library.
EXTRAS = ["manifold3d", "networkx", "scipy", "trimesh"]
LARGEST = 40e6  # bytes of a wheel

_SHIPPED = """
import json, platform
from unc_physics.compiler.tuned import compile_cache, target
shipped = target.SHIPPED.get(platform.machine(), {})
print(json.dumps([[*one, compile_cache.fingerprint(one)] for one in shipped]))
"""


def main():
    """Make the wheels, and print their sizes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--python", nargs="+", default=[sys.executable], help="Pythons, default: this one")
    parser.add_argument("--output", type=Path, default=ROOT / "dist", help="folder (default: dist)")
    parser.add_argument("--work", type=Path, default=ROOT / ".venv" / "made" / "wheels", help="kept files")
    options = parser.parse_args()
    options.output.mkdir(exist_ok=True)
    for python in options.python:
        tag = _output(
            python, "-c", "import sys; print(f'cp{sys.version_info[0]}{sys.version_info[1]}')"
        ).strip()
        work = options.work.resolve() / tag
        venv = make_environment(python, work / "venv")
        with tempfile.TemporaryDirectory() as folder:
            sources = extract_sources(venv, Path(folder))
            compile_kernels(venv, sources, work / "kernels")
            wheel = build(venv, sources, options.output, f"{MANYLINUX}_{platform.machine()}")
        _report(wheel)
    with tempfile.TemporaryDirectory() as folder:
        _report(build(venv, extract_sources(venv, Path(folder)), options.output))


def make_environment(python, venv):
    """Return the Python of an environment with the pinned dependencies; it is kept."""
    inner = venv / "bin" / "python"
    if not (venv / "ready").exists():
        subprocess.run([python, "-m", "venv", "--clear", venv], check=True)
        requirements = ["-r", ROOT / "requirements" / "run.txt", *EXTRAS, "setuptools"]
        pins = ["-c", ROOT / "requirements" / "constraints.txt"]
        subprocess.run([inner, "-m", "pip", "install", "-q", *pins, *requirements], check=True)
        (venv / "ready").touch()
    return inner


def extract_sources(python, folder):
    """Return a folder with the content of a source distribution."""
    _run(python, "setup.py", "-q", "sdist", "-d", folder, cwd=ROOT)
    (archive,) = folder.glob("*.tar.gz")
    with tarfile.open(archive) as opened:
        opened.extractall(folder, filter="data")
    return folder / archive.name.removesuffix(".tar.gz")


def compile_kernels(python, sources, cache):
    """Compile the kernels of all kinds for each target of this machine, and put them into the package."""
    env = {**os.environ, "PYTHONPATH": str(sources), "NUMBA_DISABLE_INTEL_SVML": "1"}
    env = {name: value for name, value in env.items() if name != "UNC_PHYSICS_COMPILER"}
    for processor, features, made_by in json.loads(_output(python, "-c", _SHIPPED, env=env, cwd=sources)):
        print(f"compiling for {python.parents[1].parent.name}, {processor} ...", flush=True)
        settings = {
            "NUMBA_CPU_NAME": processor,
            "NUMBA_CPU_FEATURES": features,
            "NUMBA_CACHE_DIR": str(cache),
        }
        started, spent = time.time(), os.times()
        command = [python, ROOT / "release" / "kinds.py", sources / "examples"]
        subprocess.run(command, env=env | settings, check=True, cwd=sources)
        used = [path for path in (cache / f"kernels-{made_by}").iterdir() if path.stat().st_mtime >= started]
        folder = sources / "unc_physics" / "kernels" / made_by
        folder.mkdir(parents=True)
        for path in used:
            shutil.copy(path, folder)
        cpu = sum(os.times()[2:4]) - sum(spent[2:4])
        print(f"{len(used)} kernels in {time.time() - started:.0f} s ({cpu:.0f} s of CPU)", flush=True)


def build(python, sources, output, platform_name=None):
    """Build a wheel of a folder of sources, for a platform if it holds kernels; return its path."""
    with tempfile.TemporaryDirectory() as folder:
        where = ["--plat-name", platform_name] if platform_name else []
        _run(python, "setup.py", "-q", "bdist_wheel", "-d", folder, *where, cwd=sources)
        (wheel,) = Path(folder).glob("*.whl")
        return Path(shutil.copy(wheel, output))


def _report(wheel):
    size = wheel.stat().st_size
    print(f"{wheel}: {size / 1e6:.1f} MB", flush=True)
    if size > LARGEST:
        raise SystemExit(f"{wheel.name} is larger than {LARGEST / 1e6:.0f} MB")


def _run(python, *arguments, **others):
    subprocess.run([python, *arguments], check=True, stdout=subprocess.DEVNULL, **others)


def _output(python, *arguments, **others):
    return subprocess.run(
        [python, *arguments], check=True, text=True, stdout=subprocess.PIPE, **others
    ).stdout


if __name__ == "__main__":
    main()
