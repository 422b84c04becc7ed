"""What a robot does in messages: there and back, in other frames, and bad input."""

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Transform as Place
from geometry_msgs.msg import Vector3
from geometry_msgs.msg import Wrench as WrenchMessage
from scenes import moving_object
from scipy.spatial.transform import Rotation
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from unc_physics import Belief, BodyBelief, Box, Plane, PosePath, RigidBody, Scene, UncPhysicsError, Wrench
from unc_physics.ros.messages.actions import write_actions
from unc_physics.ros.messages.frames import Transform
from unc_physics.ros.messages.scene import read_scene, write_scene
from unc_physics.ros.models import ModelLibrary, _info
from unc_physics.scene.kinematic_states import path_states
from unc_physics.scene.presets import EXACT_PRESETS
from unc_physics_msgs.msg import Action, AppliedWrench, Attachment, ObjectState
from unc_physics_msgs.msg import Scene as SceneMessage

LIBRARY = ModelLibrary()
MUG = LIBRARY.shape("mug", 30)


def told(name):
    return _info(LIBRARY, name, LIBRARY.paths[name])


def robot_scene():
    """A mug in a moving hand over a belt and a turntable."""
    q = Rotation.from_rotvec([[0.1, 0, 0], [0.1, 0.5, 1.0], [0.3, 0.5, 1.2]]).as_quat()
    path = PosePath(
        times=[0.1, 0.5, 1.25],
        positions=[[0, 0, 1], [0.1, 0.2, 1.2], [0.3, 0.2, 1.1]],
        orientations=q,
        angular_velocities=[[0, 0, 0.2], [0, 0.1, 1], [0, 0, 0]],
    )
    push = Wrench(force=(1, 2, 3), torque=(0, 0, 0.1), start=0.2, duration=0.5)
    bodies = [
        RigidBody(
            "mug",
            MUG,
            0.3,
            attached_to="hand",
            attached_at=0.25,
            released_at=1.0,
            released_at_std=0.125,
            wrenches=[push, Wrench(force=(0, 0, 1), body_axes=True)],
            torsional_friction=0.004,
        ),
        RigidBody("hand", MUG, trajectory=path, trajectory_std=[0.01, 0, 0, 0, 0.02, 0]),
    ]
    belt = Plane(
        offset=-0.1,
        surface_velocity=(0.3, 0, 0),
        surface_angular_velocity=(0, 0, 1),
        surface_center=(1, 2, 0),
    )
    table = Box((1, 1, 1), (3, 0, 0), surface_angular_velocity=(0, 0, 0.5), torsional_friction=0.01)
    scene = Scene.everyday(bodies, exact=True, environment=[belt, table])
    return scene, Belief.of(scene, {"mug": BodyBelief(position=(0, 0, 0.3), position_std=0.01)})


def read(scene, belief, frame=None):
    """What a node reads of a scene and its actions, given in another frame."""
    message = write_scene(scene, belief, told)
    actions = [action for body in scene.bodies for action in write_actions(body)]
    if frame is not None:
        message, actions = frame.scene(message), [frame.action(action) for action in actions]
    return read_scene(message, LIBRARY, EXACT_PRESETS["everyday"], actions=actions).scene


def test_a_scene_goes_there_and_back():
    scene, belief = robot_scene()
    found = read(scene, belief)
    mug, hand = found.bodies
    given = scene.bodies[0]
    for name in ("attached_to", "attached_at", "released_at", "released_at_std", "torsional_friction"):
        assert getattr(mug, name) == getattr(given, name)
    for wrench, own in zip(mug.wrenches, given.wrenches, strict=True):
        np.testing.assert_array_equal([*wrench.force, *wrench.torque], [*own.force, *own.torque])
        assert (wrench.body_axes, wrench.start, wrench.end) == (own.body_axes, own.start, own.end)
    np.testing.assert_array_equal(hand.trajectory_std, scene.bodies[1].trajectory_std)
    times = np.linspace(0, 1.5, 31)
    # poses of the path are exact; what is between belongs to the centre of mass here and there
    np.testing.assert_allclose(path_states(found, 1, times), path_states(scene, 1, times), atol=1e-12)
    for element, own in zip(found.environment, scene.environment, strict=True):
        np.testing.assert_allclose(element.moving_surface, own.moving_surface, atol=1e-12)
    assert found.environment[1].torsional_friction == 0.01
    again = read(scene, belief)
    assert again.bodies[0] is mug and again.bodies[1] is hand, "known by the same numbers"


