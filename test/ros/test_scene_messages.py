"""Messages to scenes and beliefs, and back, against poses drawn one by one."""

import numpy as np
import pytest
from scenes import diagonal, moving_object, packed, position_of
from scipy.spatial.transform import Rotation

from unc_physics.checks import errors
from unc_physics.ros.messages.covariances import CovarianceDefaults
from unc_physics.ros.messages.prediction import write_prediction, write_start
from unc_physics.ros.messages.request import RequestedOutputs
from unc_physics.ros.messages.scene import read_scene
from unc_physics.ros.models import ModelLibrary
from unc_physics.scene.belief import Belief
from unc_physics.spatial.layout import ERROR, VELOCITY
from unc_physics.spatial.origin import error_map, moved
from unc_physics_msgs.msg import JointCovariance, ObjectState, Scene

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
    scene = Scene(objects=list(messages), joint_covariance=joint or JointCovariance())
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


def test_huge_numbers_are_refused_or_stay_finite():
    message = moving_object()
    message.twist.twist.angular.x = 1e200
    message.twist.covariance = diagonal(*[1e150] * 6)
    with pytest.raises(errors.NotFiniteError):
        read(message)
