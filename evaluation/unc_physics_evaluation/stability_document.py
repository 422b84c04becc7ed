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
from .judgement import FALSE, MISSING, RIGHT, Judged, any_of, judge, rates, worst
from .methods import MONTE_CARLO, label
from .results import Rows
from .tables import number, table

#: What the rows' methods and quantities are called, beside those of `conservation`.
MEAN, TRUE, HALF, OTHER_HALF, COARSE = "mean", "truth", "first_half", "second_half", "coarser"
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

    def ratio(self, case: str, method: str, reference: str) -> tuple[float, float]:
        """Spreads of position and rotation over those of another method, of the worst body of each."""
        found = [
            judge(
                *(
                    [self.of(case, name, quantity)[k] for quantity in (POSITION_STD, ROTATION_STD)]
                    for name in (method, reference)
                ),
                extent,
                False,
            )
            for k, extent in self.of(case, TRUE, EXTENT).items()
        ]
        return worst(one.position for one in found), worst(one.rotation for one in found)


def runs_on(integrator: str) -> list[str]:
    """Propagators that work with an integrator."""
    return [name for name, cls in PROPAGATORS.items() if integrator in cls.integrators]


def sections(rows: Rows) -> str:
    """Goals, rates and the tables of all cases."""
    found = Found(rows)
    parts = ["", _goals(found), _rates(found)]
    if found.hard:
        parts.append(_means(found))
        for integrator in ("implicit", "explicit"):
            parts.append(
                _propagators(
                    found, found.by(integrator), runs_on(integrator), f"Propagators on the {integrator} step"
                )
            )
    for cases, title in ((found.paper, "The paper's scenes"), (found.everyday, "Everyday motions")):
        if cases:
            parts.append(_propagators(found, cases, PROPAGATORS, title))
    return "\n".join(parts)


def _goals(found):
    """Which cases miss what is wanted of a step."""
    implicit = found.by("implicit")
    lines = []
    for words, cases, missed in (
        ("ends without NaN, mean and all propagators", found.hard, _diverges),
        ("lets nothing pass through, or is flagged", found.hard, _passes_silently),
        ("keeps momentum, to 1e-9, where it is conserved", found.hard, _loses_momentum),
        (
            "keeps covariances positive semidefinite, to 1e-12 of the largest eigenvalue",
            found.hard + found.paper + found.everyday,
            _is_indefinite,
        ),
        (
            f"implicit: gains at most {100.0 * GAIN_LIMIT:.0f} % energy",
            implicit,
            _gains_more_than(GAIN_LIMIT),
        ),
        (f"implicit: gains at most {100.0 * GAIN_GOAL:.1f} % energy", implicit, _gains_more_than(GAIN_GOAL)),
        (
            (
                f"implicit: loses at most {100.0 * LOSS_LIMIT:.0f} % energy over the run, where nothing"
                " should take any"
            ),
            [case for case in implicit if found.of(case, MEAN, CHANGE)],
            _loses,
        ),
        (
            (
                "implicit: lets lie what came to rest (drift in a second: a thousandth of the extent, 0.1 mm"
                " for 10 cm)"
            ),
            [case for case in implicit if case in AT_REST],
            _drifts,
        ),
        (
            f"explicit: gains at most {100.0 * GAIN_LIMIT:.0f} % energy, or is flagged",
            found.by("explicit"),
            _gains_silently,
        ),
    ):
        misses = [case for case in cases if missed(found, case)]
        lines.append([words, f"{len(cases) - len(misses)} of {len(cases)}", ", ".join(misses)])
    return "### Goals\n\n" + table(["The step ...", "cases", "not in"], lines)


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


def _means(found):
    """What one rollout of the mean does."""
    lines = []
    for integrator in ("implicit", "explicit"):
        for case in found.by(integrator):
            lines.append(
                [
                    case,
                    integrator,
                    _gained(found, case, MEAN),
                    _percent(found.one(case, MEAN, CHANGE)),
                    *(
                        ["", ""]
                        if not found.one(case, MEAN, FINITE)
                        else [
                            _small(found.one(case, MEAN, MOMENTUM)),
                            "yes" if found.one(case, MEAN, PASSED) else "",
                        ]
                    ),
                    _drift(found.one(case, MEAN, DRIFT)),
                ]
            )
    head = ["", "step", "energy gained", "change at the end", "momentum", "passes", "drift [mm/s]"]
    return "### One rollout of the mean\n\n" + table(head, lines)


def _propagators(found, cases, propagators, title):
    """What each propagator makes of the uncertainty."""
    lines = []
    for case in cases:
        floor, step = (found.ratio(case, *pair) for pair in ((HALF, OTHER_HALF), (COARSE, HALF)))
        lines.append(
            [case, *(_cell(found, case, method) for method in propagators), _ratios(floor), _ratios(step)]
        )
    return f"### {title}\n\n" + table(["", *map(label, propagators), "floor", "step"], lines)


def _cell(found, case, method):
    if method not in found.propagators(case):
        return ""
    if not found.one(case, method, FINITE):
        return "**error: diverged**"
    judged = found.judged(case, method)
    counts = {}
    for one in judged:
        word = {RIGHT: "flagged" if one.flagged else "fine", FALSE: "false", MISSING: "**MISSING**"}[
            one.verdict
        ]
        counts[word] = counts.get(word, 0) + 1
    said = ", ".join(
        word if len(judged) == 1 or len(counts) == 1 else f"{count} {word}" for word, count in counts.items()
    )
    ratios = worst(one.position for one in judged), worst(one.rotation for one in judged)
    return f"{_gained(found, case, method)}; {_ratios(ratios)}; {said}"


def _gained(found, case, method):
    if not found.one(case, method, FINITE):
        return "NaN"
    return _percent(found.one(case, method, GAIN))


def _ratios(pair):
    return " / ".join(_ratio(ratio) for ratio in pair)


def _ratio(ratio):
    if ratio == 0.0:
        return "0"
    return (
        f"{ratio:.2f}"
        if 0.05 <= ratio < 9.95
        else f"{ratio:.0f}"
        if 9.95 <= ratio < 999.5
        else f"{ratio:.0e}"
    )


def _percent(share):
    """A share of energy: in percent, or as a factor where it is many times what there was."""
    if math.isnan(share):
        return ""
    if abs(share) < 1e-5:
        return "0 %"
    return (
        f"{100.0 * share:.2g} %"
        if abs(share) < 0.995
        else f"{100.0 * share:.0f} %"
        if share < 10.0
        else f"{1.0 + share:.0e} x"
    )


def _drift(speed):
    """In mm/s; below a nanometre per second it is nothing."""
    return "0" if speed < 1e-9 else number(1e3 * speed)


def _small(error):
    return "" if math.isnan(error) else f"{error:.0e}" if error else "0"


def _share(part, whole):
    return f"{part} of {whole} ({100.0 * part / whole:.0f} %)" if whole else "0 of 0"
