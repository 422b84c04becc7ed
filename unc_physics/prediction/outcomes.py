"""What may happen in a prediction, as equally probable outcomes; shares of them answer questions.

A propagator with samples of its own has them; for the others, samples fly up to their first contacts. So
they do where samples rest on too few rollouts to tell: an interval counts rollouts, not what is made of them.
"""

from __future__ import annotations

import functools
import math
import weakref
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..scene.environment import element_names
from .events import ENVIRONMENT, AtRest, FellOff, InRegion, Seen, Upright
from .first_contacts import first_contacts
from .prediction import Prediction
from .probabilities import (
    TOLERANCE,
    UNKNOWN,
    ContactProbability,
    FallProbability,
    RegionProbability,
    RestProbability,
    UprightProbability,
)
from .regions import BoxRegion

#: Half width of the interval of a share, in standard deviations: one share in a thousand lies outside.
CONFIDENCE = 3.29
#: Contacts below which too little is known of when they begin.
FEWEST_CONTACTS = 10

#: Outcomes of predictions whose answers were asked for, by the number of flights.
_known: weakref.WeakKeyDictionary = weakref.WeakKeyDictionary()


def share_of_contacts(prediction: Prediction, flights: int) -> tuple[ContactProbability, ...]:
    """As `probabilities.contact_probabilities`."""
    outcomes = _outcomes(prediction, flights)
    return tuple(
        _contact((one, other, prediction.time), outcomes, *place)
        for one, other, place in _encounters(prediction.scene)
    )


def share_inside(
    prediction: Prediction, regions: Sequence[BoxRegion], flights: int
) -> tuple[RegionProbability, ...]:
    """As `probabilities.region_probabilities`."""
    return tuple(
        RegionProbability(region.name, name, prediction.time, *share)
        for region in regions
        for name, share in _shares(prediction, functools.partial(InRegion, region=region), flights)
    )


def share_at_rest(
    prediction: Prediction, speed: float, angular_speed: float, flights: int
) -> tuple[RestProbability, ...]:
    """As `probabilities.rest_probabilities`."""
    slow = functools.partial(AtRest, speed=speed, angular_speed=angular_speed)
    return tuple(
        RestProbability(name, prediction.time, *share) for name, share in _shares(prediction, slow, flights)
    )


def share_upright(prediction: Prediction, angle: float, flights: int) -> tuple[UprightProbability, ...]:
    """As `probabilities.upright_probabilities`."""
    upright = functools.partial(Upright, angle=angle)
    return tuple(
        UprightProbability(name, prediction.time, *share)
        for name, share in _shares(prediction, upright, flights)
    )


def share_fallen(prediction: Prediction, flights: int) -> tuple[FallProbability, ...]:
    """As `probabilities.fall_probabilities`."""
    return tuple(
        FallProbability(name, prediction.time, *share)
        for name, share in _shares(prediction, FellOff, flights)
    )


def _shares(prediction, event, flights):
    """Each moving body's name, and the share of an event that is made of it."""
    outcomes = _outcomes(prediction, flights)
    for body in prediction.scene.moving:
        name = prediction.scene.bodies[body].name
        happens = event(name)
        yield (
            name,
            _first_available(
                _of_body(happens.happened(seen(prediction, own.states, own.first)), own, body)
                for own in outcomes
            ),
        )


def seen(prediction: Prediction, states: np.ndarray, first: np.ndarray) -> Seen:
    """What rollouts showed: their last states (N, B, 13), and first contacts (N, B, B + E)."""
    return Seen(prediction.scene, prediction.initial.mean, states, first)


@dataclass(frozen=True, eq=False)
class _Outcomes:
    """Equally probable outcomes.

    Attributes
    ----------
    states : (N, B, 13) array
        At the horizon, or when the body stopped.
    stopped : (R, B) array
        Time from which on nothing is known of a body [s]; infinite for one that is known to the end.
    first : (R, B, B + E) array
        Time of the first contact of bodies i < j, or of body i and element j - B [s]; infinite without one.
        Of the R rollouts that the outcomes rest on, mostly their own.
    certain : bool
        Whether nothing else may happen, instead of these being draws.
    """

    states: np.ndarray
    stopped: np.ndarray
    first: np.ndarray
    certain: bool = False


