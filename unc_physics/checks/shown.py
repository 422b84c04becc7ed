"""Format values and names from outside for a line of text."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

_LENGTH = 120  # most characters of a value's text, and most entries of a value

_DRAWN = 40  # most characters of a name in a picture
_NAMES = 4  # most names in a short text of many bodies


def printable(text: str) -> str:
    """Escape characters that could add a line or control a terminal."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def drawn_text(text: str) -> str:
    """Format a name for a picture, without Matplotlib's math mode."""
    text = printable(text)
    return (text if len(text) <= _DRAWN else text[: _DRAWN - 3] + "...").replace("$", r"\$")


def plain_digits(value: float, digits: int = 4) -> str:
    """Format a number without exponent, with a number of significant digits."""
    from numpy import format_float_positional

    if not 1e-9 < abs(value) < 1e15:
        return f"{value:.{digits}g}"
    return format_float_positional(value, digits, unique=False, fractional=False, trim="-")


def counted(count: int, noun: str) -> str:
    """Return a number with a noun in singular or plural, as "1 piece" and "2 pieces"."""
    return f"{count} {noun}{'s' * (count != 1)}"


def counted_bodies(names: Sequence[str]) -> str:
    """Return the number of bodies with their names, as "2 bodies (left, right)"; of many the first ones."""
    few = [printable(name) for name in names[:_NAMES]] + ["..."] * (len(names) > _NAMES)
    return f"{len(names)} {'body' if len(names) == 1 else 'bodies'} ({', '.join(few)})"


def shown(value: Any) -> str:
    """Format a value for a sentence: in one line, with plain numbers, shortened."""
    try:
        text = repr(_plain(value, itertools.count()))
    except (ValueError, RecursionError):  # integers of thousands of digits, and recursive containers
        text = "too large to show"
    text = " ".join(text.splitlines())
    return text if len(text) <= _LENGTH else text[: _LENGTH - 3] + "..."


def _plain(value, seen):
    """Convert a value to built-in types, limited to its first entries, which ``seen`` counts."""
    if hasattr(value, "dtype") and hasattr(value, "tolist"):  # a NumPy value; NumPy is not imported for this
        value = value.tolist() if value.size <= _LENGTH else value.ravel()[:_LENGTH].tolist()
    kind = type(value)
    if kind in (list, tuple):
        return kind(_plain(entry, seen) for entry in value if next(seen) < _LENGTH)
    if kind is dict:
        some = (item for item in value.items() if next(seen) < _LENGTH)
        return {key: _plain(entry, seen) for key, entry in some}
    return value[:_LENGTH] if kind in (str, bytes) else value
