"""Rank actions by the probability of an event, with common random numbers and sequential halving."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..checks.errors import InvalidRequestError, LimitExceededError, PredictionTimeoutError, UncPhysicsError
from ..checks.names import hint, with_known_keywords
from ..checks.shown import printable
from ..checks.validation import instance, integer, positive
from ..compiler.compile_time import clock
from ..compiler.time_limit import time_limit
from ..propagators.base import SAMPLES_LIMIT, rollout_count
from ..propagators.names import REFERENCE
from ..propagators.registry import make_propagator
from ..propagators.start import constrain_belief
from ..scene.belief import Belief
from ..scene.marks import Mark
from ..scene.scene import Scene
from .actions import Action, apply_action
from .compute_budget import ComputeBudget
from .driver import are_moved_at_start, simulate, snapshot
from .events import Event
from .predict import prepare
from .prediction import Prediction
from .probability import sample_outcomes
from .request_checks import checked_marks
from .sequential_halving import Difference, SequentialHalving
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
    seed : int
        The seed that gives the same ranking again.
    """

    actions: tuple[RankedAction, ...]
    score: Event
    seed: int

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

    def __str__(self) -> str:
        return self.table(most=FEW_LINES)

    def _repr_html_(self) -> str:
        return preformatted(str(self))

    def to_dict(self, also: Sequence[Event] = ()) -> dict[str, Any]:
        """Return the ranking as plain Python values; `also` are events whose probabilities are added."""
        return {
            "score": str(self.score),
            "seed": self.seed,
            "rollouts": self.rollouts,
            "wall_time": max(action.prediction.wall_time for action in self),
            "actions": [
                {
                    "name": action.name,
                    "score": asdict(action.score),
                    "difference": action.difference.value,
                    "difference_std": action.difference.std,
                    "margin": action.margin,
                    "tied": action.tied,
                    "clearly_worse": action.clearly_worse,
                    "rollouts": action.rollouts,
                    "also": {str(event): asdict(action.prediction.probability(event)) for event in also},
                }
                for action in self
            ],
        }

    def table(self, also: Sequence[Event] = (), most: int | None = None) -> str:
        """Return a table of at most ``most`` lines; each event of `also` is a column."""
        width = max(6, *(len(printable(action.name)) for action in self))
        lines = [
            f"probability of: {printable(str(self.score))}; {self.rollouts} rollouts, seed {self.seed}",
            f"{'action':<{width}}  probability     interval           difference  margin  rollouts"
            + "".join(f"  {f'[{k}]':>5}" for k in range(1, len(also) + 1)),
        ]
        for action in self:
            p, found = action.score, action.difference
            difference = "" if action is self.best else f"{found.value:+.3f} +- {found.std:.3f}"
            margin = "" if action.margin is None else f"{action.margin:.2f}"
            lines.append(
                f"{printable(action.name):<{width}}  {p.estimate:11.3f}  {p.low:.3f} to {p.high:.3f}"
                f"  {difference:>16}  {margin:>6}  {action.rollouts:8d}"
                + "".join(f"  {action.prediction.probability(event).estimate:.3f}" for event in also)
                + ("  tied" if action.tied else "  clearly worse" if action.clearly_worse else "")
            )
        notes = [f"[{k}] {printable(str(event))}" for k, event in enumerate(also, 1)]
        tied = [action for action in self if action.tied]
        if tied:
            order = (
                "Contacts have no margin, so they are in the order in which they were given."
                if all(action.margin is None for action in tied)
                else "They are in order of margin, the distance from failure in standard deviations."
            )
            notes.append(f"{len(tied)} actions are tied: within a standard error of the best score. {order}")
        if most is not None and len(lines) + len(notes) > most:
            kept = max(3, most - len(notes) - 1)
            lines = [*lines[:kept], f"... {len(lines) - kept} more actions"]
        return "\n".join(lines + notes)


