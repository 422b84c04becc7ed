"""Folders of compiled kernels: the first writable one, and readable ones before it."""

# pyright: reportAttributeAccessIssue=false
# numba creates its settings at run time

import contextlib
import os
import stat
import tempfile
from pathlib import Path

import numba

PACKAGE = Path(__file__).resolve().parent.parent


def find_folders(name):
    """Find the folders of compiled kernels.

    Parameters
    ----------
    name : str
        Name of the folder in each location.

    Returns
    -------
    folder : Path or None
        Folder to write to, created if necessary; None if no location is writable.
    readable : list of Path
        Folders to read from, starting with `folder`.
    """
    readable = []
    with contextlib.suppress(OSError):
        for place in _places():
            folder = place / name
            with contextlib.suppress(OSError):
                folder.mkdir(parents=True, exist_ok=True)
                tempfile.TemporaryFile(dir=folder).close()
                return folder, [folder, *readable]
            if folder.is_dir():
                readable.append(folder)
    return None, readable


def _places():
    """Yield locations: numba's cache, the package's cache, the user's cache, a temporary folder."""
    if numba.config.CACHE_DIR:
        yield Path(numba.config.CACHE_DIR)
    yield PACKAGE / "__pycache__"
    for caches in (os.environ.get("XDG_CACHE_HOME", ""), os.path.expanduser("~/.cache")):
        if os.path.isabs(caches):
            yield Path(caches) / "unc_physics"
    own = Path(tempfile.gettempdir()) / f"unc_physics-{os.getuid()}"
    own.mkdir(mode=0o700, exist_ok=True)
    found = own.lstat()
    # compiled code is loaded from it, so it must belong to this user
    if stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022:
        yield own
