"""Messages to scenes and beliefs, and back, against poses drawn one by one."""

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Vector3
from scenes import diagonal, moving_object, packed, position_of
from scipy.spatial.transform import Rotation

from unc_physics.checks import errors
from unc_physics.ros.messages import prediction
from unc_physics.ros.messages.covariances import CovarianceDefaults
from unc_physics.ros.messages.fields import duration, optional, read_duration, seconds
from unc_physics.ros.messages.prediction import write_prediction, write_start
from unc_physics.ros.messages.request import RequestedOutputs
from unc_physics.ros.messages.scene import read_scene
from unc_physics.ros.models import ModelLibrary
from unc_physics.scene.belief import Belief
from unc_physics.spatial.layout import ERROR, VELOCITY
from unc_physics.spatial.origin import error_map, moved
from unc_physics_msgs.msg import JointCovariance, Material, ObjectState, Physics, Scene

SMALL = 1e-3  # standard deviations of draws, small enough that the first order is all that shows
ROUND_OFF = 1e-12

PHYSICS = {"dt": 0.01}
LIBRARY = ModelLibrary()
ROTATION = Rotation.from_rotvec([0.4, -1.1, 0.7])
SPIN = np.array([2.0, -1.0, 3.0])


def spinning_object():
    message = moving_object(position=(0.3, -0.2, 0.9), velocity=(0.5, 0.1, -0.3))
    q = message.pose.pose.orientation
    q.x, q.y, q.z, q.w = ROTATION.as_quat()
    w = message.twist.twist.angular
    w.x, w.y, w.z = SPIN
    message.scale = 3.0  # so that the origin lies well away from the centre of mass
    return message


def read(*messages, joint=None, physics=PHYSICS, **others):
    scene = Plain(Scene())  # which takes plain objects
    scene.objects, scene.joint_covariance = list(messages), joint or JointCovariance()
    return read_scene(scene, LIBRARY, physics, **others)


def at_origins(scene, belief):
    """The belief at the models' origins, by the map of first order."""
    mean = np.array(belief.mean)
    maps = np.zeros((len(belief.moving), ERROR, len(belief.moving), ERROR))
    for b, body in enumerate(scene.bodies):
        mean[b] = moved(np.array(belief.mean[b]), np.array(body.model.origin), 1.0)
    for k, b in enumerate(belief.moving.tolist()):
        A = error_map(np.array(belief.mean[b]), np.array(scene.bodies[b].model.origin))
        maps[k, :, k] = np.linalg.solve(error_map(mean[b], np.zeros(3)), A)  # turned back to body axes
    maps = maps.reshape(belief.joint.shape)
    return Belief.trusted(mean, maps @ belief.joint @ maps.T, belief.moving)


def write_linear(scene, models, times, beliefs, **outputs):
    """What is written of beliefs about centres of mass."""
    return write_prediction(scene, models, times, [at_origins(scene, one) for one in beliefs], **outputs)


def random_covariance(seed, size):
    factor = np.random.default_rng(seed).normal(size=(size, size))
    return SMALL**2 * factor @ factor.T / size


def test_a_fixed_object_ignores_twist_and_covariances():
    message = moving_object()
    message.kind, message.mass = ObjectState.FIXED, 0.0
    message.twist.twist.linear.x = float("nan")
    message.pose.covariance = np.full(36, np.nan)
    scene, belief, models, *_ = read(message, moving_object("other"))
    assert scene.bodies[0].fixed and not belief.mean[0, VELOCITY].any()
    (written, _), (joint,) = write_linear(
        scene, models, [0.0], [belief], outputs=RequestedOutputs(joint_covariance=True)
    )
    assert not np.any(written.states[0].pose.covariance)
    assert joint.object_ids == ["other"]


def test_unknown_covariances_take_the_defaults():
    defaults = CovarianceDefaults.from_stds(0.1, 0.2, 0.3, 0.4, zero_is_exact=False)
    unknown = moving_object("unknown")
    unknown.pose.covariance[0] = -1.0
    unknown.twist.covariance[0] = -1.0
    zeros = moving_object("zeros")
    zeros.pose.covariance = np.zeros(36)
    known = moving_object("known")
    known.twist.covariance = diagonal(*[0.5] * 6)
    for message, replaced in ((unknown, False), (zeros, True), (known, False)):
        scene, belief, models, zeros_replaced, *_ = read(message, covariance_defaults=defaults)
        (written,), _ = write_linear(scene, models, [0.0], [belief])
        assert zeros_replaced == replaced
        if message is not known:
            assert np.allclose(written.states[0].pose.covariance, diagonal(0.1, 0.1, 0.1, 0.2, 0.2, 0.2))
            assert np.allclose(written.states[0].twist.covariance, diagonal(0.3, 0.3, 0.3, 0.4, 0.4, 0.4))
    exact = read(zeros, covariance_defaults=defaults._replace(zero_is_exact=True))
    assert not exact.belief.covariance.any() and not exact.zeros_replaced


