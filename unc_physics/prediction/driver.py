"""The driver of all predictions and rankings: simulates to the times that are wanted, within a time limit."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..checks.errors import DivergedError, PredictionTimeoutError, UncPhysicsError
from ..compiler.compile_time import clock
from ..compiler.threads import watched
from ..dynamics.contact_history import ContactHistory
from ..propagators.balanced_monte_carlo import WideMonteCarlo
from ..propagators.base import Anytime, Islands, Propagator, Samples, Spent, rollout_count
from ..propagators.names import POINTS
from ..propagators.registry import make_propagator
from ..propagators.start import constrain_belief
from ..scene.action_arrays import with_certain_actions, with_kinematic
from ..scene.belief import Belief
from ..scene.marks import Mark, whole
from ..scene.scene import Scene
from .compute_budget import LOOK_UP_AFTER, ComputeBudget, first_piece
from .events import Event, RolloutOutcomes
from .islands import IslandRunner
from .probability import CONFIDENCE, interval
from .rare_outcomes import WIDE_ROLLOUTS, tail_factors
from .snapshot import Snapshot

_OUTCOMES_AT_ONCE = 8192  # outcomes of several times in which events are looked for together


class Run(NamedTuple):
    """Result of propagating a belief."""

    #: initial, start: that was given, with prescribed bodies on their paths; and that was really used
    initial: Belief
    start: Belief
    snapshots: tuple[Snapshot, ...]
    #: of the points at time 0, of a propagator with a single nominal rollout on the implicit step
    points_history: ContactHistory | None


def simulate(
    begin: Callable[[], Any],
    advance_through: Callable[[Any, list[Mark]], list[Any]],
    marks: list[Mark],
    scene: Scene,
    compute_budget: ComputeBudget,
    progress: Callable[[int, int], object] | None = None,
) -> Iterator[tuple[Mark, Any]]:
    """Yield the carry at the start and at each of the marks, which ascend.

    ``begin`` makes the carry at time 0. ``advance_through`` takes a carry and marks, and makes the carries at
    these (`Propagator.advance_through`). ``progress`` is as in `predict`.

    Where time runs out, or ``progress`` raises an `UncPhysicsError`, the carry that was reached is yielded
    before the error is raised.
    """
    last, horizon = marks[-1].count, marks[-1].time
    in_one_go = compute_budget.allowed is None and progress is None
    done, shown, told = 0, 0, compute_budget.started

    def tell():
        nonlocal told
        told = clock()
        if progress is not None:
            progress(done, last)
        if done < last and compute_budget.over:
            raise compute_budget.error(done * scene.dt, horizon)

    def look():  # between the parts of a step that takes long
        if clock() - told > LOOK_UP_AFTER or compute_budget.over:
            tell()

    def complete(compute, *arguments):
        with contextlib.nullcontext() if in_one_go else watched(look):
            found = compute_budget.complete(compute, *arguments)
        if found is None:
            raise compute_budget.error(done * scene.dt, horizon)
        return found

    carry = complete(begin)
    yield whole(0, scene.dt), carry
    piece, coming = last if in_one_go else first_piece(scene), list(marks)
    while coming:
        steps, began = min(piece, coming[-1].steps - done), clock()
        due = [mark for mark in coming if mark.steps <= done + steps]
        coming = coming[len(due) :]
        stops = due.copy()
        if not due or due[-1] != whole(done + steps, scene.dt):
            stops.append(whole(done + steps, scene.dt))  # from which the next piece goes on
        try:
            carries = complete(advance_through, carry, stops)
            carry, done = carries[-1], done + steps
            if not in_one_go:
                piece = compute_budget.next_piece(max(steps, 1), clock() - began, scene)
                tell()
        except UncPhysicsError:
            if done > shown:
                yield whole(done, scene.dt), carry
            raise
        for mark, reached in zip(due, carries, strict=False):
            shown = mark.steps
            yield mark, reached
    if progress is not None and done < last:
        progress(last, last)


def run(
    scene: Scene,
    given: Belief,
    propagator: Propagator,
    marks: list[Mark],
    compute_budget: ComputeBudget,
    progress: Callable[[int, int], object] | None = None,
    events: Sequence[Event] = (),
) -> Run:
    """Propagate a belief to all marks; the arguments are checked already.

    Anytime propagators go on until the probabilities of ``events`` are known at all marks. Raises
    `DivergedError` if a belief is not finite, and what `simulate` raises; the ``prediction`` of such an error
    is the `Run` to the time reached, or None.
    """
    belief = constrain_belief(scene, given)
    initial = belief if scene.acts else given  # where prescribed bodies are is not for a belief to say
    points_history = None
    if propagator.traits.mean_update == "nominal" and scene.integrator == "implicit":
        # a single rollout cannot begin in several ways; uncertain actions have directions of their own
        begun = compute_budget.complete(points_at_start, with_certain_actions(scene), belief)
        if begun is None:
            raise compute_budget.error(0.0, marks[-1].time)
        belief, points_history = begun
    # shared parameters tie all bodies together for ever, what is fixed makes no island, and bounds of where
    # bodies get to do not know what a robot does
    divisible = len(scene.moving) > 0 and not scene.shared_parameters and not scene.acts
    in_islands = scene.islands and divisible and isinstance(propagator, Islands)
    runner: Any = IslandRunner(propagator, scene, marks) if in_islands else propagator
    # what is computed from few rollouts waits for the last time, so that all can share it
    waits = isinstance(propagator, Samples) and propagator.resamples
    snapshots: list[Snapshot] = []
    waiting: list[tuple[Mark, Any]] = []
    first = None

    def found():
        snapshots.extend(_snapshots_of(propagator, scene, waiting))
        start = belief_at_start(propagator, runner, scene, first, initial)
        return Run(initial, start, tuple(snapshots), points_history)

    try:
        for mark, carry in simulate(
            lambda: runner.init(scene, belief),
            lambda carry, some: runner.advance_through(carry, scene, some),
            marks,
            scene,
            compute_budget,
            progress,
        ):
            if mark.time == 0.0:
                first = carry
            elif waits:
                waiting.append((mark, _of_all_bodies(runner, carry)))
            else:
                snapshots.append(snapshot(propagator, scene, carry, mark, runner))
    except DivergedError:
        raise
    except UncPhysicsError as error:
        error.prediction = found() if snapshots or waiting else None
        raise
    if isinstance(propagator, Anytime):
        waiting, wide = _with_additional_rollouts(
            propagator, scene, belief, initial, waiting, compute_budget, events, in_islands
        )
        result = found()
        pairs = zip(result.snapshots, wide, strict=True)
        return result._replace(
            snapshots=tuple(one if states is None else replace(one, wide=states) for one, states in pairs)
        )
    return found()


def _snapshots_of(propagator, scene, carries):
    """The snapshots of carries (mark, carry) of one propagator, ascending; the last one comes first.

    Times between which no rollout changes, as all bodies sleep, share the later one's.
    """
    if carries:
        propagator.share_caches([carry for _, carry in carries])
    found: list[Snapshot] = []
    for mark, carry in reversed(carries):
        if found and not scene.acts and _unchanged(carry, found[-1].carry):
            found.append(found[-1].at_time(mark.time))
        else:
            found.append(snapshot(propagator, scene, carry, mark))
    return found[::-1]


def _unchanged(carry, later):
    """Whether all rollouts of a carry are still where they were, and met nothing else."""
    own, other = carry.contact_history, later.contact_history
    return (
        np.array_equal(carry.states, later.states)
        and np.array_equal(own.first_time, other.first_time)
        and (own.solver is None or np.array_equal(own.solver.residual, other.solver.residual))
    )


def snapshot(propagator: Propagator, scene: Scene, carry: Any, mark: Mark, runner: Any = None) -> Snapshot:
    """Return what a carry says at a mark; raises `DivergedError` if the belief is not finite.

    ``runner`` is what made it, by default the propagator; with islands the carry is theirs.
    """
    runner = propagator if runner is None else runner
    time = mark.time
    belief = runner.belief(carry, scene)
    mean = with_kinematic(scene, belief.mean, time)  # prescribed bodies are where their paths say
    if mean is not belief.mean:
        belief = Belief.trusted(mean, belief.covariance, belief.moving)
    if not (np.isfinite(belief.mean).all() and np.isfinite(belief.covariance).all()):
        raise DivergedError(
            f"diverged within {time:.6g} s; a smaller dt or stiffness may help", field="prediction"
        )
    whole = _of_all_bodies(runner, carry)
    draw = draw_rollouts = None
    if isinstance(propagator, Samples):
        draw = partial(propagator.own_samples, whole, scene)
        draw_rollouts = partial(propagator.rollout_states, whole, scene)
    first = whole.contact_history.first_time
    return Snapshot(time, belief, whole, draw, draw_rollouts, first)


def points_at_start(scene: Scene, belief: Belief) -> tuple[Belief, ContactHistory]:
    """Return the belief at time 0 that points of it represent, free of overlap and settled, and their
    history.
    """
    points = make_propagator(POINTS)
    carry = points.init(scene, constrain_belief(scene, belief))
    return points.belief(carry, scene), carry.contact_history


def belief_at_start(propagator: Propagator, runner: Any, scene: Scene, first: Any, initial: Belief) -> Belief:
    """Return the belief at time 0 that was really used: that of the carry ``first``, where any was moved."""
    start = _of_all_bodies(runner, first).contact_history.start
    moved = start is not None and (start.moved.any() or any(body.at_rest for body in scene.bodies))
    return runner.belief(first, scene) if moved or scene.overlap == "reject" else initial


def _of_all_bodies(runner, carry):
    """The propagator's carry of all bodies, of islands or of a propagator."""
    return runner.whole(carry) if isinstance(runner, IslandRunner) else carry


