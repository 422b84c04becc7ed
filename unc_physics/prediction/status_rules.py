"""A prediction's flags, and by which measures and limits they are raised."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntFlag
from typing import NamedTuple

from ..propagators.names import REFERENCE
from ..propagators.registry import names_where
from ..scene.scene import Scene

_SAMPLED = names_where(lambda propagator: propagator.own_sample_count is not None, " or ")
_ESTIMATED = names_where(lambda propagator: propagator.traits.mean_update == "estimated", " or ")


class Status(IntFlag):
    """Flags of one body's prediction; the numbers are those of ``unc_physics_msgs/msg/PredictedObject``."""

    FINE = 0
    NOT_CONVERGED = 1
    OUTSIDE_VALIDITY = 2
    INITIAL_OVERLAP = 4


class Rule(NamedTuple):
    """When a measure raises a flag.

    Attributes
    ----------
    flag : Status
    limit : float
        Above which it does.
    words : str
        What that says, with what to do.
    unless_compared : bool
        Whether it does not where the spread was compared with that of rollouts, which tell more.
    """

    flag: Status
    limit: float
    words: str
    unless_compared: bool = False


#: Of each measure; `status.assess` explains them.
RULES = {
    "initial_overlap": Rule(
        Status.INITIAL_OVERLAP,
        0.02,
        (
            "overlaps another body or the environment at the start; give poses without overlap, or take the"
            " implicit integrator with 'overlap: project'"
        ),
    ),
    "overlap_share": Rule(
        Status.INITIAL_OVERLAP, math.inf, "overlapped at the start, and was moved to the nearest pose without"
    ),
    "overlap_moved": Rule(
        Status.INITIAL_OVERLAP,
        0.01,
        (
            "some of the belief was moved by more than 5 standard deviations, to where it does not overlap or"
            " stands; check its pose, or give it a larger covariance"
        ),
    ),
    "overlap_kept": Rule(
        Status.INITIAL_OVERLAP,
        0.02,
        (
            "cannot come free of what it overlaps at the start, and keeps the overlap; check its pose, or"
            " give it a larger covariance"
        ),
    ),
    "overlap_certain": Rule(Status.INITIAL_OVERLAP, 0.5, "overlaps at the start for certain; check its pose"),
    "settled_tilt": Rule(
        Status.INITIAL_OVERLAP,
        math.radians(15.0),
        (
            "is said to be at rest, and tilted far until something held it; check its orientation, and"
            " what is below it"
        ),
    ),
    "unsettled": Rule(
        Status.INITIAL_OVERLAP,
        0.05,
        "is said to be at rest, and nothing holds it; put something below it, or take at_rest away",
    ),
    "energy_gain": Rule(Status.NOT_CONVERGED, 0.02, "energy was gained; a smaller dt, now {dt:.3g} s, helps"),
    "contact_residual": Rule(
        Status.NOT_CONVERGED,
        5e-3,
        (
            "contact forces were not found well enough; a smaller dt, now {dt:.3g} s, or masses that differ"
            " less, help"
        ),
    ),
    "step_times_frequency": Rule(
        Status.NOT_CONVERGED,
        1.3,
        "the step is too long for the stiffness of contacts; lower dt, now {dt:.3g} s, to {shorter:.2g} s",
    ),
    "impact_over_capacity": Rule(
        Status.NOT_CONVERGED,
        1.0,
        (
            "hits harder than the stiffness can stop; raise stiffness, now {stiffness:.3g}, above"
            " {stiffer:.2g} N/m^3, and lower dt with its root"
        ),
    ),
    "directions": Rule(
        Status.OUTSIDE_VALIDITY,
        30.0,
        f"too many uncertain directions for as few points; islands or {_SAMPLED} helps",
        True,
    ),
    "rotation_std": Rule(
        Status.OUTSIDE_VALIDITY,
        2.2,
        f"the rotation is too uncertain for a Gaussian; samples of {REFERENCE} are not",
    ),
    "spread_disagreement": Rule(
        Status.OUTSIDE_VALIDITY, 1.9, f"rollouts spread differently; {_SAMPLED} helps"
    ),
    "doubtful_contacts": Rule(
        Status.OUTSIDE_VALIDITY,
        1.75,
        (
            "contacts may open, close or coincide otherwise within a standard deviation, and rollouts spread"
            f" differently; {_ESTIMATED} helps"
        ),
    ),
    "few_samples": Rule(Status.OUTSIDE_VALIDITY, 0.3, "too few samples to tell a spread"),
    "unevenness": Rule(
        Status.OUTSIDE_VALIDITY, 2.5, f"opposite points do not move oppositely; {_SAMPLED} helps", True
    ),
    "mean_overlap": Rule(
        Status.OUTSIDE_VALIDITY,
        0.4,
        f"the mean of its points lies inside another body or the environment; {_SAMPLED} helps",
    ),
    "surface_error": Rule(Status.OUTSIDE_VALIDITY, math.inf, "rollouts do not tell what is between them"),
    "mean_error": Rule(Status.OUTSIDE_VALIDITY, 0.35, "rests on too few rollouts; more of them help"),
    "unchecked": Rule(
        Status.OUTSIDE_VALIDITY,
        0.5,
        (f"its spread after a contact was not compared with rollouts; ask for some, or take {_ESTIMATED}"),
    ),
}


@dataclass(frozen=True)
class BodyStatus:
    """What speaks against one body's prediction.

    Attributes
    ----------
    body : str
        Its name.
    flags : Status
    measures : dict of str to float
        What the flags were judged by, each by name (`assess`).
    reasons : tuple of str
        The flags in words.
    """

    body: str
    flags: Status
    measures: dict[str, float]
    reasons: tuple[str, ...]

    @property
    def message(self) -> str:
        """The reasons in one text; empty when fine."""
        return "; ".join(self.reasons)


def raised(measures: Mapping[str, float]) -> list[str]:
    """Those of a body's measures, by name, that raise their flags; what is no number does."""
    compared = "spread_disagreement" in measures
    return [
        name
        for name, value in measures.items()
        if not value <= RULES[name].limit and not (compared and RULES[name].unless_compared)
    ]


def judged(scene: Scene, name: str, measures: dict[str, float]) -> BodyStatus:
    """The status that a body's measures make."""
    flags, reasons = Status.FINE, []
    for key in raised(measures):
        value, (flag, limit, words, _) = measures[key], RULES[key]
        flags |= flag
        words = words.format(
            dt=scene.dt,
            stiffness=scene.stiffness,
            shorter=scene.dt * limit / value,
            stiffer=(scene.stiffness or 0.0) * value,
        )
        reasons.append(f"{words} ({key} {value:.3g} above {limit:.3g})")
    return BodyStatus(name, flags, measures, tuple(reasons))
