"""Where compiled kernels are kept: a folder for each state of the sources, where something can be written.

numba notices an edit of the file that holds a function, not one of the functions that it calls. So all that
is compiled from the same sources by the same numba for the same processor has a folder of its own.
"""

# pyright: reportAttributeAccessIssue=false
# numba makes its settings and the attributes of its caches at run time

import contextlib
import hashlib
import os
import pickle
import re
import shutil
import stat
import tempfile
import time
from pathlib import Path

import llvmlite
import numba
import numpy
from numba.core import caching
from numba.core.dispatcher import Dispatcher

PACKAGE = Path(__file__).resolve().parent.parent
_NO_KERNELS = ("ros", "cli")  # an edit there compiles nothing anew, but of a file that has kernels
_KEPT, _UNUSED = 3, 24.0 * 3600.0  # a folder goes that is not among the newest, and unused for so long [s]


def fingerprint():
    """Text that changes with the kernels' sources, the versions of what compiles them, and the processor."""
    processor = llvmlite.binding.get_host_cpu_name()
    compilers = [module.__version__ for module in (numba, llvmlite, numpy)]
    digest = hashlib.sha256("\0".join([*compilers, processor]).encode())
    for path in sorted(PACKAGE.rglob("*.py")):
        name, source = path.relative_to(PACKAGE), path.read_bytes()
        if name.parts[0] not in _NO_KERNELS or b"physics.compiled import" in source:
            digest.update(b"\0" + str(name).encode() + b"\0" + source)
    return digest.hexdigest()[:16]


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


def find_folder():
    """The folder of these sources, made where it does not exist; None where nothing can be written."""
    name = f"kernels-{fingerprint()}"
    with contextlib.suppress(OSError):
        for place in _places():
            with contextlib.suppress(OSError):
                folder = place / name
                folder.mkdir(parents=True, exist_ok=True)
                tempfile.TemporaryFile(dir=folder).close()
                os.utime(folder)
                _clean(place)
                return folder
    return None


def _clean(place):
    """Remove what other sources left in a place long ago; a process that still uses it makes it anew."""
    folders = [path for path in place.glob("kernels-*") if re.fullmatch("kernels-[0-9a-f]{16}", path.name)]
    for path in sorted(folders, key=_last_use)[:-_KEPT]:
        if time.time() - _last_use(path) > _UNUSED:
            shutil.rmtree(path, ignore_errors=True)


def _last_use(folder):
    """Time of the last start of a process that uses the folder; now, if another is just removing it."""
    try:
        return folder.stat().st_mtime
    except OSError:
        return time.time()


FOLDER = find_folder()


def keep(compiled):
    """Load a function's compiled code from the folder, and save there what is missing."""
    if FOLDER is not None and isinstance(compiled, Dispatcher):  # a plain function with NUMBA_DISABLE_JIT
        compiled._cache = _KernelCache(compiled.py_func)
    return compiled


class _Locator(caching._CacheLocator):
    """Tells numba the folder, and names of files that no two functions share."""

    def __init__(self, function, file):
        self._py_file = file  # numba's warnings name it
        self._name = f"{function.__module__}-{function.__code__.co_firstlineno}"

    @classmethod
    def from_function(cls, function, file):
        return cls(function, file)

    def get_cache_path(self):
        return str(FOLDER)

    def get_source_stamp(self):
        return Path(self.get_cache_path()).name

    def get_disambiguator(self):
        return self._name


class _CompiledFunctions(caching.CompileResultCacheImpl):
    _locator_classes = (_Locator,)


class _KernelCache(caching.FunctionCache):
    """numba's cache of a function, but for trouble: a full disk, a damaged file, a folder that is gone."""

    _impl_class = _CompiledFunctions

    def _guard_against_spurious_io_errors(self):
        return contextlib.suppress(OSError, EOFError, pickle.UnpicklingError)
