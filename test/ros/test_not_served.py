"""What is not served yet is refused, each field by its name, over real DDS."""

import pytest
from message_fields import element_type, message_type
from scenes import assert_answered, good_request, packed
from shape_msgs.msg import Plane, SolidPrimitive

from unc_physics.checks.errors import ErrorCode
from unc_physics.ros.not_served import NOT_SERVED, NOT_SERVED_VALUES
from unc_physics_msgs.msg import Candidate, EnvironmentElement, Score
from unc_physics_msgs.srv import PredictCandidates

ELEMENT = "scene.environment.elements[0]"


def request_with_element():
    """A good request with a floor far below."""
    request = good_request()
    floor = EnvironmentElement(plane=[Plane(coef=[0.0, 0.0, 1.0, 9.0])])
    request.scene.environment.elements = [floor]
    return request


def parts(request):
    """Where in a request each message is that has fields which are not served, and what errors call it."""
    return {
        "ObjectState": (request.scene.objects[1], "scene.objects[1]."),
        "EnvironmentElement": (request.scene.environment.elements[0], f"{ELEMENT}."),
    }


def asking(kind):
    """A value of a field's type that is not empty and not zero."""
    element, count = element_type(kind)
    if count is not None:
        value = 0.5 if element == "double" else message_type(element)()
        return packed([value] * count) if element == "double" else [value]
    raise AssertionError(f"no value of {kind} that asks for something")


CASES = [
    (part, name) for part, fields in NOT_SERVED.items() for name in fields if part != "PredictCandidates"
]


@pytest.mark.parametrize(("part", "name"), CASES)
def test_a_field_that_is_not_served_is_named(predict, part, name):
    request = request_with_element()
    message, place = parts(request)[part]
    setattr(message, name, asking(message.get_fields_and_field_types()[name]))
    response = predict(request)
    assert response.result.error_code == ErrorCode.NOT_SUPPORTED
    assert response.result.error_msg.startswith(f"{place}{name} is not supported; ")
    assert not response.prediction.objects


@pytest.mark.parametrize("kind", NOT_SERVED_VALUES["SolidPrimitive"]["type"])
def test_a_primitive_that_is_not_served_is_named(predict, kind):
    request = request_with_element()
    (element,) = request.scene.environment.elements
    element.plane, element.primitive = [], [SolidPrimitive(type=kind, dimensions=[1.0, 1.0])]
    result = predict(request).result
    assert result.error_code == ErrorCode.NOT_SUPPORTED
    assert result.error_msg.startswith(f"{ELEMENT}.primitive[0].type {('CONE', 'PRISM')[kind - 4]} is not")


def test_a_score_is_not_served(node, client):
    base = good_request()
    request = PredictCandidates.Request(request=base, candidates=[Candidate(id="a")], score=[Score()])
    response = client.call(PredictCandidates, "/unc_physics/predict_candidates", request)
    assert response.result.error_code == ErrorCode.NOT_SUPPORTED
    assert response.result.error_msg.startswith("score is not supported; ")


def test_zeros_ask_for_nothing(predict):
    request = request_with_element()
    request.scene.objects[0].inertia = packed([0.0] * 9)
    request.scene.objects[0].material.torsional_friction = [0.0]
    request.physics.impact_point_std = [0.0]
    assert_answered(predict(request))
