"""What a robot does in messages: there and back, in other frames, and bad input."""

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Transform as Place
from scenes import moving_object
from scipy.spatial.transform import Rotation
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from unc_physics import Belief, BodyBelief, Box, Plane, PosePath, RigidBody, Scene, UncPhysicsError, Wrench
from unc_physics.ros.messages.frames import Transform
from unc_physics.ros.messages.scene import read_scene, write_scene
from unc_physics.ros.models import ModelLibrary, _info
from unc_physics.scene.action_arrays import path_states
from unc_physics.scene.presets import PRESETS
from unc_physics_msgs.msg import ObjectState
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
    scene = Scene.everyday(bodies, environment=[belt, table])
    return scene, Belief.of(scene, {"mug": BodyBelief(position=(0, 0, 0.3), position_std=0.01)})


def test_a_scene_goes_there_and_back():
    scene, belief = robot_scene()
    found = read_scene(write_scene(scene, belief, told), LIBRARY, PRESETS["everyday"]).scene
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
    again = read_scene(write_scene(scene, belief, told), LIBRARY, PRESETS["everyday"]).scene
    assert again.bodies[0] is mug and again.bodies[1] is hand, "known by the same numbers"


def test_another_frame_sees_the_same_motion():
    scene, belief = robot_scene()
    turn, shift = Rotation.from_rotvec([0.3, -0.2, 0.9]), np.array([1.0, -2.0, 0.5])
    frame = Transform(turn.as_matrix(), shift, tuple(turn.as_quat()))
    message = frame.scene(write_scene(scene, belief, told))
    found = read_scene(message, LIBRARY, PRESETS["everyday"]).scene
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


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"trajectory": []}, "trajectory must hold an entry, as the object is PRESCRIBED"),
        ({"kind": ObjectState.DYNAMIC}, "trajectory must be empty for an object that is not PRESCRIBED"),
        ({"kind": 7}, "kind must be DYNAMIC, FIXED or PRESCRIBED"),
        ({"trajectory": points(1)}, "trajectory[0].times must be at least two"),
        ({"trajectory": points(2, 1)}, "trajectory[0].times[1] must be later than the time before it"),
        ({"trajectory": [MultiDOFJointTrajectoryPoint()] * 2}, "points[0] must have one transform"),
        ({"attached_to": "can"}, "attached_to of body 'a' must be another body than itself"),
        ({"released_at": [Duration(sec=1)]}, "released_at of body 'a' needs attached_to beside it"),
        ({"released_at_std": Duration(sec=-1)}, "released_at_std must not be negative"),
    ],
)
def test_bad_input_is_named(change, sentence):
    message = moving_object("a", "can", spheres=20)
    message.kind = ObjectState.PRESCRIBED
    message.trajectory = [MultiDOFJointTrajectory(points=points(0, 1))]
    for name, value in change.items():
        if name == "trajectory" and value:
            value = [MultiDOFJointTrajectory(points=value)]
        if name in ("attached_to", "released_at"):
            message.kind, message.trajectory = ObjectState.DYNAMIC, []
        setattr(message, name, "a" if name == "attached_to" else value)
    with pytest.raises(UncPhysicsError) as error:
        read_scene(SceneMessage(objects=[message]), LIBRARY, PRESETS["everyday"])
    assert sentence in str(error.value) and str(error.value).startswith("scene.objects[0].")
