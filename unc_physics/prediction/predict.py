"""The driver of all predictions."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from ..checks.errors import (
    DivergedError,
    InvalidHorizonError,
    LimitExceededError,
    NotSupportedError,
    UncPhysicsError,
)
from ..checks.validation import instance, positive
from ..physics.compile_time import clock
from ..physics.threads import watched
from ..physics.time_limit import time_limit
from ..propagators.base import Propagator, Spent
from ..propagators.names import DEFAULT, POINTS
from ..propagators.registry import make_propagator, names_where
from ..propagators.start import known
from ..scene.action_arrays import with_certain_actions, with_driven
from ..scene.belief import Belief
from ..scene.environment import element_names
from ..scene.scene import IMPACT_STDS, Scene
from ..scene.stiffness import with_stiffness
from .computed import Computed
from .islands import Islands
from .memory import check_memory
from .motion import motion_of
from .prediction import Prediction
from .within import LOOK_UP_AFTER, Within, first_piece

STEPS_LIMIT = 100_000_000
TIMES_LIMIT = 100_000


@np.errstate(all="ignore")  # what overflows is found by `finite`
def predict(
    scene: Scene,
    belief: Belief,
    propagator: str | Propagator = DEFAULT,
    horizon: float | None = None,
    *,
    times: Sequence[float] | None = None,
    max_computation_time: float | None = None,
    progress: Callable[[int, int], object] | None = None,
    keep_samples: int = 0,
) -> Prediction:
    """Predict where the bodies of a scene will be, and how surely.

    Parameters
    ----------
    scene : Scene
    belief : Belief
        About the bodies of the scene at time 0.
    propagator : str or Propagator
        A name takes the propagator's default options; `make_propagator` sets others.
    horizon : float, optional
        Time to predict for [s], rounded to whole steps. May be left out when ``times`` is given.
    times : sequence of float, optional
        Times at which a belief is wanted [s], ascending; by default the horizon alone. The horizon is added.
    max_computation_time : float, optional
        Wall time after which the prediction ends with an error [s], also within a step of many samples;
        compiling kernels does not count.
    progress : callable, optional
        Called every few hundredths of a second with the number of steps done and of all steps. What it raises
        ends the prediction; an `UncPhysicsError` then has a ``prediction`` that ends at the time reached, or
        None where not even a step was done.
    keep_samples : int, optional
        How many of its own samples a propagator that has some is to keep at each of the times
        (`Prediction.kept`).

    Returns
    -------
    Prediction

    Raises
    ------
    InvalidHorizonError
        If a time is not positive or shorter than half a step, or times do not ascend.
    PredictionTimeoutError
        If ``max_computation_time`` ran out; its ``prediction`` ends at the time reached, and is None where
        not even a step was done.
    DivergedError
        If the simulation left the range of numbers.
    NotSupportedError
        If parameters of the scene are uncertain, or its integrator is the implicit one, or overlap is to be
        rejected, and the propagator is not one of those that take it.
    InvalidRequestError, LimitExceededError, UnknownPropagatorError
        For arguments of a wrong type, a belief about other bodies, too many steps, and an unknown name.
    """
    started = clock()
    instance(scene, Scene, "scene")
    instance(belief, Belief, "belief")
    instance(propagator, (str, Propagator), "propagator")
    if isinstance(propagator, str):
        propagator = make_propagator(propagator)
    belief.check_fits(scene)
    check_supported(scene, propagator)
    marks = steps_of(scene, horizon, times)
    check_memory(scene, belief, propagator, len(marks), keep_samples)
    scene = with_stiffness(scene, belief.mean)
    allowed = None if max_computation_time is None else positive(max_computation_time, "max_computation_time")
    with time_limit() as limit:
        ends_early = scene.integrator == "implicit"  # the explicit step's kernels do not
        within = Within(allowed, started, limit if ends_early else None)
        return _predicted(scene, belief, propagator, marks, within, progress, keep_samples)


def _predicted(scene, belief, propagator, marks, within, progress, keep_samples):
    """The prediction of what `predict` has checked."""
    horizon = marks[-1] * scene.dt
    given, belief = belief, known(scene, belief)
    if scene.acts:  # where prescribed bodies are is not for a belief to say
        given = belief
    if propagator.traits.mean_update == "nominal" and scene.integrator == "implicit":
        # a single rollout cannot begin in several ways; uncertain actions have directions of their own
        belief = within.complete(start_belief, with_certain_actions(scene), belief)
        if belief is None:
            raise within.error(0.0, horizon)
    in_one_go = within.allowed is None and progress is None
    piece = marks[-1] if in_one_go else first_piece(scene)
    # shared parameters tie all bodies together for ever, what is fixed makes no island, and bounds of where
    # bodies get to do not know what a robot does
    in_islands = scene.islands and len(scene.moving) > 0 and not scene.shared_parameters and not scene.acts
    runner: Any = Islands(propagator, scene, marks) if in_islands else propagator
    keep_samples = 0 if propagator.own_sample_count is None else keep_samples
    done, reached, beliefs, kept, carries, motions = 0, [], [], [], [], []
    told = within.started

    def tell():
        nonlocal told
        told = clock()
        if progress is not None:
            progress(done, marks[-1])
        if done < marks[-1] and within.over:
            raise within.error(done * scene.dt, horizon)

    def look():  # between the parts of a step that takes long
        if clock() - told > LOOK_UP_AFTER or within.over:
            tell()

    with contextlib.nullcontext() if in_one_go else watched(look):
        carry = within.complete(runner.init, scene, belief)
    if carry is None:
        raise within.error(0.0, horizon)
    began = partial(runner.belief, carry, scene)
    grows, waiting = propagator.grows and not in_islands, []

    def made(carry):
        whole = runner.whole(carry) if in_islands else carry
        took = clock() - within.started
        states = tuple(kept) if keep_samples else None
        answers = Computed(whole, began, tuple(carries), tuple(motions))
        return Prediction(scene, propagator, tuple(reached), tuple(beliefs), took, given, answers, states)

    def reach(carry, steps):
        reached.append(steps * scene.dt)
        beliefs.append(finite(as_driven(runner.belief(carry, scene), scene, reached[-1]), reached[-1]))
        if propagator.points_in_pairs:  # few, where samples may be many
            carries.append(partial(runner.whole if in_islands else _itself, carry))
        else:
            carries.append(nothing)
        motions.append(None)
        if propagator.emits:
            states = propagator.rollout_states(runner.whole(carry) if in_islands else carry, scene)
            motions[-1] = motion_of(states)
        if keep_samples:
            kept.append(runner.own_samples(carry, scene)[:keep_samples].copy())

    for mark in marks:
        while done < mark:
            steps = min(piece, mark - done)
            if in_one_go:
                carry, done = runner.advance(carry, scene, steps), done + steps
                continue
            piece_started = clock()
            try:
                with watched(look):
                    later = within.complete(runner.advance, carry, scene, steps)
                if later is None:
                    raise within.error(done * scene.dt, horizon)
                carry, done = later, done + steps
                piece = within.next_piece(steps, clock() - piece_started, scene)
                tell()
            except UncPhysicsError as error:
                if done == 0:
                    raise
                last = [(carry, done)] if not reached or reached[-1] < done * scene.dt else []
                for state, steps in [*waiting, *last]:
                    reach(state, steps)
                error.prediction = made(carry)
                raise
        if grows:
            waiting.append((carry, done))
        else:
            reach(carry, done)
    if grows:
        for carry, steps in _grown(propagator, scene, belief, waiting, within.started, within.allowed):
            reach(carry, steps)
    return made(carry)


def _grown(propagator, scene, belief, waiting, started, allowed):
    """The carries at each number of steps, with as many more rollouts as the propagator wants."""
    simulated = clock() - started
    while True:
        count, spent = propagator.rollouts(waiting[-1][0]), clock() - started
        more = propagator.further(waiting[-1][0], scene, Spent(spent, simulated, len(waiting)))
        if more <= 0 or (allowed is not None and spent * (1.0 + more / count) > allowed):
            return waiting
        began = clock()
        further, grown, done = propagator.begun(scene, belief, count, count + more), [], 0
        for carry, steps in waiting:
            further = propagator.advance(further, scene, steps - done)
            done = steps
            grown.append((propagator.together(carry, further), steps))
        waiting = grown
        simulated += clock() - began


def start_belief(scene: Scene, belief: Belief) -> Belief:
    """The belief at time 0 that predictions begin with, without a prediction: as points of its
    covariance have it.

    Overlap is projected away from each, and what is at rest settles, as `predict` does it; nothing changes
    with the explicit integrator. It is what a propagator with a single nominal rollout begins with.

    Parameters
    ----------
    scene : Scene
    belief : Belief
        About the bodies of the scene at time 0.

    Returns
    -------
    Belief

    Raises
    ------
    InvalidRequestError
        If the belief is not about the scene's bodies.
    """
    instance(scene, Scene, "scene")
    instance(belief, Belief, "belief")
    belief.check_fits(scene)
    if scene.integrator == "explicit":
        return belief
    scene = with_stiffness(scene, belief.mean)
    points = make_propagator(POINTS)
    return points.belief(points.init(scene, known(scene, belief)), scene)


def periodic_times(period: float, horizon: float) -> list[float]:
    """Multiples of ``period`` before ``horizon`` [s]; raises `InvalidHorizonError` or
    `LimitExceededError`.
    """
    period = positive(period, "period", InvalidHorizonError)
    count = positive(horizon, "horizon", InvalidHorizonError) / period
    if count > TIMES_LIMIT:
        raise LimitExceededError(f"gives more than {TIMES_LIMIT} times", field="period", value=period)
    return [k * period for k in range(1, math.ceil(count - 1e-9))]


def check_supported(scene: Scene, propagator: Propagator) -> None:
    """Raise `NotSupportedError` unless the propagator takes integrator, overlap, actions, impacts' errors and
    uncertain parameters.
    """
    if scene.integrator not in propagator.integrators:
        able = names_where(lambda other: scene.integrator in other.integrators)
        raise NotSupportedError(
            f"does not run on the {scene.integrator} integrator; {able} do",
            field="propagator",
            value=propagator.name,
        )
    if scene.overlap == "reject" and not propagator.rejects_overlap:
        able = names_where(lambda other: other.rejects_overlap)
        raise NotSupportedError(
            f"is for {able} alone, not for {propagator.name}; 'project' is for all",
            field="overlap",
            value="reject",
        )
    takes_actions = scene.integrator in propagator.takes_actions
    if scene.acts and not takes_actions:
        able = names_where(lambda other: scene.integrator in other.takes_actions)
        where = ""
        if propagator.takes_actions:
            where = f", but on the {' and '.join(propagator.takes_actions)} integrator"
        raise NotSupportedError(
            f"does not take prescribed, held or pushed bodies, nor surfaces that move{where}; {able} do",
            field="propagator",
            value=propagator.name,
        )
    for k, surface in enumerate(scene.surfaces):
        if surface.torsional_friction and not takes_actions:
            names = [body.name for body in scene.bodies] + element_names(scene.environment)
            raise NotSupportedError(
                f"is not supported by {propagator.name}",
                field=f"torsional_friction of '{names[k]}'",
                value=surface.torsional_friction,
            )
    if scene.islands and getattr(propagator, "reduce", False):
        raise NotSupportedError(
            "does not go with islands, which have no common motion; leave out either", field="reduce"
        )
    if scene.draws_impacts and not propagator.draws_impacts:
        field = next(name for name in IMPACT_STDS if getattr(scene, name) > 0.0)
        able = names_where(lambda other: other.draws_impacts)
        raise NotSupportedError(
            f"is for propagators that draw samples ({able}), not for {propagator.name}",
            field=field,
            value=getattr(scene, field),
        )
    unknown = [parameter for parameter in scene.uncertain if parameter.name not in propagator.varied]
    if unknown and not propagator.varies_parameters:
        first = unknown[0]
        owners = [f" of body '{body.name}'" for body in scene.bodies]
        owners += [f" of element '{name}'" for name in element_names(scene.environment)]
        owner = "" if first.body < 0 else owners[first.body]
        field = f"{first.name}_std{owner}"
        raise NotSupportedError(f"is not supported by {propagator.name}", field=field, value=float(first.std))


def as_driven(belief: Belief, scene: Scene, time: float) -> Belief:
    """The belief in which prescribed bodies are where their paths say, not where one sample has them."""
    mean = with_driven(scene, belief.mean, time)
    return belief if mean is belief.mean else Belief.trusted(mean, belief.covariance, belief.moving)


def _itself(carry):
    return carry


def nothing() -> None:
    """What is kept of a state that nobody will ask for."""


def finite(belief: Belief, reached: float) -> Belief:
    """The belief itself, after so many seconds; raises `DivergedError` unless it is finite."""
    if not (np.isfinite(belief.mean).all() and np.isfinite(belief.covariance).all()):
        raise DivergedError(
            f"diverged within {reached:.6g} s; a smaller dt or stiffness may help", field="prediction"
        )
    return belief


def steps_of(scene: Scene, horizon: float | None, times: Sequence[float] | None) -> list[int]:
    """Numbers of steps after which a belief is wanted, ascending; the arguments are those of `predict`."""
    wanted = [] if times is None else list(times)
    if horizon is not None:
        wanted.append(horizon)
    if not wanted:
        raise InvalidHorizonError("must be given", field="horizon")
    names = [f"times[{k}]" for k in range(len(wanted))]
    if horizon is not None:
        names[-1] = "horizon"
    marks = []
    for name, value in zip(names, wanted, strict=True):
        ratio = positive(value, name, InvalidHorizonError) / scene.dt
        if ratio > STEPS_LIMIT:
            raise LimitExceededError(
                f"takes more than {STEPS_LIMIT} steps of dt = {scene.dt} s", field=name, value=value
            )
        steps = round(ratio)
        if steps < 1:
            raise InvalidHorizonError(
                f"is shorter than half a step of dt = {scene.dt} s", field=name, value=value
            )
        if marks and steps < marks[-1]:
            raise InvalidHorizonError("must not be earlier than the time before it", field=name, value=value)
        if not marks or steps > marks[-1]:
            marks.append(steps)
    return marks
