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

from collections.abc import Iterable
from dataclasses import dataclass

from ..checks.validation import instance, integer, positive
from .events import REST_ANGULAR_SPEED, REST_SPEED, UPRIGHT_ANGLE
from .prediction import Prediction
from .regions import BoxRegion, checked_regions

#: Whether a probability is available, itself, its lowest and highest value: where it cannot be told.
UNKNOWN = (False, None, None, None)
#: How far an available probability may be from the truth.
TOLERANCE = 0.1
#: Flights of a propagator without samples.
FLIGHTS = 1000


@dataclass(frozen=True)
class ContactProbability:
    """How probable it is that two things touch within the horizon, and when they first do.

    Attributes
    ----------
    object_a, object_b : str
        A moving body, and another body, an element of the environment, or ``environment`` for any of its
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
class _AtHorizon:
    """A probability about a body at the horizon.

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


class RestProbability(_AtHorizon):
    """How probable it is that a body is at rest at the horizon (`events.AtRest`)."""


class UprightProbability(_AtHorizon):
    """How probable it is that a body stands upright at the horizon (`events.Upright`)."""


class FallProbability(_AtHorizon):
    """How probable it is that a body fell off what carried it (`events.FellOff`)."""


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
        element of the environment, and the environment as a whole under the name ``environment``.
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


def upright_probabilities(
    prediction: Prediction, *, angle: float = UPRIGHT_ANGLE, flights: int = FLIGHTS
) -> tuple[UprightProbability, ...]:
    """How probable it is that a moving body stands upright at the horizon.

    That is: the axis of the body that points up in its given pose at time 0 leans from up by less than an
    angle. Up is against gravity, and along z where there is none.

    Parameters
    ----------
    prediction : Prediction
    angle : float
        [rad]
    flights : int, optional
        As for `contact_probabilities`.

    Returns
    -------
    tuple of UprightProbability
        One for each moving body, in the scene's order.
    """
    angle = positive(angle, "angle")
    flights = _checked(prediction, flights)
    return prediction.answers.upright(prediction, angle, flights)


def fall_probabilities(prediction: Prediction, *, flights: int = FLIGHTS) -> tuple[FallProbability, ...]:
    """How probable it is that a moving body fell off what carried it.

    That is: at the horizon its centre of mass is lower than in its given pose at time 0 by more than the
    radius about the centre of mass that encloses it, further than it comes down by toppling.

    Parameters
    ----------
    prediction : Prediction
    flights : int, optional
        As for `contact_probabilities`.

    Returns
    -------
    tuple of FallProbability
        One for each moving body, in the scene's order.
    """
    return prediction.answers.fallen(prediction, _checked(prediction, flights))


def _checked(prediction, flights):
    """The number of flights."""
    instance(prediction, Prediction, "prediction")
    return integer(flights, "flights", low=0)
