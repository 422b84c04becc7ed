"""The report on tosses: scores, coverage, differences, what was tuned, reliability, goals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .experiments import tosses as x
from .goals import Figure, goal_tables, goals_met_by
from .methods import MARGINAL, MONTE_CARLO, OURS, label
from .recorded_tosses import FACES
from .results import Results, Rows
from .rollouts import ENGINES
from .scores import bootstrap
from .tables import number, table

LEVELS = (0.5, 0.9, 0.95)
_ENGINES = ("pybullet", "mujoco")


class Line(NamedTuple):
    """One line of the tables: whose predictions, and what they are called."""

    engine: str
    given: str
    method: str
    samples: int | None
    title: str


def lines(rows: Rows) -> list[Line]:
    """All that predicted, those that know least first."""
    found = []
    for method, samples in rows.where(engine=OURS, given=x.AS_GIVEN).curves():
        if method == MARGINAL:
            found.append(Line(OURS, x.AS_GIVEN, method, samples, "outcomes of other tosses"))
        elif method == MONTE_CARLO:
            title = "the authors' friction and restitution, a solid cube"
            found.append(Line(OURS, x.AS_GIVEN, method, samples, title))
    for method, samples in rows.where(engine=OURS, given=x.NO_ERRORS).curves():
        if method == MONTE_CARLO and samples:
            found.append(Line(OURS, x.NO_ERRORS, method, samples, "tuned, without errors of the model"))
    for method, samples in rows.where(engine=OURS, given=x.ERRORS).curves():
        if method != MONTE_CARLO or samples:
            title = f"{label(method, samples)}, tuned"
            found.append(Line(OURS, x.ERRORS, method, samples, title))
    for engine in _ENGINES:
        for method, samples in rows.where(engine=engine).curves():
            if samples:
                title = f"{ENGINES[engine]}, tuned"
                found.append(Line(engine, x.ERRORS, method, samples, title))
    return found


def values(rows: Rows, line: Line, quantity: str) -> dict[int, float]:
    """A quantity of every toss that has it."""
    own = rows.where(
        engine=line.engine, given=line.given, method=line.method, samples=line.samples, quantity=quantity
    )
    return {row["replicate"]: row["value"] for row in own}


def mean(rows: Rows, line: Line, quantity: str) -> float:
    """Its mean over tosses."""
    return float(np.mean(list(values(rows, line, quantity).values())))


def coverage(rows: Rows, line: Line, quantity: str, level: float) -> float:
    """The share of tosses within the region of a level."""
    return float(np.mean(np.array(list(values(rows, line, quantity).values())) <= level))


def toss_report(results: Results) -> str:
    """The whole report in Markdown; draws the reliability diagrams."""
    rows = results.rows("tosses")
    found = lines(rows)
    parts = [
        _score_table(rows, found),
        "### Share of tosses in the regions of 50, 90 and 95 %\n",
        _coverage_table(rows, found),
    ]
    differences = _differences(rows, found)
    if differences:
        parts += [
            "### Our mean score less theirs, with the 95 % interval of a paired bootstrap\n",
            differences,
        ]
    parts += ["### Tuned values, mean and standard deviation over folds\n", _tuned_table(rows)]
    parts.append(goal_tables(figures(results)))
    from .toss_plots import draw_reliability

    path = results.figure("tosses_reliability")
    draw_reliability(path, rows, found)
    parts.append(f"![Reliability](figures/{path.name})\n")
    return "\n".join(parts)


def _score_table(rows, found):
    head = ["", "Brier", "log", "position [mm], 0.1 s", "0.2 s", "0.4 s", "rest"]
    head += ["rotation [rad], 0.1 s", "0.2 s", "0.4 s", "rest", "CPU for a toss [ms]"]
    body = [["uniform guess", number(1.0 - 1.0 / FACES), number(np.log(FACES)), *[""] * 9]]
    for line in found:
        cells = [number(mean(rows, line, x.BRIER)), number(mean(rows, line, x.LOG))]
        cells += [number(1e3 * mean(rows, line, f"{x.POSITION_SCORE} {when}")) for when in x.LABELS]
        cells += [number(mean(rows, line, f"{x.ROTATION_SCORE} {when}")) for when in x.LABELS]
        spent = list(values(rows, line, x.COST).values())
        body.append([line.title, *cells, number(1e3 * float(np.mean(spent))) if spent else ""])
    return table(head, body)


def _coverage_table(rows, found):
    head = ["", *(f"{what}, {when}" for what in ("position", "rotation") for when in x.LABELS)]
    body = []
    for line in found:
        cells = [line.title]
        for quantity in (x.POSITION_RANK, x.ROTATION_RANK):
            for when in x.LABELS:
                shares = [coverage(rows, line, f"{quantity} {when}", level) for level in LEVELS]
                cells.append(" ".join(f"{100.0 * share:.0f}" for share in shares))
        body.append(cells)
    return table(head, body)


def _differences(rows, found):
    ours = next((line for line in found if _is_ours(line)), None)
    theirs = [line for line in found if line.engine != OURS]
    if ours is None or not theirs:
        return ""
    body = []
    for line in theirs:
        cells = [line.title]
        for quantity, factor in _COMPARED.items():
            a, b = values(rows, ours, quantity), values(rows, line, quantity)
            both = np.array([a[k] - b[k] for k in sorted(a.keys() & b.keys())]) * factor
            low, high = bootstrap(both, np.random.default_rng(0))
            cells.append(f"{both.mean():+.3g} ({low:+.3g} to {high:+.3g})")
        body.append(cells)
    head = ["", "Brier", "log", *(f"position [mm], {when}" for when in x.LABELS)]
    return table([*head, *(f"rotation [rad], {when}" for when in x.LABELS)], body)


_COMPARED = (
    {x.BRIER: 1.0, x.LOG: 1.0}
    | {f"{x.POSITION_SCORE} {when}": 1e3 for when in x.LABELS}
    | {f"{x.ROTATION_SCORE} {when}": 1.0 for when in x.LABELS}
)


def _is_ours(line):
    """Whether it is Monte Carlo of ours that the engines are compared with."""
    return line[:4] == (OURS, x.ERRORS, MONTE_CARLO, x.SAMPLES)


def _tuned_table(rows):
    engines = [name for name in ENGINES if rows.where(engine=name, given=x.ERRORS)]
    kinds = [(OURS, x.NO_ERRORS), *((name, x.ERRORS) for name in engines)]
    found = {}
    for engine, given in kinds:
        for row in rows.where(engine=engine, given=given):
            if row["quantity"].startswith(x.TUNED_VALUE):
                key = row["quantity"].removeprefix(f"{x.TUNED_VALUE} "), row["unit"]
                found.setdefault(key, {}).setdefault((engine, given), []).append(row["value"])
    body = []
    for (name, unit), own in found.items():
        cells = [f"{name} [{unit}]"]
        for kind in kinds:
            v = own.get(kind)
            cells.append(f"{number(np.mean(v))} ± {number(np.std(v))}" if v else "")
        body.append(cells)
    head = ["", *(f"{ENGINES[e]}{', no model errors' if g == x.NO_ERRORS else ''}" for e, g in kinds)]
    return table(head, body)


def figures(results: Results) -> dict[str, list[Figure]]:
    """What was to be reached."""
    rows = results.rows("tosses")
    found = lines(rows)
    ours = next((line for line in found if _is_ours(line)), None)
    if ours is None:
        return {"Goals": []}
    made = [
        Figure("Brier score", "face", mean(rows, ours, x.BRIER), "", 0.24, True),
        Figure("log score", "face", mean(rows, ours, x.LOG), "", 0.42, True),
    ]
    for when, goal in zip(x.LABELS, (0.65, 3.7, 9.8), strict=False):
        value = 1e3 * mean(rows, ours, f"{x.POSITION_SCORE} {when}")
        made.append(Figure("energy score, position", when, value, "mm", goal, True))
    engines = [line for line in found if line.engine != OURS]
    rest = f"{x.POSITION_SCORE} rest"
    if engines:
        best = min(mean(rows, line, rest) for line in engines)
        value = mean(rows, ours, rest)
        note = f"{number(1e3 * value)} against {number(1e3 * best)} mm"
        made.append(
            Figure(
                "energy score, position, over the best engine's", "rest", value / best, "x", 1.05, True, note
            )
        )
    for when, goal in zip(x.LABELS, (0.011, 0.12, 0.24, 0.305), strict=True):
        value = mean(rows, ours, f"{x.ROTATION_SCORE} {when}")
        made.append(Figure("energy score, rotation", when, value, "rad", goal, True))
    for when in x.LABELS:
        share = 100.0 * coverage(rows, ours, f"{x.POSITION_RANK} {when}", 0.9)
        made.append(Figure("90 % region, position, at least", when, share, "%", 85.0))
        made.append(Figure("90 % region, position, at most", when, share, "%", 95.0, True))
        share = 100.0 * coverage(rows, ours, f"{x.ROTATION_RANK} {when}", 0.9)
        made.append(Figure("90 % region, rotation", when, share, "%", 80.0))
    truth = next((line for line in found if line.samples == x.TRUTH), None)
    cloud = next((line for line in found if line.method == "cloud"), None)
    if truth is not None and cloud is not None:
        value = mean(rows, cloud, x.LOG) - mean(rows, truth, x.LOG)
        made.append(Figure("log score less that of 1 000 samples", "cloud", value, "", 0.03, True))
    return {"Goals": made}


goals = goals_met_by(figures)
