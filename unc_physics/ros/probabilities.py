"""Answers of a prediction as messages: probabilities of contact, of being in a region, at rest, upright, and
of having fallen off.
"""

from __future__ import annotations

from unc_physics_msgs.msg import ContactProbability, Probability, RegionProbability

from ..prediction.probabilities import (
    FLIGHTS,
    contact_probabilities,
    fall_probabilities,
    region_probabilities,
    rest_probabilities,
    upright_probabilities,
)
from .durations import duration

#: Fields of a `PredictedObject`, and what fills them.
_OF_OBJECTS = {
    "at_rest": rest_probabilities,
    "upright": upright_probabilities,
    "fell_off": fall_probabilities,
}


def write_probabilities(message, prediction, regions, wanted, flies) -> None:
    """Write probabilities into a `Prediction` message.

    Parameters
    ----------
    message : unc_physics_msgs/Prediction
        Its objects are there already.
    prediction : Prediction
    regions : tuple of BoxRegion
        Answered in any case.
    wanted : bool
        Whether contacts and rest are, too.
    flies : bool
        Whether propagators that have no samples may take flights for their answers.
    """
    flights = FLIGHTS if flies else 0
    time = duration(prediction.time)
    if regions:
        message.region_probabilities = [
            RegionProbability(
                region=answer.region,
                object=answer.object,
                time_from_start=time,
                probability=write_probability(answer),
            )
            for answer in region_probabilities(prediction, regions, flights=flights)
        ]
    if not wanted:
        return
    message.contact_probabilities = [
        ContactProbability(
            object_a=answer.object_a,
            object_b=answer.object_b,
            time_from_start=time,
            probability=write_probability(answer),
            first_contact_time_available=bool(answer.first_contact_time_available),
            first_contact_time_mean=duration(answer.first_contact_time_mean or 0.0),
            first_contact_time_std=duration(answer.first_contact_time_std or 0.0),
        )
        for answer in contact_probabilities(prediction, flights=flights)
    ]
    by_id = {predicted.id: predicted for predicted in message.objects}
    for field, answers in _OF_OBJECTS.items():
        for answer in answers(prediction, flights=flights):
            setattr(by_id[answer.object], field, write_probability(answer))


def write_probability(answer) -> Probability:
    """The message of a probability and its interval."""
    return Probability(
        available=bool(answer.available),
        probability=float(answer.probability or 0.0),
        low=float(answer.low or 0.0),
        high=float(answer.high or 0.0),
    )
