"""Answers of a prediction as messages: probabilities of contact, of being in a region, and of being at rest."""

from __future__ import annotations

from unc_physics_msgs.msg import ContactProbability, RegionProbability

from ..propagation.answers import contact_probabilities, region_probabilities, rest_probabilities
from .conversions import duration


def write_probabilities(message, scene, prediction, initial, regions) -> None:
    """Write all probabilities into a response, a result or a `Prediction` message.

    Parameters
    ----------
    message : message
        Its objects are there already.
    scene : Scene
    prediction : Prediction
    initial : Belief
        What the prediction began with.
    regions : tuple of BoxRegion
    """
    time = duration(prediction.time)
    message.contact_probabilities = [
        ContactProbability(
            object_a=answer.object_a, object_b=answer.object_b, time_from_start=time, available=answer.available,
            probability=answer.probability, first_contact_time_available=answer.first_contact_time_available,
            first_contact_time_mean=answer.first_contact_time_mean, first_contact_time_std=answer.first_contact_time_std)
        for answer in contact_probabilities(scene, prediction, initial)
    ]
    message.region_probabilities = [
        RegionProbability(
            region=answer.region, object=answer.object, time_from_start=time, available=answer.available,
            probability=answer.probability)
        for answer in region_probabilities(scene, prediction, regions, initial)
    ]
    at_rest = {answer.object: answer for answer in rest_probabilities(scene, prediction, initial)}
    for predicted in message.objects:
        if (answer := at_rest.get(predicted.id)) is not None:
            predicted.rest_probability_available, predicted.rest_probability = answer.available, answer.probability
