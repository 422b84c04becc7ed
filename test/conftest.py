"""What all tests share: a compile cache that is never stale, and reproducible random examples."""

import hashlib
import os
import sys
from pathlib import Path

from hypothesis import settings

HERE = Path(__file__).resolve().parent
SOURCES = HERE.parent / "unc_physics"
sys.path[:0] = [str(HERE), str(HERE.parent)]  # `twins`, and `unc_physics` where it is not installed


def _fingerprint():
    """Of all sources: numba looks only at the file of the function itself, not at those that it calls."""
    digest = hashlib.sha256()
    for path in sorted(SOURCES.rglob("*.py")):
        digest.update(str(path.relative_to(SOURCES)).encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


# read when numba is first imported, which must come after; child processes inherit it
os.environ.setdefault("NUMBA_CACHE_DIR", str(HERE.parent / ".pytest_cache" / "numba" / _fingerprint()))

settings.register_profile("tests", deadline=None, derandomize=True, max_examples=60)
settings.register_profile("thousands", settings.get_profile("tests"), derandomize=False, max_examples=1000)
settings.load_profile("tests")
