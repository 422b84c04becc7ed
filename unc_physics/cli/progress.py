"""That long work goes on: a bar on a terminal, and elsewhere a note now and then."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator

from .output import note

PROGRESS_AFTER = 2.0  # s, until a bar is drawn
NOTE_AFTER = 30.0  # s, until the first note; each next one when that has doubled


@contextlib.contextmanager
def told_progress(name: str, unit: str, work: str) -> Iterator[Callable[[int, int], None] | None]:
    """Around work that may take long.

    Yields what is to be told how much is done, of how much; None where there is no terminal, since work that
    tells it goes in small pieces, which cost time.

    Parameters
    ----------
    name : str
        What works.
    unit : str
        What is counted, in the singular.
    work : str
        What it works at, for the notes.
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
    """Note on standard error that work goes on, until it is over."""
    started, pause = time.monotonic(), NOTE_AFTER
    while not over.wait(pause):
        pause = time.monotonic() - started
        note(
            f"{what} after {pause:.0f} s; --time-limit or Ctrl-C ends it, a shorter --horizon is done sooner"
        )
