"""Rank actions by the probability of an event, with common random numbers and sequential halving."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..checks.errors import CanceledError, InvalidRequestError, PredictionTimeoutError, UncPhysicsError
from ..checks.names import hint, with_known_keywords
from ..checks.shown import printable
from ..checks.validation import instance, integer, positive
from ..compiler.compile_time import clock
from ..propagators.names import REFERENCE
from ..propagators.registry import make_propagator
from ..scene.belief import Belief
from ..scene.marks import Mark
from ..scene.scene import Scene
from .actions import Action, about_action, after_actions
from .events import Event
from .executors import ROUND_CHUNK_TIME, AnyExecutor, Workers
from .predict import predict_marks
from .prediction import Prediction
from .probability import sample_outcomes
from .request_checks import checked_marks
from .sequential_halving import Difference, SequentialHalving
from .snapshot import Probability
from .tables import FEW_LINES, preformatted

#: Share of `rollouts` for each action that the budget is by default, where that is more than two actions'.
_BUDGET_SHARE = 0.2
_NO_TIME = 1e-9  # s, of a round that begins when time is up


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
            raise InvalidRequestError(
                f"is no action's name{hint(str(name), names)}", field="name", value=name
            )
        return self.actions[names.index(name)]

    def __str__(self) -> str:
        return self.table(FEW_LINES)

    def _repr_html_(self) -> str:
        return preformatted(str(self))

    def to_dict(self) -> dict[str, Any]:
        """Return the ranking as plain Python values."""
        rows = []
        for action in self:
            row = {key: value for key, value in vars(action).items() if key != "prediction"}
            found = action.difference
            row |= {"score": asdict(action.score), "difference": found.value, "difference_std": found.std}
            rows.append(row)
        return {"score": str(self.score), "seed": self.seed, "rollouts": self.rollouts, "actions": rows}

    def table(self, most: int | None = None) -> str:
        """Return a table of at most ``most`` lines."""
        width = max(6, *(len(printable(action.name)) for action in self))
        lines = [
            f"probability of: {printable(str(self.score))}; {self.rollouts} rollouts, seed {self.seed}",
            f"{'action':<{width}}  probability     interval           difference  margin  rollouts",
        ]
        for action in self:
            p, found = action.score, action.difference
            difference = "" if action is self.best else f"{found.value:+.3f} +- {found.std:.3f}"
            margin = "" if action.margin is None else f"{action.margin:.2f}"
            lines.append(
                f"{printable(action.name):<{width}}  {p.estimate:11.3f}  {p.low:.3f} to {p.high:.3f}"
                f"  {difference:>16}  {margin:>6}  {action.rollouts:8d}"
                + ("  tied" if action.tied else "  clearly worse" if action.clearly_worse else "")
            )
        if most is not None and len(lines) > most:
            lines = [*lines[: most - 1], f"... {len(lines) - most + 1} more actions"]
        return "\n".join(lines)


class Candidate(NamedTuple):
    """Scene with the belief about it, and the marks that it is simulated to (`checked_marks`)."""

    scene: Scene
    belief: Belief
    marks: Sequence[Mark]


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
    executor: AnyExecutor = None,
    max_computation_time: float | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Ranking:
    """Rank a robot's possible actions by their probability of success.

    The rollouts are those of `predict` with Monte Carlo and the same seed, so that all actions begin with the
    same random draws. They are added in rounds. Before each round clear losers are dropped, by a sign test on
    the draws in which they and the leader differ. The test drops the best action in one ranking of a
    thousand. If the budget has no room for all others, the last ones are dropped, too.

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
    executor : concurrent.futures.Executor, callable or str, optional
        Simulates the actions of a round, as in `predict_many`; by default this process. The ranking does not
        depend on it.
    max_computation_time : float, optional
        Wall time after which the ranking ends with an error [s]; compiling kernels does not count.
    progress : callable, optional
        Called every few hundredths of a second, or every second with an executor, with the number of rollouts
        of the rounds done, and with the budget. What it raises ends the ranking; an `UncPhysicsError` then
        has a ``prediction`` as that of `PredictionTimeoutError`.

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
    belief.check_fits(scene)
    score.check(scene, "score")
    propagator = make_propagator(REFERENCE, samples=integer(rollouts, "rollouts", low=1), seed=seed)

    def failed(name, error):
        raise about_action(name, error) from error

    def candidate(own: Scene, about: Belief) -> Candidate:
        return Candidate(own, about, checked_marks(own, about, propagator, horizon, times))

    candidates = after_actions(scene, belief, actions, candidate)
    limits = {"budget": budget, "max_computation_time": max_computation_time}
    return rank_candidates(candidates, propagator, score, failed, executor, **limits, progress=progress)


