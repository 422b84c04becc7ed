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
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..checks.array_field import Array, array_field
from ..checks.errors import DuplicateIdError, InvalidEnvironmentError, InvalidRequestError
from ..checks.validation import array, instance, integer, positive, quaternion
from ..physics.rotation import rotation_matrix
from .prediction import Prediction

#: What an answer is called with that is about any element of the environment.
ENVIRONMENT = "environment"
#: Whether a probability is available, itself, its lowest and highest value: where it cannot be told.
UNKNOWN = (False, None, None, None)
#: How far an available probability may be from the truth.
TOLERANCE = 0.1
#: Flights of a propagator without samples.
FLIGHTS = 1000
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
    probability : float or None
        None where it is not available.
    low, high : float or None
        An interval that holds the truth but in one of a thousand answers; None where it is not available.
    first_contact_time_available : bool
    first_contact_time_mean, first_contact_time_std : float or None
        Time of the first contact from the start, given that there is one: mean and standard deviation [s].
        Told by the step, so up to one ``dt`` late. None where it is not available, as where a contact is too
        improbable.
    """

    object_a: str
    object_b: str
    time_from_start: float
    available: bool = False
    probability: float | None = None
    low: float | None = None
    high: float | None = None
    first_contact_time_available: bool = False
    first_contact_time_mean: float | None = None
    first_contact_time_std: float | None = None


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
    probability : float or None
        None where it is not available.
    low, high : float or None
        An interval that holds the truth but in one of a thousand answers; None where it is not available.
    """

    region: str
    object: str
    time_from_start: float
    available: bool = False
    probability: float | None = None
    low: float | None = None
    high: float | None = None


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
    probability : float or None
        None where it is not available.
    low, high : float or None
        An interval that holds the truth but in one of a thousand answers; None where it is not available.
    """

    object: str
    time_from_start: float
    available: bool = False
    probability: float | None = None
    low: float | None = None
    high: float | None = None


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
    flights = _checked(prediction, flights)
    return prediction.answers.contacts(prediction, flights)


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
    flights = _checked(prediction, flights)
    return prediction.answers.regions(prediction, checked_regions(regions), flights)


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
    flights = _checked(prediction, flights)
    return prediction.answers.rest(prediction, speed, angular_speed, flights)


def checked_regions(regions: BoxRegion | Iterable[BoxRegion]) -> tuple[BoxRegion, ...]:
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


def _checked(prediction, flights):
    """The number of flights."""
    instance(prediction, Prediction, "prediction")
    return integer(flights, "flights", low=0)