@pytest.mark.parametrize("what", ["pose and twist", "whole", "joint"])
def test_what_was_written_is_read_as_it_was(what):
    """A prediction can begin where another one ended."""
    scene, belief, models, *_ = read(spinning_object(), moving_object("other", "can", (1.0, 0.0, 0.0)))
    P = random_covariance(9, 2 * ERROR)
    if what == "pose and twist":  # whose errors at the origin must then be independent
        at_origin = [random_covariance(10 + k, 6) for k in range(4)]
    belief = Belief(belief.mean, P)
    outputs = RequestedOutputs(covariance=True, joint_covariance=True)
    objects, joints = write_linear(scene, models, [0.5], [belief], outputs=outputs)
    messages = []
    for k, written in enumerate(objects):
        state = written.states[0]
        message = ObjectState(id=written.id, model=written.model, spheres=20, scale=(3.0, 0.0)[k])
        message.pose.pose, message.twist.twist = state.pose.pose, state.twist.twist
        if what == "whole":
            message.covariance = state.covariance
        elif what == "pose and twist":
            message.pose.covariance = at_origin[2 * k].ravel()
            message.twist.covariance = at_origin[2 * k + 1].ravel()
        messages.append(message)
    again = read(*messages, joint=joints[0] if what == "joint" else None).belief
    assert np.allclose(again.mean, belief.mean, rtol=0.0, atol=ROUND_OFF)
    if what == "joint":
        assert_close(again.joint, belief.joint)
    elif what == "whole":
        assert_close(again.blocks, belief.blocks)
    else:
        rewritten, _ = write_linear(scene, models, [0.0], [again])
        for sent, got in zip(messages, rewritten, strict=True):
            assert_close(got.states[0].pose.covariance, sent.pose.covariance)
            assert_close(got.states[0].twist.covariance, sent.twist.covariance)


def assert_close(found, expected):
    """Equal to 1e-12 of the largest entry."""
    assert np.allclose(found, expected, rtol=0.0, atol=ROUND_OFF * np.max(np.abs(expected)))


def test_a_joint_covariance_may_name_its_objects_in_any_order():
    messages = moving_object("a"), moving_object("b", "can", (1.0, 0.0, 0.0))
    C = random_covariance(11, 2 * ERROR)
    turned = np.roll(C, (ERROR, ERROR), (0, 1))
    one = read(*messages, joint=JointCovariance(object_ids=["a", "b"], data=packed(C)))
    other = read(*messages, joint=JointCovariance(object_ids=["b", "a"], data=packed(turned)))
    assert np.array_equal(one.belief.joint, other.belief.joint)


def test_the_model_s_mass_stands_in():
    message = moving_object()
    message.mass, message.scale = 0.0, 2.0
    (body,) = read(message).scene.bodies
    assert body.mass == pytest.approx(8.0 * LIBRARY.shape("bunny").mass)


def test_objects_of_unknown_model_may_be_left_out():
    known, unknown = moving_object("a"), moving_object("b", "teapot")
    found = read(known, unknown, skip_invalid_objects=True)
    assert [body.name for body in found.scene.bodies] == ["a"]
    assert list(found.skipped) == ["b"] and "teapot" in found.skipped["b"]
    C = random_covariance(12, 2 * ERROR)
    joint = JointCovariance(object_ids=["b", "a"], data=packed(C))
    own = read(known, unknown, joint=joint, skip_invalid_objects=True).belief
    known.covariance = packed(C[ERROR:, ERROR:])
    assert_close(own.joint, read(known).belief.joint)
    with pytest.raises(errors.NoObjectsError, match="teapot"):
        read(unknown, skip_invalid_objects=True)


