"""Measurements: run from the repository's root, for example ``python -m benchmarks.propagators``."""

import hashlib
import os
from pathlib import Path

_ROOT = Path(__file__).resolve().parent.parent


def _fingerprint():
    """Of all sources: numba looks only at the file of the function itself, not at those that it calls."""
    digest = hashlib.sha256()
    for path in sorted((_ROOT / "unc_physics").rglob("*.py")):
        digest.update(str(path.relative_to(_ROOT)).encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


# a stale compilation would measure yesterday's code; read when numba is first imported, which must come after
os.environ.setdefault("NUMBA_CACHE_DIR", str(_ROOT / ".pytest_cache" / "benchmarks" / _fingerprint()))
