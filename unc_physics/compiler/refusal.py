"""Refusal of compilation, for callers that must not wait for it."""

import contextlib
import threading

from numba.core import event


class CompilationRefused(Exception):
    """A kernel would have to be compiled first."""


class _Here(threading.local):
    """Whether this thread refuses to compile."""

    refuses = False


_here = _Here()


class _Refusal(event.Listener):
    """Listener that raises `CompilationRefused` before a kernel is compiled, but not before it is loaded."""

    def on_start(self, event):
        if _here.refuses:
            raise CompilationRefused(event.data["dispatcher"].py_func.__name__)

    def on_end(self, event):
        pass


def is_refused():
    """Return whether this thread refuses to compile."""
    return _here.refuses


@contextlib.contextmanager
def refused_compilation(refuses=True):
    """Raise `CompilationRefused` in the ``with`` block where a kernel would have to be compiled."""
    before, _here.refuses = _here.refuses, refuses
    try:
        yield
    finally:
        _here.refuses = before


def refusing_as_here(run):
    """Return a function that refuses compilation, in any thread, if the calling thread does now."""
    if not _here.refuses:
        return run

    def refusing(*arguments):
        with refused_compilation():
            return run(*arguments)

    return refusing


event.register("numba:compile", _Refusal())
