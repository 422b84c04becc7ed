"""Ctrl-C while modules are imported.

Before the package's first line the interpreter starts. There it prints a traceback of its own ``site``
module, which also runs the ``.pth`` files of installed packages; no package can change that.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading

_PACKAGE = __name__.rpartition(".")[0]
_PROGRAMS = _PACKAGE, f"{_PACKAGE}.ros.node", f"{_PACKAGE}.ros.lifecycle_node"
_dying = False  # whether Ctrl-C ends this process by `let_programs_die`


def let_programs_die() -> None:
    """Let Ctrl-C end the process at once, without a traceback, if it is a program of this package.

    For the package's first line: `dying_at_interrupt`, with which the command line begins, takes it back, and
    the nodes have handlers of their own.
    """
    global _dying
    program = sys.argv[0] if getattr(sys, "argv", None) else ""
    if program == "-m":  # so Python calls it until it has found the module
        program = sys.orig_argv[-len(sys.argv)].removeprefix("-m")
    if os.path.basename(program) in _PROGRAMS and _is_untouched():
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        _dying = True


@contextlib.contextmanager
def dying_at_interrupt():
    """Let Ctrl-C end the process at once, without a traceback.

    It is for imports, which leave nothing half done, and some of which swallow a `KeyboardInterrupt`.
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
    """Whether this is the thread that gets interrupts, and nobody has asked for them, or refused them."""
    here = threading.current_thread() is threading.main_thread()
    return here and signal.getsignal(signal.SIGINT) is signal.default_int_handler
