"""Pareto fronts of time and error."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple


class Choice(NamedTuple):
    """Time and error of a method.

    Attributes
    ----------
    method : str
    samples : int or None
    time : float
        [s]
    error : float
        Error over the floor.
    scatter : (float, float) or None
        Quartiles of the error.
    """

    method: str
    samples: int | None
    time: float
    error: float
    scatter: tuple[float, float] | None = None


def front(choices: Iterable[Choice]) -> list[Choice]:
    """Return the choices that no other one beats in both time and error, fastest first."""
    best: list[Choice] = []
    for choice in sorted(choices, key=lambda c: (c.time, c.error)):
        if not best or choice.error < best[-1].error:
            best.append(choice)
    return best
