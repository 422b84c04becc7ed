"""Cache of compiled kernels: one folder per compiler and processor, in a writable location.

Each kernel's file is named by its stamp (`kernel_stamp`), so that an edit recompiles only dependent kernels.
Kernels compiled in advance are also loaded from folders that this user cannot write.
"""

# pyright: reportAttributeAccessIssue=false
# numba makes its settings and the attributes of its caches at run time

import contextlib
import fcntl
import glob
import hashlib
import os
import pickle
import sys
import time
from pathlib import Path

import llvmlite
import numba
import numpy
from numba.core import caching
from numba.core.dispatcher import Dispatcher

from ..cache_folder import find_folders
from .kernel_stamp import stamp
from .noinline import keep_address, needed

# modules that determine how kernels are compiled, and the content of their files
_COMPILE = "compilation", "compile_cache", "kernel_stamp", "noinline", "references"
_UNUSED = 24.0 * 3600.0  # age after which an unused file is removed if a newer state exists [s]
_LOOK, _PATIENCE = 0.05, 300.0  # interval and limit of waiting for another process's compilation [s]


def fingerprint():
    """Return a text that depends on the compilers, the cache format, and the processor."""
    python, processor = sys.implementation.cache_tag, llvmlite.binding.get_host_cpu_name()
    compilers = [module.__version__ for module in (numba, llvmlite, numpy)]
    digest = hashlib.sha256("\0".join([*compilers, python, processor, __name__]).encode())
    for name in _COMPILE:
        digest.update(b"\0" + Path(__file__).with_name(f"{name}.py").read_bytes())
    return digest.hexdigest()[:16]


def _clean(folder):
    """Remove long-unused files of sources other than a kernel's newest."""
    states = {}
    for index in folder.glob("*.nbi"):
        states.setdefault(_kernel(index), []).append((_last_use(index), index))
    for of_kernel in states.values():
        for used, index in sorted(of_kernel)[:-1]:
            if time.time() - used > _UNUSED:
                for path in [index, *folder.glob(glob.escape(index.stem) + ".*.nbc")]:
                    path.unlink(missing_ok=True)


def _kernel(index):
    """Return a kernel's name from its file name, NAME-STAMP.nbi."""
    return index.name.rpartition("-")[0]


def _last_use(path):
    """Return the time when a file was created or loaded; now, if another process is removing it."""
    try:
        return path.stat().st_mtime
    except OSError:
        return time.time()


FOLDER, _FOLDERS = find_folders(f"kernels-{fingerprint()}")
if FOLDER is not None:
    with contextlib.suppress(OSError):
        _clean(FOLDER)


def keep(compiled):
    """Make a function load its compiled code from a folder, and save it if missing."""
    if _FOLDERS and isinstance(compiled, Dispatcher):  # a plain function with NUMBA_DISABLE_JIT
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
        return str(_FOLDERS[0])

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
        key = self._index_key(sig, target_context.codegen())
        for folder in _FOLDERS if self._enabled else ():
            with self._guard_against_spurious_io_errors():
                file = self._file(folder, sig)
                data = file.load(key)
                if data is not None:
                    needed, callee, data = data
                    if not all(called.is_loaded() for called in needed):
                        continue
                    if callee:
                        callee.announce(target_context.codegen())
                    loaded = self._impl.rebuild(target_context, data)
                    loaded.library.needed, loaded.library.callee = needed, callee
                    with contextlib.suppress(OSError):
                        os.utime(file._index_path)
                    return loaded
        return None

    def _save_overload(self, sig, data):
        try:
            if self._enabled and FOLDER is not None and self._impl.check_cachable(data):
                keep_address(self._py_func, data)
                saved = needed(data.library), getattr(data.library, "callee", None), self._impl.reduce(data)
                self._file(FOLDER, sig).save(self._index_key(sig, data.codegen), saved)
        finally:
            self._unlock()

    def _file_name(self, sig):
        return f"{self._py_func.__module__}.{self._py_func.__qualname__}-{stamp(self._py_func, sig)}"

    def _file(self, folder, sig):
        return caching.IndexDataCacheFile(str(folder), self._file_name(sig), "")

    def _index_key(self, sig, codegen):
        return sig, codegen.magic_tuple()

    def _guard_against_spurious_io_errors(self):
        return contextlib.suppress(OSError, EOFError, pickle.UnpicklingError)
