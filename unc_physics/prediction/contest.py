"""Rollouts of several scenes, round by round of a race."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..checks.errors import PredictionTimeoutError, UncPhysicsError
from ..physics.compile_time import clock
from ..physics.threads import watched
from ..physics.time_limit import time_limit
from ..propagators.batch import advance_together
from ..propagators.start import known
from ..scene.belief import Belief
from ..scene.scene import Scene
from ..scene.stiffness import with_stiffness
from .computed import Computed
from .predict import as_driven, finite, nothing
from .prediction import Prediction
from .racing import Race
from .within import LOOK_UP_AFTER, Within


class Entrant(NamedTuple):
    """One of the scenes, with the belief about it, by a name."""

    name: str
    scene: Scene
    belief: Belief


class Failed(Exception):
    """What is wrong with one entrant, the others being fine.

    Attributes
    ----------
    entrant : int
    error : UncPhysicsError
    """

    def __init__(self, entrant: int, error: UncPhysicsError):
        super().__init__(str(error))
        self.entrant, self.error = entrant, error

    @classmethod
    @contextlib.contextmanager
    def of(cls, entrant: int):
        """Have what is raised in here be about an entrant."""
        try:
            yield
        except PredictionTimeoutError:
            raise
        except UncPhysicsError as error:
            raise cls(entrant, error) from error


class Contest:
    """Runs a race.

    Parameters
    ----------
    entrants : sequence of Entrant
    propagator : Propagator
        With an option ``samples``, as `REFERENCE` has; all have its draws in common.
    marks : list of int
        Numbers of steps after which a belief is wanted, ascending.
    success : callable
        Takes a `Prediction`; in which of its rollouts (N,) the action succeeded.
    budget : int
        As in `racing.Race`, whose most rollouts of one entrant are the propagator's samples.
    keep_samples : int
        As in `predict`; an entrant with fewer rollouts has as many as these.

    Attributes
    ----------
    race : Race
    predictions : list of Prediction
        By the rollouts until now.
    rounds : int
        How many there were.
    """

    def __init__(
        self,
        entrants: Sequence[Entrant],
        propagator: Any,
        marks: list[int],
        success: Callable[[Prediction], np.ndarray],
        budget: int,
        keep_samples: int = 0,
    ):
        self.entrants, self.race, self.rounds = entrants, Race(len(entrants), propagator.samples, budget), 0
        self._keep_samples = keep_samples
        self.predictions: list[Prediction] = []
        self._propagator, self._marks, self._success, self._budget = propagator, marks, success, budget
        self._scenes, self._beliefs = [], []
        for k, entrant in enumerate(entrants):
            with Failed.of(k):
                self._scenes.append(with_stiffness(entrant.scene, entrant.belief.mean))
                self._beliefs.append(known(self._scenes[k], entrant.belief))
        # of each: the carry at time 0, and those after the marks
        self._carries: list[list[Any]] = [[] for _ in entrants]

    def run(self, allowed: float | None, progress: Callable[[int, int], object] | None) -> None:
        """Go through the rounds.

        Parameters
        ----------
        allowed : float or None
            Wall time [s].
        progress : callable, optional
            Called every few hundredths of a second, and after each round, with the number of rollouts of the
            rounds until then, and with the budget. What it raises ends the contest.
        """
        started = clock()
        with time_limit() as limit:
            ends_early = all(scene.integrator == "implicit" for scene in self._scenes)
            within = Within(allowed, started, limit if ends_early else None)
            while (following := self.race.next) is not None:
                carries = within.complete(self._rolled, following, within, progress)
                if carries is None or within.over:
                    raise self._late(within)
                self._keep(following, carries, clock() - started)
                if progress is not None:
                    progress(self.race.spent, self._budget)

    def _late(self, within):
        error = within.error(0.0, 0.0)
        done = f"after {self.race.spent} rollouts of {self._budget}" if self.rounds else "in the first round"
        return type(error)(f"ran out {done}", field=error.field, value=error.value)

    def _rolled(self, following, within, progress):
        """The carries at time 0 and after the marks of the further rollouts of a round."""

        told = clock()

        def look():
            nonlocal told
            if progress is not None and clock() - told > LOOK_UP_AFTER:
                told = clock()
                progress(self.race.spent, self._budget)
            if within.over:
                raise self._late(within)

        scenes = [self._scenes[k] for k in following.actions]
        in_one_go = within.allowed is None and progress is None
        with contextlib.nullcontext() if in_one_go else watched(look):
            carries = [
                [self._begun(k, len(self.race.outcomes[k]), following.rollouts)] for k in following.actions
            ]
            done = 0
            for mark in self._marks:
                latest = [own[-1] for own in carries]
                advanced = advance_together(self._propagator, latest, scenes, mark - done)
                done = mark
                for own, carry in zip(carries, advanced, strict=True):
                    own.append(carry)
        return carries

    def _begun(self, k, first, last):
        with Failed.of(k):
            return self._propagator.begun(self._scenes[k], self._beliefs[k], first, last)

    def _keep(self, following, carries, spent):
        """Add the round's rollouts to those before, and their outcomes to the race."""
        together, outcomes = self._propagator.together, []
        for k, further in zip(following.actions, carries, strict=True):
            before = self._carries[k]
            if before:
                further = [together(*pair) for pair in zip(before, further, strict=True)]
            self._carries[k] = further
            prediction = self._prediction(k, spent)
            outcomes.append(self._success(prediction)[len(self.race.outcomes[k]) :])
            if self.rounds:
                self.predictions[k] = prediction
            else:
                self.predictions.append(prediction)
        self.race.add(outcomes)
        self.rounds += 1

    def _prediction(self, k, spent):
        """What is known of an entrant until now."""
        first, *later = self._carries[k]
        scene = self._scenes[k]
        own = replace(self._propagator, samples=len(first.states))
        times = tuple(mark * scene.dt for mark in self._marks)
        with Failed.of(k):
            beliefs = tuple(
                finite(as_driven(own.belief(carry, scene), scene, time), time)
                for carry, time in zip(later, times, strict=True)
            )
        began = partial(own.belief, first, scene)
        answers = Computed(later[-1], began, [nothing] * len(times), [None] * len(times))
        kept = None
        if self._keep_samples:
            kept = tuple(own.own_samples(carry, scene)[: self._keep_samples].copy() for carry in later)
        return Prediction(scene, own, times, beliefs, spent, self.entrants[k].belief, answers, kept)
