"""The paper's claims beside what the same experiments show here."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from .comparison import CPU_TIME, POSITION_ERROR, REGULARISED, ROTATION_ERROR
from .methods import FLOOR, FULL_POINTS, GAUSSIAN, MONTE_CARLO, label
from .results import Rows
from .tables import number

FOUR = "surrogate", "local_sampling", "linearization", FULL_POINTS
COUNTS = (5, 10, 50, 100)
SPREAD = "position_spread_over_truth"
YES, PARTLY, NO = "yes", "partly", "no"
_SAME = 1.1  # the factor below which two errors count as equal


class Claim(NamedTuple):
    """A line of the table of claims; texts but for ``agrees``, which is yes, partly or no."""

    claim: str
    paper: str
    here: str
    agrees: str


class Measured:
    """Rows of the paper's evaluation by section, case, and method.

    A case is (model or uncertain velocity, spheres, sigma, encounter), a method (text, samples).
    """

    def __init__(self, rows: Rows):
        self._found: dict = {}
        for row in rows:
            encounter = row["repeat"] if row["section"] == "variants" else 0
            case = row["case"], row["spheres"], row["sigma"], encounter
            cases = self._found.setdefault(row["section"], {})
            quantities = cases.setdefault(case, {}).setdefault((row["method"], row["samples"]), {})
            quantities.setdefault(row["quantity"], []).append(row["value"])

    def cases(self, section: str) -> list[tuple]:
        """Return the cases of a section in order."""
        return sorted(self._found.get(section, {}))

    def methods(self, section: str) -> list[tuple[str, int | None]]:
        """Return all methods of a section in order of appearance."""
        return list(dict.fromkeys(key for found in self._found.get(section, {}).values() for key in found))

    def values(self, section, case, method, quantity) -> np.ndarray:
        """Return the repeated measurements of a quantity; empty if there are none."""
        found = self._found.get(section, {}).get(case, {}).get(method, {})
        return np.array(found.get(quantity, ()), float)

    def value(self, section, case, method, quantity) -> float:
        """Return the mean of an error and the median of a time; NaN without any."""
        found = self.values(section, case, method, quantity)
        if not len(found):
            return float("nan")
        return float(np.median(found) if quantity == CPU_TIME else np.mean(found))

    def ratios(self, section, method, other, quantity, cases=None) -> np.ndarray:
        """Return a quantity of a method over that of another one, in each case that has both."""
        pairs = [
            (self.value(section, case, method, quantity), self.value(section, case, other, quantity))
            for case in (self.cases(section) if cases is None else cases)
        ]
        found = np.array([one / two for one, two in pairs if two])
        return found[np.isfinite(found)]

    def ratio(self, *arguments) -> float:
        """Return the geometric mean of `ratios`; NaN without any."""
        return geometric_mean(self.ratios(*arguments))


def geometric_mean(values) -> float:
    """Return the geometric mean; NaN without values."""
    return float(np.exp(np.mean(np.log(values)))) if len(values) else float("nan")


def claims(measured: Measured, storage: Iterable[tuple[str, int, int]]) -> Iterator[Claim]:
    """Yield all claims that there are measurements for; ``storage`` has methods, counts, and the paper's."""
    if measured.cases("time"):
        yield from _times(measured)
    if measured.cases("error"):
        yield from _errors(measured)
    if measured.cases("free"):
        yield from _free(measured)
    if measured.cases("variants"):
        yield from _choices(measured)
    wrong = [f"{label(name)} {here}, not {paper}" for name, here, paper in storage if here != paper]
    yield Claim(
        "Storage of two bodies (Table 3)",
        "602, 314, 314 and 1274 scalars; per-body methods need less than 13 samples do",
        "; ".join(wrong) + ": roots have a column for each uncertain direction"
        if wrong
        else "the same counts",
        PARTLY if wrong else YES,
    )


def _times(measured):
    def faster(method, cases=None):
        return 1.0 / measured.ratios("time", (method, None), (MONTE_CARLO, 10), CPU_TIME, cases)

    def at(spheres):
        return [case for case in measured.cases("time") if case[1] == spheres]

    nominal = FOUR[:3]
    means = {method: geometric_mean(faster(method)) for method in nominal}
    most = max(float(faster(method).max()) for method in nominal)
    yield Claim(
        "Surrogate, local sampling and linearization are 1 to 1.5 orders of magnitude faster than 10 samples",
        "10 to 30 times at best",
        f"{', '.join(f'{label(m)} {number(v)}' for m, v in means.items())} times on average,"
        f" {number(most)} at best",
        YES if min(means.values()) >= 10.0 else PARTLY if most >= 10.0 else NO,
    )
    order = sorted(means, key=lambda method: -means[method])
    yield Claim(
        "The surrogate is the fastest, then local sampling, then linearization",
        ", ".join(map(label, nominal)),
        ", ".join(map(label, order))
        + ": an analytic derivative of one contact and of the uncertain directions only",
        YES if tuple(order) == nominal else NO,
    )
    sizes = sorted({case[1] for case in measured.cases("time")})
    ends = [geometric_mean(faster("linearization", at(n))) for n in (sizes[0], sizes[-1])]
    yield Claim(
        "Linearization gains with more spheres, as it takes one contact",
        "faster than others at many spheres",
        f"{number(ends[0])} times faster than 10 samples with {sizes[0]} spheres,"
        f" {number(ends[1])} with {sizes[-1]}",
        YES if ends[1] > _SAME * ends[0] else NO,
    )
    points = geometric_mean(faster(FULL_POINTS))
    yield Claim(
        "Sigma points take longest of the four",
        "longest",
        f"{number(1.0 / points)} times as long as 10 samples",
        YES if points < min(means.values()) else NO,
    )
    yield _claim_of_sigma(measured)
    growth = measured.ratio("time", (MONTE_CARLO, 100), (MONTE_CARLO, 10), CPU_TIME, at(sizes[-1]))
    yield Claim(
        "The time of sampling is linear in the number of samples",
        "linear",
        f"100 samples take {number(growth)} times as long as 10, with {sizes[-1]} spheres",
        YES if 8.0 < growth < 12.0 else PARTLY,
    )


