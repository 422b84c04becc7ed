"""Order of accuracy: errors of single rollouts over the time step, beside other engines."""

from __future__ import annotations

import math

import numpy as np

from unc_physics.checks.errors import DivergedError

from ..jobs import Job, Outcome, Row, Settings
from ..order_cases import CASES, end_states
from ..results import Results
from ..rollouts import ENGINES, available, missing_engines
from ..tables import number, table

TITLE = "Order of accuracy"
RATES = (60, 120, 240, 480, 1000, 2000, 4000)  # steps in a second
QUICK_RATES = (60, 240, 1000)
ERROR = "error"


def jobs(settings: Settings) -> list[Job]:
    """Each case in every engine that is there, at every time step."""
    return [
        Job("orders", settings.parameters(case=case, engine=engine, rate=rate), cost=0.2 + 1e-4 * rate)
        for case in CASES
        for engine in available()
        for rate in (QUICK_RATES if settings.quick else RATES)
    ]


def missing(settings: Settings) -> list[str]:
    """Engines that are not installed."""
    return missing_engines("orders")


def run(job: Job) -> Outcome:
    """The error of one rollout; NaN where it diverges."""
    p = job.parameters
    case = CASES[p["case"]](1.0 / p["rate"])
    try:
        error = case.error(end_states(case, p["engine"]))
    except DivergedError:
        error = math.nan
    return Outcome([Row(p["engine"], ERROR, case.unit, error)])


def observed_order(curve: np.ndarray, floor: float) -> tuple[float, int]:
    """Fit the order of accuracy.

    Parameters
    ----------
    curve : (n, 2) array
        Time steps [s] and errors; NaN for a rollout that diverged.
    floor : float
        Smaller errors do not count.

    Returns
    -------
    order : float
        Slope of log error over log time step; infinite where fewer than two errors are above the floor.
    count : int
        Number of errors above the floor.
    """
    above = curve[curve[:, 1] > floor]
    if np.isnan(curve[:, 1]).any():
        return math.nan, len(above)
    if len(above) < 2:
        return math.inf, len(above)
    steps, errors = np.log(above).T
    return float(np.polyfit(steps, errors, 1)[0]), len(above)


def report(results: Results) -> str:
    """The figure, errors and orders, and what the cases are."""
    from ..order_plots import Panel, draw_orders

    rows = results.rows("orders")
    rates = sorted(rows.unique("rate"))
    shown = rates[::2]  # the figure has all
    panels, lines, cases = [], [], []
    for name in (name for name in CASES if rows.where(case=name)):
        case, curves = CASES[name](1.0 / rates[0]), _curves(rows, name)
        panels.append(Panel(case.title, case.unit, case.floor, curves))
        for engine, curve in curves.items():
            errors = dict(zip(np.rint(1.0 / curve[:, 0]).astype(int).tolist(), curve[:, 1], strict=True))
            cells = [_scientific(errors.get(rate, math.nan)) for rate in shown]
            lines.append([f"{case.title} [{case.unit}]", ENGINES[engine], *cells, _order(curve, case.floor)])
        wanted = "" if case.order is None else str(case.order)
        cases.append(
            [case.title, case.reference, f"{case.horizon:g} s", wanted]
            + [f"{_scientific(case.floor)} {case.unit}", case.reason]
        )
    figure = results.figure("orders")
    draw_orders(figure, panels)
    return "\n".join(
        [
            f"![Error over the time step](figures/{figure.name})\n",
            results.table(
                "order_of_accuracy", ["error", "engine", *(f"1/{rate} s" for rate in shown), "order"], lines
            ),
            table(
                ["case", "answer from", "error after", "order wanted", "floor", "cause of the floor"], cases
            ),
        ]
    )


def _curves(rows, case):
    """Time steps and errors (n, 2) of each engine that has any, the longest step first."""
    found = {}
    for engine in ENGINES:
        own = sorted(rows.where(case=case, engine=engine), key=lambda row: row["rate"])
        if own:
            found[engine] = np.array([(1.0 / row["rate"], row["value"]) for row in own], float)
    return found


def _scientific(value):
    return f"{value:.1e}" if math.isfinite(value) else ""


def _order(curve, floor):
    order, count = observed_order(curve, floor)
    if math.isinf(order):
        return f"within the floor ({count})"
    return "diverged" if math.isnan(order) else f"{number(order)} ({count})"
