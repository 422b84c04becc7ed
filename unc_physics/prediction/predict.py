"""The driver of all predictions."""

from __future__ import annotations

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
    PredictionTimeoutError,
    UncPhysicsError,
)
from ..checks.validation import instance, positive
from ..physics.compile_time import clock
from ..propagators.base import Propagator
from ..propagators.names import DEFAULT
from ..propagators.registry import make_propagator, names_where
from ..propagators.start import known
from ..scene.belief import Belief
from ..scene.environment import element_names
from ..scene.scene import Scene
from ..scene.stiffness import with_stiffness
from .computed import Computed
from .islands import Islands
from .prediction import Prediction

STEPS_LIMIT = 100_000_000
TIMES_LIMIT = 100_000
_LOOK_UP_AFTER = 0.02  # s, wall time between looks at the clock and reports of progress


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
        Wall time after which the prediction ends with an error [s]; compiling kernels does not count.
    progress : callable, optional
        Called every few hundredths of a second with the number of steps done and of all steps. What it raises
        ends the prediction; an `UncPhysicsError` then has a ``prediction`` that ends at the time reached.
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
        If ``max_computation_time`` ran out; its ``prediction`` ends at the time reached.
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
    scene = with_stiffness(scene, belief.mean)
    given, belief = belief, known(scene, belief)
    if propagator.traits.mean_update == "nominal" and scene.integrator == "implicit":
        belief = start_belief(scene, belief)  # a single rollout cannot begin in several ways
    marks = steps_of(scene, horizon, times)
    allowed = None if max_computation_time is None else positive(max_computation_time, "max_computation_time")
    in_one_go = allowed is None and progress is None
    piece = marks[-1] if in_one_go else 1
    # shared parameters tie all bodies together for ever, and what is fixed makes no island
    in_islands = scene.islands and len(scene.moving) > 0 and not scene.shared_parameters
    runner: Any = Islands(propagator, scene, marks) if in_islands else propagator
    carry = runner.init(scene, belief)
    began = partial(runner.belief, carry, scene)
    keep_samples = 0 if propagator.own_sample_count is None else keep_samples
    done, reached, beliefs, kept = 0, [], [], []

    def made(carry):
        whole = runner.whole(carry) if in_islands else carry
        took = clock() - started
        states = tuple(kept) if keep_samples else None
        answers = Computed(whole, began)
        return Prediction(scene, propagator, tuple(reached), tuple(beliefs), took, given, answers, states)

    def reach(carry):
        reached.append(done * scene.dt)
        beliefs.append(_finite(runner.belief(carry, scene), reached[-1]))
        if keep_samples:
            kept.append(runner.own_samples(carry, scene)[:keep_samples].copy())

    for mark in marks:
        while done < mark:
            steps = min(piece, mark - done)
            piece_started = clock()
            carry = runner.advance(carry, scene, steps)
            done += steps
            if in_one_go:
                continue
            now = clock()
            piece = _next_piece(steps, now - piece_started)
            try:
                if progress is not None:
                    progress(done, marks[-1])
                if allowed is not None and done < marks[-1] and now - started > allowed:
                    raise PredictionTimeoutError(
                        f"ran out after {done * scene.dt:.6g} s of {marks[-1] * scene.dt:.6g} s simulated",
                        field="max_computation_time",
                        value=max_computation_time,
                    )
            except UncPhysicsError as error:
                reach(carry)
                error.prediction = made(carry)
                raise
        reach(carry)
    return made(carry)


def start_belief(scene: Scene, belief: Belief) -> Belief:
    """The belief at time 0 that predictions begin with, without a prediction: as the default propagator has
    it.

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
    points = make_propagator(DEFAULT)
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
    """Raise `NotSupportedError` unless the propagator takes integrator, overlap and uncertain parameters."""
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
    if scene.uncertain and not propagator.varies_parameters:
        first = scene.uncertain[0]
        owners = [f" of body '{body.name}'" for body in scene.bodies]
        owners += [f" of element '{name}'" for name in element_names(scene.environment)]
        owner = "" if first.body < 0 else owners[first.body]
        field = f"{first.name}_std{owner}"
        raise NotSupportedError(f"is not supported by {propagator.name}", field=field, value=float(first.std))


def _next_piece(steps, took):
    """Steps that will take about as long as is wanted between looks at the clock, when ``steps`` took
    ``took`` s.
    """
    return max(1, min(4 * steps, round(steps * _LOOK_UP_AFTER / max(took, 1e-9))))


def _finite(belief, reached):
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
