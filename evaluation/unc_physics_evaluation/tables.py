"""Markdown tables, and how figures are written in them."""

from __future__ import annotations

import math
from collections.abc import Sequence


def number(value: float) -> str:
    """A figure with three digits, or nothing where it is missing."""
    if not math.isfinite(value):
        return ""
    return f"{value:.0f}" if abs(value) >= 999.5 else f"{value:#.3g}".rstrip(".")


def table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A Markdown table; the first column to the left, all others to the right."""
    rows = [head, ["---", *["--:"] * (len(head) - 1)], *lines]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n"
