"""Markdown tables, and the format of their numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence


def number(value: float) -> str:
    """Format a number with three digits; empty text if it is missing."""
    if not math.isfinite(value):
        return ""
    return f"{value:.0f}" if abs(value) >= 999.5 else f"{value:#.3g}".rstrip(".")


def table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table; the first column is aligned left, others right."""
    rows = [head, ["---", *["--:"] * (len(head) - 1)], *lines]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n"
