"""Status of a prediction, for users: `assess` at the horizon and `assess_all` at each time."""

from __future__ import annotations

from dataclasses import replace

from ..checks.validation import instance
from .body_status import BodyStatus
from .diagnosis import ROLLOUTS, judge
from .prediction import Prediction


def assess(prediction: Prediction, *, rollouts: int = ROLLOUTS) -> tuple[BodyStatus, ...]:
    """Check what can be checked of a prediction at its end.

    Parameters
    ----------
    prediction : Prediction
    rollouts : int, optional
        Number of rollouts to compare spread and mean with; 0 for none. A single nominal rollout is compared
        if there is something to touch, or a gyroscopic term. Pairs of points are compared where they may
        fail (`evidence.Evidence.doubts`). If spreads differ by a factor of more than 1.15, or means by more
        than a quarter of the standard deviation, 24 more rollouts decide, unless there are 36. With 0,
        answers that should be compared are flagged as unchecked.

    Returns
    -------
    tuple of BodyStatus
        One for each body, in the scene's order; a fixed body's has no measures.

    Notes
    -----
    Each measure stands with its limit and its words in `diagnostics`.
    """
    instance(prediction, Prediction, "prediction")
    return assess_all(replace(prediction, snapshots=(prediction.at(),)), rollouts=rollouts)[0]


def assess_all(prediction: Prediction, *, rollouts: int = ROLLOUTS) -> tuple[tuple[BodyStatus, ...], ...]:
    """As `assess`, at each of the prediction's times, of the prediction that ends there."""
    instance(prediction, Prediction, "prediction")
    return judge(prediction, rollouts)
