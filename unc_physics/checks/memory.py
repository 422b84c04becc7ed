"""Whether there is memory enough, asked before it is taken."""

from __future__ import annotations

import contextlib
import os
import resource
from pathlib import Path

from .errors import InvalidOptionError, LimitExceededError

#: Environment variable: bytes that may be taken, in place of those that are available.
LIMIT = "UNC_PHYSICS_MEMORY"
_ALWAYS = 100_000_000  # bytes that are not asked about: looking takes longer than many a prediction


def require_memory(needed: float, what: str, field: str, value: object = None) -> None:
    """Refuse what needs more memory than there is.

    Parameters
    ----------
    needed : float
        About how much [bytes].
    what : str
        What for, in a few words.
    field : str
        What to change.
    value : object, optional

    Raises
    ------
    LimitExceededError
    """
    if needed <= _ALWAYS:
        return
    there = available_memory()
    if needed > there:
        raise LimitExceededError(
            f"must be less: {what} takes about {_size(needed)} of memory, and {_size(there)} are available"
            f" (the environment variable {LIMIT} sets another limit, in bytes)",
            field=field,
            value=value,
        )


def available_memory() -> float:
    """Bytes that may be taken: of the machine, of the container, and of the process's own limit."""
    if given := os.environ.get(LIMIT):
        with contextlib.suppress(ValueError):
            if (limit := float(given)) >= 0.0:
                return limit
        raise InvalidOptionError("must be a number of bytes", field=LIMIT, value=given)
    limits = [float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))]
    with contextlib.suppress(OSError, ValueError, IndexError):
        lines = Path("/proc/meminfo").read_text().splitlines()
        limits += [1024.0 * float(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]
    with contextlib.suppress(OSError, ValueError):  # "max" where a container has no limit
        group = Path("/sys/fs/cgroup")
        limits.append(
            float((group / "memory.max").read_text()) - float((group / "memory.current").read_text())
        )
    own, _ = resource.getrlimit(resource.RLIMIT_AS)
    if own != resource.RLIM_INFINITY:
        limits.append(float(own) - _taken())
    return max(min(limits), 0.0)


def _taken():
    """Bytes of address space that this process has."""
    with contextlib.suppress(OSError, ValueError):
        return float(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    return 0.0


def _size(count):
    """Bytes in the largest unit that leaves a whole number of them."""
    for unit in ("bytes", "kB", "MB", "GB"):
        if count < 1e4 or unit == "GB":
            return f"{count:,.0f} {unit}".replace(",", " ")
        count /= 1e3
    raise AssertionError
