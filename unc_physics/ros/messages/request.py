"""Prediction requests, checked and read."""

from __future__ import annotations

import re
import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Quaternion, Vector3

from unc_physics_msgs.msg import Environment, PredictionRequest
from unc_physics_msgs.msg import Scene as SceneMessage

from ...checks.errors import (
    InvalidHorizonError,
    InvalidOptionError,
    InvalidRequestError,
    LimitExceededError,
    NotSupportedError,
    PredictionTimeoutError,
    UncPhysicsError,
)
from ...checks.validation import array, non_negative, positive
from ...prediction.events import Event, InRegion, encounters, moving_names
from ...prediction.predict import predict_marks
from ...prediction.prediction import Prediction
from ...prediction.regions import BoxRegion
from ...prediction.request_checks import check_supported, marks_of, periodic_times
from ...propagators.base import Anytime, Propagator, Samples
from ...propagators.names import ANYTIME
from ...propagators.registry import PROPAGATORS, propagator_from_texts
from ...scene.belief import Belief
from ...scene.entries import at_field
from ...scene.marks import Mark
from ...scene.scene import Scene
from ...spatial.layout import ERROR, STATE
from .environment import read_regions
from .events import object_events
from .fields import read_duration, seconds, xyz, xyzw
from .frames import Frames
from .physics import read_physics
from .scene import FieldNames, read_scene

_STATE_BYTES = 800  # size of a PredictedState without optional parts
_START_BYTES = 350  # size of an object's start
_POSE_BYTES = 56
_PROBABILITY_BYTES = 100
_NUMBER_BYTES = 8
_COPIES = 8  # memory of a message's objects in Python over its size
_BYTES = 1e6  # of one MB
_LIMIT = "the parameter max_memory allows {:g} MB"
#: Options of the anytime propagator for fields of a request.
_TARGETS = {
    "wanted_position_error": "position_error",
    "wanted_rotation_error": "rotation_error",
    "wanted_probability_error": "probability_error",
}
# how far a budget of time may be exceeded: as a share of it, and in any case [s]
_OVER_BUDGET, _OVER_ANY_BUDGET = 0.05, 0.025
_SEED_BITS = 53  # largest integers that JavaScript and MATLAB clients represent exactly


class TimeLimits(NamedTuple):
    """Limits that the node sets for the computation of a request.

    Attributes
    ----------
    limit : float or None
        Longest wall time, even if the request allows more [s].
    budget : float
        Time after which an anytime method adds no more rollouts, if the request sets no goals [s]; 0 for any.
    """

    limit: float | None = None
    budget: float = 0.0


UNLIMITED = TimeLimits()


class RequestedOutputs(NamedTuple):
    """Requested outputs besides means and marginal covariances; each has a field ``return_<name>``.

    Attributes
    ----------
    covariance, joint_covariance : bool
        Complete covariance of each object; joint covariance of all moving objects.
    probabilities : bool
        Probabilities of contact, rest, uprightness and falls.
    modes : bool
        Split outcomes as weighted Gaussians.
    """

    covariance: bool = False
    joint_covariance: bool = False
    probabilities: bool = False
    modes: bool = False

    @classmethod
    def read(cls, request: Any) -> RequestedOutputs:
        """Return the outputs that a request asks for."""
        return cls(*(getattr(request, f"return_{name}") for name in cls._fields))


MARGINALS_ONLY = RequestedOutputs()


