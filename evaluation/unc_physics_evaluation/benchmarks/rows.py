"""Rows of results: printed beside their goals as they come, and written as JSON with versions and machine."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from datetime import datetime, timezone
from pathlib import Path

from unc_physics_evaluation.provenance import machine, versions


@dataclass(frozen=True)
class Row:
    """One figure.

    Attributes
    ----------
    section, what, case : str
        What was measured, and on what.
    value : float
    unit : str
    goal : float or None
        None where the figure only informs.
    at_most : bool
        Whether the goal is an upper bound.
    note : str
        Other figures of the same measurement, in words.
    """

    section: str
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

    def __str__(self):
        goal = "" if self.goal is None else f"{'<=' if self.at_most else '>='} {self.goal:g}"
        verdict = {None: "", True: "met", False: "MISSED"}[self.met]
        return (
            f"  {self.what:34} {self.case:18} {self.value:9.3g} {self.unit:3} {goal:>8} {verdict:7}"
            f" {self.note}".rstrip()
        )


class Report:
    """Collects rows and prints each as it comes, under its section's heading."""

    def __init__(self):
        self.rows: list[Row] = []
        self.skipped: list[str] = []

    def add(self, *args, **kwargs):
        """Add a `Row` made of these arguments."""
        row = Row(*args, **kwargs)
        self.rows.append(row)
        print(row, flush=True)

    def heading(self, text):
        """Begin a section."""
        print(f"\n{text}", flush=True)

    def skip(self, what, why):
        """Say what was not measured."""
        self.skipped.append(f"{what}: {why}")
        print(f"  SKIPPED {what}: {why}", flush=True)

    def write(self, path):
        """Write everything as JSON."""
        content = {
            "made": datetime.now(timezone.utc).isoformat(timespec="seconds"),
            "machine": machine_and_load(),
            "versions": versions(),
            "rows": [asdict(row) | {"value": float(row.value), "met": row.met} for row in self.rows],
            "skipped": self.skipped,
        }
        Path(path).write_text(json.dumps(content, indent=1) + "\n")

    def summary(self):
        """One sentence on the goals."""
        judged = [row for row in self.rows if row.goal is not None]
        missed = [f"{row.what}, {row.case}" for row in judged if not row.met]
        text = f"{len(judged) - len(missed)} of {len(judged)} goals met"
        return text + ("; missed: " + "; ".join(missed) if missed else "")


def machine_and_load() -> str:
    """The machine, and how busy it is."""
    return f"{machine()}, load {os.getloadavg()[0]:.1f}"
