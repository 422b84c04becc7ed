"""Progress of long work: a bar on a terminal, otherwise occasional notes."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator

from .output import note

PROGRESS_AFTER = 2.0  # s, until a bar is drawn
NOTE_AFTER = 30.0  # s, until the first note; the interval doubles after each


@contextlib.contextmanager
def told_progress(name: str, unit: str, work: str) -> Iterator[Callable[[int, int], None] | None]:
    """Report the progress of the work in the ``with`` block.

    Yields a function of the amount done and the total, or None without a terminal. Work that reports progress
    runs in small pieces, which is slower.

    Parameters
    ----------
    name : str
        Name of the command or method.
    unit : str
        Unit of progress, singular.
    work : str
        Description of the work, for the notes.
    """
    from tqdm import tqdm

    with tqdm(unit=unit, delay=PROGRESS_AFTER, leave=False, disable=None, desc=name) as bar:

        def show(done, total):
            bar.total = total
            bar.update(done - bar.n)

        if not bar.disable:
            yield show
            return
    over = threading.Event()
    thread = threading.Thread(
        target=_note_until, args=(over, f"{name}: still at work on {work}"), daemon=True
    )
    thread.start()
    try:
        yield None
    finally:
        over.set()
        thread.join()


def _note_until(over, what):
    """Print notes on standard error until the work is over."""
    started, pause = time.monotonic(), NOTE_AFTER
    while not over.wait(pause):
        pause = time.monotonic() - started
        note(
            f"{what} after {pause:.0f} s; --time-limit or Ctrl-C ends it, a shorter --horizon is done sooner"
        )
