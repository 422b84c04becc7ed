"""The document on stability: what every propagator makes of the hard cases, from the rows of the experiment."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ..propagation import PROPAGATORS
from ..propagation.status import Status
from .conservation import CHANGE, DRIFT, EIGENVALUE, FINITE, GAIN, MOMENTUM, PASSED
from .hard_cases import load, names
from .judgement import FALSE, MISSING, RIGHT, Judged, judge, rates, worst
from .results import Rows
from .tables import label, number, table

COMMAND = "python -m unc_physics evaluate stability"
#: What the rows' methods and quantities are called, beside those of `conservation`.
NAIVE, OURS, TRUE, HALF, OTHER_HALF, COARSE = "explicit", "mean", "truth", "first_half", "second_half", "coarser"
POSITION_STD, ROTATION_STD, EXTENT, FLAGS, MEASURE = "position_std", "rotation_std", "extent", "flags", "measure_"
GAIN_LIMIT, FOUND_GOAL, FALSE_GOAL = 0.01, 0.8, 0.05


class Found:
    """Figures of the experiment by case, method and quantity.

    Parameters
    ----------
    rows : Rows
    """

    def __init__(self, rows: Rows):
        self._by_place = {}
        for row in rows:
            self._by_place.setdefault((row["case"], row["method"], row["quantity"]), {})[row["replicate"]] = row["value"]
        hard = set(names())
        complete = [name for name in rows.unique("case") if self.of(name, TRUE, EXTENT) and self.of(name, NAIVE, FINITE)]
        self.hard = [name for name in complete if name in hard]
        self.paper = [name for name in complete if name not in hard]

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
        spread = {name: [self.of(case, name, quantity) for quantity in (POSITION_STD, ROTATION_STD)] for name in (method, TRUE)}
        flags = self.of(case, method, FLAGS)
        return [
            judge([s[k] for s in spread[method]], [s[k] for s in spread[TRUE]], extent, flags[k] != 0)
            for k, extent in extents.items()
        ]

    def says(self, case: str, method: str, flag: Status) -> bool:
        """Whether a prediction carries a flag for any body."""
        return any(int(flags) & flag for flags in self.of(case, method, FLAGS).values())

    def ratio(self, case: str, method: str, reference: str) -> tuple[float, float]:
        """Spreads of position and rotation over those of another method, of the worst body of each."""
        found = [
            judge(*([self.of(case, name, quantity)[k] for quantity in (POSITION_STD, ROTATION_STD)] for name in (method, reference)),
                  extent, False)
            for k, extent in self.of(case, TRUE, EXTENT).items()
        ]
        return worst(one.position for one in found), worst(one.rotation for one in found)


def document(rows: Rows) -> str:
    """The whole document."""
    body = sections(rows).replace("\n### ", "\n## ")
    return f"# Stability on hard cases\n\n{INTRODUCTION}\n{SHOWN}\n{body}"


def sections(rows: Rows) -> str:
    """Goals, rates and the tables of all cases."""
    found = Found(rows)
    parts = ["", _goals(found), _rates(found)]
    if found.hard:
        parts += [_means(found), _propagators(found, found.hard, "Propagators"), _cases(found)]
    if found.paper:
        parts.append(_propagators(found, found.paper, "The paper's scenes"))
    return "\n".join(parts)


def _goals(found):
    """Which cases miss what is wanted of the default step."""
    lines = []
    for words, missed in (
        ("ends without NaN, mean and all propagators", lambda case: not all(found.one(case, m, FINITE) for m in (OURS, *PROPAGATORS))),
        (f"gains at most {100 * GAIN_LIMIT:.0f} % energy", lambda case: found.one(case, OURS, GAIN) > GAIN_LIMIT),
        ("lets nothing pass through without a flag", lambda case: found.one(case, OURS, PASSED) == 1.0 and not all(
            found.says(case, m, Status.NOT_CONVERGED) for m in PROPAGATORS)),
        ("keeps covariances positive semidefinite, to 1e-12 of the largest eigenvalue",
         lambda case: min(found.one(case, m, EIGENVALUE) for m in PROPAGATORS if found.one(case, m, FINITE)) < -1e-12),
        ("keeps momentum to 1e-9 where it is conserved", lambda case: max(
            (value for m in (OURS, *PROPAGATORS) for value in found.of(case, m, MOMENTUM).values()), default=0.0) > 1e-9),
    ):
        misses = [case for case in found.hard if missed(case)]
        lines.append([words, f"{len(found.hard) - len(misses)} of {len(found.hard)}", ", ".join(map(_words, misses))])
    return "### Goals\n\n" + table(["The default step ...", "cases", "not in"], lines)


def _rates(found):
    """How many predictions were bad, and how the flags did."""
    lines = []
    for method in (*PROPAGATORS, None):
        cells = ["all" if method is None else label(method)]
        for cases in (found.hard, found.paper, found.hard + found.paper):
            of = rates(one for case in cases for m in (PROPAGATORS if method is None else [method]) for one in found.judged(case, m))
            cells += [_share(of.found, of.bad), _share(of.false, of.good)]
        lines.append(cells)
    head = [f"{words}, {where}" for where in ("catalogue", "paper", "both") for words in ("bad and flagged", "good but flagged")]
    return (
        "### Flags\n\nOf the predictions of a body that are bad, how many are flagged; of those that are good, how many are flagged as "
        f"well. Wanted: at least {100 * FOUND_GOAL:.0f} %, and at most {100 * FALSE_GOAL:.0f} %.\n\n" + table(["", *head], lines))


def _means(found):
    """What one rollout of the mean does."""
    lines = []
    for case in found.hard:
        cells = [_words(case)]
        for method in (NAIVE, OURS):
            cells += [_gained(found, case, method), _percent(found.one(case, method, CHANGE)), *(
                ["", ""] if not found.one(case, method, FINITE) else
                [_small(found.one(case, method, MOMENTUM)), "yes" if found.one(case, method, PASSED) else ""])]
        lines.append([*cells, number(1e3 * found.one(case, OURS, DRIFT))])
    head = [f"{method}: {what}" for method in ("explicit", "default") for what in ("energy gained", "change at the end", "momentum", "passes")]
    return (
        "### One rollout of the mean\n\nNaive: the explicit step of the paper; default: the robust step, both at the case's `dt`. Energy "
        "gained is the largest on the way, over what there was and what gravity gave; contacts' own energy counts at the start alone. "
        "The change at the end counts it there as well, where nothing takes energy away. Momentum: the largest error over the sum of all "
        "sizes, where it is conserved. Drift: the fastest body's mean speed over the second half, in scenes with friction.\n\n"
        + table(["", *head, "default: drift [mm/s]"], lines))


def _propagators(found, cases, title):
    """What each propagator makes of the uncertainty."""
    lines = []
    for case in cases:
        floor, step = (found.ratio(case, *pair) for pair in ((HALF, OTHER_HALF), (COARSE, HALF)))
        lines.append([_words(case), *(_cell(found, case, method) for method in PROPAGATORS), _ratios(floor), _ratios(step)])
    return (
        f"### {title}\n\nEach cell: energy gained by the expected motion, spread included; spread of position / of rotation at the end over the "
        "truth's, of the body where it is farthest off; and the bodies' flags: `fine` (right and not flagged), `flagged` (wrong and "
        "flagged), `false` (right but flagged), `MISSING` (wrong and not flagged). Floor: the same ratio between two halves of the truth. "
        "Step: between a truth with twice as long steps and this one, from the same samples.\n\n"
        + table(["", *map(label, PROPAGATORS), "floor", "step"], lines))


def _cases(found):
    """What is hard about each case."""
    return "### Cases\n\n" + "\n".join(f"* **{_words(case)}**: {load(case).about}" for case in found.hard) + "\n"


def _cell(found, case, method):
    if not found.one(case, method, FINITE):
        return "**error: diverged**"
    judged = found.judged(case, method)
    counts = {}
    for one in judged:
        word = {RIGHT: "flagged" if one.flagged else "fine", FALSE: "false", MISSING: "**MISSING**"}[one.verdict]
        counts[word] = counts.get(word, 0) + 1
    said = ", ".join(word if len(judged) == 1 or len(counts) == 1 else f"{count} {word}" for word, count in counts.items())
    ratios = worst(one.position for one in judged), worst(one.rotation for one in judged)
    return f"{_gained(found, case, method)}; {_ratios(ratios)}; {said}"


def _gained(found, case, method):
    if not found.one(case, method, FINITE):
        return "NaN"
    return _percent(found.one(case, method, GAIN))


def _ratios(pair):
    return " / ".join(_ratio(ratio) for ratio in pair)


def _ratio(ratio):
    return "0" if ratio == 0.0 else f"{ratio:.2f}" if 0.05 <= ratio < 20.0 else f"{ratio:.0e}"


def _percent(share):
    """A share of energy: in percent, or as a factor where it is many times what there was."""
    if math.isnan(share):
        return ""
    if abs(share) < 1e-5:
        return "0 %"
    return f"{100.0 * share:.2g} %" if abs(share) < 0.995 else f"{100.0 * share:.0f} %" if share < 10.0 else f"{1.0 + share:.0e} x"


def _small(error):
    return "" if math.isnan(error) else f"{error:.0e}" if error else "0"


def _share(part, whole):
    return f"{part} of {whole} ({100.0 * part / whole:.0f} %)" if whole else "0 of 0"


def _words(case):
    return case.replace("_", " ")


INTRODUCTION = f"""Made by `{COMMAND}` (to be written)."""

SHOWN = """
## What it shows

(to be written)
"""