@dataclass(frozen=True, eq=False, kw_only=True)
class Job:
    """Checked request, in the core's types.

    Attributes
    ----------
    scene : Scene
    belief : Belief
    models : tuple of str
        Names of the objects' models.
    propagator : Propagator
    marks : sequence of Mark
        Requested times, the last of which is the horizon.
    seed : int
    max_computation_time : float or None
        [s]
    regions : tuple of BoxRegion
    return_samples : int
    outputs : RequestedOutputs
    zeros_replaced : bool
        Whether a covariance of zeros was read as unknown.
    skipped : dict of str
        Reasons of omitted objects, by id.
    notes : dict of tuple of str
        What was changed in the covariances of an object, by id.
    """

    scene: Scene
    belief: Belief
    models: tuple[str, ...]
    propagator: Propagator
    marks: Sequence[Mark]
    seed: int
    max_computation_time: float | None = None
    regions: tuple[BoxRegion, ...] = ()
    return_samples: int = 0
    outputs: RequestedOutputs = MARGINALS_ONLY
    zeros_replaced: bool = False
    skipped: dict[str, str] = field(default_factory=dict)
    notes: dict[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def horizon(self) -> float:
        """Last time [s]."""
        return self.marks[-1].time

    @property
    def events(self) -> list[Event]:
        """Events whose probabilities are in the answer; events of regions are always included."""
        bodies = moving_names(self.scene)
        found: list[Event] = [InRegion(name, region) for region in self.regions for name in bodies]
        if self.outputs.probabilities:
            found += encounters(self.scene)
            found += object_events(bodies)
        return found

    def run(self, progress: Callable[[int, int], object] | None = None) -> Prediction:
        """Run the prediction.

        Parameters
        ----------
        progress : callable, optional
            As in `predict`.

        Raises
        ------
        UncPhysicsError
            As `predict`, with the prediction until then as its ``prediction``.
        """
        try:
            return predict_marks(
                self.scene,
                self.belief,
                self.propagator,
                self.marks,
                max_computation_time=self.max_computation_time,
                progress=progress,
                events=self.events,
            )
        except PredictionTimeoutError as error:
            budget = getattr(self.propagator, "time", 0.0)
            if budget and self.max_computation_time == _budget_limit(budget):
                named = PredictionTimeoutError(error.problem, field="time_budget", value=budget)
                named.prediction = error.prediction
                raise named from None
            raise

    @property
    def memory(self) -> int:
        """Approximate memory of the answer and of the rollouts that it is computed from [bytes]."""
        outputs, moving, bodies = self.outputs, len(self.scene.moving), len(self.scene.bodies)
        states = len(self.marks)
        one = _STATE_BYTES + _POSE_BYTES * self.return_samples + _NUMBER_BYTES * ERROR**2 * outputs.covariance
        one += _START_BYTES * outputs.modes
        joint = _NUMBER_BYTES * (ERROR * moving) ** 2 * outputs.joint_covariance
        pairs = moving * (bodies + len(self.scene.environment) + 1) * outputs.probabilities
        probabilities = _PROBABILITY_BYTES * (pairs + moving * len(self.regions))
        answer = _START_BYTES * bodies + states * (bodies * one + joint) + probabilities
        rollouts = max(getattr(self.propagator, option, 0) for option in ("samples", "runs"))
        kept = states if isinstance(self.propagator, Samples) else 0
        return _COPIES * answer + _NUMBER_BYTES * STATE * rollouts * bodies * (kept + 1)


def read_request(
    request: PredictionRequest,
    settings,
    library,
    frames: Frames,
    *,
    limits: TimeLimits = UNLIMITED,
    fields: FieldNames | None = None,
    environment_of: Callable[[SceneMessage], Environment] = lambda scene: scene.environment,
) -> Job:
    """Read a request and check it.

    Parameters
    ----------
    request : PredictionRequest
    settings : Settings
    library : ModelLibrary
    frames : Frames
    limits : TimeLimits, optional
    fields : FieldNames, optional
        Names in error messages; by default ``scene.objects[0]``, ``actions[0]`` and so on.
    environment_of : callable
        Returns the environment of a scene of the world frame (`NodeEnvironment.around`).

    Raises
    ------
    UncPhysicsError
        A subclass that names field and value.
    """
    transform = frames.to_world(request.scene.header)
    if transform is not None:
        request = transform.moved(request)
    message = request.scene
    horizon = read_horizon(request.horizon, settings)
    options = _options(request.propagator_options)
    name = _add_targets(options, request)
    seed = request.seed or (None if "seed" in options else 1 + secrets.randbelow(2**_SEED_BITS - 1))
    name = name or settings.default_propagator
    propagator = propagator_from_texts(name, options, request.samples or None, seed)
    asked_time = getattr(propagator, "time", 0.0)
    if limits.budget and not options and isinstance(propagator, Anytime):
        propagator = propagator.within(limits.budget)
    read = read_scene(
        message,
        library,
        read_physics(request.physics, settings.physics),
        settings.covariance_defaults,
        settings.max_objects,
        actions=request.actions,
        environment=environment_of(message),
        fields=fields,
        skip_invalid_objects=request.skip_invalid_objects,
    )
    check_supported(read.scene, propagator)
    belief = at_field("scene", _with_common_error, read.belief, message, transform)
    job = Job(
        **(read._asdict() | {"belief": belief}),
        propagator=propagator,
        marks=read_marks(request, horizon, read.scene, settings),
        seed=getattr(propagator, "seed", seed or 0),
        max_computation_time=_computation_time(request.max_computation_time, limits.limit, asked_time),
        regions=limited_regions(request.regions, settings),
        return_samples=request.return_samples,
        outputs=RequestedOutputs.read(request),
    )
    check_answer(job, settings)
    return job


def as_sent(error: UncPhysicsError, request: PredictionRequest) -> UncPhysicsError:
    """Return an error with the value that the request has in its field.

    The scene may have been transformed to another frame. The limit of a prediction's time may be the
    node's, or the rest of a limit that several predictions share.
    """
    value = _value_at(request, error.field or "")
    if value is None or error.value is None or value == error.value:
        return error
    field, problem = error.field, error.problem
    if isinstance(error, PredictionTimeoutError):
        problem += f", after {error.value:.3g} s for this prediction"
        if not value:
            field, value = "the node's limit of computation time", None
    own = type(error)(problem, field=field, value=value)
    own.prediction = error.prediction
    return own


def _value_at(message, field):
    """Return the number, the numbers or the time [s] in a field such as ``scene.objects[0].mass``."""
    for part in re.findall(r"\w+", field):
        if part.isdigit() and hasattr(message, "__len__") and int(part) < len(message):
            message = message[int(part)]
        elif hasattr(message, part):
            message = getattr(message, part)
        else:
            return None
    if isinstance(message, Duration):
        return seconds(message)
    if isinstance(message, (Point, Vector3)):
        return xyz(message)
    if isinstance(message, Quaternion):
        return xyzw(message)
    return message if isinstance(message, (str, bool, int, float)) else None


def _options(pairs):
    """Return options as strings by key."""
    options = {}
    for k, pair in enumerate(pairs):
        if not pair.key:
            raise InvalidOptionError("must not be empty", field=f"propagator_options[{k}].key")
        if pair.key in options:
            raise InvalidOptionError("is given twice", field=f"propagator_options[{k}].key", value=pair.key)
        options[pair.key] = pair.value
    return options


def _add_targets(options, request):
    """Add the target errors and the time budget to the options; return the propagator's name."""
    targets = {option: getattr(request, name) for name, option in _TARGETS.items()}
    for name, option in _TARGETS.items():
        non_negative(targets[option], name)
    targets["time"] = read_duration(request.time_budget, "time_budget")
    if not any(targets.values()):
        return request.propagator
    name = request.propagator or ANYTIME
    if name in PROPAGATORS and not issubclass(PROPAGATORS[name], Anytime):
        field = next((f for f, option in _TARGETS.items() if targets[option]), "time_budget")
        raise NotSupportedError(f"is not for {name}; {ANYTIME} takes it", field=field)
    if set(filter(targets.get, targets)) != {"probability_error"}:
        options.setdefault("error", 0.0)  # what is asked for counts alone
    for option, target in targets.items():
        if target:
            options.setdefault(option, target)
    return name


def limited_regions(messages, settings) -> tuple[BoxRegion, ...]:
    """Return the regions of a request, of which the node allows ``max_objects``."""
    if len(messages) > settings.max_objects:
        raise LimitExceededError(
            f"must be at most {settings.max_objects}", field="regions", value=len(messages)
        )
    return read_regions(messages)


def _with_common_error(belief, message, transform):
    """Return the belief with the pose error shared by all moving objects, given in the header's frame."""
    origin, axes = array(xyz(message.common_pose_origin), (3,), "common_pose_origin"), None
    if transform is not None:
        origin, axes = transform.R @ origin + transform.translation, transform.R
    return belief.with_common_pose_std(message.common_pose_std, origin, axes)


def read_horizon(message, settings) -> float:
    """Return a horizon [s], of at most ``max_horizon``."""
    horizon = positive(read_duration(message, "horizon", InvalidHorizonError), "horizon", InvalidHorizonError)
    if horizon > settings.max_horizon:
        raise LimitExceededError(f"must be at most {settings.max_horizon} s", field="horizon", value=horizon)
    return horizon


def read_marks(request, horizon: float, scene: Scene, settings) -> list[Mark]:
    """Return the marks of the requested times and of the horizon."""
    period = read_duration(request.trajectory_period, "trajectory_period", InvalidHorizonError)
    if period and request.times:
        raise InvalidRequestError(
            "must be empty where trajectory_period is set", field="times", value=len(request.times)
        )
    if period:
        if horizon / period * _STATE_BYTES > _BYTES * settings.max_memory:
            raise LimitExceededError(
                f"gives more states than {_LIMIT.format(settings.max_memory)}",
                field="trajectory_period",
                value=period,
            )
        times = periodic_times(scene, period, horizon, "trajectory_period")
    else:
        given = enumerate(request.times)
        times = [read_duration(time, f"times[{k}]", InvalidHorizonError) for k, time in given]
    return marks_of(scene, horizon, times)


def _computation_time(value, limit, budget):
    asked = read_duration(value, "max_computation_time") or None
    times = asked, limit, _budget_limit(budget) if budget else None
    return min((time for time in times if time is not None), default=None)


def _budget_limit(budget):
    """Return the time [s] after which a prediction ends whose fewest rollouts do not fit into its budget."""
    return budget + max(_OVER_BUDGET * budget, _OVER_ANY_BUDGET)


def check_answer(job: Job, settings) -> None:
    """Raise an error for an answer that the propagator does not have, or that is too large."""
    if job.outputs.joint_covariance and not job.propagator.traits.cross_body:
        raise NotSupportedError(
            f"has no answer from {job.propagator.name}, which keeps no correlations between objects",
            field="return_joint_covariance",
        )
    own = job.propagator.own_sample_count if isinstance(job.propagator, Samples) else None
    if own is not None and job.return_samples > own:
        raise LimitExceededError(
            f"must be at most the {own} samples of the prediction",
            field="return_samples",
            value=job.return_samples,
        )
    check_memory(job, settings)


def check_memory(job: Job, settings, count: int = 1) -> None:
    """Raise `LimitExceededError` if several predictions as of a job would take too much memory."""
    if (size := count * job.memory) > _BYTES * settings.max_memory:
        raise LimitExceededError(
            f"takes {size / _BYTES:.3g} MB, and {_LIMIT.format(settings.max_memory)}; ask for fewer objects,"
            " states, samples or candidates",
            field="the prediction",
        )
