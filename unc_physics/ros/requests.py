"""One request, from its message to the answer: checked, predicted, written."""

from __future__ import annotations

import functools
import math
import secrets
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from diagnostic_msgs.msg import KeyValue
from std_msgs.msg import Header

from unc_physics_msgs.msg import Prediction as PredictionMessage
from unc_physics_msgs.msg import PredictionRequest, Result

from ..checks.errors import (
    ErrorCode,
    InvalidHorizonError,
    InvalidOptionError,
    LimitExceededError,
    NotSupportedError,
    UncPhysicsError,
)
from ..checks.shown import printable
from ..checks.validation import array, non_negative, positive
from ..physics.layout import ERROR
from ..prediction.predict import check_supported, periodic_times, predict
from ..prediction.prediction import Prediction
from ..prediction.regions import BoxRegion
from ..propagators.base import Propagator
from ..propagators.names import ANYTIME
from ..propagators.registry import PROPAGATORS, propagator_from_texts
from ..scene.belief import Belief
from ..scene.entries import at_field
from ..scene.physics_keys import PHYSICS_KEYS
from ..scene.physics_summary import physics_as_text
from ..scene.scene import Scene
from .durations import duration, read_duration
from .frames import Frames
from .models import ModelLibrary
from .parameters import Settings
from .physics_message import physics_message, read_physics
from .prediction_writer import Wanted, write_modes, write_prediction, write_start
from .probabilities import write_probabilities
from .scene_reader import Limits, read_scene
from .statuses import write_statuses
from .surroundings import read_regions

_STATE_BYTES = 800  # of a PredictedState without its optional parts
_START_BYTES = 350  # of where an object began
_POSE_BYTES = 56
_PROBABILITY_BYTES = 100
_NUMBER_BYTES = 8
#: Errors that a request may want, and the option that each is.
_WISHES = {
    "wanted_position_error": "position_error",
    "wanted_rotation_error": "rotation_error",
    "wanted_probability_error": "probability_error",
}
_SEED_BITS = 53  # whole numbers that JavaScript and MATLAB clients keep, too


class Job(NamedTuple):
    """A request in the core's terms, checked.

    Attributes
    ----------
    scene : Scene
    belief : Belief
    regions : tuple of BoxRegion
    models : tuple of str
        Names of the objects' models.
    propagator : Propagator
    horizon : float
        [s]
    times : list of float or None
        Times at which states are wanted besides the horizon [s].
    max_computation_time : float or None
        [s]
    seed : int
    return_samples : int
    wanted : Wanted
    zeros_replaced : bool
        Whether a covariance of zeros was read as unknown.
    skipped : dict of str
        Ids of objects that were left out, and why.
    """

    scene: Scene
    belief: Belief
    regions: tuple[BoxRegion, ...]
    models: tuple[str, ...]
    propagator: Propagator
    horizon: float
    times: list[float] | None
    max_computation_time: float | None
    seed: int
    return_samples: int
    wanted: Wanted
    zeros_replaced: bool
    skipped: dict[str, str]


class Outcome(NamedTuple):
    """A prediction, and for each of its times the states (N, B, 13) drawn from it, if any are wanted."""

    prediction: Prediction
    samples: list[np.ndarray] | None


def read_request(
    request: PredictionRequest,
    settings: Settings,
    library: ModelLibrary,
    frames: Frames,
    *,
    time_limit: float | None = None,
    fields: Sequence[str] | None = None,
) -> Job:
    """Check a request.

    Parameters
    ----------
    request : PredictionRequest
    settings : Settings
    library : ModelLibrary
    frames : Frames
    time_limit : float, optional
        Longest wall time, whatever the request allows [s].
    fields : sequence of str, optional
        What errors call each object; by default ``scene.objects[0]`` and so on.

    Raises
    ------
    UncPhysicsError
        One of its kinds, naming the field and the value.
    """
    message, regions = request.scene, request.regions
    transform = frames.to_world(message.header)
    if transform is not None:
        message, regions = transform.scene(message), [transform.region(region) for region in regions]
    horizon = _horizon(request.horizon, settings)
    seed = request.seed or 1 + secrets.randbelow(2**_SEED_BITS - 1)
    options = _options(request.propagator_options)
    name = _add_wishes(options, request)
    propagator = _propagator(name, options, request.samples, seed, settings)
    # of others the work is that of single bodies anyway, and what grows does so for all bodies
    islands = settings.islands and propagator.traits.cross_body and not propagator.grows
    read = read_scene(
        message,
        library,
        read_physics(request.physics, settings.physics | {"islands": islands}),
        settings.doubts,
        Limits(settings.max_objects, settings.max_spheres, settings.max_elements),
        fields=fields,
        skip_unknown_models=request.skip_unknown_models,
    )
    check_supported(read.scene, propagator)
    belief = at_field("scene", _with_common_error, read.belief, message, transform)
    times = _times(request.trajectory_period, horizon, read.scene.dt, settings)
    job = Job(
        read.scene,
        belief,
        _regions(regions, settings),
        read.models,
        propagator,
        horizon,
        times,
        _computation_time(request.max_computation_time, time_limit),
        getattr(propagator, "seed", seed),
        request.return_samples,
        Wanted(
            request.return_covariance,
            request.return_joint_covariance,
            request.return_probabilities,
            request.return_modes,
        ),
        read.zeros_replaced,
        read.skipped,
    )
    _check_answer(job, settings)
    return job


