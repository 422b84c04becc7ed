"""Report on recorded motions: scores, coverage, and comparison with the outcomes of other motions."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.stats import binomtest

from .experiments import reality as x
from .methods import MARGINAL, OURS, STILL, label
from .results import Results, Rows
from .scores import bootstrap, rms
from .tables import number, table

LEVELS = (0.5, 0.9)
#: Lines of the tables: method, and with what it predicts.
LINES = (
    (OURS, x.DEFAULTS),
    (OURS, x.EXACT),
    (OURS, x.CALIBRATED),
    ("mujoco", x.DEFAULTS),
    ("mujoco", x.CALIBRATED),
    ("pybullet", x.DEFAULTS),
    ("pybullet", x.CALIBRATED),
    (MARGINAL, x.DEFAULTS),
    (STILL, x.DEFAULTS),
)


class Line(NamedTuple):
    """Predictions of a set by one method: values by quantity and motion, and CPU times of a sample [s]."""

    of: str
    method: str
    given: str
    values: dict[str, dict[int, float]]
    times: list[float]

    @property
    def title(self) -> str:
        """Label of the predictions."""
        return label(self.method) + (f", {self.given}" if self.method not in (MARGINAL, STILL) else "")


def lines(rows: Rows) -> list[Line]:
    """Return the predictions of `LINES`, grouped by set."""
    found: dict[tuple, dict[str, dict[int, float]]] = {}
    times: dict[tuple, list[float]] = {}
    for row in rows:
        key = row["set"], row["method"], row["given"]
        if row["quantity"] == x.TIME:
            times.setdefault(key, []).append(row["value"] / row["samples"])
        elif not row["quantity"].startswith("fitted"):
            found.setdefault(key, {}).setdefault(row["quantity"], {})[row["replicate"]] = row["value"]
    return [
        Line(name, method, given, found[name, method, given], times.get((name, method, given), []))
        for name, (method, given) in product(rows.unique("set"), LINES)
        if (name, method, given) in found
    ]


def reality_report(results: Results) -> str:
    """Return the report in Markdown, and write both tables as CSV files."""
    found = lines(results.rows("reality"))
    parts = []
    for name, head, cells in (("reality_scores", *_scores(found)), ("reality_coverage", *_coverage(found))):
        with open(results.folder / f"{name}.csv", "w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([head, *cells])
        parts.append(table(head, cells))
    return "\n".join(parts)


def _scores(found: Sequence[Line]) -> tuple[list[str], list[list[str]]]:
    """Return mean scores, and their reduction relative to the outcomes of other motions, over all times."""
    head = ["motions", "prediction", *(f"position, {when} [mm]" for when in x.TIMES)]
    head += [*(f"rotation, {when} [rad]" for when in x.TIMES), "Brier score of the face"]
    head += ["error of the mean at rest, rms [mm]", "CPU time of 100 samples [ms]"]
    head += [f"{what} above {label(MARGINAL)} [%]" for what in ("position", "rotation")]
    marginal = {line.of: line for line in found if line.method == MARGINAL}
    cells = []
    for line in found:
        own = [f"{line.of}, {len(line.values[f'{x.POSITION_SCORE} rest'])}", line.title]
        own += [_mean(line, f"{x.POSITION_SCORE} {when}", 1e3) for when in x.TIMES]
        own += [_mean(line, f"{x.ROTATION_SCORE} {when}") for when in x.TIMES]
        own += [
            _mean(line, x.BRIER),
            number(1e3 * rms(np.array(list(line.values[f"{x.ERROR} rest"].values())))),
            number(1e5 * float(np.median(line.times))) if line.times else "",
        ]
        for quantity in (x.POSITION_SCORE, x.ROTATION_SCORE):
            other = marginal.get(line.of)
            own.append("" if other in (None, line) else above(line, other, quantity))
        cells.append(own)
    return head, cells


def _mean(line, quantity, factor=1.0):
    own = line.values.get(quantity)
    return number(factor * float(np.mean(list(own.values())))) if own else ""


def above(line: Line, other: Line, quantity: str) -> str:
    """Return the increase of the mean score over another method's in percent, relative at each time.

    The text includes the 95 % interval of a paired bootstrap over motions, and the times with an increase.
    """
    sums: dict[int, list[float]] = {}
    worse = []
    for when in x.TIMES:
        a, b = (one.values.get(f"{quantity} {when}", {}) for one in (line, other))
        both = sorted(a.keys() & b.keys())
        if not both:
            continue
        unit = np.mean([b[k] for k in both])
        differences = np.array([a[k] - b[k] for k in both]) / unit
        if bootstrap(differences, np.random.default_rng(0))[0] > 0.0:
            worse.append(when)
        for k, difference in zip(both, differences, strict=True):
            sums.setdefault(k, []).append(difference)
    pooled = 100.0 * np.array([np.mean(own) for own in sums.values()])
    low, high = bootstrap(pooled, np.random.default_rng(0))
    text = f"{pooled.mean():+.0f} ({low:+.0f} to {high:+.0f})"
    return text + (f"; worse at {', '.join(worse)}" if worse else "")


def _coverage(found: Sequence[Line]) -> tuple[list[str], list[list[str]]]:
    """Return the shares of motions in the regions of each level, with binomial intervals."""
    pairs = list(product(((x.POSITION_RANK, "position"), (x.ROTATION_RANK, "rotation")), LEVELS, x.TIMES))
    head = ["motions", "prediction", *(f"{what} in {100 * p:.0f} %, {when}" for (_, what), p, when in pairs)]
    cells = []
    for line in found:
        own = [f"{line.of}, {len(line.values[f'{x.POSITION_SCORE} rest'])}", line.title]
        for (quantity, _), level, when in pairs:
            ranks = np.array(list(line.values.get(f"{quantity} {when}", {}).values()))
            own.append(_share(int(np.sum(ranks <= level)), len(ranks)) if len(ranks) else "")
        cells.append(own)
    return head, cells


def _share(inside, count):
    low, high = binomtest(inside, count).proportion_ci()
    return f"{100.0 * inside / count:.0f} ({100.0 * low:.0f} to {100.0 * high:.0f})"
