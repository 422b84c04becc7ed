"""Says that kernels are being compiled, and how long that takes: it is no prediction's time."""

import logging
import threading
import time

from numba.core import event

from .backend import FOLDER

_EACH_TIME = "at every start, as no folder can be written: NUMBA_CACHE_DIR may name one"
_HOW_OFTEN = "once for each kind of scene and method, up to two minutes" if FOLDER else _EACH_TIME
_PACKAGE = __name__.partition(".")[0]


class _Spent(threading.local):
    """What this thread has spent so far [s], how many compilations it is in, and since when."""

    seconds, depth, since = 0.0, 0, 0.0


_spent = _Spent()


class _Clock(event.Listener):
    """Counts what a thread spends in numba's compiler, or waits for it; events are nested."""

    def on_start(self, event):
        if _spent.depth == 0:
            _spent.since = time.perf_counter()
        _spent.depth += 1

    def on_end(self, event):
        _spent.depth -= 1
        if _spent.depth == 0:
            _spent.seconds += time.perf_counter() - _spent.since


class _Notice(event.Listener):
    """Says so the first time that something is compiled and not loaded.

    As a warning: whoever has not set up logging at all should know too why a first prediction takes so long.
    """

    said = False

    def on_start(self, event):
        if not self.said and event.data["dispatcher"].py_func.__module__.partition(".")[0] == _PACKAGE:
            self.said = True
            log = logging.getLogger(_PACKAGE)
            log.warning("Compiling the simulation's kernels for this machine (%s) ...", _HOW_OFTEN)

    def on_end(self, event):
        pass


def seconds_compiling():
    """What this thread, and others for it (`count_compiling`), has spent on compiling and loading [s]."""
    return _spent.seconds


def count_compiling(seconds):
    """Add what other threads spent while this one waited for them [s]."""
    _spent.seconds += seconds


def clock():
    """`time.perf_counter` of this thread [s], which stands still while kernels are compiled or loaded."""
    return time.perf_counter() - _spent.seconds


event.register("numba:compiler_lock", _Clock())
event.register("numba:compile", _Notice())
