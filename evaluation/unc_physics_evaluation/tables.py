"""Markdown tables, and how methods and figures are written in them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from unc_physics.propagators.names import REFERENCE
from unc_physics.propagators.registry import PROPAGATORS

#: What is compared beside the propagators.
LABELS = {"sigma_points_full": "sigma points, full", "gaussian": "best Gaussian", "floor": "floor"}


def label(method: str, samples: int | None = None) -> str:
    """A method's name for people."""
    if method == REFERENCE and samples is not None:
        return f"MC-{samples}"
    if method in PROPAGATORS:
        return PROPAGATORS[method].label
    return LABELS.get(method, method.replace("_", " "))


def number(value: float) -> str:
    """A figure with three digits, or nothing where it is missing."""
    if not math.isfinite(value):
        return ""
    return f"{value:.0f}" if abs(value) >= 999.5 else f"{value:#.3g}".rstrip(".")


def table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A Markdown table; the first column to the left, all others to the right."""
    rows = [head, ["---", *["--:"] * (len(head) - 1)], *lines]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n"
