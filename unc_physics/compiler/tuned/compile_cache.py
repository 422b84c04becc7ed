"""Cache of compiled kernels: one folder per compiler and processor, in a writable location.

Each kernel's file is named by its stamp (`kernel_stamp`), so that an edit recompiles only dependent kernels.
Kernels compiled in advance are also loaded from the package (`SHIPPED_FOLDER`), and from folders that this
user cannot write. Shipped kernels are preferred, as their callees are shipped, too.
"""

# pyright: reportAttributeAccessIssue=false
# numba makes its settings and the attributes of its caches at run time

import contextlib
import fcntl
import hashlib
import os
import sys
import time
from pathlib import Path
from typing import NamedTuple

import llvmlite
import numba
import numpy
from numba.core import caching
from numba.core.dispatcher import Dispatcher

from .. import versions
from ..cache_folder import PACKAGE, find_folders
from ..refusal import is_refused
from . import kernel_file
from .kernel_stamp import stamp
from .noinline import keep_address, needed
from .target import Target, supported_targets

#: Folder of the kernels that come with a wheel; a folder for each compiler and target is in it.
SHIPPED_FOLDER = PACKAGE / "kernels"

# modules that determine how kernels are compiled, and the content of their files
_COMPILE = "compilation", "compile_cache", "kernel_file", "kernel_stamp", "noinline", "references", "target"
_UNUSED = 24.0 * 3600.0  # age after which an unused file is removed if a newer state exists [s]
_LOOK, _PATIENCE = 0.05, 300.0  # interval and limit of waiting for another process's compilation [s]


class _Folder(NamedTuple):
    """Folder of kernels, and the fingerprint of their compilers and target."""

    path: Path
    made_by: str


def fingerprint(target):
    """Return a text that depends on the compilers, the cache format, and the target.

    Of numpy only the major version counts: kernels contain none of its code, but its rules for types.
    """
    compilers = [numba.__version__, llvmlite.__version__, numpy.__version__.partition(".")[0]]
    python = sys.implementation.cache_tag
    digest = hashlib.sha256("\0".join([*compilers, python, *target, __name__]).encode())
    for name in _COMPILE:
        digest.update(b"\0" + Path(__file__).with_name(f"{name}.py").read_bytes())
    return digest.hexdigest()[:16]


def _clean(folder):
    """Remove long-unused files of sources other than a kernel's newest."""
    states = {}
    for path in folder.glob(f"*{kernel_file.SUFFIX}"):
        states.setdefault(_kernel(path), []).append((_last_use(path), path))
    for of_kernel in states.values():
        for used, path in sorted(of_kernel)[:-1]:
            if time.time() - used > _UNUSED:
                path.unlink(missing_ok=True)


def _kernel(path):
    """Return a kernel's name and types from its file name, NAME-TYPES-STAMP.kernel."""
    return path.name.rpartition("-")[0]


def _last_use(path):
    """Return the time when a file was created or loaded; now, if another process is removing it."""
    try:
        return path.stat().st_mtime
    except OSError:
        return time.time()


def _shipped_folders():
    """Return the folders in the package with kernels of this compiler that this processor runs."""
    names = map(fingerprint, supported_targets())
    return [_Folder(SHIPPED_FOLDER / name, name) for name in names if (SHIPPED_FOLDER / name).is_dir()]


def _own_folders():
    """Return the folder to write to or None, the folders to read from, and their fingerprint."""
    name = fingerprint(Target.current())
    folder, readable = find_folders(f"kernels-{name}")
    return folder, [_Folder(path, name) for path in readable], name


FOLDER, _OWN, _MADE_BY = _own_folders()
_FOLDERS = [*_shipped_folders(), *_OWN]
if FOLDER is not None:
    with contextlib.suppress(OSError):
        _clean(FOLDER)


def keep(compiled):
    """Make a function load its compiled code from a folder, and save it if missing."""
    if isinstance(compiled, Dispatcher) and (_FOLDERS or versions.is_off()):
        compiled._cache = _KernelCache(compiled.py_func)
    return compiled


