"""Answers that a robot asks a prediction for: will they touch, and when; where will it be; will it be at
rest?

An answer is available if its probability is within `TOLERANCE` of the truth, as far as the interval tells
that its outcomes leave for the truth. A propagator with samples of its own counts these. The others have
none, and the Gaussian that they end with is no good for probabilities once bodies have touched
(``python -m unc_physics evaluate calibration`` shows how far off it is). They can tell what the first
contacts decide, before which all bodies fly freely: flights drawn from the initial belief answer each
question with yes, no, or not yet. "Not yet" counts half, and widens the interval by as much.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..checks.array_field import Array, array_field
from ..checks.errors import DuplicateIdError, InvalidEnvironmentError, InvalidRequestError
from ..checks.validation import array, instance, integer, positive, quaternion
from ..physics.layout import ANGULAR_VELOCITY, POSITION, VELOCITY
from ..physics.rotation import rotation_matrix
from ..scene.environment import element_names
from .first_contacts import first_contacts
from .prediction import Prediction

#: What an answer is called with that is about any element of the environment.
ENVIRONMENT = "environment"
#: How far an available probability may be from the truth.
TOLERANCE = 0.1
#: Half width of the interval of a share, in standard deviations: one share in a thousand lies outside.
CONFIDENCE = 3.29
#: Flights of a propagator without samples.
FLIGHTS = 1000
#: Contacts below which too little is known of when they begin.
FEWEST_CONTACTS = 10
#: Speeds below which a body counts as at rest [m/s], [rad/s].
REST_SPEED, REST_ANGULAR_SPEED = 0.01, math.radians(5.0)

#: Outcomes of predictions whose answers were asked for, by the number of flights.
_known: weakref.WeakKeyDictionary = weakref.WeakKeyDictionary()


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
    size: Array = array_field()
    position: Array = array_field((0.0, 0.0, 0.0))
    orientation: Array = array_field((0.0, 0.0, 0.0, 1.0))

    def __post_init__(self):
        if not isinstance(self.name, str) or not self.name:
            raise InvalidRequestError("must be a non-empty text", field="name of region", value=self.name)
        of = f"of region '{self.name}'"
        size = array(self.size, (3,), f"size {of}", InvalidEnvironmentError)
        for k in range(3):
            positive(size[k], f"size[{k}] {of}", InvalidEnvironmentError)
        object.__setattr__(self, "size", size)
        object.__setattr__(
            self, "position", array(self.position, (3,), f"position {of}", InvalidEnvironmentError)
        )
        object.__setattr__(self, "orientation", quaternion(self.orientation, f"orientation {of}"))

    def contains(self, points: np.ndarray) -> np.ndarray:
        """(...,) bool: which points (..., 3) [m], world frame, lie in the box or on its surface."""
        R = rotation_matrix(self.orientation)
        return (np.abs((points - self.position) @ R) <= 0.5 * self.size).all(axis=-1)


@dataclass(frozen=True)
class ContactProbability:
    """How probable it is that two things touch within the horizon, and when they first do.

    Attributes
    ----------
    object_a, object_b : str
        A moving body, and another body, an element of the environment, or `ENVIRONMENT` for any of its
        elements. Two bodies are in the scene's order, where either may be the fixed one.
    time_from_start : float
        The contact happens between the start and this time [s].
    available : bool
        Whether the propagator can give the probability well enough.
    probability : float
        0 where it is not available.
    low, high : float
        An interval that holds the truth but in one of a thousand answers; 0 where it is not available.
    first_contact_time_available : bool
    first_contact_time_mean, first_contact_time_std : float
        Time of the first contact from the start, given that there is one: mean and standard deviation [s].
        Told by the step, so up to one ``dt`` late. 0 where it is not available, as where a contact is too
        improbable.
    """

    object_a: str
    object_b: str
    time_from_start: float
    available: bool = False
    probability: float = 0.0
    low: float = 0.0
    high: float = 0.0
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
    low, high : float
        An interval that holds the truth but in one of a thousand answers; 0 where it is not available.
    """

    region: str
    object: str
    time_from_start: float
    available: bool = False
    probability: float = 0.0
    low: float = 0.0
    high: float = 0.0


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
    low, high : float
        An interval that holds the truth but in one of a thousand answers; 0 where it is not available.
    """

    object: str
    time_from_start: float
    available: bool = False
    probability: float = 0.0
    low: float = 0.0
    high: float = 0.0


def contact_probabilities(
    prediction: Prediction, *, flights: int = FLIGHTS
) -> tuple[ContactProbability, ...]:
    """How probable contacts within the horizon are, and when they first happen.

    Parameters
    ----------
    prediction : Prediction
    flights : int, optional
        How many flights up to the first contacts answer for a propagator without samples; the first question
        about a prediction takes them. With 0 only what is certain is answered.

    Returns
    -------
    tuple of ContactProbability
        For each pair of bodies of which one moves, in the scene's order; then, for each moving body, each
        element of the environment, and the environment as a whole under the name `ENVIRONMENT`.
    """
    outcomes = _outcomes(prediction, flights)
    return tuple(
        _contact((one, other, prediction.time), outcomes, *place)
        for one, other, place in _encounters(prediction.scene)
    )


def region_probabilities(
    prediction: Prediction, regions: BoxRegion | Iterable[BoxRegion], *, flights: int = FLIGHTS
) -> tuple[RegionProbability, ...]:
    """How probable it is that a moving body's centre of mass lies in a region at the horizon.

    Parameters
    ----------
    prediction : Prediction
    regions : iterable of BoxRegion, or BoxRegion
    flights : int, optional
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
    outcomes = _outcomes(prediction, flights)
    regions = _checked_regions(regions)
    scene, answers = prediction.scene, []
    for region in regions:
        for body in scene.moving:
            inside = None if outcomes is None else region.contains(outcomes.states[:, body, POSITION])
            answers.append(
                RegionProbability(
                    region.name, scene.bodies[body].name, prediction.time, *_of_body(inside, outcomes, body)
                )
            )
    return tuple(answers)


