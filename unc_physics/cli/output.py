"""Output files of commands, and notes on standard error."""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path

from ..checks.errors import OutputError
from ..checks.shown import printable


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