def _with_additional_rollouts(
    propagator, scene, belief, initial, waiting, compute_budget, events, in_islands
):
    """The carries at each mark, with as many more rollouts as the propagator wants; and states of rollouts
    of a wider belief, each None where it did not look for rare outcomes.
    """
    marks = [mark for mark, _ in waiting]
    simulated, factor = clock() - compute_budget.started, None
    wide: list[np.ndarray | None] = [None] * len(marks)
    while True:
        last = waiting[-1][1]
        count, spent = rollout_count(last), clock() - compute_budget.started
        errors = _probability_errors(propagator, scene, initial, waiting, events)
        if factor is not None:
            factor = _rare_factor(propagator, scene, last, wide[-1])
        now = Spent(spent, simulated, len(waiting), errors, factor)
        more = propagator.additional_rollouts(last, scene, now)
        if (
            more <= 0
            and factor is None
            and propagator.looks_far(last, scene)
            and compute_budget.allowed is None
        ):
            wide = wide_states(scene, initial, marks, count)
            factor = _rare_factor(propagator, scene, last, wide[-1])
            more = propagator.additional_rollouts(last, scene, now._replace(rare=factor))
        if more <= 0 or (
            compute_budget.allowed is not None and spent * (1.0 + more / count) > compute_budget.allowed
        ):
            return waiting, wide
        began, rollouts = clock(), (count, count + more)
        runner: Any = IslandRunner(propagator, scene, marks, rollouts) if in_islands else propagator
        begin = (
            partial(runner.init, scene, belief)
            if in_islands
            else partial(propagator.init_rollouts, scene, belief, *rollouts)
        )
        try:
            _, *additional = simulate(
                begin,
                lambda carry, some, of=runner: of.advance_through(carry, scene, some),
                marks,
                scene,
                compute_budget,
            )
        except PredictionTimeoutError:
            if compute_budget.limit is not None:
                compute_budget.limit.flag[0] = 0
            return waiting, wide  # rollouts that are complete are an answer
        waiting = [
            (mark, propagator.concatenate(carry, _of_all_bodies(runner, new)))
            for (mark, carry), (_, new) in zip(waiting, additional, strict=True)
        ]
        simulated += clock() - began


