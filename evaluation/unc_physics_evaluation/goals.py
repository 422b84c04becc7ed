"""Measured values and their goals: tables of met and missed goals, and one sentence on all of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from .results import Results, Rows
from .tables import number, table


class Figure(NamedTuple):
    """One measured value of a report.

    Attributes
    ----------
    what, case : str
        Quantity and case.
    value : float
    unit : str
        ``x`` for a ratio.
    goal : float or None
        None without a goal.
    at_most : bool
        Whether the goal is an upper bound.
    note : str
        Other values of the same measurement, in words.
    """

    what: str
    case: str
    value: float
    unit: str = "x"
    goal: float | None = None
    at_most: bool = False
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the goal is met; None without a goal."""
        if self.goal is None:
            return None
        return bool(self.value <= self.goal if self.at_most else self.value >= self.goal)

    def cells(self) -> list[str]:
        """Return the line of the table."""
        bound = "" if self.goal is None else f"{'≤' if self.at_most else '≥'} {self.goal:g}, "
        verdict = {None: "", True: f"{bound}met", False: f"**{bound}missed**"}[self.met]
        return [self.what, self.case, f"{number(self.value)} {self.unit}".strip(), verdict, self.note]


def goal_tables(sections: Mapping[str, Sequence[Figure]]) -> str:
    """Return a heading and a table for each section with values."""
    head = ["", "", "", "goal", ""]
    return "\n".join(
        f"{heading}:\n\n{table(head, [figure.cells() for figure in figures])}"
        for heading, figures in sections.items()
        if figures
    )


def goals_met_by(sections: Callable[[Results], Mapping[str, Sequence[Figure]]]) -> Callable[[Results], str]:
    """Return a function for an experiment's verdict: one sentence on its goals."""

    def verdict(results):
        judged = [
            figure for figures in sections(results).values() for figure in figures if figure.goal is not None
        ]
        missed = [f"{figure.what}, {figure.case}" for figure in judged if not figure.met]
        text = f"{len(judged) - len(missed)} of {len(judged)} goals met"
        return text + ("; missed: " + "; ".join(missed) if missed else "")

    return verdict


def ratio(slow: Rows, fast: Rows) -> float:
    """Return the median ratio of two times over the rounds."""
    return float(np.median(slow.values() / fast.values()))
