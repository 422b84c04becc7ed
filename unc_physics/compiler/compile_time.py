"""Notice of compilation, and its duration, which does not count as prediction time."""

import logging
import threading
import time

from numba.core import event

from .backend import FOLDER

_EACH_TIME = "at every start, as no folder can be written: NUMBA_CACHE_DIR may name one"
#: How long the first use of a kind of scene and method compiles; the page on installation says it, too.
FIRST_USE = "up to two minutes"
_HOW_OFTEN = f"once for each kind of scene and method, {FIRST_USE}" if FOLDER else _EACH_TIME
_PACKAGE = __name__.partition(".")[0]


class _Spent(threading.local):
    """Compilation time of this thread [s], nesting depth, and start of the outermost compilation."""

    seconds, depth, since = 0.0, 0, 0.0


_spent = _Spent()


class _Clock(event.Listener):
    """Listener that measures the time in numba's compiler or waiting for it; events are nested."""

    def on_start(self, event):
        if _spent.depth == 0:
            _spent.since = time.perf_counter()
        _spent.depth += 1

    def on_end(self, event):
        _spent.depth -= 1
        if _spent.depth == 0:
            _spent.seconds += time.perf_counter() - _spent.since


class _Notice(event.Listener):
    """Listener that logs the first compilation of a kernel, and counts those that run.

    It is a warning, so that users without logging set up also see why the first prediction is slow.
    """

    said = False
    running = 0  # nested ones, too; numba holds its compiler lock while one begins or ends

    def on_start(self, event):
        self.running += 1
        if not self.said and event.data["dispatcher"].py_func.__module__.partition(".")[0] == _PACKAGE:
            self.said = True
            log = logging.getLogger(_PACKAGE)
            log.warning("Compiling the simulation's kernels for this machine (%s) ...", _HOW_OFTEN)

    def on_end(self, event):
        self.running -= 1


class CompiledKernels(event.Listener):
    """Listener that adds the number of compiled kernels to a number shared by processes."""

    def __init__(self, shared):
        self._shared = shared

    def register(self):
        """Count from now on."""
        event.register("numba:compile", self)

    def on_start(self, event):
        pass

    def on_end(self, event):
        with self._shared.get_lock():
            self._shared.value += 1


def seconds_compiling():
    """Return the time spent on compiling and loading [s], by this thread and for it (`count_compiling`)."""
    return _spent.seconds


def is_compiling() -> bool:
    """Return whether any thread of this process compiles a kernel."""
    return _notice.running > 0


def count_compiling(seconds):
    """Add the compilation time of other threads while this thread waited for them [s]."""
    _spent.seconds += seconds


def clock():
    """Return `time.perf_counter` of this thread [s] without the time of compiling and loading kernels."""
    return time.perf_counter() - _spent.seconds


event.register("numba:compiler_lock", _Clock())
_notice = _Notice()
event.register("numba:compile", _notice)
