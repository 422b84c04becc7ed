"""Predictions of bodies against the truth: wrong or good, flagged or not, inside intervals or not."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from unc_physics.spatial.layout import ERR_POSITION, ERR_ROTATION, POSITION, QUATERNION

#: Factor of a spread, and error of a mean over the true standard deviation: beyond which an answer is wrong,
#: and within which it is good.
WRONG = 1.5, 0.5
GOOD = 1.25, 0.25
#: Spreads below count as nothing [m], [rad]: a contact's own compliance, not the belief's.
NOTHING = 5e-5, 1e-3


class Moments(NamedTuple):
    """Mean state (13,) and covariance (12, 12) of a body."""

    mean: np.ndarray
    covariance: np.ndarray

    @property
    def spreads(self) -> tuple[float, float]:
        """Return the standard deviations of position [m] and rotation [rad] over all axes."""
        variances = np.diagonal(self.covariance)
        position, rotation = (
            max(math.sqrt(max(variances[block].sum(), 0.0)), nothing)
            for block, nothing in zip((ERR_POSITION, ERR_ROTATION), NOTHING, strict=True)
        )
        return position, rotation


class Answer(NamedTuple):
    """Error of one body's prediction.

    Attributes
    ----------
    factor : float
        Larger ratio, at least 1, between predicted and true standard deviation of position or rotation.
    mean_error : float
        Larger distance of the means of position or rotation, over the true standard deviation.
    flagged : bool
        Whether any flag is raised.
    falsely : bool
        Whether a flag is raised that the truth does not confirm.
    covered : bool
        Whether intervals contain the true means and standard deviations.
    """

    factor: float
    mean_error: float
    flagged: bool
    falsely: bool
    covered: bool

    @property
    def wrong(self) -> bool:
        """Whether the error of a spread or a mean exceeds `WRONG`, or is NaN."""
        return not (self.factor <= WRONG[0] and self.mean_error <= WRONG[1])

    @property
    def good(self) -> bool:
        """Whether the errors of spreads and means are within `GOOD`."""
        return self.factor <= GOOD[0] and self.mean_error <= GOOD[1]


class Counts(NamedTuple):
    """Numbers of bodies: all, wrong, wrong without a flag or interval, good, good but falsely flagged."""

    bodies: int
    wrong: int
    silent: int
    good: int
    false: int


def distance(
    predicted: Moments, truth: Moments, least: tuple[float, float] = (0.0, 0.0)
) -> tuple[float, float]:
    """Return `Answer.factor` and `Answer.mean_error` of a body.

    Means within ``least`` [m], [rad] of each other count as equal.
    """
    factor = max(max(a / b, b / a) for a, b in zip(predicted.spreads, truth.spreads, strict=True))
    shift = np.linalg.norm(predicted.mean[POSITION] - truth.mean[POSITION])
    cosine = abs(predicted.mean[QUATERNION] @ truth.mean[QUATERNION])
    angle = 2.0 * math.acos(min(cosine, 1.0))
    errors = zip((shift, angle), truth.spreads, least, strict=True)
    return factor, max(float(error / spread) * (error > small) for error, spread, small in errors)


def count(answers: Iterable[Answer]) -> Counts:
    """Count bodies by category."""
    answers = list(answers)
    wrong = [one for one in answers if one.wrong]
    good = [one for one in answers if one.good]
    return Counts(
        len(answers),
        len(wrong),
        sum(not one.flagged and not one.covered for one in wrong),
        len(good),
        sum(one.falsely for one in good),
    )
