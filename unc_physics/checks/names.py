"""Suggestions for unknown names."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def hint(name: str, known: Iterable[str]) -> str:
    """Return the end of a sentence about an unknown name: the closest known name, or all if they are few."""
    known = list(known)
    close = difflib.get_close_matches(name[:50], known, n=1)
    if close:
        return f"; did you mean '{close[0]}'?"
    shown = known[:10] + ["..."] * (len(known) > 10)
    return f"; there {'is' if len(known) == 1 else 'are'} {', '.join(shown)}" if known else "; there is none"
