"""Rank actions by the probability of an event, with common random numbers and sequential halving."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..checks.errors import InvalidHorizonError, InvalidRequestError, LimitExceededError, UncPhysicsError
from ..checks.names import hint
from ..checks.validation import flag, instance, integer, positive
from ..propagators.base import SAMPLES_LIMIT
from ..propagators.names import REFERENCE
from ..propagators.registry import make_propagator
from ..scene.belief import Belief
from ..scene.scene import Scene
from .actions import Action, apply_action
from .candidates import Candidate, CandidateError, CandidateRollouts
from .events import Event
from .prediction import Prediction
from .probability import sample_outcomes
from .ranking_table import ranking_as_dict, ranking_as_table
from .request_checks import check_memory, check_supported, marks_of
from .sequential_halving import Difference
from .snapshot import Probability
from .tables import FEW_LINES, preformatted

#: Share of `rollouts` for each action that the budget is by default, where that is more than two actions'.
_BUDGET_SHARE = 0.2


@dataclass(frozen=True, eq=False)
class RankedAction:
    """Action with its score, its difference from the first action, and its prediction.

    Attributes
    ----------
    name : str
    prediction : Prediction
        From all rollouts of the action.
    score : Probability
        Of the event by which actions are ranked.
    difference : Difference
        From the score of the first action, over the draws that both have.
    margin : float or None
        Distance of the outcomes from failure, in standard deviations over the rollouts (`Event.margin`); None
        if the events of the score have no distance.
    tied : bool
        Whether the score is within a standard error of the best one. Tied actions are ordered by margin.
    clearly_worse : bool
        Whether another action is better; wrong for the best action in at most one ranking of a thousand.
    rollouts : int
    """

    name: str
    prediction: Prediction
    score: Probability
    difference: Difference
    margin: float | None
    tied: bool
    clearly_worse: bool
    rollouts: int


@dataclass(frozen=True, eq=False)
class Ranking:
    """Actions, the best one first.

    Attributes
    ----------
    actions : tuple of RankedAction
        The best one and those tied with it, the largest margin first; then the others by their difference
        from it.
    score : Event
        What they are ranked by.
    smallest_first : bool
        Whether the best action is the one by which it is least probable.
    seed : int
        The seed that gives the same ranking again.
    """

    actions: tuple[RankedAction, ...]
    score: Event
    smallest_first: bool
    seed: int

    def __str__(self) -> str:
        return ranking_as_table(self, most=FEW_LINES)

    def _repr_html_(self) -> str:
        return preformatted(str(self))

    def to_dict(self, also: Sequence[Event] = ()) -> dict[str, Any]:
        """Return the ranking as plain Python values; `also` are events whose probabilities are added."""
        return ranking_as_dict(self, also)

    @property
    def best(self) -> RankedAction:
        """The first one."""
        return self.actions[0]

    @property
    def rollouts(self) -> int:
        """Number of rollouts of all actions together."""
        return sum(action.rollouts for action in self.actions)

    def __len__(self) -> int:
        return len(self.actions)

    def __iter__(self) -> Iterator[RankedAction]:
        return iter(self.actions)

    def __getitem__(self, name: str) -> RankedAction:
        """Return the action of that name."""
        names = [action.name for action in self.actions]
        if name not in names:
            raise InvalidRequestError(f"is no action{hint(str(name), names)}", field="name", value=name)
        return self.actions[names.index(name)]


@np.errstate(all="ignore")  # what overflows is found when beliefs are made
def rank(
    scene: Scene,
    belief: Belief,
    actions: Mapping[str, Action],
    score: Event,
    horizon: float | None = None,
    *,
    times: Sequence[float] | None = None,
    smallest_first: bool = False,
    rollouts: int = 1000,
    budget: int | None = None,
    seed: int = 0,
    max_computation_time: float | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Ranking:
    """Rank a robot's possible actions by their probability of success.

    All actions begin with the same random draws, in one batch on all threads, round by round. Before each
    round clear losers are dropped, by a sign test on the draws in which they and the leader differ. The test
    drops the best action in one ranking of a thousand. If the budget has no room for all others, the last
    ones are dropped, too.

    Parameters
    ----------
    scene : Scene
    belief : Belief
        About the bodies of the scene at time 0.
    actions : mapping of str to action
        By names of their own. An action is what changes: another `Belief`; another scene and the belief about
        it; a function that takes scene and belief and returns these; or a mapping of names to changes, for
        bodies a `BodyBelief` or fields of `BodyBelief` and `RigidBody` with their values, for elements of the
        environment fields of their class.
    score : Event
        What counts as success, such as ``InRegion("cup", bin) & Upright("cup")``.
    horizon : float, optional
        Time to predict for [s], as in `predict`. May be left out when ``times`` is given.
    times : sequence of float, optional
        Times at which a belief is wanted [s], ascending, as in `predict`.
    smallest_first : bool
        Whether the least probable action comes first, as where the score is a failure.
    rollouts : int
        Most of one action.
    budget : int, optional
        Most of all actions together; by default a fifth of ``rollouts`` for each, but as many as two of them
        may take.
    seed : int
        Of all draws. The ranking does not depend on the number of threads.
    max_computation_time : float, optional
        Wall time after which the ranking ends with an error [s]; compiling kernels does not count.
    progress : callable, optional
        Called every few hundredths of a second with the number of rollouts of the rounds done, and with the
        budget. What it raises ends the ranking; an `UncPhysicsError` then has a ``prediction`` as that of
        `PredictionTimeoutError`.

    Returns
    -------
    Ranking

    Raises
    ------
    InvalidRequestError
        If there is no action, an action changes what is not there, or the score is about it.
    PredictionTimeoutError
        If ``max_computation_time`` ran out; its ``prediction`` is the `Ranking` by the rounds until then, and
        None where not even the first one was done.
    DivergedError
        If the simulation of an action left the range of numbers.
    UncPhysicsError
        What `predict` raises, with the action that it is about.
    """
    for value, kind, name in (
        (scene, Scene, "scene"),
        (belief, Belief, "belief"),
        (actions, Mapping, "actions"),
        (score, Event, "score"),
    ):
        instance(value, kind, name)
    if not actions:
        raise InvalidRequestError("must name at least one action", field="actions")
    belief.check_fits(scene)
    score.check(scene, "score")
    flag(smallest_first, "smallest_first")
    candidates = [
        Candidate(name, *apply_action(scene, belief, action, f"actions[{name!r}]"))
        for name, action in actions.items()
    ]
    rollouts = integer(rollouts, "rollouts", low=1)
    if rollouts > SAMPLES_LIMIT:
        raise LimitExceededError(f"must be at most {SAMPLES_LIMIT}", field="rollouts", value=rollouts)
    try:
        return rank_candidates(
            candidates,
            make_propagator(REFERENCE, samples=rollouts, seed=seed),
            score,
            horizon,
            times=times,
            smallest_first=smallest_first,
            budget=budget,
            max_computation_time=max_computation_time,
            progress=progress,
        )
    except CandidateError as failed:
        error = failed.error
        field = f"actions[{candidates[failed.candidate].name!r}]" + (
            f": {error.field}" if error.field else ""
        )
        raise type(error)(error.problem, field=field, value=error.value) from error


def rank_candidates(
    candidates: Sequence[Candidate],
    propagator: Any,
    score: Event,
    horizon: float | None = None,
    *,
    times: Sequence[float] | None = None,
    smallest_first: bool = False,
    budget: int | None = None,
    max_computation_time: float | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Ranking:
    """Rank scenes and beliefs by their names, as `rank`, with a Monte Carlo propagator.

    Raises `CandidateError` with the error of a candidate, and otherwise an `UncPhysicsError`.
    """
    count, rollouts = len(candidates), propagator.samples
    usual = max(min(count, 2) * rollouts, round(_BUDGET_SHARE * rollouts * count), count)
    most: int = usual if budget is None else integer(budget, "budget", low=1)
    if most < count:
        raise InvalidRequestError(
            f"must be at least one rollout for each of {count} actions", field="budget", value=most
        )
    allowed = None if max_computation_time is None else positive(max_computation_time, "max_computation_time")
    marks = None
    for k, candidate in enumerate(candidates):
        with CandidateError.of(k):
            score.check(candidate.scene, "score")
            check_supported(candidate.scene, propagator)
            own = marks_of(candidate.scene, horizon, times)
            if marks not in (None, own):
                raise InvalidHorizonError(
                    "must be that of the other actions", field="dt", value=candidate.scene.dt
                )
            marks = own
            check_memory(candidate.scene, candidate.belief, propagator, len(own))
    assert marks is not None

    def success(prediction):
        return score.happened(_outcomes(prediction)) ^ smallest_first

    candidate_rollouts = CandidateRollouts(candidates, propagator, marks, success, most)
    make = functools.partial(_ranking, candidate_rollouts, score, smallest_first, propagator.seed)
    try:
        candidate_rollouts.run(allowed, progress)
    except UncPhysicsError as error:
        error.prediction = make() if candidate_rollouts.rounds else None
        raise
    return make()


def _outcomes(prediction):
    return sample_outcomes(prediction.scene, prediction.initial, prediction.at())


def _ranking(candidate_rollouts, score, smallest_first, seed):
    """Return the ranking from the rounds so far."""
    halving, margins, actions = candidate_rollouts.halving, [], []
    for prediction in candidate_rollouts.predictions:
        margin = score.margin(_outcomes(prediction))
        margins.append(-margin if margin is not None and smallest_first else margin)
    ties = halving.ties()
    ties.sort(key=lambda k: math.inf if margins[k] is None else -margins[k])
    for k in [*ties, *(k for k in halving.order() if k not in ties)]:
        prediction = candidate_rollouts.predictions[k]
        difference = halving.difference(k, ties[0])
        if smallest_first:
            difference = difference._replace(value=-difference.value)
        actions.append(
            RankedAction(
                candidate_rollouts.candidates[k].name,
                prediction,
                prediction.probability(score),
                difference,
                margins[k],
                len(ties) > 1 and k in ties,
                k in halving.losers,
                len(halving.outcomes[k]),
            )
        )
    return Ranking(tuple(actions), score, smallest_first, seed)