class _Locator(caching._CacheLocator):
    """Cache locator for numba, which asks before the functions that a kernel calls exist."""

    def __init__(self, function, file):
        self._py_file = file  # numba's warnings name it

    @classmethod
    def from_function(cls, function, file):
        return cls(function, file)

    def get_cache_path(self):
        return str(FOLDER or "")

    def get_source_stamp(self):
        return ""

    def get_disambiguator(self):
        return None


class _CompiledFunctions(caching.CompileResultCacheImpl):
    _locator_classes = (_Locator,)


class _KernelCache(caching.FunctionCache):
    """numba's function cache with another location, tolerant of a full disk or damaged files.

    A process waits for another's compilation of the same kernel, since compiling it again would not be
    faster. Kernels call each other in one direction only, so processes never wait for each other.
    """

    _impl_class = _CompiledFunctions
    _lock = None

    def _load_overload(self, sig, target_context):
        loaded = self._loaded(sig, target_context)
        if loaded is None and versions.is_off():
            raise RuntimeError(
                f"{self._name} is not compiled for {sig}, and environment variable {versions.VARIABLE} is"
                " 'off'; unset it to compile"
            )
        if loaded is None and is_refused():  # numba raises the refusal next
            return None
        began = time.monotonic()
        while loaded is None and self._enabled and not self._locks(sig):
            if time.monotonic() - began > _PATIENCE:
                return None
            time.sleep(_LOOK)
            loaded = self._loaded(sig, target_context)
        if loaded is None and self._enabled:
            loaded = self._loaded(sig, target_context)  # saved just before the lock was released
        if loaded is not None:
            self._unlock()
        return loaded

    def _locks(self, sig):
        """Return whether this process may compile: no other process seems to compile the kernel."""
        if FOLDER is None or self._lock is not None:
            return True
        try:
            lock = open(FOLDER / f"{self._file_name(sig)}.lock", "wb")  # noqa: SIM115  (until it is saved)
        except OSError:
            return True
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
            return False
        except OSError:
            lock.close()
            return True
        self._lock = lock
        return True

    def _unlock(self):
        if self._lock is not None:
            with contextlib.suppress(OSError):
                os.unlink(self._lock.name)
            self._lock.close()
            self._lock = None

    def _loaded(self, sig, target_context):
        codegen, name = target_context.codegen(), self._file_name(sig)
        for folder in _FOLDERS if self._enabled else ():
            path = folder.path / name
            data = kernel_file.read(path, _key(sig, codegen, name, folder.made_by))
            if data is None:
                continue
            needed, callee, data = data
            if not all(called.is_loaded() for called in needed):
                continue
            if callee:
                callee.announce(codegen)
            loaded = self._impl.rebuild(target_context, data)
            loaded.library.needed, loaded.library.callee = needed, callee
            if folder.path == FOLDER:
                with contextlib.suppress(OSError):
                    os.utime(path)
            return loaded
        return None

    def _save_overload(self, sig, data):
        try:
            if self._enabled and FOLDER is not None and self._impl.check_cachable(data):
                keep_address(self._py_func, data)
                saved = needed(data.library), getattr(data.library, "callee", None), self._impl.reduce(data)
                name = self._file_name(sig)
                with contextlib.suppress(OSError):  # the disk may be full
                    kernel_file.write(FOLDER / name, _key(sig, data.codegen, name, _MADE_BY), saved)
        finally:
            self._unlock()

    def _file_name(self, sig):
        name = f"{self._py_func.__module__}.{self._py_func.__qualname__}".replace(".<locals>", "")
        kinds = hashlib.sha256(str(sig).encode()).hexdigest()[:8]
        return f"{name}-{kinds}-{stamp(self._py_func, sig)}{kernel_file.SUFFIX}"


def _key(sig, codegen, name, made_by):
    """Return all that a kernel's file must agree with; its name contains the stamp."""
    return sig, codegen.magic_tuple()[0], name, made_by
