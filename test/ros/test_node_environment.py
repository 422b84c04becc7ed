"""The environment of the node, which scenes without elements have, and what detections stand on."""

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from running import Client, Inbox, NodeProcess
from scenes import assert_answered, floor, measured, moving_object, position_of, request_of, with_physics
from shape_msgs.msg import Mesh, Plane, SolidPrimitive
from std_msgs.msg import Header

from unc_physics.checks.errors import ErrorCode, InvalidEnvironmentError
from unc_physics.ros.detected import settle_detected
from unc_physics.ros.models import ModelLibrary
from unc_physics.ros.node_environment import NodeEnvironment
from unc_physics.ros.parameters import Settings
from unc_physics_msgs.msg import Environment, EnvironmentElement, ObjectState, Prediction, Scene
from unc_physics_msgs.srv import SetEnvironment

NODE = "placed"
OBJECTS = ["first", "second"]
TOPICS = [f"/{NODE}/observed/{name}" for name in OBJECTS]
GRAVITY = 9.81  # m/s^2
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
AHEAD = Duration(seconds=1000)  # of stamps: no prediction is late, however slow the machine
STD = 0.003  # m, of detected positions
ON_TABLE = 0.002  # m, height of a detected can that stands on the table


@pytest.fixture(scope="module")
def placed():
    parameters = {
        "observed_objects": [f"{name}=can" for name in OBJECTS],
        "max_input_age": 0.0,
        "max_input_lead": 0.0,
        "stream_time_budget": 30.0,
        "horizons": [0.5, 20.0],
    }
    with NodeProcess(name=NODE, **parameters) as process:
        yield process


@pytest.fixture(scope="module")
def user(placed):
    with Client() as made:
        yield made


def table(height=0.0, name="table"):
    return floor(height, name)


def set_environment(user, *elements, frame=""):
    request = SetEnvironment.Request(
        header=Header(frame_id=frame), environment=Environment(elements=elements)
    )
    return user.call(SetEnvironment, f"/{NODE}/set_environment", request).result


@pytest.fixture(scope="module")
def publishers(user):
    return [
        user.node.create_publisher(PoseWithCovarianceStamped, topic, qos_profile_sensor_data)
        for topic in TOPICS
    ]


@pytest.fixture(scope="module")
def predictions(user):
    with Inbox(user, Prediction, f"/{NODE}/predictions", 100) as inbox:
        yield inbox


def seen(user, x=0.0, z=ON_TABLE):
    """A detected pose, with a stamp of its own."""
    message = PoseWithCovarianceStamped(pose=measured((x, 0.0, z), STD, 0.01))
    message.header.stamp = (user.node.get_clock().now() + AHEAD).to_msg()
    return message


@pytest.fixture(scope="module")
def see(user, publishers, predictions):
    """Function that publishes a detected pose, and returns the prediction of it."""

    def predicted(topic=0, **place):
        sent = seen(user, **place)
        return predictions.answer(
            lambda: publishers[topic].publish(sent), lambda found: found.header.stamp == sent.header.stamp
        )

    return predicted


@pytest.fixture(scope="module")
def before(placed, user, publishers, predictions):
    """The node's status after something was detected before it has an environment, and what it predicted."""
    with Inbox(user, DiagnosticArray, "/diagnostics") as diagnostics:
        status, _ = diagnostics.status(
            f"{NODE}: predictions",
            lambda values: int(values["errors"]) > 0,
            lambda: publishers[0].publish(seen(user)),
        )
    return status, predictions.all()


@pytest.fixture(scope="module")
def on_table(before, user):
    """The node has a table as its environment."""
    with Inbox(user, Environment, f"/{NODE}/current_environment", LATCHED) as latched:
        assert set_environment(user, table()).error_code == ErrorCode.NONE
        while [element.id for element in latched.next().elements] != ["table"]:
            pass


def test_without_an_environment_nothing_detected_is_predicted(placed, before):
    status, predicted = before
    assert status.level == DiagnosticStatus.WARN and not predicted
    assert "set_environment" in status.message and "planning_scene_topic" in status.message
    assert "a scene was not predicted" in placed.output


def test_a_detected_can_stands_on_the_table(on_table, see):
    predicted, *_ = see().objects
    for state in predicted.states:
        assert position_of(state.pose.pose) == pytest.approx([0.0, 0.0, 0.0], abs=2e-3)
        spread = np.sqrt(np.reshape(state.pose.covariance, (6, 6)).diagonal())
        assert spread[:2] == pytest.approx(STD, rel=0.3)
        assert spread[2] < 1e-3  # the table tells its height


def falling(**others):
    message = moving_object("box", "salt_box", (0.0, 0.0, 0.4), (0.0, 0.0, 0.0))
    return with_physics(request_of(message, **others), gravity=(0.0, 0.0, -GRAVITY))


