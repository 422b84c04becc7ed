"""Tables on stability, from the rows of the experiment."""

from __future__ import annotations

import math
from collections.abc import Mapping

from unc_physics.prediction.body_status import Status
from unc_physics.prediction.diagnostics import RULES, raised
from unc_physics.propagators.registry import PROPAGATORS

from . import everyday_cases
from .conservation import CHANGE, DRIFT, EIGENVALUE, FINITE, GAIN, MOMENTUM, PASSED
from .hard_cases import load, names
from .judgement import Judged, any_of, judge, rates
from .methods import MONTE_CARLO, label
from .results import Rows
from .tables import table

#: What the rows' methods and quantities are called, beside those of `conservation`.
MEAN, TRUE = "mean", "truth"
POSITION_STD, ROTATION_STD, EXTENT, MEASURE = "position_std", "rotation_std", "extent", "measure_"
GAIN_LIMIT, GAIN_GOAL, LOSS_LIMIT = 0.01, 0.001, 0.02
GAIN_OF_ROLLOUTS = RULES["energy_gain"].limit
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


class Found:
    """Figures of the experiment by case, method and quantity.

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
        """The catalogue's cases that ask for an integrator."""
        return [case for case in self.hard if load(case).scene.integrator == integrator]

    def propagators(self, case: str) -> list[str]:
        """Those that made a prediction of a case."""
        return [name for name in PROPAGATORS if self.of(case, name, FINITE)]

    def of(self, case: str, method: str, quantity: str) -> Mapping[int, float]:
        """A quantity by body (or 0 where it is the scene's); empty where there is none."""
        return self._by_place.get((case, method, quantity), {})

    def one(self, case: str, method: str, quantity: str) -> float:
        """The scene's quantity; NaN where there is none."""
        return self.of(case, method, quantity).get(0, math.nan)

    def judged(self, case: str, method: str) -> list[Judged]:
        """Each moving body's prediction against the truth; one that ended in an error is bad and flagged."""
        extents = self.of(case, TRUE, EXTENT)
        if not self.one(case, method, FINITE):
            return [Judged(math.nan, math.nan, True, True)] * len(extents)
        spread = {
            name: [self.of(case, name, quantity) for quantity in (POSITION_STD, ROTATION_STD)]
            for name in (method, TRUE)
        }
        return [
            judge(
                [s[k] for s in spread[method]],
                [s[k] for s in spread[TRUE]],
                extent,
                bool(self._flags(case, method, k) & ~Status.INITIAL_OVERLAP),
                self._impossible(case),
            )
            for k, extent in extents.items()
        ]

    def _impossible(self, case):
        """Whether bodies go through each other, or rollouts gain energy."""
        return self.one(case, MEAN, PASSED) == 1.0 or self.one(case, MONTE_CARLO, GAIN) > GAIN_OF_ROLLOUTS

    def says(self, case: str, method: str, flag: Status) -> bool:
        """Whether a prediction carries a flag for any body."""
        return any(self._flags(case, method, k) & flag for k in self.of(case, TRUE, EXTENT))

    def _flags(self, case, method, body):
        """Those that a prediction's measures raise by the present limits."""
        found = {name: self.of(case, method, MEASURE + name).get(body) for name in RULES}
        flags = Status.FINE
        for name in raised({name: value for name, value in found.items() if value is not None}):
            flags |= RULES[name].flag
        return flags


def runs_on(integrator: str) -> list[str]:
    """Propagators that work with an integrator."""
    return [name for name, cls in PROPAGATORS.items() if integrator in cls.integrators]


def sections(rows: Rows) -> str:
    """Goals, and rates of the flags."""
    found = Found(rows)
    return "\n".join(["", _goals(found), _rates(found)])


def _goals(found):
    """Which cases miss what is wanted of a step."""
    implicit, explicit, hard = found.by("implicit"), found.by("explicit"), found.hard
    lossless = [case for case in implicit if found.of(case, MEAN, CHANGE)]
    resting = [case for case in implicit if case in AT_REST]
    lines = []
    for name, cases, missed in (
        ("finite", hard, _diverges),
        ("passes through nothing, or flagged", hard, _passes_silently),
        ("momentum to 1e-9", hard, _loses_momentum),
        ("eigenvalues above -1e-12 of the largest", hard + found.paper + found.everyday, _is_indefinite),
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
    """Whether all predictions of a case say that they are not converged."""
    return all(found.says(case, method, Status.NOT_CONVERGED) for method in found.propagators(case))


def _drifts(found, case):
    return not found.one(case, MEAN, DRIFT) <= DRIFT_LIMIT * min(found.of(case, TRUE, EXTENT).values())


def _loses_momentum(found, case):
    return any(found.one(case, method, MOMENTUM) > 1e-9 for method in (MEAN, *found.propagators(case)))


def _is_indefinite(found, case):
    return any(found.one(case, method, EIGENVALUE) < -1e-12 for method in found.propagators(case))


def _rates(found):
    """How many predictions were bad, and how the flags did."""
    every = found.hard + found.paper + found.everyday
    lines = []
    for method in (*PROPAGATORS, None):
        some = PROPAGATORS if method is None else [method]
        by_scene = [
            [found.judged(case, m) for case in cases for m in some if m in found.propagators(case)]
            for cases in (found.hard, found.paper, found.everyday, every)
        ]
        cells = ["all" if method is None else label(method)]
        for of in (
            *(rates(one for bodies in scenes for one in bodies) for scenes in by_scene),
            rates(map(any_of, by_scene[-1])),
        ):
            cells += [_share(of.found, of.bad), _share(of.false, of.good)]
        lines.append(cells)
    head = [
        f"{where}: {words}"
        for where in ("catalogue", "paper", "everyday", "all", "by scene")
        for words in ("bad, flagged", "good, flagged")
    ]
    wanted = [f"≥ {100 * FOUND_GOAL:.0f} %", f"≤ {100 * FALSE_GOAL:.0f} %"]
    lines.append(["wanted", *wanted * (len(head) // 2)])
    return "### Flags\n\n" + table(["", *head], lines)


def _share(part, whole):
    return f"{part} of {whole} ({100.0 * part / whole:.0f} %)" if whole else "0 of 0"
