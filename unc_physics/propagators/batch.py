"""Advance rollouts of several scenes in one batch, so that few rollouts of each occupy all threads."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..compiler.threads import in_threads, single_thread
from ..compiler.time_limit import limit_here, under_limit
from ..scene.marks import Mark
from ..scene.scene import Scene
from .base import rollout_count


def advance_together(
    propagator: Any, carries: Sequence[Any], scenes: Sequence[Scene], marks: Sequence[Mark]
) -> list[list[Any]]:
    """Return the carries of several scenes, for each of several marks (`Propagator.advance_through`).

    The carries have done equally many steps. Each of numba's threads advances a part of all rollouts
    (`base.Rollouts`), which may be of more than one scene.
    """
    counts = [rollout_count(carry) for carry in carries]
    ends = np.cumsum(counts)
    parts: list[list[tuple[int, Any]]] = [[] for _ in carries]
    limit, lock = limit_here(), threading.Lock()

    def run(batch):
        for k, end in enumerate(ends.tolist()):
            begin = end - counts[k]
            first, last = max(batch.start, begin), min(batch.stop, end)
            if first >= last:
                continue
            some = propagator.select_rollouts(carries[k], slice(first - begin, last - begin))
            with under_limit(limit), single_thread():
                advanced = propagator.advance_through(some, scenes[k], marks)
            with lock:
                parts[k].append((first, advanced))

    in_threads(int(ends[-1]), run)
    return [
        [_joined(propagator, [(first, carries[m]) for first, carries in own]) for own in parts]
        for m in range(len(marks))
    ]


def _joined(propagator, parts):
    """Return one carry of parts, which are sorted by their first rollouts and joined pairwise."""
    carries = [part for _, part in sorted(parts, key=lambda entry: entry[0])]
    while len(carries) > 1:
        pairs = [carries[k : k + 2] for k in range(0, len(carries), 2)]
        carries = [propagator.concatenate(*pair) if len(pair) == 2 else pair[0] for pair in pairs]
    return carries[0]