def rank_candidates(
    candidates: Mapping[str, Candidate],
    propagator: Any,
    score: Event,
    failed: Callable[[str, UncPhysicsError], object],
    executor: AnyExecutor = None,
    *,
    budget: int | None = None,
    max_computation_time: float | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Ranking:
    """Rank scenes and beliefs by name, with a Monte Carlo propagator.

    The propagator's ``samples`` are the most rollouts of one candidate. Other parameters and errors are those
    of `rank`, but an error about one candidate goes to ``failed``, with the candidate's name. If ``failed``
    returns, the other candidates are ranked.
    """
    started, count = clock(), len(candidates)
    most = max(min(count, 2) * propagator.samples, round(_BUDGET_SHARE * propagator.samples * count), count)
    if budget is not None:
        most = integer(budget, "budget", low=1)
    if most < count:
        raise InvalidRequestError(
            f"must be at least one rollout for each of {count} actions", field="budget", value=most
        )
    allowed = None if max_computation_time is None else positive(max_computation_time, "max_computation_time")
    halving = SequentialHalving(candidates, propagator.samples, most)
    found: dict[str, Prediction] = {}

    def show(*_):
        if progress is not None:
            progress(halving.spent, most)

    def ranking():
        return Ranking(tuple(_ranked_actions(found, halving, score)), score, propagator.seed)

    try:
        with closing(Workers(executor, ROUND_CHUNK_TIME)) as workers:
            while halving.remaining:
                own = replace(propagator, samples=halving.count)
                left = None if allowed is None else max(allowed - (clock() - started), _NO_TIME)
                work = partial(_simulated, own, score, left, show if workers.here and progress else None)
                asked = [(name, candidates[name], found.get(name)) for name in halving.remaining]
                if not (found or workers.here):
                    _simulated(own, score, left, None, asked[0])  # compiles, and workers load
                added = {}
                for _, (name, *_), result in workers.results(work, asked, show):
                    if isinstance(result, UncPhysicsError):
                        failed(name, result)
                    else:
                        added[name] = result
                found |= added
                halving.add(
                    {
                        name: score.happened(_outcomes(added[name]))
                        for name in halving.remaining
                        if name in added
                    }
                )
                show()
    except UncPhysicsError as error:
        if isinstance(error, PredictionTimeoutError):
            when = f"after {halving.spent} rollouts of {most}" if halving.spent else "in the first round"
            error = PredictionTimeoutError(f"ran out {when}", field=error.field, value=allowed)
        error.prediction = ranking() if halving.spent else None
        raise error from None
    return ranking()


def _outcomes(prediction):
    """Return the outcomes of the rollouts at the horizon."""
    return sample_outcomes(prediction.scene, prediction.initial, prediction.at())


def _simulated(propagator, score, allowed, progress, asked) -> Prediction | UncPhysicsError:
    """Predict a candidate with as many rollouts as the propagator has, within the allowed time [s].

    Returns an error that is about the candidate.
    """
    _, (scene, belief, marks), before = asked
    earlier = () if before is None else (before,)
    limits = {"max_computation_time": allowed, "progress": progress}
    try:
        if before is None:
            score.check(scene, "score")
        else:
            scene = before.scene
        return predict_marks(scene, belief, propagator, marks, **limits, earlier=earlier)
    except (PredictionTimeoutError, CanceledError):
        raise
    except UncPhysicsError as error:
        return error


def _ranked_actions(found, halving, score):
    """Yield the actions of a ranking by the rounds so far, in order."""
    margins = {name: score.margin(_outcomes(found[name])) for name in halving.order}
    ties = halving.ties()
    ties.sort(key=lambda name: math.inf if margins[name] is None else -margins[name])
    for name in [*ties, *(name for name in halving.order if name not in ties)]:
        prediction = found[name]
        yield RankedAction(
            name,
            prediction,
            prediction.probability(score),
            halving.difference(name, ties[0]),
            margins[name],
            len(ties) > 1 and name in ties,
            name in halving.losers,
            len(halving.outcomes[name]),
        )