def test_a_request_without_elements_has_the_environment_of_the_node(on_table, user):
    """A request may also have other elements, or none: it falls for half a second."""

    def height(request):
        response = user.predict(request, node=NODE)
        assert_answered(response)
        return position_of(response.prediction.objects[0].states[-1].pose.pose)[2]

    lower, nothing = falling(horizon=2.0), falling(horizon=0.5)
    lower.scene.environment.elements, nothing.scene.environment.complete = [table(-1.0)], True
    assert height(falling(horizon=2.0)) > -0.05 and -1.05 < height(lower) < -0.8
    assert height(nothing) == pytest.approx(0.4 - 0.5 * GRAVITY * 0.5**2, abs=0.02)


def test_a_bad_environment_is_refused_and_changes_nothing(on_table, user):
    flat = EnvironmentElement(
        id="flat", primitive=SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[1.0, 1.0, -0.1])
    )
    result = set_environment(user, flat)
    assert result.error_code == ErrorCode.INVALID_ENVIRONMENT
    assert "elements[0].primitive.dimensions[2]" in result.error_msg
    assert set_environment(user, table(), frame="camera").error_code == ErrorCode.UNKNOWN_FRAME
    with Inbox(user, Environment, f"/{NODE}/current_environment", LATCHED) as latched:
        assert [element.id for element in latched.next().elements] == ["table"]


def test_the_latched_topic_sets_the_environment(on_table, user):
    publisher = user.node.create_publisher(Environment, f"/{NODE}/environment", LATCHED)
    with Inbox(user, Environment, f"/{NODE}/current_environment", LATCHED) as latched:
        publisher.publish(Environment(elements=[table(0.1, name="")]))
        while [element.id for element in latched.next().elements] != ["element_0"]:
            pass
    set_environment(user, table())
    user.node.destroy_publisher(publisher)


def test_a_file_of_an_environment(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text("environment:\n  - plane: {normal: [0, 0, 1], offset: 0.5}\n    name: shelf\n")
    environment = NodeEnvironment()
    assert not environment.is_set
    environment.load(str(path))
    (element,) = environment.message.elements
    assert element.id == "shelf" and list(element.plane.coef) == [0.0, 0.0, 1.0, -0.5]
    path.write_text("bodies: []\n")
    with pytest.raises(InvalidEnvironmentError, match="key 'environment'"):
        environment.load(str(path))


def test_elements_of_the_planning_scene_join_those_of_users():
    environment = NodeEnvironment()
    environment.set([table(), table(name="shelf")])
    environment.set_planned([table(0.7, name="shelf"), EnvironmentElement(id="can", mesh=Mesh())])
    assert [element.id for element in environment.message.elements] == ["table", "shelf", "can"]
    assert environment.message.elements[1].plane.coef[3] == -0.7
    around = environment.around(Scene(objects=[ObjectState(id="can")]))
    assert [element.id for element in around.elements] == ["table", "shelf"]
    own = Scene(environment=Environment(elements=[table(name="own")]))
    assert environment.around(own) == own.environment


def detected(name, x=0.0, z=0.0, std=STD, model="can"):
    state = ObjectState(id=name, model=model, pose=measured((x, 0.0, z), std, 0.01))
    return state


@pytest.fixture(scope="module")
def settle():
    library = ModelLibrary()

    def settled(*objects, elements=(), **parameters):
        environment = Environment(elements=list(elements) or [table()])
        scene, skipped = settle_detected(
            Scene(objects=list(objects)), environment, library, Settings(**parameters)
        )
        return {own.id: own.at_rest for own in scene.objects}, skipped

    return settled


def test_what_is_within_three_standard_deviations_stands(settle):
    gap = 2e-3  # m, that a packing leaves
    for z, stands in ((2.9 * STD, True), (-5.0 * STD, True), (3.5 * STD + gap, False)):
        at_rest, skipped = settle(detected("can", z=z))
        assert bool(at_rest) is stands and bool(skipped) is not stands
    assert settle(detected("can", z=0.05, std=0.02))[0] == {"can": True}


def test_a_stack_stands_from_below(settle):
    height = 0.11  # m, of a can
    at_rest, skipped = settle(detected("top", z=2 * height), detected("bottom"), detected("middle", z=height))
    assert at_rest == {"top": True, "bottom": True, "middle": True} and not skipped
    at_rest, skipped = settle(detected("top", z=2 * height), detected("bottom"))
    assert at_rest == {"bottom": True}
    assert "mid-air" in skipped["top"] and "0.11 m above 'bottom'" in skipped["top"]


def test_a_wall_supports_nothing_and_without_gravity_nothing_falls(settle):
    wall = EnvironmentElement(id="wall", plane=Plane(coef=[1.0, 0.0, 0.0, 0.04]))
    at_rest, skipped = settle(detected("can"), elements=[wall])
    assert not at_rest and "nothing below it" in skipped["can"]
    assert settle(detected("can", z=1.0), gravity=(0.0, 0.0, 0.0)) == ({"can": False}, {})


def test_neighbours_are_no_duplicates(settle):
    at_rest, skipped = settle(
        detected("left"), detected("right", x=0.078), detected("other", model="salt_box")
    )
    assert set(at_rest) == {"left", "right", "other"} and not skipped
    at_rest, skipped = settle(detected("unsure", std=0.01), detected("sure", x=0.01))
    assert set(at_rest) == {"sure"} and "'sure'" in skipped["unsure"]
