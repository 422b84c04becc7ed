"""Tables on stability, from the rows of the experiment."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from unc_physics.prediction.body_status import Status
from unc_physics.prediction.diagnostics import RULES, raised
from unc_physics.propagators.names import ANYTIME
from unc_physics.propagators.registry import PROPAGATORS
from unc_physics.spatial.layout import ERR_POSITION, ERR_ROTATION, ERROR, POSITION, QUATERNION, STATE

from . import everyday_cases
from .answers import Answer, Moments, count, distance
from .conservation import CHANGE, DRIFT, FINITE, GAIN, MOMENTUM, PASSED
from .hard_cases import load, names
from .methods import MONTE_CARLO, label
from .results import Results, Rows
from .tables import table

#: Names of methods and quantities in the rows, beside those of `conservation`.
MEAN, TRUE = "mean", "truth"
POSITION_STD, ROTATION_STD, EXTENT, MEASURE = "position_std", "rotation_std", "extent", "measure_"
POSE = tuple(f"mean_{name}" for name in ("x", "y", "z", "qx", "qy", "qz", "qw"))
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
#: Error of means that a finite step may make, over a body's extent (rotations: over half of it, in rad): the
#: truth's steps are shorter, and a belief without spread would count any difference as wrong.
STEP_ERROR = 0.01
DRIFT_LIMIT = 1e-3  # of a body's extent in a second: 0.1 mm/s for 10 cm
#: Overlap that was resolved at the start is no doubt about the answer.
IGNORED = Status.INITIAL_OVERLAP
#: Measures that say to read modes or samples in place of the mean.
SHAPE = {"outcomes", "mean_penetration", "rotation_std"}


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

    def answers(self, case: str, method: str) -> list[Answer]:
        """Compare each moving body's prediction with the truth.

        A failed prediction is wrong and flagged. All are wrong where bodies pass through each other, or
        rollouts gain energy. A flag of a good prediction is false unless the truth confirms it.
        """
        bodies, found = self.of(case, TRUE, EXTENT), []
        for k in bodies:
            if not self.one(case, method, FINITE):
                found.append(Answer(math.inf, math.inf, True, True, False))
                continue
            least = STEP_ERROR * bodies[k], 2.0 * STEP_ERROR
            errors = distance(self._moments(case, method, k), self._moments(case, TRUE, k), least)
            if self._impossible(case):
                errors = math.inf, math.inf
            reasons = self._reasons(case, method, k)
            falsely = bool(reasons - self._confirmed(case, method, k))
            found.append(Answer(*errors, bool(reasons), falsely, False))
        return found

    def _moments(self, case, method, body):
        """Return a body's mean pose, and a covariance with its standard deviations along one axis each."""
        mean, P = np.zeros(STATE), np.zeros((ERROR, ERROR))
        pose = [self.of(case, method, quantity)[body] for quantity in POSE]
        mean[POSITION], mean[QUATERNION] = pose[:3], pose[3:]
        for quantity, block in ((POSITION_STD, ERR_POSITION), (ROTATION_STD, ERR_ROTATION)):
            P[block.start, block.start] = self.of(case, method, quantity)[body] ** 2
        return Moments(mean, P)

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
    """Return the table of wrong and good predictions of bodies, and of the flagged ones among each."""
    groups = {"catalogue": found.hard, "the paper's scenes": found.paper, "everyday motions": found.everyday}
    lines = []
    for method in (*PROPAGATORS, None):
        methods = PROPAGATORS if method is None else [method]
        for group, cases in groups.items():
            counts = count(
                answer
                for case in cases
                for name in methods
                if name in found.propagators(case)
                for answer in found.answers(case, name)
            )
            name = "all" if method is None else label(method)
            told = counts.wrong - counts.silent
            numbers = counts.bodies, counts.wrong, told, counts.good, counts.false
            lines.append([name, group, *map(str, numbers)])
    wanted = (
        f"Wanted: {100 * FOUND_GOAL:.0f} % of wrong, at most {100 * FALSE_GOAL:.0f} % of good ones flagged."
    )
    head = ["propagator", "scenes", "bodies", "wrong", "wrong and flagged", "good", "good and flagged"]
    return f"### Flags\n\n{wanted}\n\n" + results.table("flags", head, lines)
