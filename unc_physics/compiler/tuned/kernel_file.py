"""Files of compiled kernels: a digest, and the kernel with the key that it was compiled for.

Machine code from a damaged file would crash the process, so nothing is read before the digest is checked.
"""

import contextlib
import hashlib
import os
import pickle
import tempfile

from numba.core.serialize import dumps

SUFFIX = ".kernel"
_DIGEST = hashlib.sha256


def write(path, key, kernel):
    """Write a kernel, in one step for readers; ``key`` is compared on reading."""
    content = dumps((key, kernel))
    file, name = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    try:
        with open(file, "wb") as opened:
            opened.write(_DIGEST(content).digest() + content)
        os.chmod(name, 0o644)  # users share folders that were compiled in advance
        os.replace(name, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(name)
        raise


def read(path, key):
    """Return the kernel of a file, or None if the file is missing, damaged, or of another key."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    size = _DIGEST().digest_size
    if _DIGEST(memoryview(data)[size:]).digest() != data[:size]:
        return None
    found, kernel = pickle.loads(memoryview(data)[size:])
    return kernel if found == key else None
