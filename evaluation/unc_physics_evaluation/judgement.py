"""Comparison of predicted spreads and flags with the truth."""

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
    """Comparison of a body's prediction with the truth.

    Attributes
    ----------
    position, rotation : float
        Predicted spread over the true one; 1 if both are 0, infinite if only the true one is 0.
    bad : bool
        Whether a ratio differs from 1 by more than a factor of 2, or a value is not finite.
    flagged : bool
        Whether a flag is raised; for a good prediction, only flags that the truth does not confirm count.
    """

    position: float
    rotation: float
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
    return Judged(position, rotation, bad, bool(reasons if bad else reasons - confirmed))


def any_of(judged) -> Judged:
    """Combine bodies into one, which is bad or flagged if any of them is, with their worst ratios."""
    judged = list(judged)
    return Judged(
        worst(one.position for one in judged),
        worst(one.rotation for one in judged),
        any(one.bad for one in judged),
        any(one.flagged for one in judged),
    )


def rates(judged) -> Rates:
    """Count bad, good and flagged predictions."""
    judged = list(judged)
    bad = [one for one in judged if one.bad]
    good = [one for one in judged if not one.bad]
    return Rates(len(bad), len(good), sum(one.flagged for one in bad), sum(one.flagged for one in good))


def worst(ratios) -> float:
    """Return the ratio that is farthest from 1 in either direction; NaN counts as farthest."""
    return max(ratios, key=lambda ratio: math.inf if not ratio > 0.0 else abs(math.log(ratio)))


def _ratio(predicted, truth, floor):
    if predicted <= floor and truth <= floor:
        return 1.0
    return predicted / truth if truth > 0.0 else math.inf