def test_another_frame_sees_the_same_motion():
    scene, belief = robot_scene()
    turn, shift = Rotation.from_rotvec([0.3, -0.2, 0.9]), np.array([1.0, -2.0, 0.5])
    frame = Transform(turn.as_matrix(), shift, tuple(turn.as_quat()))
    found = read(scene, belief, frame)
    times = np.linspace(0, 1.5, 7)
    here, there = path_states(scene, 1, times), path_states(found, 1, times)
    np.testing.assert_allclose(there[:, :3], turn.apply(here[:, :3]) + shift, atol=1e-12)
    np.testing.assert_allclose(there[:, 10:], turn.apply(here[:, 10:]), atol=1e-12)
    np.testing.assert_allclose(found.bodies[0].wrenches[0].force, turn.apply([1, 2, 3]), atol=1e-12)
    np.testing.assert_array_equal(found.bodies[0].wrenches[1].force, [0, 0, 1])
    point = np.array([0.3, 0.4, -0.1])  # of the belt

    def speed(element, p):
        v = element.moving_surface
        return v[:3] + np.cross(v[3:], p)

    expected = turn.apply(speed(scene.environment[0], point))
    np.testing.assert_allclose(speed(found.environment[0], turn.apply(point) + shift), expected, atol=1e-12)


def points(*times):
    return [
        MultiDOFJointTrajectoryPoint(transforms=[Place()], time_from_start=Duration(sec=time))
        for time in times
    ]


def along(*times, **others):
    path = MultiDOFJointTrajectory(points=points(*times))
    return Action(type=Action.TRAJECTORY, object="a", trajectory=path, **others)


def held(**fields):
    return Action(type=Action.ATTACHMENT, object="a", attachment=Attachment(**fields))


TWO_PER_POINT = MultiDOFJointTrajectory(points=[MultiDOFJointTrajectoryPoint()] * 2)
PUSH = AppliedWrench(wrench=WrenchMessage(force=Vector3(x=1.0)))


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
        (0, [held(attached_to="a")], "actions[0].attachment.attached_to must be another body than itself"),
        (0, [held(attached_to="b")], "actions[0].attachment.attached_to is no body of the scene"),
        (0, [held()], "actions[0].attachment.attached_to must be the id of an object"),
        (
            0,
            [held(attached_to="b", released_at=Duration(sec=1))],
            "actions[0].attachment.released_at needs has_released_at beside it",
        ),
        (
            0,
            [held(attached_to="b", released_at_std=Duration(sec=-1))],
            "actions[0].attachment.released_at_std must not be negative",
        ),
        (
            0,
            [held(attached_to="b", released_at_std=Duration(sec=1))],
            "actions[0].attachment.released_at_std needs released_at beside it",
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


def test_drag_and_materials_go_there_and_back():
    bodies = [
        RigidBody("mug", MUG, 0.3, drag=0.01, material="cardboard"),
        RigidBody("cup", MUG, 0.3, material="wood", friction=0.4, restitution_std=0.05),
        RigidBody("plain", MUG, 0.3),
    ]
    scene = Scene.everyday(bodies, environment=[Plane(material="rubber", restitution=0.2)])
    found = read(scene, Belief.of(scene, {body.name: BodyBelief() for body in bodies}))
    names = ("material", "friction", "friction_std", "restitution", "restitution_std")
    for own, given in zip(
        (*found.bodies, *found.environment), (*scene.bodies, *scene.environment), strict=True
    ):
        assert [getattr(own, name) for name in names] == [getattr(given, name) for name in names]
    assert [body.drag for body in found.bodies] == [0.01, 0.0, 0.0]