@pytest.mark.parametrize(
    ("sec", "nanosec", "field"),
    [(-1, 0, "horizon"), (-1, 999_999_999, "horizon"), (0, 10**9, "horizon.nanosec")],
)
def test_a_duration_that_is_none_is_named(sec, nanosec, field):
    with pytest.raises(errors.InvalidHorizonError, match=f"^{field} must"):
        read_duration(Duration(sec=sec, nanosec=nanosec), "horizon", errors.InvalidHorizonError)


@pytest.mark.parametrize("time", [0.0, 1e-9, 0.1, 0.999_999_999_9, 7.25, 1e6])
def test_durations(time):
    message = duration(time)
    assert 0 <= message.nanosec < 1_000_000_000
    assert abs(seconds(message) - time) <= 1e-9


class Plain:
    """What a message is when its fields are not checked: it takes anything."""

    def __init__(self, message):
        self.get_fields_and_field_types = message.get_fields_and_field_types
        for name in message.get_fields_and_field_types():
            value = getattr(message, name)
            setattr(self, name, Plain(value) if hasattr(value, "get_fields_and_field_types") else value)


def put(message, path, value):
    *parents, last = path.split(".")
    for name in parents:
        message = getattr(message, name)
    setattr(message, last, value)


@pytest.mark.parametrize(
    ("path", "value", "error"),
    [
        ("mass", "heavy", errors.InvalidMassError),
        ("pose.pose.position.y", "far", errors.InvalidRequestError),
        ("covariance", np.zeros(143), errors.InvalidCovarianceError),
        ("pose.covariance", np.zeros(35), errors.InvalidCovarianceError),
        ("pose.covariance", None, errors.InvalidCovarianceError),
    ],
)
def test_values_that_messages_hold_unchecked_are_named(path, value, error):
    """Other bad values are in test_bad_requests.py."""
    message = Plain(moving_object("bad"))
    put(message, path, value)
    with pytest.raises(error) as raised:
        read(moving_object("good"), message)
    assert f"scene.objects[1].{path.removesuffix('.y')}" in str(raised.value)


def test_where_a_prediction_began():
    message = spinning_object()
    message.pose.covariance = random_covariance(8, 6).ravel()
    fixed = moving_object("fixed one")
    fixed.kind = ObjectState.FIXED
    scene, belief, models, *_ = read(message, fixed)
    objects, _ = write_linear(scene, models, [0.0], [belief])
    write_start(objects, scene, belief)
    for written, sent in zip(objects, (message, fixed), strict=True):
        assert np.allclose(
            position_of(written.start.pose), position_of(sent.pose.pose), rtol=0.0, atol=ROUND_OFF
        )
        assert_close(written.start.covariance, written.states[0].pose.covariance)
    assert np.allclose(objects[0].start.covariance, message.pose.covariance, rtol=0.0, atol=ROUND_OFF)
    assert not np.any(objects[1].start.covariance)


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        (Physics, "dt", 0.1),
        (Physics, "gravity", Vector3(z=-1.0)),
        (Physics, "sleep", True),
        (Material, "friction", 0.5),
    ],
)
def test_an_optional_value_needs_its_flag(kind, name, value):
    message = kind(**{name: value})
    with pytest.raises(errors.InvalidRequestError, match=f"^thing.{name} needs has_{name} beside it"):
        optional(message, name, "thing")
    setattr(message, f"has_{name}", True)
    assert optional(message, name, "thing") is getattr(message, name)
    assert optional(kind(), name, "thing") is None


@pytest.mark.parametrize("number", [np.nan, -np.inf])
def test_what_left_the_range_of_numbers_is_not_written(number):
    """Of the second of two bodies, and of one of several samples."""
    scene, belief, models, *_ = read(spinning_object(), moving_object("other"))
    mean, samples = belief.mean.copy(), np.tile(belief.mean[1], (3, 1))
    mean[1, 4] = samples[2, 12] = number
    with pytest.raises(errors.DivergedError, match="^prediction left the range of numbers"):
        write_prediction(scene, models, [0.0], [Belief.trusted(mean, belief.covariance, belief.moving)])
    with pytest.raises(errors.DivergedError, match="^pose_samples left the range of numbers"):
        prediction._origin_poses(samples, np.zeros(3))
    assert len(prediction._origin_poses(samples[:2], np.zeros(3))) == 2


def test_huge_numbers_are_refused_or_stay_finite():
    message = moving_object()
    message.twist.twist.angular.x = 1e200
    message.twist.covariance = diagonal(*[1e150] * 6)
    with pytest.raises(errors.NotFiniteError):
        read(message)
