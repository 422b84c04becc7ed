"""Scores of faces, and intervals of mean scores; the other proper scores are `unc_physics.calibration`'s."""

from __future__ import annotations

import numpy as np


def brier_score(classes: np.ndarray, observed: int, count: int) -> float:
    """Sum of squared differences between the samples' shares of the classes and the outcome: 0 to 2.

    Parameters
    ----------
    classes : (n,) int array
        Of the samples, below ``count``.
    observed : int
        The class that came.
    count : int
        Number of classes.
    """
    shares = np.bincount(classes, minlength=count) / len(classes)
    shares[observed] -= 1.0
    return float(shares @ shares)


def bootstrap(values: np.ndarray, rng: np.random.Generator, resamples: int = 2000) -> tuple[float, float]:
    """2.5 % and 97.5 % quantiles of the mean of values (n,), drawn anew with replacement."""
    drawn = values[rng.integers(len(values), size=(resamples, len(values)))]
    return tuple(np.quantile(drawn.mean(axis=1), [0.025, 0.975]).tolist())


def rms(values: np.ndarray) -> float:
    """Root mean square of values (n,)."""
    return float(np.sqrt(np.mean(np.square(values))))
