"""Folders for compiled kernels: the first place that can be written, and earlier places that can be read."""

# pyright: reportAttributeAccessIssue=false
# numba makes its settings at run time

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
        Of the folder in each place.

    Returns
    -------
    folder : Path or None
        The folder to write to; it is made where it does not exist. None where no place can be written.
    readable : list of Path
        The folders to read from, `folder` first.
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
    """Folders to try: the user's for numba, the package's own, the user's for caches, a temporary one."""
    if numba.config.CACHE_DIR:
        yield Path(numba.config.CACHE_DIR)
    yield PACKAGE / "__pycache__"
    for caches in (os.environ.get("XDG_CACHE_HOME", ""), os.path.expanduser("~/.cache")):
        if os.path.isabs(caches):
            yield Path(caches) / "unc_physics"
    own = Path(tempfile.gettempdir()) / f"unc_physics-{os.getuid()}"
    own.mkdir(mode=0o700, exist_ok=True)
    found = own.lstat()
    # compiled code is loaded from there, so nobody else may have made it
    if stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022:
        yield own
