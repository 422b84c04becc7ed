"""Provenance of results: machine and versions."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from unc_physics import __version__

PACKAGES = ("numpy", "numba", "scipy", "POT", "pybullet", "mujoco")


def machine() -> str:
    """Return the processor, the number of usable threads, and the operating system."""
    name = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                name = line.split(":", 1)[1].strip()
                break
    return f"{name}, {threads()} threads, {platform.platform()}"


def threads() -> int:
    """Return the number of the processor's threads that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def versions() -> dict[str, str]:
    """Return the versions of this package, of Python, and of the installed ones of `PACKAGES`."""
    found = {"unc_physics": __version__, "python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
