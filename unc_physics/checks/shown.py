"""Values and names of others, as they may stand in a line of text."""

from __future__ import annotations

import itertools
from typing import Any

_LENGTH = 120  # of a value's text, which has no more entries than characters

_DRAWN = 40  # of a name in a picture


def printable(text: str) -> str:
    """A text in which nothing can forge a line or command a terminal: such characters are escaped."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def drawn_text(text: str) -> str:
    """A name as a picture shows it, which Matplotlib takes for no formula."""
    text = printable(text)
    return (text if len(text) <= _DRAWN else text[: _DRAWN - 3] + "...").replace("$", r"\$")


def plain_digits(value: float, digits: int = 4) -> str:
    """A number without an exponent, of which so many digits count."""
    from numpy import format_float_positional

    if not 1e-9 < abs(value) < 1e15:
        return f"{value:.{digits}g}"
    return format_float_positional(value, digits, unique=False, fractional=False, trim="-")


def shown(value: Any) -> str:
    """A value as a sentence shows it: in one line, with plain numbers, shortened."""
    try:
        text = repr(_plain(value, itertools.count()))
    except (ValueError, RecursionError):  # integers of thousands of digits, and what holds itself
        text = "too large to show"
    text = " ".join(text.splitlines())
    return text if len(text) <= _LENGTH else text[: _LENGTH - 3] + "..."


def _plain(value, seen):
    """The same value of Python's own kinds; of a large one the first entries, which ``seen`` counts."""
    if hasattr(value, "dtype") and hasattr(value, "tolist"):  # NumPy's, which is not imported for this
        value = value.tolist() if value.size <= _LENGTH else value.ravel()[:_LENGTH].tolist()
    kind = type(value)
    if kind in (list, tuple):
        return kind(_plain(entry, seen) for entry in value if next(seen) < _LENGTH)
    if kind is dict:
        some = (item for item in value.items() if next(seen) < _LENGTH)
        return {key: _plain(entry, seen) for key, entry in some}
    return value[:_LENGTH] if kind in (str, bytes) else value