@with_known_keywords
@np.errstate(all="ignore")  # what overflows is found when beliefs are made
def rank(
    scene: Scene,
    belief: Belief,
    actions: Mapping[str, Action],
    score: Event,
    horizon: float | None = None,
    *,
    times: Sequence[float] | None = None,
    rollouts: int = 1000,
    budget: int | None = None,
    seed: int = 0,
    max_computation_time: float | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Ranking:
    """Rank a robot's possible actions by their probability of success.

    All actions begin with the same random draws, and are simulated round by round. Before each round clear
    losers are dropped, by a sign test on the draws in which they and the leader differ. The test drops the
    best action in one ranking of a thousand. If the budget has no room for all others, the last ones are
    dropped, too.

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
        What counts as success, such as ``InRegion("cup", bin) & ~Touches("cup", "wall")``.
    horizon : float, optional
        Time to predict for [s], as in `predict`. May be left out when ``times`` is given.
    times : sequence of float, optional
        Times at which a belief is wanted [s], ascending, as in `predict`.
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
    changed = {
        name: apply_action(scene, belief, action, f"actions[{name!r}]") for name, action in actions.items()
    }
    rollouts = integer(rollouts, "rollouts", low=1)
    if rollouts > SAMPLES_LIMIT:
        raise LimitExceededError(f"must be at most {SAMPLES_LIMIT}", field="rollouts", value=rollouts)
    propagator = make_propagator(REFERENCE, samples=rollouts, seed=seed)

    def failed(k, error):
        field = f"actions[{[*changed][k]!r}]" + (f": {error.field}" if error.field else "")
        raise error.at(field) from error

    candidates = []
    for k, (name, own) in enumerate(changed.items()):
        try:
            candidates.append(Candidate(name, *own, checked_marks(*own, propagator, horizon, times)))
        except UncPhysicsError as error:
            failed(k, error)
    return rank_candidates(
        candidates,
        propagator,
        score,
        failed,
        budget=budget,
        max_computation_time=max_computation_time,
        progress=progress,
    )


class Candidate(NamedTuple):
    """Scene with the belief about it, by name, and the marks that it is simulated to (`checked_marks`)."""

    name: str
    scene: Scene
    belief: Belief
    marks: Sequence[Mark]


def rank_candidates(
    candidates: Sequence[Candidate],
    propagator: Any,
    score: Event,
    failed: Callable[[int, UncPhysicsError], object],
    *,
    budget: int | None = None,
    max_computation_time: float | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Ranking:
    """Rank scenes and beliefs with a Monte Carlo propagator.

    The propagator's ``samples`` are the most rollouts of one candidate. Other parameters and errors are those
    of `rank`, but an error about one candidate goes to ``failed``, with the candidate's index. If ``failed``
    returns, the other candidates are ranked.
    """
    started, count, rollouts = clock(), len(candidates), propagator.samples
    usual = max(min(count, 2) * rollouts, round(_BUDGET_SHARE * rollouts * count), count)
    most: int = usual if budget is None else integer(budget, "budget", low=1)
    if most < count:
        raise InvalidRequestError(
            f"must be at least one rollout for each of {count} actions", field="budget", value=most
        )
    allowed = None if max_computation_time is None else positive(max_computation_time, "max_computation_time")
    halving, runs, stopped = SequentialHalving(count, rollouts, most), {}, []

    def attempt(compute):
        """Return the results by candidate, without candidates that fail."""
        results = {}
        for k in halving.remaining:
            try:
                results[k] = compute(k)
            except UncPhysicsError as error:
                if isinstance(error, PredictionTimeoutError) or error in stopped:
                    raise
                failed(k, error)
                halving.drop(k)
        return results

    def show(done, steps):
        assert progress is not None
        try:
            progress(halving.spent, most)
        except UncPhysicsError as error:
            stopped.append(error)
            raise

    def simulate_round(compute_budget):
        counted = None if progress is None else show
        carries = attempt(lambda k: runs[k].carries_of(halving.count, compute_budget, counted))
        predictions = attempt(lambda k: runs[k].prediction_of(carries[k], clock() - started))
        for k, prediction in predictions.items():
            runs[k].carries, runs[k].prediction = carries[k], prediction
        if predictions:
            halving.add({k: score.happened(runs[k].outcomes) for k in predictions})
        if counted is not None:
            counted(0, 0)

    def ranking():
        return _ranking(candidates, runs, halving, score, propagator) if halving.spent else None

    try:
        runs = attempt(lambda k: _Rollouts(candidates[k], propagator, score))
        with time_limit() as limit:
            while halving.remaining:
                simulate_round(ComputeBudget(allowed, started, limit))
    except PredictionTimeoutError as error:
        when = f"after {halving.spent} rollouts of {most}" if halving.spent else "in the first round"
        ended = PredictionTimeoutError(f"ran out {when}", field=error.field, value=error.value)
        ended.prediction = ranking()
        raise ended from None
    except UncPhysicsError as error:
        error.prediction = ranking()
        raise
    return _ranking(candidates, runs, halving, score, propagator)


class _Rollouts:
    """Rollouts of one candidate, to which more can be added; parameters as for `rank_candidates`."""

    prediction: Prediction

    def __init__(self, candidate, propagator, score):
        _, scene, belief, self._marks = candidate
        score.check(scene, "score")
        self._given, self._propagator = belief, propagator
        self._scene = prepare(scene, belief, propagator, self._marks)
        self._belief = constrain_belief(self._scene, belief)
        self.carries = []  # at time 0, and at each mark

    def carries_of(self, count, compute_budget, progress):
        """Return the carries of the first ``count`` rollouts: those so far, and additional ones."""
        scene, propagator = self._scene, self._propagator
        if scene.integrator == "explicit":  # whose kernels do not end early
            compute_budget = compute_budget._replace(limit=None)
        first = rollout_count(self.carries[0]) if self.carries else 0
        added = simulate(
            partial(propagator.init_rollouts, scene, self._belief, first, count),
            lambda carry, marks: propagator.advance_through(carry, scene, marks),
            self._marks,
            scene,
            compute_budget,
            progress,
        )
        carries = [carry for _, carry in added]
        if not self.carries:
            return carries
        return [propagator.concatenate(*pair) for pair in zip(self.carries, carries, strict=True)]

    def prediction_of(self, carries, wall_time):
        """Return the prediction that carries represent."""
        first, *later = carries
        scene, own = self._scene, replace(self._propagator, samples=rollout_count(first))
        snapshots = tuple(
            snapshot(own, scene, carry, mark) for carry, mark in zip(later, self._marks, strict=True)
        )
        start = own.belief(first, scene) if are_moved_at_start(scene, first) else self._given
        return Prediction(scene, own, snapshots, self._given, start, wall_time)

    @property
    def outcomes(self):
        """Outcomes of the rollouts at the horizon."""
        return sample_outcomes(self.prediction.scene, self._given, self.prediction.at())


def _ranking(candidates, runs, halving, score, propagator):
    """Return the ranking by the rounds so far."""
    margins = {k: score.margin(runs[k].outcomes) for k in halving.order}
    ties = halving.ties()
    ties.sort(key=lambda k: math.inf if margins[k] is None else -margins[k])
    actions = []
    for k in [*ties, *(k for k in halving.order if k not in ties)]:
        prediction = runs[k].prediction
        actions.append(
            RankedAction(
                candidates[k].name,
                prediction,
                prediction.probability(score),
                halving.difference(k, ties[0]),
                margins[k],
                len(ties) > 1 and k in ties,
                k in halving.losers,
                len(halving.outcomes[k]),
            )
        )
    return Ranking(tuple(actions), score, propagator.seed)
