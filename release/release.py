"""Check what ``make wheels`` made, and add the source distribution and notes: ``python release/release.py``.

It runs in an environment with twine, ROS and the interfaces (``.venv``). Each wheel with kernels is installed
into an empty environment of its Python and runs all kinds of prediction (`check`), and the demo in this one.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from notes import ROOT, notes, version

DIST = ROOT / "dist"


def main():
    """Run all steps; the first failure ends it."""
    of = version()
    text = notes(of, (ROOT / "CHANGELOG.rst").read_text())
    subprocess.run([sys.executable, "setup.py", "-q", "sdist", "-d", DIST], check=True, cwd=ROOT)
    files = sorted([*DIST.glob(f"unc_physics-{of}-*.whl"), *DIST.glob(f"unc_physics-{of}.tar.gz")])
    subprocess.run([sys.executable, "-m", "twine", "check", "--strict", *files], check=True)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(check, DIST.glob(f"unc_physics-{of}-cp3*.whl")))
    lines = [f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}" for file in files]
    (DIST / "SHA256SUMS").write_text("\n".join(lines) + "\n")
    Path(DIST / f"notes-{of}.md").write_text(text)
    print(f"ready in {DIST}: {', '.join(file.name for file in files)}")


def check(wheel):
    """Check a wheel with kernels by its Python; print the output of a check that fails."""
    digits = wheel.name.split("-")[2].removeprefix("cp3")
    python = shutil.which(f"python3.{digits}")
    if python is None:
        raise SystemExit(f"{wheel.name} is not checked without python3.{digits}; install it")
    here = ["--node", sys.executable] if f"3.{digits}" == "{}.{}".format(*sys.version_info[:2]) else []
    command = [sys.executable, ROOT / "release" / "check.py", wheel, "--python", python, *here]
    done = subprocess.run(command, check=False, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode:
        raise SystemExit(f"{done.stdout}\n{wheel.name}: the check failed")
    (first,) = (line for line in done.stdout.splitlines() if line.startswith("first prediction"))
    print(f"{wheel.name}: no kernel was compiled; {first}", flush=True)


if __name__ == "__main__":
    main()
