"""Where compiled kernels are kept: a folder for each compiler and processor, where something can be written.

Each kernel's file is named by its stamp (`kernel_stamp`), so an edit compiles anew what depends on it, and
nothing else. Kernels that were compiled ahead load also from where this user cannot write.
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

# modules that say how kernels are compiled, and what a kernel's file holds
_COMPILE = "compilation", "compile_cache", "kernel_stamp", "noinline", "references"
_UNUSED = 24.0 * 3600.0  # what has a newer state goes when it was unused for so long [s]
_LOOK, _PATIENCE = 0.05, 300.0  # how often, and how long, to see whether another process has compiled it [s]


def fingerprint():
    """Text that changes with what compiles the kernels and keeps them, and with the processor."""
    python, processor = sys.implementation.cache_tag, llvmlite.binding.get_host_cpu_name()
    compilers = [module.__version__ for module in (numba, llvmlite, numpy)]
    digest = hashlib.sha256("\0".join([*compilers, python, processor, __name__]).encode())
    for name in _COMPILE:
        digest.update(b"\0" + Path(__file__).with_name(f"{name}.py").read_bytes())
    return digest.hexdigest()[:16]


def _clean(folder):
    """Remove what was compiled from other sources than the newest of its kernel, and unused for long."""
    states = {}
    for index in folder.glob("*.nbi"):
        states.setdefault(_kernel(index), []).append((_last_use(index), index))
    for of_kernel in states.values():
        for used, index in sorted(of_kernel)[:-1]:
            if time.time() - used > _UNUSED:
                for path in [index, *folder.glob(glob.escape(index.stem) + ".*.nbc")]:
                    path.unlink(missing_ok=True)


def _kernel(index):
    """Name of a kernel, of the name of its file: NAME-STAMP.nbi."""
    return index.name.rpartition("-")[0]


def _last_use(path):
    """Time when a file was made or loaded; now, if another process is just removing it."""
    try:
        return path.stat().st_mtime
    except OSError:
        return time.time()


FOLDER, _FOLDERS = find_folders(f"kernels-{fingerprint()}")
if FOLDER is not None:
    with contextlib.suppress(OSError):
        _clean(FOLDER)


def keep(compiled):
    """Load a function's compiled code from a folder, and save what is missing."""
    if _FOLDERS and isinstance(compiled, Dispatcher):  # a plain function with NUMBA_DISABLE_JIT
        compiled._cache = _KernelCache(compiled.py_func)
    return compiled


class _Locator(caching._CacheLocator):
    """Tells numba where: it asks before the functions that a kernel calls exist."""

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
    """numba's cache of a function, but for its place and for trouble: a full disk, a damaged file.

    What one process compiles others wait for, since they would not have it any sooner. Kernels call each
    other in one direction only, so no two processes wait for each other.
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
            loaded = self._loaded(sig, target_context)  # saved just before the lock was free
        if loaded is not None:
            self._unlock()
        return loaded

    def _locks(self, sig):
        """Whether this process may compile: no other one is just doing so, as far as can be told."""
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
