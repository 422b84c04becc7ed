"""Times at which rollouts are recorded."""

from typing import NamedTuple

import numpy as np

#: Stop flag of rollouts that are never stopped early (`compiler.time_limit`).
NEVER = np.zeros(1, np.int64)


class Stops(NamedTuple):
    """Times at which rollouts are recorded, ascending.

    Attributes
    ----------
    steps : (T,) int64
        Whole time steps before each, counted from the first step of the call.
    rest : (T,) float64
        Length of the shorter step that follows these [s]; 0 for none. It changes only what is recorded.
    """

    steps: np.ndarray
    rest: np.ndarray
