"""Parameters: described, checked, changed at run time."""

import pytest
import rclpy
import rclpy.parameter
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, ListParameters
from running import NodeProcess
from scenes import assert_answered, moving_object, position_of, request_of, with_physics

from unc_physics.checks.errors import InvalidOptionError
from unc_physics.ros import UncPhysicsNode
from unc_physics.ros.parameters import Settings


@pytest.fixture(scope="module")
def node():
    with NodeProcess(zero_covariance="exact", name="parameters") as process:
        yield process


@pytest.fixture
def change(node, client):
    return lambda name, value: client.set_parameter("parameters", name, value)


def test_every_parameter_is_described(node, client):
    names = client.call(ListParameters, "/parameters/list_parameters", ListParameters.Request()).result.names
    assert set(Settings.__dataclass_fields__) <= set(names)
    request = DescribeParameters.Request(names=list(Settings.__dataclass_fields__))
    for found in client.call(DescribeParameters, "/parameters/describe_parameters", request).descriptors:
        assert found.description.endswith("."), found.name
        numbers = ParameterType.PARAMETER_DOUBLE, ParameterType.PARAMETER_INTEGER
        if found.type in numbers and not found.dynamic_typing:
            assert found.floating_point_range or found.integer_range, found.name


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("dt", -1.0, "range"),
        ("friction", float("nan"), "range"),
        ("default_pose_std", [0.1], "2 numbers"),
        ("default_twist_std", [0.1, -0.1], "at least 0"),
        ("models_dir", "/tmp", "read-only"),
        ("zero_covariance", "push", "one of"),
        ("default_propagator", "crystal_ball", "one of"),
        ("gravity", [1.0], "3 numbers"),
        ("horizons", [0.0], "above 0"),
        ("gravity", [0.0, 0.0, float("inf")], "finite"),
        ("dt", "fast", "type"),
        ("max_objects", 0, "range"),
    ],
)
def test_a_rejected_change_says_why(change, name, value, reason):
    result = change(name, value)
    assert not result.successful
    assert reason in result.reason


def test_physics_change_between_predictions(change, client):
    def fall():
        falling = moving_object(position=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0))
        request = request_of(falling, horizon=1.0, propagator="sigma_points")
        with_physics(request, gravity=None)
        response = client.predict(request, node="parameters")
        assert_answered(response)
        return position_of(response.prediction.objects[0].states[-1].pose.pose)

    assert fall()[2] == pytest.approx(-9.81 / 2, rel=0.02)
    assert change("gravity", [1.0, 0.0, 0.0]).successful
    assert fall() == pytest.approx([0.5, 0.0, 0.0], rel=0.02, abs=1e-3)
    assert change("default_propagator", "monte_carlo").successful
    request = request_of(moving_object())
    assert client.predict(request, node="parameters").prediction.propagator == "monte_carlo"


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"stiffness": 1e4}, "stiffness was removed in version 0.3: set it in 'physics' of a request"),
        ({"max_samples": 10}, "max_samples was removed in version 0.3: the limits are max_horizon"),
        ({"tracked_topics": ["/can"]}, "tracked_topics was removed in version 0.3: write ID=MODEL"),
        ({"observed_objects": ["can=mug=cup"]}, "observed_objects must be ID or ID=CLASS"),
        ({"class_models": ["Bottle"]}, "class_models must be CLASS=MODEL"),
        ({"class_models": ["Bottle=can@top"]}, "class_models must be CLASS=MODEL"),
        ({"symmetric_models": ["can:w"]}, "symmetric_models must be MODEL, or MODEL:x"),
    ],
)
def test_parameters_of_earlier_versions_and_bad_lists_are_refused(given, words):
    context = rclpy.Context()
    rclpy.init(context=context)
    start = [rclpy.parameter.Parameter(name, value=value) for name, value in given.items()]
    try:
        with pytest.raises(InvalidOptionError) as error:
            UncPhysicsNode("old", context=context, parameter_overrides=start, use_global_arguments=False)
        assert str(error.value).startswith(words)
    finally:
        context.try_shutdown()


def test_lists_of_pairs_are_read():
    settings = Settings(
        class_models=("Bottle=bottle", "cup=mug@base"),
        observed_objects=("can", "mine=cup"),
        symmetric_models=("can", "bottle:y"),
    )
    assert settings.classes == {"Bottle": ("bottle", ""), "cup": ("mug", "base")}
    assert settings.observed == {"can": "can", "mine": "cup"}
    assert settings.symmetries == {"can": "z", "bottle": "y"}


def test_the_interface_is_small():
    assert len(Settings.__dataclass_fields__) <= 45