def rest_probabilities(
    prediction: Prediction,
    *,
    speed: float = REST_SPEED,
    angular_speed: float = REST_ANGULAR_SPEED,
    flights: int = FLIGHTS,
) -> tuple[RestProbability, ...]:
    """How probable it is that a moving body is at rest at the horizon.

    Parameters
    ----------
    prediction : Prediction
    speed, angular_speed : float
        A body is at rest when its centre of mass is slower [m/s], and it turns slower [rad/s].
    flights : int, optional
        As for `contact_probabilities`.

    Returns
    -------
    tuple of RestProbability
        One for each moving body, in the scene's order.
    """
    speed, angular_speed = positive(speed, "speed"), positive(angular_speed, "angular_speed")
    outcomes = _outcomes(prediction, flights)
    scene, answers = prediction.scene, []
    for body in scene.moving:
        slow = None
        if outcomes is not None:
            slow = np.linalg.norm(outcomes.states[:, body, VELOCITY], axis=1) < speed
            slow &= np.linalg.norm(outcomes.states[:, body, ANGULAR_VELOCITY], axis=1) < angular_speed
        answers.append(
            RestProbability(scene.bodies[body].name, prediction.time, *_of_body(slow, outcomes, body))
        )
    return tuple(answers)


@dataclass(frozen=True, eq=False)
class _Outcomes:
    """Equally probable outcomes.

    Attributes
    ----------
    states : (N, B, 13) array
        At the horizon, or when the body stopped.
    stopped : (N, B) array
        Time from which on nothing is known of a body [s]; infinite for one that is known to the end.
    first : (N, B, B + E) array
        Time of the first contact of bodies i < j, or of body i and element j - B [s]; infinite without one.
    certain : bool
        Whether nothing else may happen, instead of these being draws.
    """

    states: np.ndarray
    stopped: np.ndarray
    first: np.ndarray
    certain: bool = False


def _checked_regions(regions):
    """Regions as a tuple; their names must differ."""
    try:
        regions = (regions,) if isinstance(regions, BoxRegion) else tuple(regions)
    except TypeError:
        raise InvalidRequestError("must be a sequence of BoxRegion", field="regions", value=regions) from None
    names = []
    for k, region in enumerate(regions):
        instance(region, BoxRegion, f"regions[{k}]")
        if region.name in names:
            raise DuplicateIdError(
                "is the name of two regions", field=f"regions[{k}].name", value=region.name
            )
        names.append(region.name)
    return regions


