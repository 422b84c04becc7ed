"""Paired timings: compared functions run in turns, so that other load slows all of them equally."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Mapping
from typing import TypeVar

import numpy as np

from .jobs import Row

Key = TypeVar("Key", bound=Hashable)


def paired(
    functions: Mapping[Key, Callable[[int], object]], repeats: int, clock=time.process_time
) -> dict[Key, np.ndarray]:
    """Time several functions in turns: A B C, A B C, ...

    Parameters
    ----------
    functions : mapping to callable
        Each is called with the number of the round, after one call that is not measured.
    repeats : int
        Number of rounds.
    clock : callable
        `time.process_time` (CPU time, which other processes do not add to) or `time.perf_counter` (wall
        time).

    Returns
    -------
    dict to (repeats,) array
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


def timed(
    functions: Mapping[tuple[str, int | None, str], Callable[[int], object]],
    rounds: int,
    clock=time.process_time,
) -> list[Row]:
    """Return rows of the times of functions, by method, samples and quantity."""
    return [
        Row(method, quantity, "s", float(seconds), samples, k)
        for (method, samples, quantity), taken in paired(functions, rounds, clock).items()
        for k, seconds in enumerate(taken)
    ]