def run(job: Job, progress: Callable[[int, int], object] | None = None) -> Outcome:
    """Predict; an error that ends the prediction early has the outcome until then as its ``prediction``.

    Raises
    ------
    UncPhysicsError
    """
    try:
        prediction = predict(
            job.scene,
            job.belief,
            job.propagator,
            job.horizon,
            times=job.times,
            max_computation_time=job.max_computation_time,
            progress=progress,
            keep_samples=job.return_samples,
        )
    except UncPhysicsError as error:
        if error.prediction is not None:
            error.prediction = _outcome(job, error.prediction)
        raise
    return _outcome(job, prediction)


def _outcome(job, prediction):
    """The prediction, and the states that are wanted with it."""
    samples = None
    if prediction.kept is not None:
        samples = list(prediction.kept)
    elif (
        job.return_samples
    ):  # the same normal numbers at every time, so that an entry belongs together over time
        samples = [
            belief.sample(job.return_samples, np.random.default_rng(job.seed))
            for belief in prediction.beliefs
        ]
    return Outcome(prediction, samples)


def write_answer(message: PredictionMessage, header: Header, settings: Settings, job: Job, outcome: Outcome):
    """Write a prediction into its message, whose header becomes that of the request's scene."""
    prediction = outcome.prediction
    objects, joints = write_prediction(
        job.scene, job.models, prediction.times, prediction.beliefs, outcome.samples, job.wanted
    )
    write_start(objects, job.scene, prediction.start)
    if job.wanted.modes:
        write_modes(objects, prediction)
    message.header.stamp = header.stamp
    message.header.frame_id = settings.world_frame
    message.propagator = job.propagator.name
    used = prediction.scene
    message.physics, message.physics_summary = _told_physics(used)
    message.rollouts = job.propagator.rollouts(prediction.carry)
    errors = job.propagator.standard_errors(prediction.carry, used)
    if errors is not None:
        message.position_error = [float(errors.position.max(initial=0.0))]
        message.rotation_error = [float(errors.rotation.max(initial=0.0))]
        message.probability_error = [0.5 / math.sqrt(message.rollouts) if errors.relative.any() else 0.0]
    message.objects = objects
    message.skipped = [KeyValue(key=name, value=reason) for name, reason in job.skipped.items()]
    message.joint_covariances = joints
    complete = prediction.time > job.horizon - job.scene.dt
    write_statuses(message, prediction, settings.status_rollouts if complete else 0)
    flies = len(job.scene.moving) * prediction.time / job.scene.dt <= settings.max_flight_steps
    write_probabilities(message, prediction, job.regions, job.wanted.probabilities, complete and flies)
    message.seed = job.seed
    message.time_reached = duration(prediction.time)
    message.computation_time = duration(prediction.wall_time)


@functools.lru_cache(maxsize=32)
def _told_physics(scene):
    """A scene's physics as a message, which nobody changes, and as text; scenes come again and again."""
    return physics_message({key: getattr(scene, key) for key in PHYSICS_KEYS}), physics_as_text(scene)


def write_error(result: Result, error: Exception) -> None:
    """Write an error as a request's result; what is no `UncPhysicsError` is a fault of the node itself."""
    if isinstance(error, UncPhysicsError):
        result.error_code, result.error_msg = int(error.code), str(error)
    else:
        result.error_code = int(ErrorCode.INTERNAL)
        result.error_msg = printable(f"a fault of the node: {type(error).__name__}: {error}")


def _options(pairs):
    """Texts by key."""
    options = {}
    for k, pair in enumerate(pairs):
        if not pair.key:
            raise InvalidOptionError("must not be empty", field=f"propagator_options[{k}].key")
        if pair.key in options:
            raise InvalidOptionError("is given twice", field=f"propagator_options[{k}].key", value=pair.key)
        options[pair.key] = pair.value
    return options