def _claim_of_sigma(measured):
    """Return how much the time of ten samples changes with sigma."""
    changes = {}
    for model, spheres, *_ in measured.cases("time"):
        over = [case for case in measured.cases("time") if case[:2] == (model, spheres)]
        times = [measured.value("time", case, (MONTE_CARLO, 10), CPU_TIME) for case in over]
        changes.setdefault(model, {})[spheres] = max(times) / min(times)
    means = {model: geometric_mean(list(found.values())) for model, found in changes.items()}
    return Claim(
        "Times do not depend on sigma",
        "almost constant",
        "longest over shortest time of 10 samples: "
        + ", ".join(f"{model} {number(value)}" for model, value in means.items()),
        YES if max(means.values()) < 1.25 else PARTLY if min(means.values()) < 1.25 else NO,
    )


def samples_for(measured, section, method, quantity) -> float:
    """Return how many samples have a method's error, by power laws between the measured numbers."""
    errors = [measured.ratio(section, (MONTE_CARLO, n), method, quantity) for n in COUNTS]
    known = [(n, error) for n, error in zip(COUNTS, errors, strict=True) if np.isfinite(error)]
    x, y = np.log(np.array(known)).T
    slope = (y[-1] - y[0]) / (x[-1] - x[0])
    if y[0] <= 0.0:  # outside, by the mean slope
        return float(np.exp(x[0] - y[0] / slope))
    if y[-1] >= 0.0:
        return float(np.exp(x[-1] - y[-1] / slope))
    return float(np.exp(np.interp(0.0, -y, x)))


def _errors(measured):
    quantities = POSITION_ERROR, ROTATION_ERROR
    equal = {
        method: [samples_for(measured, "error", (method, None), quantity) for quantity in quantities]
        for method in FOUR
    }
    grow = [_grows(measured, quantity) for quantity in quantities]
    position, rotation = (number(100.0 * np.mean(found)) for found in grow)
    yield Claim(
        "W1 grows with sigma for all methods",
        "all",
        f"from the smallest to the largest sigma in {position} % (position) and {rotation} % (rotation)"
        " of all cases",
        YES if np.all(grow) else PARTLY if np.mean(grow) > 0.5 else NO,
    )
    falls = [
        measured.ratio("error", (MONTE_CARLO, 10), (MONTE_CARLO, 100), quantity) for quantity in quantities
    ]
    yield Claim(
        "More samples are more alike, less than linearly",
        "not linearly",
        f"ten times as many samples have {number(falls[0])} (position) and {number(falls[1])} times"
        " (rotation) less error",
        YES if all(_SAME < fall < 10.0 / _SAME for fall in falls) else NO,
    )
    position, rotation = equal["surrogate"]
    yield Claim(
        "The surrogate is as accurate as 10 samples in position and 5 in rotation",
        "10, 5",
        f"{number(position)}, {number(rotation)}",
        YES if position >= 8.0 and rotation >= 4.0 else PARTLY if position >= 5.0 or rotation >= 4.0 else NO,
    )
    better = [
        measured.ratio("error", (method, None), ("surrogate", None), quantity)
        for quantity in quantities
        for method in FOUR[1:3]
    ]
    agree = [value < 1.0 for value in better[:2]] + [value > 1.0 for value in better[2:]]
    yield Claim(
        "Local sampling and linearization are better than the surrogate in position, worse in rotation",
        "better, worse",
        "W1 over the surrogate's: position "
        + ", ".join(map(number, better[:2]))
        + "; rotation "
        + ", ".join(map(number, better[2:])),
        YES if all(agree) else PARTLY if any(agree) else NO,
    )
    best = [max(FOUR, key=lambda method, k=k: equal[method][k]) for k in (0, 1)]
    position, rotation = equal[FULL_POINTS]
    minimal = [samples_for(measured, "error", ("sigma_points", None), quantity) for quantity in quantities]
    yield Claim(
        "Sigma points are the most accurate of the four in position and rotation",
        "both",
        f"best: {label(best[0])} (position), {label(best[1])} (rotation)",
        YES if best == 2 * [FULL_POINTS] else PARTLY if FULL_POINTS in best else NO,
    )
    yield Claim(
        "Rotations of sigma points are as accurate as 5 to 10 samples",
        "5 to 10",
        f"{number(rotation)}, positions {number(position)}; along uncertain directions only"
        f" {number(minimal[1])}, {number(minimal[0])}",
        YES if 4.0 <= rotation <= 12.0 else PARTLY if rotation > 12.0 else NO,
    )
    over = {
        method: [
            measured.ratio("error", (method, None), (MONTE_CARLO, 10), quantity) for quantity in quantities
        ]
        for method in FOUR
    }
    larger = [rotation > position for position, rotation in over.values()]
    yield Claim(
        "Relative to sampling, errors of rotation are larger than those of position",
        "larger",
        "W1 over that of 10 samples, position and rotation: "
        + "; ".join(f"{label(method)} {number(p)}, {number(r)}" for method, (p, r) in over.items()),
        YES if all(larger) else PARTLY if any(larger) else NO,
    )
    models = sorted({case[0] for case in measured.cases("error")})
    limit = {
        model: measured.ratio(
            "error",
            (GAUSSIAN, None),
            (FLOOR, None),
            POSITION_ERROR,
            [case for case in measured.cases("error") if case[0] == model],
        )
        for model in models
    }
    yield Claim(
        "A single Gaussian agrees well with sampling",
        "good agreement",
        "W1 of the best Gaussian over that of a second truth: "
        + ", ".join(f"{model} {number(value)}" for model, value in limit.items()),
        YES if max(limit.values()) < 1.5 else PARTLY if min(limit.values()) < 1.5 else NO,
    )


