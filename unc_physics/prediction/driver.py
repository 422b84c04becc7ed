"""Driver of predictions and rankings: simulates to the requested times, within a time limit."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..checks.errors import DivergedError, PredictionTimeoutError, UncPhysicsError
from ..compiler.compile_time import clock
from ..compiler.threads import watched
from ..physics.contact_history import ContactHistory
from ..propagators.balanced_monte_carlo import WideMonteCarlo
from ..propagators.base import Anytime, PointPairs, Propagator, Samples, Spent, rollout_count
from ..propagators.names import POINTS
from ..propagators.registry import make_propagator
from ..propagators.start import constrain_belief
from ..scene.belief import Belief
from ..scene.kinematic_states import with_certain_actions, with_kinematic
from ..scene.marks import Mark, whole
from ..scene.scene import Scene
from .compute_budget import LOOK_UP_AFTER, ComputeBudget, first_piece
from .events import Event, RolloutOutcomes
from .probability import NORMAL_QUANTILE, interval
from .rare_outcomes import WIDE_ROLLOUTS, tail_factors
from .snapshot import Counted, Snapshot

_OUTCOMES_AT_ONCE = 8192  # outcomes of several times in which events are evaluated together


class PropagationResult(NamedTuple):
    """Result of propagating a belief.

    Attributes
    ----------
    initial : Belief
        Given belief, with prescribed bodies on their paths.
    start : Belief
        Belief at time 0 after the removal of overlap and settling.
    snapshots : tuple of Snapshot
    points_history : ContactHistory or None
        Of the sigma points that settled at time 0, for a propagator with a single nominal rollout on the
        implicit step.
    first : NamedTuple
        The propagator's carry at time 0.
    """

    initial: Belief
    start: Belief
    snapshots: tuple[Snapshot, ...]
    points_history: ContactHistory | None
    first: Any


class Propagation:
    """Propagation of one belief to all marks; the arguments are already checked.

    By default the budget has no limit. Anytime propagators add rollouts until the probabilities of ``events``
    are accurate enough at all marks. Raises `PredictionTimeoutError` if time ran out before the first step.
    """

    def __init__(
        self,
        scene: Scene,
        given: Belief,
        propagator: Propagator,
        marks: Sequence[Mark],
        compute_budget: ComputeBudget | None = None,
        events: Sequence[Event] = (),
    ):
        compute_budget = compute_budget or ComputeBudget(None, clock(), None)
        self._scene, self._marks = scene, marks
        self._propagator: Any = propagator
        self._compute_budget, self._events = compute_budget, events
        belief = constrain_belief(scene, given)
        self._initial = belief if scene.acts else given  # the paths of prescribed bodies replace their means
        self._points_history = None
        if propagator.traits.mean_update == "nominal" and scene.integrator != "explicit":
            # one rollout has one start; uncertain actions have their own sigma points
            resolved = compute_budget.complete(points_at_start, with_certain_actions(scene), belief)
            if resolved is None:
                raise compute_budget.error(0.0, marks[-1].time)
            belief, self._points_history = resolved
        self._belief = belief
        self._snapshots: list[Snapshot] = []
        self._first: Any = None  # carry at time 0

    def run(
        self, progress: Callable[[int, int], object] | None = None, earlier: Sequence[Any] = ()
    ) -> PropagationResult:
        """Return the result.

        ``earlier`` are carries of the first rollouts of Monte Carlo with the same seed, at time 0 and at each
        mark; only the others are simulated.

        Raises
        ------
        DivergedError
            If a belief is not finite.
        UncPhysicsError
            Of a time that ran out, and from ``progress``; its ``prediction`` is the result to the time
            reached, or None.
        """
        scene = self._scene
        propagator: Any = self._propagator
        # snapshots of resampled rollouts share computations with the last one, so they are made at the end
        waits = isinstance(self._propagator, Samples) and self._propagator.resamples
        waiting: list[tuple[Mark, Any]] = []
        try:
            begin = partial(propagator.init, scene, self._belief)
            if earlier:
                count = rollout_count(earlier[0])
                begin = partial(propagator.init_rollouts, scene, self._belief, count, propagator.samples)
            known = dict(zip([whole(0, scene.dt), *self._marks], earlier, strict=False))
            for mark, carry in self._simulate(begin, self._marks, progress):
                if earlier:
                    if mark not in known:  # where time ran out
                        continue
                    carry = propagator.concatenate(known[mark], carry)
                if mark.time == 0.0:
                    self._first = carry
                elif waits:
                    waiting.append((mark, carry))
                else:
                    self._snapshots.append(snapshot(propagator, scene, carry, mark))
        except DivergedError:
            raise
        except UncPhysicsError as error:
            error.prediction = self._result(waiting) if self._snapshots or waiting else None
            raise
        if not isinstance(propagator, Anytime):
            return self._result(waiting)
        waiting, wide = self._with_additional_rollouts(waiting)
        result = self._result(waiting)
        pairs = zip(result.snapshots, wide, strict=True)
        return result._replace(
            snapshots=tuple(one if states is None else replace(one, wide=states) for one, states in pairs)
        )

    def counted(self, progress: Callable[[int, int], object] | None) -> list[Counted]:
        """Return rollouts at each mark, enough for the probabilities of the events.

        Raises
        ------
        PredictionTimeoutError
            If time ran out within the first rollouts.
        DivergedError
            If a rollout is not finite.
        """
        propagator: Any = self._propagator
        begin = partial(propagator.init, self._scene, self._belief)
        first = list(self._simulate(begin, self._marks, progress))[1:]
        waiting, _ = self._with_additional_rollouts(first)
        found = [
            Counted(
                propagator.rollout_states(carry, self._scene),
                carry.contact_history.first_time,
                partial(propagator.effective_counts, carry),
            )
            for _, carry in waiting
        ]
        if not all(np.isfinite(one.states).all() for one in found):
            raise DivergedError("diverged", field="events")
        return found

    def _simulate(self, begin, marks, progress=None) -> Iterator[tuple[Mark, Any]]:
        """Yield the carry that ``begin`` returns, at time 0, and that at each of the marks, which ascend.

        If time runs out, or ``progress`` raises an `UncPhysicsError`, the carry of the last complete step is
        yielded before the error is raised.
        """
        scene, budget = self._scene, self._compute_budget
        last, horizon = marks[-1].count, marks[-1].time
        in_one_go = budget.allowed is None and progress is None
        done, shown, reported = 0, 0, budget.started

        def report():
            nonlocal reported
            reported = clock()
            if progress is not None:
                progress(done, last)
            if done < last and budget.over:
                raise budget.error(done * scene.dt, horizon)

        def watch():  # between the parts of a long step
            if clock() - reported > LOOK_UP_AFTER or budget.over:
                report()

        def complete(compute, *arguments):
            with contextlib.nullcontext() if in_one_go else watched(watch):
                found = budget.complete(compute, *arguments)
            if found is None:
                raise budget.error(done * scene.dt, horizon)
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
                stops.append(whole(done + steps, scene.dt))  # where the next piece begins
            try:
                carries = complete(self._propagator.advance_through, carry, scene, stops)
                carry, done = carries[-1], done + steps
                if not in_one_go:
                    piece = budget.next_piece(max(steps, 1), clock() - began, scene)
                    report()
            except UncPhysicsError:
                if done > shown:
                    yield whole(done, scene.dt), carry
                raise
            for mark, reached in zip(due, carries, strict=False):
                shown = mark.steps
                yield mark, reached
        if progress is not None and done < last:
            progress(last, last)

    def _result(self, waiting):
        """Return the `PropagationResult` with the snapshots of the carries that waited."""
        self._snapshots.extend(_snapshots_of(self._propagator, self._scene, waiting))
        scene, adjusted = self._scene, self._first.contact_history.start
        rests = any(body.at_rest for body in scene.bodies)
        moved = adjusted is not None and (adjusted.moved.any() or rests) or scene.overlap == "reject"
        start = self._propagator.belief(self._first, scene) if moved else self._initial
        return PropagationResult(
            self._initial, start, tuple(self._snapshots), self._points_history, self._first
        )

    def _with_additional_rollouts(self, waiting):
        """Add rollouts to the carries until the propagator needs no more, or time is up.

        Returns the carries (mark, carry), and at each mark the states of rollouts of a wider belief, or None
        if rare outcomes were not searched for.
        """
        scene, propagator, compute_budget = self._scene, self._propagator, self._compute_budget
        marks = [mark for mark, _ in waiting]
        simulated, factor = clock() - compute_budget.started, None
        wide: list[np.ndarray | None] = [None] * len(marks)
        while True:
            last = waiting[-1][1]
            count, spent = rollout_count(last), clock() - compute_budget.started
            errors = self._probability_errors(waiting)
            if factor is not None:
                factor = _rare_factor(propagator, scene, last, wide[-1])
            now = Spent(spent, simulated, len(waiting), errors, factor)
            more = propagator.additional_rollouts(last, scene, now)
            may_search = more <= 0 and factor is None and compute_budget.allowed is None
            if may_search and propagator.looks_far(last, scene):
                wide = wide_states(scene, self._initial, marks, count)
                factor = _rare_factor(propagator, scene, last, wide[-1])
                more = propagator.additional_rollouts(last, scene, now._replace(rare=factor))
            allowed = math.inf if compute_budget.allowed is None else compute_budget.allowed
            if more <= 0 or spent * (1.0 + more / count) > allowed:
                return waiting, wide
            began = clock()
            additional = self._additional_carries(marks, count, count + more)
            if additional is None:
                return waiting, wide
            waiting = [
                (mark, propagator.concatenate(carry, new))
                for (mark, carry), new in zip(waiting, additional, strict=True)
            ]
            simulated += clock() - began

    def _additional_carries(self, marks, first, last):
        """Return the carries of rollouts ``first`` to ``last`` at each mark; None if time ran out."""
        compute_budget = self._compute_budget
        begin = partial(self._propagator.init_rollouts, self._scene, self._belief, first, last)
        try:
            _, *additional = self._simulate(begin, marks)
        except PredictionTimeoutError:  # the complete rollouts are an answer
            if compute_budget.limit is not None:
                compute_budget.limit.resume()
            return None
        return [carry for _, carry in additional]

    def _probability_errors(self, waiting):
        """Return half widths (T E,) of the intervals of events at all times, in standard deviations."""
        if not self._events:
            return np.array([])
        propagator, scene = self._propagator, self._scene
        found = []
        count = rollout_count(waiting[-1][1])
        batch = max(_OUTCOMES_AT_ONCE // count, 1)  # times; evaluating few outcomes is mostly call overhead
        for k in range(0, len(waiting), batch):
            carries = [carry for _, carry in waiting[k : k + batch]]
            states = np.concatenate([propagator.rollout_states(carry, scene) for carry in carries])
            first = np.concatenate([carry.contact_history.first_time for carry in carries])
            outcomes = RolloutOutcomes(scene, self._initial.mean, states, first)
            for event in self._events:
                happened = event.happened(outcomes).reshape(len(carries), count)
                counts = propagator.effective_counts(carries[0], happened)
                for share, effective in zip(happened.mean(axis=1).tolist(), counts.tolist(), strict=True):
                    low, high = interval(share, effective)
                    found.append(0.5 * (high - low) / NORMAL_QUANTILE)
        return np.array(found)


def _snapshots_of(propagator, scene, carries):
    """Return the snapshots of carries (mark, carry) of one propagator, which ascend.

    They are made from the last one backwards. While all bodies stay where they are, times share the later
    snapshot.
    """
    if carries:
        propagator.share_caches([carry for _, carry in carries])
    found: list[Snapshot] = []
    for mark, carry in reversed(carries):
        if found and not scene.acts and _unchanged(propagator, scene, carry, found[-1]):
            found.append(found[-1].at_time(mark.time))
        else:
            found.append(snapshot(propagator, scene, carry, mark))
    return found[::-1]


def _unchanged(propagator, scene, carry, later):
    """Return whether all rollouts of a carry equal those of a later snapshot, with the same first contacts.

    States of a carry may equal later ones although the rollouts move, in a motion that is not simulated.
    """
    own, other = carry.contact_history, later.carry.contact_history
    return (
        np.array_equal(carry.states, later.carry.states)
        and np.array_equal(propagator.rollout_states(carry, scene), later.rollout_states)
        and np.array_equal(own.first_time, other.first_time)
    )


def snapshot(propagator: Propagator, scene: Scene, carry: Any, mark: Mark) -> Snapshot:
    """Return the snapshot of a carry at a mark.

    Raises
    ------
    DivergedError
        If the belief is not finite.
    """
    time = mark.time
    belief = propagator.belief(carry, scene)
    mean = with_kinematic(scene, belief.mean, time)  # the paths of prescribed bodies
    if mean is not belief.mean:
        belief = belief.with_mean(mean)
    if not (np.isfinite(belief.mean).all() and np.isfinite(belief.blocks).all()):
        raise DivergedError(
            f"diverged within {time:.6g} s; a smaller dt or stiffness may help", field="prediction"
        )
    rollouts = drawn = points = effective = None
    if isinstance(propagator, Samples):
        rollouts = propagator.rollout_states(carry, scene)
        effective = partial(propagator.effective_counts, carry)
        if propagator.resamples:
            drawn = partial(propagator.own_samples, carry, scene)
    if isinstance(propagator, PointPairs):
        points = propagator.point_states(carry, scene)
    first = carry.contact_history.first_time
    return Snapshot(time, belief, carry, rollouts, drawn, points, first, effective)


def points_at_start(scene: Scene, belief: Belief) -> tuple[Belief, ContactHistory]:
    """Return the belief of sigma points at time 0, settled and without overlap, and their history."""
    points = make_propagator(POINTS)
    carry = points.init(scene, constrain_belief(scene, belief))
    return points.belief(carry, scene), carry.contact_history


def wide_states(scene: Scene, initial: Belief, marks: Sequence[Mark], count: int) -> list[np.ndarray | None]:
    """Return states (R, B, 13) of rollouts of a belief that is twice as wide, at each mark.

    There are `rare_outcomes.WIDE_ROLLOUTS`, at most ``count``; None where they diverge.
    """
    propagator = WideMonteCarlo(samples=min(WIDE_ROLLOUTS, count))
    try:
        wide = Propagation(scene, initial, propagator, marks).run()
    except DivergedError:
        return [None] * len(marks)
    return [snapshot.rollout_states for snapshot in wide.snapshots]


def _rare_factor(propagator, scene, carry, wide):
    """Return the largest factor by which rare outcomes widen the spread of a body."""
    if wide is None:
        return 1.0
    return float(tail_factors(scene, propagator.belief(carry, scene), wide).max(initial=1.0))
