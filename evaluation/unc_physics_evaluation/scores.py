"""Scores of faces, and intervals of mean scores; other proper scores are in `unc_physics.calibration`."""

from __future__ import annotations

import numpy as np


def brier_score(classes: np.ndarray, observed: int, count: int) -> float:
    """Return the sum of squared differences between the samples' class shares and the outcome, 0 to 2.

    Parameters
    ----------
    classes : (n,) int array
        Classes of the samples, below ``count``.
    observed : int
        Observed class.
    count : int
        Number of classes.
    """
    shares = np.bincount(classes, minlength=count) / len(classes)
    shares[observed] -= 1.0
    return float(shares @ shares)


def bootstrap(values: np.ndarray, rng: np.random.Generator) -> tuple[float, float]:
    """Return the 2.5 % and 97.5 % bootstrap quantiles of the mean of values (n,)."""
    drawn = values[rng.integers(len(values), size=(2000, len(values)))]
    return tuple(np.quantile(drawn.mean(axis=1), [0.025, 0.975]).tolist())


def rms(values: np.ndarray) -> float:
    """Return the root mean square of values (n,)."""
    return float(np.sqrt(np.mean(np.square(values))))
