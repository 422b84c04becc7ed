"""Ctrl-C while modules are imported."""

from __future__ import annotations

import contextlib
import signal
import threading


@contextlib.contextmanager
def dying_at_interrupt():
    """Let Ctrl-C end the process at once, without a traceback.

    It is for imports, which leave nothing half done, and some of which swallow a `KeyboardInterrupt`.
    """
    here = threading.current_thread() is threading.main_thread()
    if not here or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
