"""Paired timings: what is compared runs in turns, so that a busy machine slows all of it alike."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import numpy as np


def paired(
    functions: Mapping[str, Callable[[int], object]], repeats: int, clock=time.process_time
) -> dict[str, np.ndarray]:
    """Time several functions in turns: A B C, A B C, ...

    Parameters
    ----------
    functions : mapping of str to callable
        Each is called with the number of the round. One call of each comes first and is not counted.
    repeats : int
        Number of rounds.
    clock : callable
        `time.process_time` (CPU time, which other processes do not add to) or `time.perf_counter` (wall
        time).

    Returns
    -------
    dict of str to (repeats,) array
        [s]
    """
    for function in functions.values():
        function(0)
    times = {name: np.empty(repeats) for name in functions}
    for k in range(repeats):
        for name, function in functions.items():
            start = clock()
            function(k)
            times[name][k] = clock() - start
    return times


def ratio(times: Mapping[str, np.ndarray], slow: str, fast: str) -> float:
    """Median over the rounds of how many times longer ``slow`` took than ``fast``."""
    return float(np.median(times[slow] / times[fast]))
