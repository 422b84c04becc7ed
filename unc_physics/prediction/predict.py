"""Predictions of one scene."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..checks.errors import DivergedError, PredictionTimeoutError, UncPhysicsError
from ..checks.validation import instance, positive
from ..compiler.compile_time import clock
from ..compiler.time_limit import time_limit
from ..propagators.base import Propagator, Samples
from ..propagators.names import ANYTIME
from ..propagators.registry import make_propagator
from ..scene.belief import Belief
from ..scene.marks import Mark
from ..scene.scene import Scene
from .compute_budget import ComputeBudget
from .driver import Propagation, points_at_start
from .events import Event, checked_events
from .prediction import Prediction
from .probability import is_certain
from .request_checks import check_memory, checked_marks
from .simulated_scene import left_out, without, without_idle_parts


def predict(
    scene: Scene,
    belief: Belief,
    propagator: str | Propagator = ANYTIME,
    horizon: float | None = None,
    *,
    times: Sequence[float] | None = None,
    max_computation_time: float | None = None,
    progress: Callable[[int, int], object] | None = None,
    events: Iterable[Event] = (),
) -> Prediction:
    """Predict the poses and velocities of a scene's bodies, with their uncertainty.

    Parameters
    ----------
    scene : Scene
    belief : Belief
        About the bodies of the scene at time 0.
    propagator : str or Propagator
        A name takes the propagator's default options; `make_propagator` sets others.
    horizon : float, optional
        Time to predict for [s]. May be left out when ``times`` is given. The implicit integrator takes any
        time, and ends with a shorter step where it is no multiple of ``dt``; the explicit one takes multiples
        only. The same holds for ``times``.
    times : sequence of float, optional
        Times at which a belief is wanted [s], ascending; by default the horizon alone. The horizon is added.
    max_computation_time : float, optional
        Wall time after which the prediction ends with an error [s], also within a step of many samples;
        compiling kernels does not count.
    progress : callable, optional
        Called every few hundredths of a second with the number of steps done and of all steps. An exception
        from it ends the prediction. An `UncPhysicsError` then has a ``prediction`` that ends at the time
        reached, or None before the first step.
    events : iterable of Event, optional
        Those that `Prediction.probability` will be asked for. For propagators without samples, rollouts are
        simulated beside the prediction, as many as the intervals need. If time runs out in them, or they
        diverge, the intervals are 0 to 1.

    Returns
    -------
    Prediction

    Raises
    ------
    InvalidHorizonError
        If a time is not positive, times do not ascend, or one is no multiple of ``dt`` with the explicit
        integrator.
    PredictionTimeoutError
        If ``max_computation_time`` ran out. Its ``prediction`` ends at the time reached, and is None before
        the first step.
    DivergedError
        If the simulation left the range of numbers.
    NotSupportedError
        If the propagator does not support the scene's uncertain parameters, its integrator, or the rejection
        of overlap. Uncertain materials and errors of impacts are left out instead (`Prediction.left_out`).
    InvalidRequestError, LimitExceededError, UnknownPropagatorError
        For arguments of a wrong type, a belief about other bodies, too many steps, and an unknown name.
    """
    instance(scene, Scene, "scene")
    instance(belief, Belief, "belief")
    instance(propagator, (str, Propagator), "propagator")
    if isinstance(propagator, str):
        propagator = make_propagator(propagator)
    marks = checked_marks(scene, belief, propagator, horizon, times)
    return predict_marks(
        scene,
        belief,
        propagator,
        marks,
        max_computation_time=max_computation_time,
        progress=progress,
        events=events,
    )


@np.errstate(all="ignore")  # beliefs that are not finite raise an error
def predict_marks(
    scene: Scene,
    belief: Belief,
    propagator: Propagator,
    marks: Sequence[Mark],
    *,
    max_computation_time: float | None = None,
    progress: Callable[[int, int], object] | None = None,
    events: Iterable[Event] = (),
    earlier: Sequence[Prediction] | None = None,
) -> Prediction:
    """Predict as `predict`, for marks of `request_checks.checked_marks` with the same arguments.

    The rollouts of an ``earlier`` prediction of the same scene by Monte Carlo with the same seed are not
    simulated again. An empty sequence asks for a prediction that can be an earlier one.
    """
    started = clock()
    known = [carry for one in earlier or () for carry in (one.first, *(at.carry for at in one.snapshots))]
    asked_for = scene if known else without_idle_parts(scene, belief, marks[-1].time)
    check_memory(asked_for, belief, propagator, len(marks))
    missing = left_out(asked_for, propagator)
    scene = without(asked_for, missing)
    allowed = None if max_computation_time is None else positive(max_computation_time, "max_computation_time")
    asked = checked_events(events, scene)

    def prediction_of(found):
        return Prediction(
            scene,
            propagator,
            found.snapshots,
            found.initial,
            found.start,
            clock() - started + sum(one.wall_time for one in earlier or ()),
            asked_for if missing else None,
            found.points_history,
            None if earlier is None else found.first,
        )

    with time_limit() as limit:
        ends_early = scene.integrator != "explicit"  # the explicit step's kernels do not
        compute_budget = ComputeBudget(allowed, started, limit if ends_early else None)
        try:
            propagation = Propagation(scene, belief, propagator, marks, compute_budget, asked)
            prediction = prediction_of(propagation.run(progress, known))
            if asked:
                prediction = _with_counted(prediction, marks, compute_budget, progress, asked)
                prediction = replace(prediction, wall_time=clock() - started)
        except UncPhysicsError as error:
            if error.prediction is not None:
                error.prediction = prediction_of(error.prediction)
            raise
    return prediction


def _with_counted(prediction, marks, compute_budget, progress, events):
    """Return the prediction with rollouts for the events, unless it has samples or only one outcome.

    If they diverge or time runs out, the prediction stays without them.
    """
    scene, initial = prediction.scene, prediction.initial
    if isinstance(prediction.propagator, Samples) or is_certain(scene, initial, prediction.at()):
        return prediction
    propagator: Any = make_propagator(ANYTIME, error=0.0, spread_error=0.0)
    check_memory(scene, initial, propagator, len(marks))

    def done(_, count):  # all steps are done, but an exception still ends the prediction
        progress(count, count)

    report = None if progress is None else done
    try:
        found = Propagation(scene, initial, propagator, marks, compute_budget, events).counted(report)
    except (PredictionTimeoutError, DivergedError):
        return prediction
    pairs = zip(prediction.snapshots, found, strict=True)
    return replace(prediction, snapshots=tuple(replace(one, counted=counted) for one, counted in pairs))


def start_belief(scene: Scene, belief: Belief) -> Belief:
    """Return the belief at time 0 of a prediction with a single nominal rollout, without a prediction.

    It has the moments of sigma points that are moved out of overlap, and in
    which bodies at rest settle. With the explicit integrator it is the given belief.

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
    return points_at_start(scene, belief)[0]
