"""Requests that tests begin from."""

from array import array

import numpy as np
from geometry_msgs.msg import Point, PoseWithCovariance, Vector3
from shape_msgs.msg import Mesh, MeshTriangle, Plane

from unc_physics.checks.errors import ErrorCode
from unc_physics.ros.messages.fields import duration, pose_message
from unc_physics_msgs.msg import EnvironmentElement, Material, ObjectState, PredictionRequest, Scene

POSITION_STD = 0.02  # m
ROTATION_STD = 0.05  # rad


def packed(values):
    """Numbers for a field of any length; where it checks, it takes no NumPy array and no NaN."""
    return array("d", np.ravel(values))


def diagonal(*stds):
    """A covariance (36,) of a message from 6 standard deviations."""
    return np.diag(np.square(stds)).ravel()


def moving_object(
    name="left", model="bunny", position=(-0.2, 0.0, 0.0), velocity=(0.5, 0.0, 0.0), spheres=20
):
    """An object with an uncertain pose."""
    message = ObjectState(id=name, model=model, mass=1.0, spheres=spheres)
    pose, twist = message.pose.pose, message.twist.twist
    pose.position.x, pose.position.y, pose.position.z = position
    twist.linear.x, twist.linear.y, twist.linear.z = velocity
    message.pose.covariance = diagonal(*[POSITION_STD] * 3, *[ROTATION_STD] * 3)
    return message


def floor(height=0.0, name="floor", **others):
    """A level half-space."""
    return EnvironmentElement(id=name, plane=Plane(coef=[0.0, 0.0, 1.0, -height]), **others)


def mesh_message(vertices, faces):
    """A mesh of corners (n, 3) and triangles (m, 3)."""
    return Mesh(
        vertices=[Point(**dict(zip("xyz", map(float, v), strict=True))) for v in vertices],
        triangles=[MeshTriangle(vertex_indices=np.array(face, np.uint32)) for face in faces],
    )


def tetrahedron(height):
    """A mesh of a corner of a box with edges of 0.1 m."""
    corners = [(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, height)]
    return mesh_message(corners, [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])


def measured(position, position_std, rotation_std=0.02, q=(0.0, 0.0, 0.0, 1.0)):
    """A measured pose with equal standard deviations [m, rad] along all axes."""
    covariance = diagonal(*[position_std] * 3, *[rotation_std] * 3)
    return PoseWithCovariance(pose=pose_message(position, q), covariance=covariance)


#: Fields that are Durations, for which tests give seconds.
_TIMES = "horizon", "trajectory_period", "max_computation_time"


def request_of(*objects, horizon=0.2, **others):
    """A request without gravity; times in seconds."""
    others = others | {"horizon": horizon}
    others |= {name: duration(others[name]) for name in _TIMES if name in others}
    request = PredictionRequest(scene=Scene(objects=list(objects)), **others)
    return with_physics(request, gravity=(0.0, 0.0, 0.0))


def with_physics(request, **values):
    """The same request, with fields of its physics replaced; None takes the node's."""
    for name, value in values.items():
        if hasattr(request.physics, f"has_{name}"):
            setattr(request.physics, f"has_{name}", value is not None)
        if value is None:
            value = type(getattr(request.physics, name))()
        elif name == "gravity":
            value = Vector3(**dict(zip("xyz", value, strict=True)))
        setattr(request.physics, name, value)
    return request


def material_of(**values):
    """A Material with these values, and their flags."""
    message = Material(**values)
    for name in values:
        if hasattr(message, f"has_{name}"):
            setattr(message, f"has_{name}", True)
    return message


def explicit(request):
    """The same request, for the paper's step, which all propagators run on."""
    return with_physics(request, integrator="explicit", friction=0.0, restitution=1.0)


def good_request(**others):
    """Two objects that approach each other."""
    right = moving_object("right", "armadillo", (0.2, 0.0, 0.0), (-0.5, 0.0, 0.0))
    return request_of(moving_object(), right, **others)


def assert_answered(response):
    """The answer is no error, and holds finite numbers only."""
    assert response.result.error_code == ErrorCode.NONE, response.result.error_msg
    assert response.prediction.objects
    assert all(predicted.states for predicted in response.prediction.objects)
    check_numbers(response.prediction)


def check_numbers(prediction):
    """All numbers of a prediction are finite."""
    for predicted in prediction.objects:
        for state in predicted.states:
            assert np.isfinite(numbers_of(state)).all()
            assert np.isfinite(np.asarray(state.covariance)).all()
            for pose in state.pose_samples:
                assert np.isfinite(position_of(pose)).all() and np.isfinite(orientation_of(pose)).all()
    for joint in prediction.joint_covariances:
        assert np.isfinite(np.asarray(joint.data)).all()


def numbers_of(state):
    """All numbers of a PredictedState but its optional parts."""
    pose, twist = state.pose.pose, state.twist.twist
    return np.concatenate(
        [
            position_of(pose),
            orientation_of(pose),
            [
                twist.linear.x,
                twist.linear.y,
                twist.linear.z,
                twist.angular.x,
                twist.angular.y,
                twist.angular.z,
            ],
            state.pose.covariance,
            state.twist.covariance,
        ]
    )


def assert_same(response, expected):
    """Both answer the same; to round-off, as steps are grouped by the clock."""
    assert_answered(response)
    for got, want in zip(response.prediction.objects, expected.prediction.objects, strict=True):
        assert np.allclose(numbers_of(got.states[-1]), numbers_of(want.states[-1]), rtol=0.0, atol=1e-9)
        assert (got.status, got.status_msg) == (want.status, want.status_msg)


def position_of(pose):
    """(3,)"""
    pose = getattr(pose, "pose", pose)  # with or without a covariance
    return np.array([pose.position.x, pose.position.y, pose.position.z])


def orientation_of(pose):
    """(4,)"""
    q = getattr(pose, "pose", pose).orientation
    return np.array([q.x, q.y, q.z, q.w])
