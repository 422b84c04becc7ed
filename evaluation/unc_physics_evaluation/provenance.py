"""Where results come from: machine and versions."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from unc_physics import __version__

PACKAGES = ("numpy", "numba", "scipy", "POT", "pybullet", "mujoco")


def machine() -> str:
    """Processor, number of its threads that we may use, and operating system."""
    name = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                name = line.split(":", 1)[1].strip()
                break
    return f"{name}, {threads()} threads, {platform.platform()}"


def threads() -> int:
    """Number of the processor's threads that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def versions() -> dict[str, str]:
    """Versions of this package, of Python, and of those of `PACKAGES` that are installed."""
    found = {"unc_physics": __version__, "python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