def _grows(measured, quantity):
    """Return for each model, number of spheres and method whether an error is larger at the largest sigma."""
    grows = []
    for sized in dict.fromkeys(case[:2] for case in measured.cases("error")):
        sigmas = [case[2] for case in measured.cases("error") if case[:2] == sized]
        for method in measured.methods("error"):
            if method[0] != FLOOR:
                small, large = (
                    measured.value("error", (*sized, sigma, 0), method, quantity)
                    for sigma in (min(sigmas), max(sigmas))
                )
                grows.append(large > small)
    return grows


def _free(measured):
    linear, angular = ("linear_velocity", 10, 0.1, 0), ("angular_velocity", 10, 1.0, 0)
    if not {linear, angular} <= set(measured.cases("free")):
        return
    floors = [
        measured.value("free", linear, (method, None), POSITION_ERROR)
        / measured.value("free", linear, (FLOOR, None), POSITION_ERROR)
        for method in FOUR
    ]
    yield Claim(
        "Without collisions, an uncertain velocity is carried without error (Table 2)",
        "0.0021 m for all four",
        f"{number(min(floors))} to {number(max(floors))} times W1 of a second truth",
        YES if max(floors) < _SAME else NO,
    )
    points, nominal = (
        measured.value("free", angular, (method, None), REGULARISED[1]) for method in (FULL_POINTS, FOUR[0])
    )
    yield Claim(
        "An uncertain angular velocity has a small error, of sigma points the largest (Table 2)",
        "0.78 to 0.79 deg, sigma points 1.86",
        f"{number(nominal)} deg, sigma points {number(points)}, at 1 rad/s: they reach beyond half a turn",
        YES if points > 1.5 * nominal else NO,
    )


def _choices(measured):
    def both(method, other, quantities=(POSITION_ERROR, ROTATION_ERROR)):
        return [measured.ratio("variants", (method, None), (other, None), q) for q in quantities]

    def spread(method):
        return measured.ratio("variants", (method, None), ("linearization", None), SPREAD)

    def said(found):
        return f"W1 {number(found[0])} (position) and {number(found[1])} times (rotation) as large"

    for what, paper, method in (
        ("all contacts in place of the dominant one", "large covariance inflation", "contacts=all"),
        ("plain normals in place of Eq. 10", "large covariance growth", "regularisation=0"),
        ("the whole law in place of a constant force", "much uncertainty along the normal", "force=whole"),
        (
            "all three, the plain derivative of the step",
            "unstable",
            "contacts=all regularisation=0 force=whole",
        ),
    ):
        wide, found = (
            spread(f"numerical_linearization {method}"),
            both(f"numerical_linearization {method}", "linearization"),
        )
        yield Claim(
            f"Linearization with {what}",
            paper,
            f"spread of positions {number(wide)} times as wide; {said(found)}",
            YES if wide > 2.0 else PARTLY if wide > _SAME else NO,
        )
    found = both("regenerated_sigma_points points=full", FULL_POINTS)
    yield Claim(
        "Sigma points that are regenerated after each step",
        "large errors",
        said(found),
        YES if max(found) > 1.5 else PARTLY if max(found) > _SAME else NO,
    )
    found = both("joint_local_sampling", "local_sampling")
    yield Claim(
        "Local sampling with a joint covariance",
        "less stable, not consistently better",
        said(found),
        YES if max(found) > 1.0 / _SAME else NO,
    )
