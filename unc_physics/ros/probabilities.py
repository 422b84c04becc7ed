"""Answers of a prediction as messages: probabilities of contact, of being in a region, and of
being at rest.
"""

from __future__ import annotations

from unc_physics_msgs.msg import ContactProbability, RegionProbability

from ..prediction.probabilities import contact_probabilities, region_probabilities, rest_probabilities
from .conversions import duration


def write_probabilities(message, scene, prediction, initial, regions, wanted) -> None:
    """Write probabilities into a response, a result or a `Prediction` message.

    Parameters
    ----------
    message : message
        Its objects are there already.
    scene : Scene
    prediction : Prediction
    initial : Belief or None
        What the prediction began with; None spares the flights of propagators that have no samples.
    regions : tuple of BoxRegion
        Answered in any case.
    wanted : bool
        Whether contacts and rest are, too.
    """
    time = duration(prediction.time)
    if regions:
        message.region_probabilities = [
            RegionProbability(
                region=answer.region,
                object=answer.object,
                time_from_start=time,
                available=bool(answer.available),
                probability=float(answer.probability),
            )
            for answer in region_probabilities(scene, prediction, regions, initial)
        ]
    if not wanted:
        return
    message.contact_probabilities = [
        ContactProbability(
            object_a=answer.object_a,
            object_b=answer.object_b,
            time_from_start=time,
            available=bool(answer.available),
            probability=float(answer.probability),
            first_contact_time_available=bool(answer.first_contact_time_available),
            first_contact_time_mean=float(answer.first_contact_time_mean),
            first_contact_time_std=float(answer.first_contact_time_std),
        )
        for answer in contact_probabilities(scene, prediction, initial)
    ]
    at_rest = {answer.object: answer for answer in rest_probabilities(scene, prediction, initial)}
    for predicted in message.objects:
        if (answer := at_rest.get(predicted.id)) is not None:
            predicted.rest_probability_available = bool(answer.available)
            predicted.rest_probability = float(answer.probability)