def wide_states(scene: Scene, initial: Belief, marks: list[Mark], count: int) -> list[np.ndarray | None]:
    """Return states (R, B, 13) of rollouts of a belief that is twice as wide, at each mark.

    There are `rare_outcomes.WIDE_ROLLOUTS`, at most ``count``; None where they diverge.
    """
    propagator = WideMonteCarlo(samples=min(WIDE_ROLLOUTS, count))
    try:
        wide = run(scene, initial, propagator, marks, ComputeBudget(None, clock(), None))
    except DivergedError:
        return [None] * len(marks)
    return [snapshot.rollout_states for snapshot in wide.snapshots]


def _rare_factor(propagator, scene, carry, wide):
    """The largest factor on a spread by rare outcomes, of any body."""
    if wide is None:
        return 1.0
    return float(tail_factors(scene, propagator.belief(carry, scene), wide).max(initial=1.0))


def _probability_errors(propagator, scene, initial, waiting, events):
    """(T E,): half widths of the intervals of events at all times, in standard deviations."""
    found = []
    count = rollout_count(waiting[-1][1])
    together = max(_OUTCOMES_AT_ONCE // count, 1)  # times, as an event takes longer to call than to compute
    for k in range(0, len(waiting) if events else 0, together):
        some = [carry for _, carry in waiting[k : k + together]]
        states = np.concatenate([propagator.rollout_states(carry, scene) for carry in some])
        first = np.concatenate([carry.contact_history.first_time for carry in some])
        outcomes = RolloutOutcomes(scene, initial.mean, states, first)
        for event in events:
            for share in event.happened(outcomes).reshape(len(some), count).mean(axis=1).tolist():
                low, high = interval(share, count)
                found.append(0.5 * (high - low) / CONFIDENCE)
    return np.array(found)