def _add_wishes(options, request):
    """Add the wanted errors and the time budget to the options; returns the propagator's name."""
    wishes = {option: getattr(request, field) for field, option in _WISHES.items()}
    for field, option in _WISHES.items():
        non_negative(wishes[option], field)
    wishes["time"] = read_duration(request.time_budget, "time_budget")
    if not any(wishes.values()):
        return request.propagator
    name = request.propagator or ANYTIME
    if name in PROPAGATORS and not PROPAGATORS[name].grows:
        field = next((f for f, option in _WISHES.items() if wishes[option]), "time_budget")
        raise NotSupportedError(f"is not for {name}; {ANYTIME} takes it", field=field)
    options.setdefault("error", 0.0)
    for option, wish in wishes.items():
        if wish:
            options.setdefault(option, wish)
    return name


def _regions(messages, settings):
    if len(messages) > settings.max_regions:
        raise LimitExceededError(
            f"must be at most {settings.max_regions}", field="regions", value=len(messages)
        )
    return read_regions(messages)


def _with_common_error(belief, message, transform):
    """The belief with the error that all moving objects share, given in the header's frame."""
    origin, axes = message.common_pose_origin, None
    origin = array((origin.x, origin.y, origin.z), (3,), "common_pose_origin")
    if transform is not None:
        origin, axes = transform.R @ origin + transform.translation, transform.R
    return belief.with_common_pose_std(message.common_pose_std, origin, axes)


def _horizon(message, settings):
    horizon = positive(read_duration(message, "horizon", InvalidHorizonError), "horizon", InvalidHorizonError)
    if horizon > settings.max_horizon:
        raise LimitExceededError(f"must be at most {settings.max_horizon} s", field="horizon", value=horizon)
    return horizon


def _times(period, horizon, dt, settings):
    steps = horizon / dt
    if steps > settings.max_steps:
        raise LimitExceededError(
            f"takes {steps:.0f} steps of {dt} s, and the limit is {settings.max_steps}",
            field="horizon",
            value=horizon,
        )
    if (period := read_duration(period, "trajectory_period", InvalidHorizonError)) == 0.0:
        return None
    if horizon / period > settings.max_states:
        raise LimitExceededError(
            f"gives more than {settings.max_states} states", field="trajectory_period", value=period
        )
    if period < 0.5 * dt:
        raise InvalidHorizonError(
            f"is shorter than half a step of dt = {dt} s", field="trajectory_period", value=period
        )
    return periodic_times(period, horizon)


def _propagator(name, options, samples, seed, settings):
    """The propagator that is asked for; a default above the node's limit is lowered to it."""
    if samples > settings.max_samples:
        raise LimitExceededError(f"must be at most {settings.max_samples}", field="samples", value=samples)
    propagator = propagator_from_texts(name or settings.default_propagator, options, samples or None, seed)
    for option in ("samples", "runs"):
        if (drawn := getattr(propagator, option, 0)) <= settings.max_samples:
            continue
        if option in options:
            raise LimitExceededError(
                f"must be at most {settings.max_samples}", field=f"propagator_options '{option}'", value=drawn
            )
        propagator = replace(propagator, **{option: settings.max_samples})
    return propagator


def _computation_time(value, limit):
    asked = read_duration(value, "max_computation_time") or None
    return min((time for time in (asked, limit) if time is not None), default=None)


def _check_answer(job, settings):
    """Refuse an answer that cannot be given, or is too large."""
    if job.wanted.joint_covariance and not job.propagator.traits.cross_body:
        raise NotSupportedError(
            f"has no answer from {job.propagator.name}, which keeps no correlations between objects",
            field="return_joint_covariance",
        )
    if job.return_samples > settings.max_return_samples:
        raise LimitExceededError(
            f"must be at most {settings.max_return_samples}", field="return_samples", value=job.return_samples
        )
    own = job.propagator.own_sample_count
    if own is not None and job.return_samples > own:
        raise LimitExceededError(
            f"must be at most the {own} samples of the prediction",
            field="return_samples",
            value=job.return_samples,
        )
    size = answer_bytes(job)
    if size > settings.max_response_bytes:
        raise LimitExceededError(
            f"would take {size} bytes, and the limit is {settings.max_response_bytes}; ask for fewer states"
            " or samples",
            field="the answer",
        )


def answer_bytes(job: Job) -> int:
    """About how many bytes the answer takes."""
    states = 1 + len(job.times or ())
    one = _STATE_BYTES + _POSE_BYTES * job.return_samples + _NUMBER_BYTES * ERROR**2 * job.wanted.covariance
    one += _START_BYTES * job.wanted.modes
    moving = len(job.scene.moving)
    joint = _NUMBER_BYTES * (ERROR * moving) ** 2 * job.wanted.joint_covariance
    pairs = moving * (len(job.scene.bodies) + len(job.scene.environment) + 1) * job.wanted.probabilities
    starts = _START_BYTES * len(job.scene.bodies)
    probabilities = _PROBABILITY_BYTES * (pairs + moving * len(job.regions))
    return starts + states * (len(job.scene.bodies) * one + joint) + probabilities
