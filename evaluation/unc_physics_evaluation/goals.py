"""Figures beside their goals: tables that say met or missed, and one sentence on all of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from .results import Results, Rows
from .tables import number, table


class Figure(NamedTuple):
    """One figure of a report.

    Attributes
    ----------
    what, case : str
        What was measured, and on what.
    value : float
    unit : str
        ``x`` for how many times more.
    goal : float or None
        None where the figure only informs.
    at_most : bool
        Whether the goal is an upper bound.
    note : str
        Other figures of the same measurement, in words.
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
        """Whether the goal is reached; None without a goal."""
        if self.goal is None:
            return None
        return bool(self.value <= self.goal if self.at_most else self.value >= self.goal)

    def cells(self) -> list[str]:
        """Its line in a table."""
        bound = "" if self.goal is None else f"{'≤' if self.at_most else '≥'} {self.goal:g}, "
        verdict = {None: "", True: f"{bound}met", False: f"**{bound}missed**"}[self.met]
        return [self.what, self.case, f"{number(self.value)} {self.unit}".strip(), verdict, self.note]


def goal_tables(sections: Mapping[str, Sequence[Figure]]) -> str:
    """A table of each section that has figures, below its heading."""
    head = ["", "", "", "goal", ""]
    return "\n".join(
        f"{heading}:\n\n{table(head, [figure.cells() for figure in figures])}"
        for heading, figures in sections.items()
        if figures
    )


def goals_met_by(sections: Callable[[Results], Mapping[str, Sequence[Figure]]]) -> Callable[[Results], str]:
    """An experiment's verdict from its figures: one sentence on their goals."""

    def verdict(results):
        judged = [
            figure for figures in sections(results).values() for figure in figures if figure.goal is not None
        ]
        missed = [f"{figure.what}, {figure.case}" for figure in judged if not figure.met]
        text = f"{len(judged) - len(missed)} of {len(judged)} goals met"
        return text + ("; missed: " + "; ".join(missed) if missed else "")

    return verdict


def ratio(slow: Rows, fast: Rows) -> float:
    """Median over the rounds of how many times longer one took than the other."""
    return float(np.median(slow.values() / fast.values()))
