"""Check available memory before allocation."""

from __future__ import annotations

import contextlib
import os
import resource
from pathlib import Path

from .errors import InvalidOptionError, LimitExceededError

#: Environment variable with a limit in bytes, which replaces the available memory.
LIMIT = "UNC_PHYSICS_MEMORY"
_ALWAYS = 100_000_000  # bytes that are not checked: the check takes longer than many predictions


def require_memory(needed: float, what: str, field: str, value: object = None) -> None:
    """Raise `LimitExceededError` if about ``needed`` bytes are more than the available memory.

    ``what`` is the purpose in a few words, and ``field`` what the user can change.
    """
    if needed <= _ALWAYS:
        return
    limit = available_memory()
    if needed > limit:
        raise LimitExceededError(
            f"must be less: {what} takes about {_size(needed)} of memory, and {_size(limit)} are available"
            f" (the environment variable {LIMIT} sets another limit, in bytes)",
            field=field,
            value=value,
        )


def available_memory() -> float:
    """Return the limit memory [bytes]: the least of machine, container, and process limits."""
    if given := os.environ.get(LIMIT):
        with contextlib.suppress(ValueError):
            if (limit := float(given)) >= 0.0:
                return limit
        raise InvalidOptionError("must be a number of bytes", field=LIMIT, value=given)
    limits = [float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))]
    with contextlib.suppress(OSError, ValueError, IndexError):
        lines = Path("/proc/meminfo").read_text().splitlines()
        limits += [1024.0 * float(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]
    with contextlib.suppress(OSError, ValueError):  # "max" if a container has no limit
        group = Path("/sys/fs/cgroup")
        limits.append(
            float((group / "memory.max").read_text()) - float((group / "memory.current").read_text())
        )
    own, _ = resource.getrlimit(resource.RLIMIT_AS)
    if own != resource.RLIM_INFINITY:
        limits.append(float(own) - _taken())
    return max(min(limits), 0.0)


def _taken():
    """Return the size of this process's address space [bytes]."""
    with contextlib.suppress(OSError, ValueError):
        return float(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    return 0.0


def _size(count):
    """Format a number of bytes in the largest unit that leaves a whole number."""
    for unit in ("bytes", "kB", "MB", "GB"):
        if count < 1e4 or unit == "GB":
            return f"{count:,.0f} {unit}".replace(",", " ")
        count /= 1e3
    raise AssertionError
