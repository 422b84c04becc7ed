"""Make wheels with compiled kernels, and one without: ``python release/wheels.py [--python PYTHON ...]``.

For each Python an environment with the pinned dependencies compiles the kernels of `kinds` for the target of
wheels (`unc_physics.compiler.tuned.target`), not for this processor. A second run on the same sources
compiles only what is missing. Pythons compile side by side, one on each processor core.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
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
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "plain").mkdir()
        first, *_ = venvs = [make_environment(python, options.work.resolve()) for python in options.python]
        sources = extract_sources(first, Path(folder) / "plain")

        def make_wheel(python):
            work = python.parents[2]
            own = shutil.copytree(sources, Path(folder) / work.name)
            compile_kernels(python, own, work)
            return build(python, own, options.output, f"{MANYLINUX}_{platform.machine()}")

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            wheels = list(pool.map(make_wheel, venvs))
        for wheel in [*wheels, build(first, sources, options.output)]:
            _report(wheel)


def make_environment(python, work):
    """Return the Python of an environment with the pinned dependencies, WORK/cp3X/venv; it is kept."""
    code = "import sys; print(f'cp{sys.version_info[0]}{sys.version_info[1]}')"
    venv = work / _output(python, "-c", code).strip() / "venv"
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


def compile_kernels(python, sources, work):
    """Compile the kernels of all kinds for each target of this machine, and put them into the package.

    The times of all kinds are in WORK/compile.log.
    """
    env = {**os.environ, "PYTHONPATH": str(sources), "NUMBA_DISABLE_INTEL_SVML": "1"}
    env = {name: value for name, value in env.items() if name != "UNC_PHYSICS_COMPILER"}
    for processor, features, made_by in json.loads(_output(python, "-c", _SHIPPED, env=env, cwd=sources)):
        print(f"compiling for {work.name}, {processor} ...", flush=True)
        cache = kernel_folder(work, sources)
        settings = {
            "NUMBA_CPU_NAME": processor,
            "NUMBA_CPU_FEATURES": features,
            "NUMBA_CACHE_DIR": str(cache),
        }
        started = time.time()
        command = [python, ROOT / "release" / "kinds.py", sources / "examples"]
        log = work / "compile.log"
        with log.open("w") as opened:
            process = subprocess.Popen(
                command, env=env | settings, cwd=sources, stdout=opened, stderr=subprocess.STDOUT
            )
            _, status, used = os.wait4(process.pid, 0)
        if status:
            raise SystemExit(f"{log.read_text()}\n{work.name}: compiling failed")
        kernels = list((cache / f"kernels-{made_by}").glob("*.kernel"))
        folder = sources / "unc_physics" / "kernels" / made_by
        folder.mkdir(parents=True)
        for path in kernels:
            shutil.copy(path, folder)
        wall, cpu = time.time() - started, used.ru_utime + used.ru_stime
        print(f"{work.name}: {len(kernels)} kernels in {wall:.0f} s ({cpu:.0f} s of CPU)", flush=True)


def kernel_folder(work, sources):
    """Return the folder of the kernels of these sources, and remove those of other sources.

    A kernel that is loaded does not load the kernels that were compiled into it. So which kernels a run uses
    does not show which ones a wheel needs, and kernels of older sources must not be among them.
    """
    files = [*sources.rglob("*.py"), *(sources / "examples").rglob("*.yaml"), ROOT / "release" / "kinds.py"]
    digest = hashlib.sha256()
    for file in sorted(files):
        digest.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    wanted = work / "kernels" / digest.hexdigest()[:16]
    wanted.mkdir(parents=True, exist_ok=True)
    for folder in wanted.parent.iterdir():
        if folder != wanted:
            shutil.rmtree(folder)
    return wanted


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
