"""Tables on stability, from the rows of the experiment."""

from __future__ import annotations

import math
from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from typing import NamedTuple

from unc_physics.prediction.body_status import Status
from unc_physics.prediction.diagnostics import RULES, raised
from unc_physics.propagators.names import ANYTIME
from unc_physics.propagators.registry import PROPAGATORS

from . import everyday_cases
from .conservation import CHANGE, DRIFT, FINITE, GAIN, MOMENTUM, PASSED
from .hard_cases import load, names
from .methods import MONTE_CARLO, label
from .results import Results, Rows
from .tables import table

#: Names of methods and quantities in the rows, beside those of `conservation`.
MEAN, TRUE = "mean", "truth"
POSITION_STD, ROTATION_STD, EXTENT, MEASURE = "position_std", "rotation_std", "extent", "measure_"
GAIN_LIMIT, GAIN_GOAL, LOSS_LIMIT = 0.01, 0.001, 0.02
GAIN_OF_ROLLOUTS = RULES["energy_error"].limit
FOUND_GOAL, FALSE_GOAL = 0.95, 0.03
AT_REST = (
    "body_in_bin",
    "hundred_metres_rest",
    "mass_ratio_stack",
    "millimetres_rest",
    "overlap_in_floor",
    "rest_in_corner",
    "rest_on_fixed_body",
    "rest_on_floor",
    "rest_plate_settling",
    "rest_rocking",
    "rest_sliding",
    "stack_of_three",
)
DRIFT_LIMIT = 1e-3  # of a body's extent in a second: 0.1 mm/s for 10 cm
FACTOR = 2.0  # within which a spread is right
POSITION_FLOOR = 1e-9  # of the body's extent: spreads below are nothing
ROTATION_FLOOR = 1e-9  # rad
#: Overlap that was resolved at the start is no doubt about the answer.
IGNORED = Status.INITIAL_OVERLAP
#: Measures that say to read modes or samples in place of the mean.
SHAPE = {"outcomes", "mean_penetration", "rotation_std"}


class Judged(NamedTuple):
    """Comparison of a body's prediction with the truth.

    Attributes
    ----------
    bad : bool
        Whether a spread is off by more than a factor of 2, or not finite.
    flagged : bool
        Whether a flag is raised; for a good prediction, only flags that the truth does not confirm count.
    """

    bad: bool
    flagged: bool


class Rates(NamedTuple):
    """Numbers of bad and of good predictions, and of flagged ones among each."""

    bad: int
    good: int
    found: int
    false: int


def judge(
    predicted,
    truth,
    extent: float,
    reasons: AbstractSet[str],
    confirmed: AbstractSet[str] = frozenset(),
    impossible: bool = False,
) -> Judged:
    """Compare spreads (position [m], rotation [rad]) with the true ones for a body of an extent [m].

    ``reasons`` are the measures that raise flags. Measures in ``confirmed`` are no false flags of right
    spreads. An ``impossible`` prediction, with bodies that pass through each other or rollouts that gain
    energy, is always bad.
    """
    position = _ratio(predicted[0], truth[0], POSITION_FLOOR * extent)
    rotation = _ratio(predicted[1], truth[1], ROTATION_FLOOR)
    bad = impossible or not all(1.0 / FACTOR <= ratio <= FACTOR for ratio in (position, rotation))
    return Judged(bad, bool(reasons if bad else reasons - confirmed))


def rates(judged) -> Rates:
    """Count bad, good and flagged predictions."""
    judged = list(judged)
    bad = [one for one in judged if one.bad]
    good = [one for one in judged if not one.bad]
    return Rates(len(bad), len(good), sum(one.flagged for one in bad), sum(one.flagged for one in good))


def _ratio(predicted, truth, floor):
    if predicted <= floor and truth <= floor:
        return 1.0
    return predicted / truth if truth > 0.0 else math.inf


class Found:
    """Values of the experiment by case, method and quantity.

    Parameters
    ----------
    rows : Rows
    """

    def __init__(self, rows: Rows):
        self._by_place = {}
        for row in rows:
            self._by_place.setdefault((row["case"], row["method"], row["quantity"]), {})[row["replicate"]] = (
                row["value"]
            )
        hard = set(names())
        complete = [
            name
            for name in rows.unique("case")
            if self.of(name, TRUE, EXTENT) and self.of(name, MEAN, FINITE)
        ]
        everyday = set(everyday_cases.names())
        self.hard = [name for name in complete if name in hard]
        self.everyday = [name for name in complete if name in everyday]
        self.paper = [name for name in complete if name not in hard | everyday]

    def by(self, integrator: str) -> list[str]:
        """Return the catalogue's cases for an integrator."""
        return [case for case in self.hard if load(case).scene.integrator == integrator]

    def propagators(self, case: str) -> list[str]:
        """Return the propagators with a prediction of a case."""
        return [name for name in PROPAGATORS if self.of(case, name, FINITE)]

    def of(self, case: str, method: str, quantity: str) -> Mapping[int, float]:
        """Return a quantity by body, or by 0 for the scene; empty without rows."""
        return self._by_place.get((case, method, quantity), {})

    def one(self, case: str, method: str, quantity: str) -> float:
        """Return a quantity of the scene; NaN without a row."""
        return self.of(case, method, quantity).get(0, math.nan)

    def judged(self, case: str, method: str) -> list[Judged]:
        """Compare each moving body's prediction with the truth; a failed prediction is bad and flagged."""
        extents = self.of(case, TRUE, EXTENT)
        if not self.one(case, method, FINITE):
            return [Judged(True, True)] * len(extents)
        spread = {
            name: [self.of(case, name, quantity) for quantity in (POSITION_STD, ROTATION_STD)]
            for name in (method, TRUE)
        }
        return [
            judge(
                [s[k] for s in spread[method]],
                [s[k] for s in spread[TRUE]],
                extent,
                self._reasons(case, method, k),
                self._confirmed(case, method, k),
                self._impossible(case),
            )
            for k, extent in extents.items()
        ]

    def _confirmed(self, case, method, body):
        """Return the measures of another method's samples that also exceed their limits.

        Any measure of `SHAPE` confirms all of them.
        """
        others = {MONTE_CARLO, ANYTIME} - {method}
        found = set().union(*(self._reasons(case, other, body) for other in others))
        return found | SHAPE if found & SHAPE else found

    def _impossible(self, case):
        """Return whether bodies pass through each other, or rollouts gain energy."""
        return self.one(case, MEAN, PASSED) == 1.0 or self.one(case, MONTE_CARLO, GAIN) > GAIN_OF_ROLLOUTS

    def says(self, case: str, method: str, flag: Status) -> bool:
        """Return whether a prediction has a flag for any body."""
        bodies = self.of(case, TRUE, EXTENT)
        return any(RULES[name].flag in flag for k in bodies for name in self._reasons(case, method, k))

    def _reasons(self, case, method, body):
        """Return the measures that raise flags by the present limits, except resolved overlap."""
        found = {name: self.of(case, method, MEASURE + name).get(body) for name in RULES}
        values = {name: value for name, value in found.items() if value is not None}
        return {name for name in raised(values) if RULES[name].flag not in IGNORED}