def _outcomes(prediction, flights):
    """What may happen, from a prediction's samples or from flights; None where there is nothing to tell it
    from.
    """
    instance(prediction, Prediction, "prediction")
    flights = integer(flights, "flights", low=0)
    known = _known.setdefault(prediction, {})
    if flights not in known:
        known[flights] = _sampled(prediction) or _flown(prediction, flights)
    return known[flights]


def _sampled(prediction):
    """The outcomes that a prediction holds: the propagator's samples, or the only one there is."""
    scene = prediction.scene
    certain = not (prediction.belief.covariance.any() or scene.uncertain)
    first = prediction.contact_history.first_time
    states = prediction.propagator.own_samples(prediction.carry, scene)
    if states is not None:
        certain = certain or (len(states) > 1 and bool((states == states[0]).all()))
    elif certain:
        states, first = prediction.belief.mean[None], first[:1]
    else:
        return None
    return _Outcomes(states, np.full(states.shape[:2], np.inf), first, certain)


def _flown(prediction, flights):
    """Outcomes as far as first contacts decide them."""
    scene = prediction.scene
    if flights == 0 or scene.uncertain or prediction.propagator.own_sample_count is not None:
        return None
    steps = round(prediction.time / scene.dt)
    return _Outcomes(*first_contacts(scene, prediction.initial, steps, flights))


def _encounters(scene):
    """Who may touch whom: their names, and (body, other body or None, columns) in the table of first
    contacts.
    """
    names = [body.name for body in scene.bodies]
    elements = element_names(scene.environment)
    B, E = len(names), len(elements)
    for i in range(B):
        for j in range(i + 1, B):
            if not (scene.bodies[i].fixed and scene.bodies[j].fixed):
                yield names[i], names[j], (i, j, slice(j, j + 1))
    for i in scene.moving:
        for e in range(E):
            yield names[i], elements[e], (i, None, slice(B + e, B + e + 1))
        if E:
            yield names[i], ENVIRONMENT, (i, None, slice(B, B + E))


def _contact(names: tuple[str, str, float], outcomes, body, other, columns):
    """The answer about one encounter."""
    if outcomes is None:
        return ContactProbability(*names)
    first = outcomes.first[:, body, columns].min(axis=1)
    known = outcomes.stopped[:, body]
    if other is not None:
        known = np.minimum(known, outcomes.stopped[:, other])
    yes = np.isfinite(first) & (
        first <= known
    )  # later than that, it is contact with a body that is not there any more
    share = _share(yes, np.isfinite(known) & ~yes, outcomes.certain)
    if not share[0] or yes.sum() < min(FEWEST_CONTACTS, len(yes)):  # one outcome is enough if it is certain
        return ContactProbability(*names, *share)
    times = first[yes].astype(float)
    return ContactProbability(*names, *share, True, float(times.mean()), float(times.std()))


def _of_body(yes, outcomes, body):
    """Whether a question about a body at the horizon, with these answers (N,) if it was known to the end, can
    be answered.
    """
    if outcomes is None:
        return False, 0.0, 0.0, 0.0
    return _share(yes, np.isfinite(outcomes.stopped[:, body]), outcomes.certain)


def _share(yes, unknown, certain):
    """Availability, probability, and its lowest and highest value, from outcomes (N,) that say yes, and those
    that leave it open, which count half.
    """
    count = len(yes)
    low, high = np.count_nonzero(yes & ~unknown) / count, np.count_nonzero(yes | unknown) / count
    probability = 0.5 * (low + high)
    if not certain:
        low, high = _interval(low, count)[0], _interval(high, count)[1]
    if max(probability - low, high - probability) > TOLERANCE:
        return False, 0.0, 0.0, 0.0
    # round-off must not leave the probability outside
    low, high = min(max(low, 0.0), probability), max(min(high, 1.0), probability)
    return True, float(probability), float(low), float(high)


def _interval(share, count):
    """Lowest and highest probability that may have given a share of ``count`` draws (Wilson 1927)."""
    square = CONFIDENCE**2 / count
    middle = (share + 0.5 * square) / (1.0 + square)
    half = CONFIDENCE * math.sqrt(share * (1.0 - share) / count + 0.25 * square / count) / (1.0 + square)
    return middle - half, middle + half
