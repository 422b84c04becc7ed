"""Actions of a robot in messages: read, written, in other frames, and bad input."""

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Transform as Place
from geometry_msgs.msg import Vector3
from geometry_msgs.msg import Wrench as WrenchMessage
from scenes import moving_object
from scipy.spatial.transform import Rotation
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from unc_physics import UncPhysicsError
from unc_physics.ros import environment, make_message
from unc_physics.ros.messages.actions import ObjectActions, read_path, write_path
from unc_physics.ros.messages.fields import duration, quaternion_message, twist_message, vector_message
from unc_physics.ros.messages.frames import Transform
from unc_physics.ros.messages.scene import read_scene
from unc_physics.ros.models import ModelLibrary
from unc_physics.scene.kinematic_states import path_states
from unc_physics.scene.presets import EXACT_PRESETS
from unc_physics_msgs.msg import Action, Material, ObjectState
from unc_physics_msgs.msg import Scene as SceneMessage

LIBRARY = ModelLibrary()
MUG = LIBRARY.shape("mug", 30)
TIMES = np.array([0.125, 0.5, 1.25])  # s
PLACES = np.array([[0, 0, 1], [0.1, 0.2, 1.2], [0.3, 0.2, 1.1]])  # of the hand's model [m]
TURNS = Rotation.from_rotvec([[0.1, 0, 0], [0.1, 0.5, 1.0], [0.3, 0.5, 1.2]])
SPEEDS = np.array([[0, 0, 0], [0.2, 0.1, 0.1], [0, 0, 0]])  # of the hand's model [m/s]
SPINS = np.array([[0, 0, 0.2], [0, 0.1, 1], [0, 0, 0]])  # rad/s


def robot_scene(frame=None):
    """A mug in a moving hand over a belt and a turntable, as the node reads them of messages in a frame."""
    mug = make_message(
        ObjectState,
        id="mug",
        model="mug",
        spheres=30,
        mass=0.3,
        pose=(0, 0, 0.3),
        drag=0.01,
        material=make_message(Material, name="wood", friction=0.4, torsional_friction=0.004),
    )
    hand = make_message(ObjectState, id="hand", model="mug", spheres=30, mass=0.3, pose=PLACES[0])
    along = MultiDOFJointTrajectory()
    for time, place, q, speed, spin in zip(TIMES, PLACES, TURNS.as_quat(), SPEEDS, SPINS, strict=True):
        along.points.append(
            MultiDOFJointTrajectoryPoint(
                transforms=[Place(translation=vector_message(place), rotation=quaternion_message(q))],
                velocities=[twist_message(speed, spin)],
                time_from_start=duration(time),
            )
        )
    push = WrenchMessage(force=Vector3(x=1.0, y=2.0, z=3.0), torque=Vector3(z=0.1))
    lift = WrenchMessage(force=Vector3(z=1.0))
    actions = [
        make_message(
            Action,
            type=Action.ATTACHMENT,
            object="mug",
            attached_to="hand",
            start=0.25,
            duration=0.75,
            release_std=0.125,
        ),
        make_message(Action, type=Action.WRENCH, object="mug", wrench=push, start=0.25, duration=0.5),
        Action(type=Action.WRENCH, object="mug", wrench=lift, body_axes=True),
        Action(
            type=Action.TRAJECTORY,
            object="hand",
            trajectory=along,
            trajectory_std=np.array([0.01, 0, 0, 0, 0.02, 0]),
        ),
    ]
    surroundings = environment({"belt": (0, 0, 2, 0.2)}, {"table": ((1, 1, 1), (3, 0, 0, 0, 0, 0.6, 0.8))})
    belt, table = surroundings.elements
    belt.pose.position.x, belt.surface_velocity = 1.0, twist_message((0.3, 0, 0), (0, 0, 1))
    belt.material = make_message(Material, name="rubber", restitution=0.2)
    table.surface_velocity = twist_message((0, 0, 0), (0, 0, 0.5))
    table.material = make_message(Material, torsional_friction=0.01)
    message = SceneMessage(objects=[mug, hand], environment=surroundings)
    if frame is not None:
        message, actions = frame.moved(message), frame.moved(actions)
    return read_scene(message, LIBRARY, EXACT_PRESETS["everyday"], actions=actions).scene


def speed_at(element, point):
    """(3,): velocity of an element's surface there [m/s]."""
    v = element.moving_surface
    return v[:3] + np.cross(v[3:], point)


def test_actions_and_materials_are_read():
    scene = robot_scene()
    mug, hand = scene.bodies
    held = (mug.attached_to, mug.attached_at, mug.released_at, mug.released_at_std)
    assert held == ("hand", 0.25, 1.0, 0.125)
    push, lift = mug.wrenches
    np.testing.assert_array_equal([*push.force, *push.torque], [1, 2, 3, 0, 0, 0.1])
    assert (push.body_axes, push.start, push.end) == (False, 0.25, 0.75)
    np.testing.assert_array_equal([*lift.force, *lift.torque], [0, 0, 1, 0, 0, 0])
    assert (lift.body_axes, lift.start, lift.end) == (True, 0.0, np.inf)
    np.testing.assert_array_equal(hand.trajectory_std, [0.01, 0, 0, 0, 0.02, 0])
    states = path_states(scene, 1, TIMES)  # of the centre of mass
    arms = -TURNS.apply(np.array(MUG.origin))
    np.testing.assert_allclose(states[:, :3], PLACES + arms, atol=1e-12)
    np.testing.assert_allclose(states[:, 3:6], SPEEDS + np.cross(SPINS, arms), atol=1e-12)
    np.testing.assert_allclose(states[:, 10:], SPINS, atol=1e-12)
    assert (Rotation.from_quat(states[:, 6:10]).inv() * TURNS).magnitude() == pytest.approx(0.0, abs=1e-7)
    belt, table = scene.environment
    assert belt.offset == pytest.approx(-0.1)
    np.testing.assert_allclose(speed_at(belt, [1, 0, -0.1]), [0.3, 0, 0], atol=1e-12)
    np.testing.assert_allclose(speed_at(belt, [2, 1, -0.1]), [-0.7, 1, 0], atol=1e-12)
    np.testing.assert_allclose(speed_at(table, [3, 2, 0.5]), [-1, 0, 0], atol=1e-12)
    assert (mug.material, mug.friction, mug.drag) == ("wood", 0.4, 0.01)
    assert (belt.material, belt.restitution) == ("rubber", 0.2)
    assert (mug.torsional_friction, table.torsional_friction) == (0.004, 0.01)
    again = robot_scene()
    assert again.bodies[0] is mug and again.bodies[1] is hand, "known by the same numbers"


