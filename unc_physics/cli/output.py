"""Output files of commands, notes on standard error, and progress of long work."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from ..checks.errors import OutputError
from ..checks.shown import printable

PROGRESS_AFTER = 2.0  # s, until a bar is drawn
NOTE_AFTER = 30.0  # s, until the first note; the interval doubles after each
_REMEDY = "--time-limit or Ctrl-C ends it, a shorter --horizon takes less time"


def note(text: str) -> None:
    """Print a note about something harmless but possibly unintended on standard error."""
    print(f"unc_physics: note: {printable(text)}", file=sys.stderr)


def check_output(path, suffix: str, field: str) -> Path:
    """Return the path of a file to write, after a check that its folder is writable.

    Raises
    ------
    OutputError
    """
    path = Path(path)
    if path.suffix != suffix:
        raise OutputError(f"must end in {suffix}", field=field, value=str(path))
    try:
        if not path.parent.is_dir():
            raise OutputError("is in a folder that does not exist", field=field, value=str(path))
        if path.is_dir() or not os.access(path.parent, os.W_OK):
            raise OutputError("cannot be written", field=field, value=str(path))
    except ValueError:  # a null character
        raise OutputError("is no path", field=field, value=str(path)) from None
    return path


@contextlib.contextmanager
def writing(path: Path, field: str):
    """Wrap the writing of a file: report a replaced file, and raise an error if it fails.

    Raises
    ------
    OutputError
    """
    existed = path.exists()
    try:
        yield
    except OSError as error:
        if not existed:
            with contextlib.suppress(OSError):
                path.unlink()  # the incomplete file
        raise OutputError(
            f"cannot be written: {error.strerror or error}", field=field, value=str(path)
        ) from error
    if existed:
        note(f"{path} was there already, and is replaced")


@contextlib.contextmanager
def progress_display(
    name: str, unit: str, work: str, remedy: str = _REMEDY
) -> Iterator[Callable[[int, int], None] | None]:
    """Report the progress of the work in the ``with`` block.

    Yields a function of the amount done and the total, or None without a terminal. Work that reports progress
    runs in small pieces, which is slower.

    Parameters
    ----------
    name : str
        Name of the command or method.
    unit : str
        Unit of progress, singular.
    work, remedy : str
        Description of the work, and what makes it shorter, for the notes.
    """
    from tqdm import tqdm

    with tqdm(unit=unit, delay=PROGRESS_AFTER, leave=False, disable=None, desc=name) as bar:

        def show(done, total):
            bar.total = total
            bar.update(done - bar.n)

        if not bar.disable:
            timer = threading.Timer(PROGRESS_AFTER, bar.refresh)  # if nothing is done until then
            timer.daemon = True
            timer.start()
            try:
                yield show
            finally:
                timer.cancel()
            return
    over = threading.Event()
    thread = threading.Thread(target=_note_until, args=(over, name, work, remedy), daemon=True)
    thread.start()
    try:
        yield None
    finally:
        over.set()
        thread.join()


def _note_until(over, name, work, remedy):
    """Print notes on standard error until the work is over."""
    started, pause = time.monotonic(), NOTE_AFTER
    while not over.wait(pause):
        from ..compiler.compile_time import is_compiling  # slow to import

        pause = time.monotonic() - started
        doing, then = f"at work on {work}", remedy
        if is_compiling():
            doing, then = "compiling kernels", "Ctrl-C ends it"
        note(f"{name}: still {doing} after {pause:.0f} s; {then}")
