"""The outcomes that a prediction splits into, as a few weighted Gaussians."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .predict import Prediction


class Mode(NamedTuple):
    """One outcome of a body.

    Attributes
    ----------
    weight : float
        Those of a body's modes add up to 1.
    mean : (13,) array
        As in `Belief.mean`.
    covariance : (12, 12) array
        Over the error state about the mean.
    """

    weight: float
    mean: np.ndarray
    covariance: np.ndarray


def modes(prediction: Prediction, time: int, body: int) -> tuple[Mode, ...]:
    """The modes of a body at one of a prediction's times.

    Parameters
    ----------
    prediction : Prediction
    time, body : int
        Indices of the time and of the body.

    Returns
    -------
    tuple of Mode
        The most probable first. All propagators that there are give a single Gaussian, so it is one.
    """
    belief = prediction.beliefs[time]
    return (Mode(1.0, belief.mean[body], belief.marginal(body)),)