def test_another_frame_sees_the_same_motion():
    turn, shift = Rotation.from_rotvec([0.3, -0.2, 0.9]), np.array([1.0, -2.0, 0.5])
    scene, found = robot_scene(), robot_scene(Transform(turn.as_matrix(), shift, tuple(turn.as_quat())))
    times = np.linspace(0, 1.5, 7)
    here, there = path_states(scene, 1, times), path_states(found, 1, times)
    np.testing.assert_allclose(there[:, :3], turn.apply(here[:, :3]) + shift, atol=1e-12)
    np.testing.assert_allclose(there[:, 10:], turn.apply(here[:, 10:]), atol=1e-12)
    np.testing.assert_allclose(found.bodies[0].wrenches[0].force, turn.apply([1, 2, 3]), atol=1e-12)
    np.testing.assert_array_equal(found.bodies[0].wrenches[1].force, [0, 0, 1])
    point = np.array([0.3, 0.4, -0.1])  # of the belt
    expected = turn.apply(speed_at(scene.environment[0], point))
    np.testing.assert_allclose(
        speed_at(found.environment[0], turn.apply(point) + shift), expected, atol=1e-12
    )


def test_a_path_goes_there_and_back():
    path = robot_scene().bodies[1].trajectory
    action = write_path("hand", path, np.array(MUG.origin))
    assert (action.type, action.object) == (Action.TRAJECTORY, "hand")
    found = read_path(ObjectActions("hand", trajectory=("actions[0]", action)), np.array(MUG.origin))
    assert found.times.tolist() == TIMES.tolist()
    np.testing.assert_allclose(found.states, path.states, atol=1e-12)


def points(*times):
    return [
        MultiDOFJointTrajectoryPoint(transforms=[Place()], time_from_start=Duration(sec=time))
        for time in times
    ]


def along(*times, **others):
    path = MultiDOFJointTrajectory(points=points(*times))
    return Action(type=Action.TRAJECTORY, object="a", trajectory=path, **others)


def held(**fields):
    return Action(type=Action.ATTACHMENT, object="a", **fields)


TWO_PER_POINT = MultiDOFJointTrajectory(points=[MultiDOFJointTrajectoryPoint()] * 2)
PUSH = WrenchMessage(force=Vector3(x=1.0))


@pytest.mark.parametrize(
    ("kind", "actions", "sentence"),
    [
        (
            ObjectState.PRESCRIBED,
            [],
            "scene.objects[0].kind needs a TRAJECTORY of the object among the actions",
        ),
        (ObjectState.FIXED, [along(0, 1)], "actions[0].trajectory must be absent: the body is fixed"),
        (7, [], "scene.objects[0].kind must be DYNAMIC, FIXED or PRESCRIBED"),
        (0, [along(1)], "actions[0].trajectory.times must be at least two"),
        (0, [along(2, 1)], "actions[0].trajectory.times[1] must be later than the time before it"),
        (
            0,
            [Action(type=Action.TRAJECTORY, object="a", trajectory=TWO_PER_POINT)],
            "actions[0].trajectory.points[0] must have one transform",
        ),
        (0, [along(0, 1), along(0, 1)], "actions[1] is the second trajectory of 'a', beside actions[0]"),
        (0, [along(0, 1, wrench=PUSH)], "actions[0].wrench must not be set in an action of type TRAJECTORY"),
        (0, [Action(object="a")], "actions[0].type must be TRAJECTORY, ATTACHMENT or WRENCH"),
        (0, [Action(type=Action.WRENCH, object="b")], "actions[0].object is no object of the scene"),
        (0, [held(attached_to="a")], "actions[0].attached_to must be another body than itself"),
        (0, [held(attached_to="b")], "actions[0].attached_to is no body of the scene"),
        (0, [held()], "actions[0].attached_to must be the id of an object"),
        (0, [held(body_axes=True)], "actions[0].body_axes must not be set in an action of type ATTACHMENT"),
        (
            0,
            [held(attached_to="b", release_std=Duration(sec=-1))],
            "actions[0].release_std must not be negative",
        ),
        (
            0,
            [held(attached_to="b", release_std=Duration(sec=1))],
            "actions[0].release_std needs a duration beside it",
        ),
        (
            0,
            [Action(type=Action.WRENCH, object="a", wrench=PUSH), along(0, 1)],
            "actions[0].wrench must be absent: no force moves this body",
        ),
    ],
)
def test_bad_input_is_named(kind, actions, sentence):
    message = moving_object("a", "can", spheres=20)
    message.kind = kind
    with pytest.raises(UncPhysicsError) as error:
        read_scene(SceneMessage(objects=[message]), LIBRARY, EXACT_PRESETS["everyday"], actions=actions)
    assert str(error.value).startswith(sentence)
