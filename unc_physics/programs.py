"""Settings of this package's programs, made before anything else is imported: Ctrl-C, and threads of BLAS.

Before the package's first line, during the interpreter's start, Ctrl-C prints a traceback of the ``site``
module. That also runs the ``.pth`` files of installed packages. No package can change this.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading

_PACKAGE = __name__.rpartition(".")[0]
_PROGRAMS = _PACKAGE, f"{_PACKAGE}.ros.node", f"{_PACKAGE}.ros.lifecycle_node"
_EXECUTABLES = "unc_physics_node", "unc_physics_lifecycle_node", "unc_physics_replay"
_BLAS_THREADS = "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"
_dying = False  # whether Ctrl-C ends this process by `let_programs_die`


def let_programs_die() -> None:
    """Let Ctrl-C end the process at once, without a traceback, if it is a program of this package.

    It is called in the package's first line. `dying_at_interrupt`, which the command line calls first,
    reverts it. The nodes install their own handlers.
    """
    global _dying
    if _program() in _PROGRAMS and _is_untouched():
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        _dying = True


def let_programs_use_one_blas_thread() -> None:
    """Let BLAS use one thread if this process is a program of this package.

    Matrices of predictions are small. Threads of OpenBLAS wait for each other in a loop. Where other
    processes run, the eigenvalues of a 120 x 120 matrix take 200 times as long. Rollouts use numba's threads.
    """
    if _program() in (*_PROGRAMS, *_EXECUTABLES):
        for name in _BLAS_THREADS:
            os.environ.setdefault(name, "1")


def _program():
    """Return the name of the running program, or the module that Python runs."""
    program = sys.argv[0] if getattr(sys, "argv", None) else ""
    if program == "-m":  # Python's value until it has found the module
        program = sys.orig_argv[-len(sys.argv)].removeprefix("-m")
    return os.path.basename(program)


@contextlib.contextmanager
def dying_at_interrupt():
    """Let Ctrl-C end the process at once, without a traceback.

    It is for imports, which have no side effects. Some of them suppress a `KeyboardInterrupt`.
    """
    global _dying
    if not (_dying or _is_untouched()):
        yield
        return
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        _dying = False


def _is_untouched():
    """Return whether this is the main thread, and SIGINT has Python's default handler."""
    here = threading.current_thread() is threading.main_thread()
    return here and signal.getsignal(signal.SIGINT) is signal.default_int_handler
