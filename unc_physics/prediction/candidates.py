"""Rollouts of several scenes, round by round of a sequential halving."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..checks.errors import PredictionTimeoutError, UncPhysicsError
from ..compiler.compile_time import clock
from ..compiler.threads import in_threads, single_thread
from ..compiler.time_limit import limit_here, time_limit, under_limit
from ..propagators.base import rollout_count
from ..propagators.start import constrain_belief
from ..scene.belief import Belief
from ..scene.marks import Mark
from ..scene.scene import Scene
from ..scene.stiffness import with_stiffness
from .compute_budget import ComputeBudget
from .driver import are_moved_at_start, simulate, snapshot
from .prediction import Prediction
from .sequential_halving import SequentialHalving


class Candidate(NamedTuple):
    """Scene with the belief about it, by name."""

    name: str
    scene: Scene
    belief: Belief


class CandidateError(Exception):
    """Error of one candidate, by its index; the others may be valid."""

    def __init__(self, candidate: int, error: UncPhysicsError):
        super().__init__(str(error))
        self.candidate, self.error = candidate, error

    @classmethod
    @contextlib.contextmanager
    def of(cls, candidate: int):
        """Attribute errors of the ``with`` block to a candidate."""
        try:
            yield
        except PredictionTimeoutError:
            raise
        except UncPhysicsError as error:
            raise cls(candidate, error) from error


class CandidateRollouts:
    """Sequential halving over candidates, with common draws of one Monte Carlo propagator.

    Parameters
    ----------
    candidates : sequence of Candidate
    propagator : MonteCarlo
        Its samples are the most rollouts of one candidate.
    marks : list of Mark
        Times of beliefs, ascending.
    success : callable
        Takes a `Prediction`, and returns in which of its rollouts (N,) the action succeeded.
    budget : int
        As in `SequentialHalving`.

    Attributes
    ----------
    predictions : list of Prediction
        Of all candidates, from the rollouts so far.
    rounds : int
        Number of rounds so far.
    """

    def __init__(
        self,
        candidates: Sequence[Candidate],
        propagator: Any,
        marks: list[Mark],
        success: Callable[[Prediction], np.ndarray],
        budget: int,
    ):
        self.candidates, self.rounds = candidates, 0
        self.halving = SequentialHalving(len(candidates), propagator.samples, budget)
        self.predictions: list[Prediction] = []
        self._propagator, self._marks, self._success, self._budget = propagator, marks, success, budget
        self._scenes, self._beliefs = [], []
        for k, candidate in enumerate(candidates):
            with CandidateError.of(k):
                self._scenes.append(with_stiffness(candidate.scene, candidate.belief.mean))
                self._beliefs.append(constrain_belief(self._scenes[k], candidate.belief))
        # of each: the carry at time 0, and those after the marks
        self._carries: list[list[Any]] = [[] for _ in candidates]

    def run(self, allowed: float | None, progress: Callable[[int, int], object] | None) -> None:
        """Run the rounds, within a wall time ``allowed`` [s] if there is one.

        ``progress`` is called every few hundredths of a second and after each round, with the number of
        rollouts of the completed rounds and the budget. Its exceptions end the ranking.
        """
        started = clock()
        with time_limit() as limit:
            ends_early = all(scene.integrator == "implicit" for scene in self._scenes)
            compute_budget = ComputeBudget(allowed, started, limit if ends_early else None)
            while (following := self.halving.next) is not None:
                try:
                    carries = self._round(following, compute_budget, progress)
                except PredictionTimeoutError as error:
                    done = f"after {self.halving.spent} rollouts of {self._budget}"
                    done = done if self.rounds else "in the first round"
                    raise type(error)(f"ran out {done}", field=error.field, value=error.value) from None
                self._keep(following, carries, clock() - started)
                if progress is not None:
                    progress(self.halving.spent, self._budget)

    def _round(self, following, compute_budget, progress):
        """Return the carries at time 0 and after the marks, of the additional rollouts of a round."""
        scenes = [self._scenes[k] for k in following.actions]
        counts = [len(self.halving.outcomes[k]) for k in following.actions]

        def begin():
            carries = []
            for k, first in zip(following.actions, counts, strict=True):
                with CandidateError.of(k):
                    scene, belief = self._scenes[k], self._beliefs[k]
                    carries.append(self._propagator.init_rollouts(scene, belief, first, following.rollouts))
            return carries

        def advance_through(carries, marks):
            return _advance_together(self._propagator, carries, scenes, marks)

        def show(done, steps):
            progress(self.halving.spent, self._budget)

        shown = None if progress is None else show
        run = simulate(begin, advance_through, self._marks, scenes[0], compute_budget, shown)
        return list(zip(*(carries for _, carries in run), strict=True))

    def _keep(self, following, carries, spent):
        """Add the round's rollouts to those before, and their outcomes to the halving."""
        concatenate, outcomes = self._propagator.concatenate, []
        for k, further in zip(following.actions, carries, strict=True):
            before = self._carries[k]
            if before:
                further = [concatenate(*pair) for pair in zip(before, further, strict=True)]
            self._carries[k] = further
            prediction = self._prediction(k, spent)
            outcomes.append(self._success(prediction)[len(self.halving.outcomes[k]) :])
            if self.rounds:
                self.predictions[k] = prediction
            else:
                self.predictions.append(prediction)
        self.halving.add(outcomes)
        self.rounds += 1

    def _prediction(self, k, spent):
        """Return the prediction of a candidate from the rollouts so far."""
        first, *later = self._carries[k]
        scene, given = self._scenes[k], self.candidates[k].belief
        own = replace(self._propagator, samples=len(first.states))
        with CandidateError.of(k):
            snapshots = tuple(
                snapshot(own, scene, carry, mark) for carry, mark in zip(later, self._marks, strict=True)
            )
        start = own.belief(first, scene) if are_moved_at_start(scene, first) else given
        return Prediction(scene, own, snapshots, given, start, spent)


def _advance_together(
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
