"""Answers that a robot asks a prediction for: will they touch, and when; where will it be; will it be at rest?

Every answer is a probability that was found to be within `TOLERANCE` of the truth, or says that it is not available:
``python -m benchmarks.calibration`` compares all of them with Monte Carlo.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from ..belief import Belief
from ..environment import element_names
from ..errors import DuplicateIdError, InvalidEnvironmentError, InvalidRequestError
from ..kernels.laws import FIRST
from ..kernels.so3 import write_matrix
from ..layout import ANGULAR_VELOCITY, POSITION, VELOCITY
from ..scene import Scene
from ..validation import array, positive, quaternion
from .predict import Prediction

#: What an answer is called with that is about any element of the environment.
ENVIRONMENT = "environment"
#: How far an available probability may be from the truth.
TOLERANCE = 0.1
#: Samples below which a probability's binomial error at 95 % may be above the tolerance.
FEWEST_SAMPLES = math.ceil((1.96 * 0.5 / TOLERANCE) ** 2)
#: Contacts below which too little is known of when they begin.
FEWEST_CONTACTS = 10
#: Speeds below which a body counts as at rest [m/s], [rad/s].
REST_SPEED, REST_ANGULAR_SPEED = 0.01, math.radians(5.0)


@dataclass(frozen=True, eq=False)
class BoxRegion:
    """A box in space to ask about.

    Attributes
    ----------
    name : str
    size : (3,) array
        Edge lengths [m].
    position : (3,) array
        Of its centre, world frame [m].
    orientation : (4,) array
        Quaternion (x, y, z, w) of ``R_world_region``.

    Raises
    ------
    InvalidRequestError, InvalidEnvironmentError, NotFiniteError, InvalidOrientationError
    """

    name: str
    size: np.ndarray
    position: np.ndarray = (0.0, 0.0, 0.0)
    orientation: np.ndarray = field(default=(0.0, 0.0, 0.0, 1.0))

    def __post_init__(self):
        if not isinstance(self.name, str) or not self.name:
            raise InvalidRequestError("must be a non-empty text", field="name of region", value=self.name)
        of = f"of region '{self.name}'"
        size = array(self.size, (3,), f"size {of}", InvalidEnvironmentError)
        for k in range(3):
            positive(size[k], f"size[{k}] {of}", InvalidEnvironmentError)
        object.__setattr__(self, "size", size)
        object.__setattr__(self, "position", array(self.position, (3,), f"position {of}", InvalidEnvironmentError))
        object.__setattr__(self, "orientation", quaternion(self.orientation, f"orientation {of}"))

    def contains(self, points: np.ndarray) -> np.ndarray:
        """(...,) bool: which points (..., 3) [m], world frame, lie in the box or on its surface."""
        R = np.empty((1, 3, 3))
        write_matrix(tuple(self.orientation), R, 0)
        return (np.abs((points - self.position) @ R[0]) <= 0.5 * self.size).all(axis=-1)


@dataclass(frozen=True)
class ContactProbability:
    """How probable it is that two things touch within the horizon, and when they first do.

    Attributes
    ----------
    object_a, object_b : str
        A moving body, and another body, an element of the environment, or `ENVIRONMENT` for any of its elements. Two
        bodies are in the scene's order, where either may be the fixed one.
    time_from_start : float
        The contact happens between the start and this time [s].
    available : bool
        Whether the propagator can give the probability well enough.
    probability : float
        0 where it is not available.
    first_contact_time_available : bool
    first_contact_time_mean, first_contact_time_std : float
        Time of the first contact from the start, given that there is one: mean and standard deviation [s]. Told by
        the step, so up to one ``dt`` late. 0 where it is not available, as where a contact is too improbable.
    """

    object_a: str
    object_b: str
    time_from_start: float
    available: bool = False
    probability: float = 0.0
    first_contact_time_available: bool = False
    first_contact_time_mean: float = 0.0
    first_contact_time_std: float = 0.0


@dataclass(frozen=True)
class RegionProbability:
    """How probable it is that a body's centre of mass lies in a region at the horizon.

    Attributes
    ----------
    region, object : str
        Names.
    time_from_start : float
        The horizon [s].
    available : bool
        Whether the propagator can give the probability well enough.
    probability : float
        0 where it is not available.
    """

    region: str
    object: str
    time_from_start: float
    available: bool = False
    probability: float = 0.0


@dataclass(frozen=True)
class RestProbability:
    """How probable it is that a body is at rest at the horizon.

    Attributes
    ----------
    object : str
        Its name.
    time_from_start : float
        The horizon [s].
    available : bool
        Whether the propagator can give the probability well enough.
    probability : float
        0 where it is not available.
    """

    object: str
    time_from_start: float
    available: bool = False
    probability: float = 0.0


def contact_probabilities(scene: Scene, prediction: Prediction, initial: Belief | None = None) -> tuple[ContactProbability, ...]:
    """How probable contacts within the horizon are, and when they first happen.

    Parameters
    ----------
    scene : Scene
    prediction : Prediction
    initial : Belief, optional
        The belief that the prediction began with. Propagators that have no samples need it.

    Returns
    -------
    tuple of ContactProbability
        For each pair of bodies of which one moves, in the scene's order; then, for each moving body, each element of
        the environment, and the environment as a whole under the name `ENVIRONMENT`.
    """
    samples = _samples(scene, prediction)
    answers = []
    for body_a, body_b, columns in _encounters(scene):
        names = (body_a, body_b, prediction.time)
        if samples is None:
            answers.append(ContactProbability(*names))
        else:
            answers.append(_contact(names, samples.first[:, columns[0], columns[1]].min(axis=1)))
    return tuple(answers)


def region_probabilities(
    scene: Scene, prediction: Prediction, regions: Iterable[BoxRegion], initial: Belief | None = None
) -> tuple[RegionProbability, ...]:
    """How probable it is that a moving body's centre of mass lies in a region at the horizon.

    Parameters
    ----------
    scene : Scene
    prediction : Prediction
    regions : iterable of BoxRegion
    initial : Belief, optional
        As for `contact_probabilities`.

    Returns
    -------
    tuple of RegionProbability
        For each region, each moving body in the scene's order.

    Raises
    ------
    DuplicateIdError
        If two regions have one name.
    """
    regions = tuple(regions)
    names = [region.name for region in regions]
    for k, name in enumerate(names):
        if name in names[:k]:
            raise DuplicateIdError("is the name of two regions", field=f"regions[{k}].name", value=name)
    samples = _samples(scene, prediction)
    answers = []
    for region in regions:
        for body in scene.moving:
            of = (region.name, scene.bodies[body].name, prediction.time)
            if samples is None:
                answers.append(RegionProbability(*of))
            else:
                inside = region.contains(samples.states[:, body, POSITION])
                answers.append(RegionProbability(*of, True, float(inside.mean())))
    return tuple(answers)


def rest_probabilities(
    scene: Scene, prediction: Prediction, initial: Belief | None = None,
    *, speed: float = REST_SPEED, angular_speed: float = REST_ANGULAR_SPEED,
) -> tuple[RestProbability, ...]:
    """How probable it is that a moving body is at rest at the horizon.

    Parameters
    ----------
    scene : Scene
    prediction : Prediction
    initial : Belief, optional
        As for `contact_probabilities`.
    speed, angular_speed : float
        A body is at rest when its centre of mass is slower [m/s], and it turns slower [rad/s].

    Returns
    -------
    tuple of RestProbability
        One for each moving body, in the scene's order.
    """
    speed, angular_speed = positive(speed, "speed"), positive(angular_speed, "angular_speed")
    samples = _samples(scene, prediction)
    answers = []
    for body in scene.moving:
        of = (scene.bodies[body].name, prediction.time)
        if samples is None:
            answers.append(RestProbability(*of))
        else:
            state = samples.states[:, body]
            slow = np.linalg.norm(state[:, VELOCITY], axis=1) < speed
            slow &= np.linalg.norm(state[:, ANGULAR_VELOCITY], axis=1) < angular_speed
            answers.append(RestProbability(*of, True, float(slow.mean())))
    return tuple(answers)


@dataclass(frozen=True, eq=False)
class _Samples:
    """Equally probable outcomes.

    Attributes
    ----------
    states : (N, B, 13) array
        At the horizon.
    first : (N, B, B + E) array
        Time of the first contact of bodies i < j, or of body i and element j - B [s]; infinite without one.
    """

    states: np.ndarray
    first: np.ndarray


def _samples(scene, prediction):
    """The outcomes that a prediction holds; None for fewer than it takes to tell a probability from."""
    carry = prediction.carry
    if prediction.propagator.name != "monte_carlo" or len(carry.states) < FEWEST_SAMPLES:
        return None
    return _Samples(carry.states, carry.memory[..., FIRST])


def _encounters(scene):
    """Who may touch whom: name, name, and (row, columns) in the table of first contacts."""
    names = [body.name for body in scene.bodies]
    elements = element_names(scene.environment)
    B, E = len(names), len(elements)
    for i in range(B):
        for j in range(i + 1, B):
            if not (scene.bodies[i].fixed and scene.bodies[j].fixed):
                yield names[i], names[j], (i, slice(j, j + 1))
    for i in scene.moving:
        for e in range(E):
            yield names[i], elements[e], (i, slice(B + e, B + e + 1))
        if E:
            yield names[i], ENVIRONMENT, (i, slice(B, B + E))


def _contact(names, first):
    """The answer from the times of the first contact (N,) in all samples."""
    touching = first[np.isfinite(first)].astype(float)
    probability = len(touching) / len(first)
    if len(touching) < min(FEWEST_CONTACTS, len(first)):
        return ContactProbability(*names, True, probability)
    return ContactProbability(*names, True, probability, True, float(touching.mean()), float(touching.std()))