def _outcomes(prediction, flights):
    """What may happen, each of which may answer where those before it do not: a prediction's samples, and
    flights.
    """
    known = _known.setdefault(prediction, {})
    if flights not in known:
        sampled = _sampled(prediction)
        few = sampled is None or len(sampled.first) < len(sampled.states)
        found = (sampled, _flown(prediction, flights) if few and not (sampled and sampled.certain) else None)
        known[flights] = tuple(outcomes for outcomes in found if outcomes is not None)
    return known[flights]


def _first_available(shares):
    """The first of some shares, each computed only if needed, that is available."""
    return next((share for share in shares if share[0]), UNKNOWN)


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
    return _Outcomes(states, np.full(first.shape[:2], np.inf), first, certain)


def _flown(prediction, flights):
    """Outcomes as far as first contacts decide them."""
    scene = prediction.scene
    if flights == 0 or scene.uncertain:
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
            if scene.bodies[i].free or scene.bodies[j].free:
                yield names[i], names[j], (i, j, slice(j, j + 1))
    for i in scene.moving:
        for e in range(E):
            yield names[i], elements[e], (i, None, slice(B + e, B + e + 1))
        if E:
            yield names[i], ENVIRONMENT, (i, None, slice(B, B + E))


def _contact(names: tuple[str, str, float], outcomes, body, other, columns):
    """The answer about one encounter."""
    answers = (_contact_of(names, own, body, other, columns) for own in outcomes)
    return next((answer for answer in answers if answer.available), ContactProbability(*names))


def _contact_of(names: tuple[str, str, float], outcomes, body, other, columns):
    """The answer from some outcomes."""
    first = outcomes.first[:, body, columns].min(axis=1)
    known = outcomes.stopped[:, body]
    if other is not None:
        known = np.minimum(known, outcomes.stopped[:, other])
    yes = np.isfinite(first) & (
        first <= known
    )  # later than that, it is contact with a body that is not there any more
    share = _share(yes, np.isfinite(known) & ~yes, outcomes.certain, len(yes))
    if not share[0] or yes.sum() < min(FEWEST_CONTACTS, len(yes)):  # one outcome is enough if it is certain
        return ContactProbability(*names, *share)
    times = first[yes].astype(float)
    return ContactProbability(*names, *share, True, float(times.mean()), float(times.std()))


def _of_body(yes, outcomes, body):
    """Whether a question about a body at the horizon, with these answers (N,) if it was known to the end, can
    be answered.
    """
    rollouts = len(outcomes.first)
    unknown = np.isfinite(outcomes.stopped[:, body]) if rollouts == len(yes) else np.zeros(len(yes), bool)
    return _share(yes, unknown, outcomes.certain, min(rollouts, len(yes)))


def _share(yes, unknown, certain, rollouts):
    """Availability, probability, and its lowest and highest value, from outcomes (N,) that say yes, and those
    that leave it open, which count half; they rest on so many ``rollouts``.
    """
    count = len(yes)
    low, high = np.count_nonzero(yes & ~unknown) / count, np.count_nonzero(yes | unknown) / count
    probability = 0.5 * (low + high)
    if not certain:
        low, high = interval(low, rollouts)[0], interval(high, rollouts)[1]
    if max(probability - low, high - probability) > TOLERANCE:
        return UNKNOWN
    # round-off must not leave the probability outside
    low, high = min(max(low, 0.0), probability), max(min(high, 1.0), probability)
    return True, float(probability), float(low), float(high)


def interval(share: float, count: int) -> tuple[float, float]:
    """Lowest and highest probability that may have given a share of ``count`` draws (Wilson 1927)."""
    square = CONFIDENCE**2 / count
    middle = (share + 0.5 * square) / (1.0 + square)
    half = CONFIDENCE * math.sqrt(share * (1.0 - share) / count + 0.25 * square / count) / (1.0 + square)
    return middle - half, middle + half
