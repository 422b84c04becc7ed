"""What is not served yet is refused, each field by its name, over real DDS."""

import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Twist, Vector3
from message_fields import element_type, message_type
from scenes import assert_answered, good_request, packed
from shape_msgs.msg import Plane

from unc_physics.checks.errors import ErrorCode
from unc_physics.ros.not_served import NOT_SERVED
from unc_physics_msgs.msg import EnvironmentElement

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
        "Material": (request.scene.objects[1].material, "scene.objects[1].material."),
        "EnvironmentElement": (request.scene.environment.elements[0], f"{ELEMENT}."),
    }


def asking(kind):
    """A value of a field's type that is not empty and not zero."""
    element, count = element_type(kind)
    if count is not None:
        value = 0.5 if element == "double" else message_type(element)()
        return packed([value] * count) if element == "double" else [value]
    special = {
        "double": 0.5,
        "string": "gripper",
        "builtin_interfaces/Duration": Duration(nanosec=1),
        "geometry_msgs/Twist": Twist(angular=Vector3(z=0.1)),
    }
    return special[element]


CASES = [(part, name) for part, fields in NOT_SERVED.items() for name in fields]


@pytest.mark.parametrize(("part", "name"), CASES)
def test_a_field_that_is_not_served_is_named(predict, part, name):
    request = request_with_element()
    message, place = parts(request)[part]
    setattr(message, name, asking(message.get_fields_and_field_types()[name]))
    response = predict(request)
    assert response.result.error_code == ErrorCode.NOT_SUPPORTED
    assert response.result.error_msg.startswith(f"{place}{name} is not supported; ")
    assert not response.prediction.objects


def test_a_kind_that_is_not_served_is_named(predict):
    request = good_request()
    request.scene.objects[0].kind = 2
    result = predict(request).result
    assert result.error_code == ErrorCode.NOT_SUPPORTED
    assert result.error_msg == "scene.objects[0].kind PRESCRIBED is not supported; take DYNAMIC or FIXED"


def test_zeros_ask_for_nothing(predict):
    request = request_with_element()
    request.scene.objects[0].inertia = packed([0.0] * 9)
    request.scene.objects[0].material.torsional_friction = [0.0]
    request.physics.impact_point_std = [0.0]
    assert_answered(predict(request))
