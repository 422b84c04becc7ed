"""Whether predicted spreads are right, and whether the flags of a prediction say so."""

from __future__ import annotations

import math
from collections.abc import Set as AbstractSet
from typing import NamedTuple

from unc_physics.prediction.body_status import Status

FACTOR = 2.0  # within which a spread is right
POSITION_FLOOR = 1e-9  # of the body's extent: spreads below are nothing
ROTATION_FLOOR = 1e-9  # rad
#: Overlap that was resolved at the start is no doubt about the answer.
IGNORED = Status.INITIAL_OVERLAP
#: Measures that say to read modes or samples in place of the mean.
SHAPE = {"outcomes", "mean_penetration", "rotation_std"}


class Judged(NamedTuple):
    """A body's prediction against the truth.

    Attributes
    ----------
    position, rotation : float
        Predicted spread over the true one; 1 where both are nothing, infinite where only the true one is.
    bad : bool
        Whether one of them is off by more than a factor of 2, or no number, or the truth is none.
    flagged : bool
        Whether a flag is raised; of a good prediction, one that the truth does not confirm.
    """

    position: float
    rotation: float
    bad: bool
    flagged: bool


class Rates(NamedTuple):
    """How many predictions were bad and good, and of each how many were flagged."""

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
    """Compare spreads (position [m], rotation [rad]) with the true ones, of a body of that extent [m].

    ``reasons`` are the measures that raise flags. Those that are ``confirmed`` do not doubt right spreads.
    What is ``impossible``, because bodies go through each other or rollouts gain energy, is bad however well
    the spreads agree.
    """
    position = _ratio(predicted[0], truth[0], POSITION_FLOOR * extent)
    rotation = _ratio(predicted[1], truth[1], ROTATION_FLOOR)
    bad = impossible or not all(1.0 / FACTOR <= ratio <= FACTOR for ratio in (position, rotation))
    return Judged(position, rotation, bad, bool(reasons if bad else reasons - confirmed))


def any_of(judged) -> Judged:
    """Several bodies as one, which is bad or flagged if any of them is; with their worst ratios."""
    judged = list(judged)
    return Judged(
        worst(one.position for one in judged),
        worst(one.rotation for one in judged),
        any(one.bad for one in judged),
        any(one.flagged for one in judged),
    )


def rates(judged) -> Rates:
    """Of any number of predictions."""
    judged = list(judged)
    bad = [one for one in judged if one.bad]
    good = [one for one in judged if not one.bad]
    return Rates(len(bad), len(good), sum(one.flagged for one in bad), sum(one.flagged for one in good))


def worst(ratios) -> float:
    """The ratio that is farthest from 1, in either direction; NaN counts as farthest."""
    return max(ratios, key=lambda ratio: math.inf if not ratio > 0.0 else abs(math.log(ratio)))


def _ratio(predicted, truth, floor):
    if predicted <= floor and truth <= floor:
        return 1.0
    return predicted / truth if truth > 0.0 else math.inf
