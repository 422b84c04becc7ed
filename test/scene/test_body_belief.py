"""Beliefs by the names of bodies, with the keys of scene files."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics import Belief, BodyBelief, PoseMeasurement, RigidBody, Scene, UncPhysicsError, load_model
from unc_physics.scene.scene_file import scene_from_dict

PIN = load_model("pin").prefix(20)
TURNED = [0, 0, 0, 1]
SCENE = Scene([RigidBody("left", PIN), RigidBody("post", PIN, fixed=True), RigidBody("right", PIN)])
LEFT = BodyBelief(
    position=(1, 2, 3),
    orientation=(0, 0, 1, 0),
    linear_velocity=(4, 5, 6),
    angular_velocity=(7, 8, 9),
    position_std=0.1,
    orientation_std=(0.2, 0.3, 0.4),
    linear_velocity_std=0.5,
    angular_velocity_std=0.6,
)
POST, RIGHT = BodyBelief(position=(0, 0, 1)), BodyBelief(covariance=4.0 * np.eye(12))


def test_names_and_fields_find_their_places():
    belief = Belief.of(SCENE, {"right": RIGHT, "left": LEFT, "post": POST})
    assert belief.mean[0].tolist() == [1, 2, 3, 4, 5, 6, 0, 0, 1, 0, 7, 8, 9]
    assert belief.mean[1].tolist() == [0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0]
    assert belief.moving.tolist() == [0, 2] and belief.independent
    stds = np.sqrt(belief.covariance[0].diagonal())
    np.testing.assert_allclose(stds, [0.1] * 3 + [0.5] * 3 + [0.2, 0.3, 0.4] + [0.6] * 3)
    np.testing.assert_array_equal(belief.covariance[1], 4.0 * np.eye(12))
    assert RIGHT.orientation_std.tolist() == [2.0, 2.0, 2.0]


@pytest.mark.parametrize(
    "bodies, words",
    [
        ({"left": LEFT, "post": POST}, "bodies must have an entry for 'right'"),
        ({"lefft": LEFT}, "did you mean 'left'"),
        ({"left": [1, 2, 3]}, r"bodies\['left'\] must be a BodyBelief, not a list"),
        (
            {"post": BodyBelief(position_std=0.1)},
            "position_std of body 'post' must be zero or absent: the body",
        ),
        ({"post": BodyBelief(angular_velocity=(0, 0, 1))}, "angular_velocity of body 'post' must be zero"),
    ],
)
def test_what_does_not_fit_is_named(bodies, words):
    others = {"left": LEFT, "post": POST, "right": RIGHT} if bodies.keys() == {"post"} else {}
    with pytest.raises(UncPhysicsError, match=words):
        Belief.of(SCENE, others | bodies)


@pytest.mark.parametrize(
    "fields, words",
    [
        ({"position": (1, 2)}, r"^position must have shape \(3,\)"),
        ({"orientation": (0, 0, 0, 2)}, "^orientation must have unit length"),
        ({"position_std": -0.1}, "^position_std must not be negative"),
        ({"orientation_std": (0, 0, float("nan"))}, "^orientation_std must be finite"),
        ({"linear_velocity_std": 1e200}, "^linear_velocity_std is too large"),
        ({"orientation_std": 20.0}, "^orientation_std is more than a full turn; it is in rad"),
        ({"roll_pitch_yaw": (0, 0, -90)}, "^roll_pitch_yaw is more than a full turn; it is in rad"),
        ({"covariance": np.eye(6)}, "^covariance must have 12 rows"),
        ({"pose_covariance": np.eye(6), "axes": "world"}, r"^axes must be 'fixed' .* or 'body', .*'world'"),
        ({"pose_covariance": np.eye(6), "axes": "body", "position_std": 0.1}, "^pose_covariance must not be"),
        ({"pose_covariance": np.eye(6), "covariance": np.eye(12)}, "^covariance must not be given beside"),
        (
            {"covariance": np.eye(12), "position_std": 0.1},
            "^covariance must not be given beside position_std",
        ),
        (
            {"roll_pitch_yaw": (0, 0, 1), "orientation": (0, 0, 0, 1)},
            "^roll_pitch_yaw must not be given beside",
        ),
        ({"origin": "base"}, "^origin must be one of center_of_mass, model"),
    ],
)
def test_wrong_fields_are_named(fields, words):
    with pytest.raises(UncPhysicsError, match=words):
        BodyBelief(**fields)


@pytest.mark.parametrize(
    ("moving", "blocks", "words"),
    [
        ([0, 2], 2, None),
        ([], 0, "belief must have covariance for the scene's moving bodies, moving=.0, 2.*Belief.of"),
        ([0, 1], 2, "belief must have covariance for the scene's moving bodies, moving=.0, 2.*Belief.of"),
        (None, 3, "belief must have covariance for the scene's moving bodies, moving=.0, 2.*Belief.of"),
        ([0, 3], 2, "moving must be indices of 3 bodies"),
        ([-1, 0], 2, "moving must be indices of 3 bodies"),
        ([2, 0], 2, "moving must be ascending indices of bodies"),
        ([2, 2], 2, "moving must be ascending indices of bodies"),
        ([0, 1.5], 2, "moving must be ascending indices of bodies"),
        ([[0, 2]], 2, "moving must be ascending indices of bodies"),
        ("ab", 2, "moving must"),
        ([0, 2], 3, "covariance must have 2 blocks, not 3"),
        ([0, 2], np.eye(24), None),
        ([0, 2], np.eye(36), r"covariance must have shape \(24, 24\), not \(36, 36\)"),
        ([0, 2], np.eye(24, k=12) + np.eye(24, k=-12), "covariance has entries beside a diagonal of zeros"),
    ],
)
def test_indices_of_moving_bodies_are_those_of_the_scene(moving, blocks, words):
    """Of a covariance with so many blocks, or of a joint one."""
    mean, P = np.tile(POST.state, (3, 1)), np.zeros((blocks, 12, 12)) if isinstance(blocks, int) else blocks
    if words is None:
        Belief(mean, P, moving).check_fits(SCENE)
        return
    with pytest.raises(UncPhysicsError, match=words):
        Belief(mean, P, moving).check_fits(SCENE)


def test_roll_pitch_yaw_are_rotations_about_fixed_axes():
    angles = [0.3, -0.7, 2.1]
    expected = Rotation.from_euler("xyz", angles).as_quat()
    found = BodyBelief(roll_pitch_yaw=angles).orientation
    np.testing.assert_allclose(found * np.sign(found @ expected), expected, atol=1e-15)


def test_a_pose_of_the_model_s_origin():
    """Mean and covariance at the centre of mass, against those of samples that are moved there exactly."""
    origin, rng = np.array([0.02, -0.01, -0.06]), np.random.default_rng(0)
    given = BodyBelief(
        origin="model",
        position=[0.4, 0.1, 0.2],
        roll_pitch_yaw=[0.2, 0.5, -1.0],
        linear_velocity=[0.3, 0.0, 0.1],
        angular_velocity=[1.0, -2.0, 3.0],
        position_std=[1e-3, 2e-3, 3e-3],
        orientation_std=[0.02, 0.01, 0.03],
        linear_velocity_std=0.01,
        angular_velocity_std=0.05,
    )
    found = given.at_center_of_mass(origin)
    turn = Rotation.from_quat(given.orientation)
    np.testing.assert_allclose(found.position, given.position - turn.apply(origin), atol=1e-15)
    errors = rng.standard_normal((400_000, 12)) * np.sqrt(given.covariance.diagonal())
    turns = turn * Rotation.from_rotvec(errors[:, 6:9])
    spins = given.angular_velocity + errors[:, 9:]
    lever = -turns.apply(origin)
    moved = errors.copy()
    moved[:, :3] += given.position + lever - found.position
    moved[:, 3:6] += given.linear_velocity + np.cross(spins, lever) - found.linear_velocity
    scale = np.sqrt(found.covariance.diagonal())
    np.testing.assert_allclose(
        np.cov(moved.T) / np.outer(scale, scale), found.covariance / np.outer(scale, scale), atol=0.02
    )
    assert given.at_center_of_mass(origin).at_center_of_mass(origin).origin == "center_of_mass"


def test_a_scene_file_places_the_model_s_origin():
    body = {"name": "can", "model": "can", "spheres": 50, "roll_pitch_yaw": [0, 0, 1.0], "position_std": 0.01}
    can, standing = load_model("can"), {"origin": "model", "position": [0.1, 0.2, 0.0]}
    scene, belief, _ = scene_from_dict({"physics": "everyday", "exact": True, "bodies": [body | standing]})
    np.testing.assert_allclose(belief.mean[0, 2], -can.origin[2], atol=1e-12)
    of_python = Belief.of(
        scene, {"can": BodyBelief(roll_pitch_yaw=[0, 0, 1.0], position_std=0.01, **standing)}
    )
    np.testing.assert_array_equal(of_python.mean, belief.mean)
    np.testing.assert_array_equal(of_python.blocks, belief.blocks)


def _pose_covariance():
    root = np.random.default_rng(3).normal(size=(6, 6)) * np.repeat([0.01, 0.1], 3)[:, None]
    return root @ root.T


@pytest.mark.parametrize("axes", ["fixed", "body"])
def test_pose_covariance_has_the_rotations_of_its_axes(axes):
    # the error of a rotation about fixed axes is R times that about the body's axes
    P, turn = _pose_covariance(), Rotation.from_euler("xyz", [0.3, -0.7, 2.0])
    to_body = np.eye(6)
    to_body[3:, 3:] = turn.as_matrix().T if axes == "fixed" else np.eye(3)
    found = BodyBelief(
        orientation=turn.as_quat(), pose_covariance=P, axes=axes, linear_velocity_std=0.2, position=(1, 2, 3)
    )
    wanted = np.zeros((12, 12))
    pose = np.r_[0:3, 6:9]
    wanted[np.ix_(pose, pose)] = to_body @ P @ to_body.T
    wanted[3:6, 3:6] = 0.04 * np.eye(3)
    np.testing.assert_allclose(found.covariance, wanted, atol=1e-15)
    measured = PoseMeasurement([1, 2, 3, *turn.as_quat()], P, axes=axes).covariance
    np.testing.assert_allclose(measured, to_body @ P @ to_body.T, atol=1e-15)


def test_pose_covariance_in_a_scene_file_is_that_of_python():
    P = _pose_covariance()
    body = {"name": "can", "model": "can", "roll_pitch_yaw": {"degrees": [10, 20, 30]}, "origin": "model"}
    loaded = scene_from_dict({"bodies": [body | {"pose_covariance": P.tolist(), "axes": "fixed"}]})
    given = BodyBelief(
        origin="model", roll_pitch_yaw=np.radians([10, 20, 30]), pose_covariance=P, axes="fixed"
    )
    wanted = Belief.of(loaded.scene, {"can": given})
    np.testing.assert_array_equal(loaded.belief.mean, wanted.mean)
    np.testing.assert_array_equal(loaded.belief.covariance, wanted.covariance)


def test_angles_in_degrees_turn_elements_and_paths():
    quarter = Rotation.from_euler("z", 90, degrees=True).as_quat()
    turned = {"roll_pitch_yaw": {"degrees": [0, 0, 90]}}
    loaded = scene_from_dict(
        {
            "environment": [{"box": {"size": [1, 2, 3], **turned}}],
            "bodies": [
                {"name": "ball", "shape": {"sphere": {"radius": 0.1}}, "mass": 1},
                {
                    "name": "hand",
                    "shape": {"sphere": {"radius": 0.1}},
                    "trajectory": [{"time": t, "position": [5, 0, t], **turned} for t in (0, 1)],
                },
            ],
        }
    )
    np.testing.assert_allclose(loaded.scene.environment[0].orientation, quarter, atol=1e-15)
    np.testing.assert_allclose(loaded.scene.bodies[1].trajectory.orientations, [quarter] * 2, atol=1e-15)


@pytest.mark.parametrize(
    "place, entries, words",
    [
        ("body", {"pose_covariance": np.eye(6).tolist()}, r"bodies\[0\].axes must be 'fixed'"),
        ("body", {"axes": "body"}, r"bodies\[0\].axes needs pose_covariance beside it"),
        ("body", {"covariance": np.eye(6).tolist()}, "is pose_covariance"),
        ("body", {"roll_pitch_yaw": {"radians": [0, 0, 1]}}, "has no key 'radians'"),
        ("box", {"roll_pitch_yaw": [0, 0, 1], "orientation": TURNED}, "must not be given beside orientation"),
        ("sphere", {"roll_pitch_yaw": [0, 0, 1], "radius": 1}, "has no key 'roll_pitch_yaw'"),
    ],
)
def test_bad_poses_are_named(place, entries, words):
    """The wrong values of keys are in test/cli/test_bad_input.py."""
    body = {"name": "pin", "model": "pin"} | (entries if place == "body" else {})
    shape = {"size": [1, 1, 1]} if place == "box" else {}
    elements = [] if place == "body" else [{place: shape | entries}]
    with pytest.raises(UncPhysicsError, match=words):
        scene_from_dict({"bodies": [body], "environment": elements})


def test_a_measured_matrix_needs_its_axes():
    with pytest.raises(UncPhysicsError, match="^axes must be 'fixed'"):
        PoseMeasurement([0, 0, 0, 0, 0, 0, 1], np.eye(6))