def runs_on(integrator: str) -> list[str]:
    """Return the propagators that support an integrator."""
    return [name for name, cls in PROPAGATORS.items() if integrator in cls.integrators]


def sections(results: Results) -> str:
    """Return the sections on goals and on rates of flags."""
    found = Found(results.rows("stability"))
    return "\n".join(["", _goals(found), _rates(results, found)])


def _goals(found):
    """Return the table of goals of a step, with the cases that miss them."""
    implicit, explicit, hard = found.by("implicit"), found.by("explicit"), found.hard
    lossless = [case for case in implicit if found.of(case, MEAN, CHANGE)]
    resting = [case for case in implicit if case in AT_REST]
    lines = []
    for name, cases, missed in (
        ("finite", hard, _diverges),
        ("passes through nothing, or flagged", hard, _passes_silently),
        ("momentum to 1e-9", hard, _loses_momentum),
        (f"implicit: gain below {GAIN_LIMIT:g}", implicit, _gains_more_than(GAIN_LIMIT)),
        (f"implicit: gain below {GAIN_GOAL:g}", implicit, _gains_more_than(GAIN_GOAL)),
        (f"implicit: loss below {LOSS_LIMIT:g}", lossless, _loses),
        (f"implicit: drift below {DRIFT_LIMIT:g} extents in 1 s", resting, _drifts),
        (f"explicit: gain below {GAIN_LIMIT:g}, or flagged", explicit, _gains_silently),
    ):
        misses = [case for case in cases if missed(found, case)]
        lines.append([name, f"{len(cases) - len(misses)} of {len(cases)}", ", ".join(misses)])
    return "### Goals\n\n" + table(["goal", "cases", "not in"], lines)


def _diverges(found, case):
    return not all(found.one(case, method, FINITE) for method in (MEAN, *found.propagators(case)))


def _gains_more_than(limit):
    return lambda found, case: found.one(case, MEAN, GAIN) > limit


def _gains_silently(found, case):
    return found.one(case, MEAN, GAIN) > GAIN_LIMIT and not _is_flagged(found, case)


def _loses(found, case):
    return not found.one(case, MEAN, CHANGE) >= -LOSS_LIMIT


def _passes_silently(found, case):
    return found.one(case, MEAN, PASSED) == 1.0 and not _is_flagged(found, case)


def _is_flagged(found, case):
    """Return whether all predictions of a case are flagged as not converged."""
    return all(found.says(case, method, Status.NOT_CONVERGED) for method in found.propagators(case))


def _drifts(found, case):
    return not found.one(case, MEAN, DRIFT) <= DRIFT_LIMIT * min(found.of(case, TRUE, EXTENT).values())


def _loses_momentum(found, case):
    return found.one(case, MEAN, MOMENTUM) > 1e-9


def _rates(results, found):
    """Return the table of wrong and right predictions of bodies, and of the flagged ones among each."""
    groups = {"catalogue": found.hard, "the paper's scenes": found.paper, "everyday motions": found.everyday}
    lines = []
    for method in (*PROPAGATORS, None):
        methods = PROPAGATORS if method is None else [method]
        for group, cases in groups.items():
            bodies = [
                judged
                for case in cases
                for name in methods
                if name in found.propagators(case)
                for judged in found.judged(case, name)
            ]
            counts = rates(bodies)
            name = "all" if method is None else label(method)
            lines.append(
                [
                    name,
                    group,
                    *(str(number) for number in (counts.bad, counts.found, counts.good, counts.false)),
                ]
            )
    wanted = (
        f"Wanted: {100 * FOUND_GOAL:.0f} % of wrong, at most {100 * FALSE_GOAL:.0f} % of right ones flagged."
    )
    head = ["propagator", "scenes", "wrong", "wrong and flagged", "right", "right and flagged"]
    return f"### Flags\n\n{wanted}\n\n" + results.table("flags", head, lines)
