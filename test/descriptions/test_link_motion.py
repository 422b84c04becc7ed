"""A robot's links along a trajectory of its joints."""

import numpy as np
import pytest
from files import write_descriptions
from scipy.spatial.transform import Rotation

from unc_physics import (
    Belief,
    BodyBelief,
    RigidBody,
    Scene,
    Touches,
    UncPhysicsError,
    link_motions,
    load_model,
    load_robot_motion,
    predict,
)
from unc_physics.descriptions.link_motion import of_com

pytest.importorskip("yourdfpy")


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    return write_descriptions(tmp_path_factory.mktemp("descriptions")) / "arm.urdf"


def test_links_follow_the_joints(robot):
    """The hand turns about z, the knob is 0.2 m and the tip's position away from the axis."""
    times, joints = [0.0, 1.0, 2.0], [[0.0, 0.0], [np.pi / 2, 0.3], [np.pi / 2, 0.0]]
    motions = link_motions(robot, ["turn", "tip"], times, joints, base_position=(1, 0, 0), period=0.1)
    assert set(motions) == {"base", "post", "hand", "visual_only"}
    hand, knob = motions["hand"], motions["visual_only"]
    assert len(knob.times) == 21 and np.all(np.diff(knob.times) < 0.1 + 1e-9)
    angle = np.interp(knob.times, times, [0.0, np.pi / 2, np.pi / 2])
    reach = 0.2 + np.interp(knob.times, times, [0.0, 0.3, 0.0])
    expected = np.stack([1 + reach * np.cos(angle), reach * np.sin(angle), np.full(21, 0.55)], axis=1)
    np.testing.assert_allclose(knob.positions, expected, atol=1e-12)
    np.testing.assert_allclose(hand.orientations[:, 2], np.sin(angle / 2), atol=1e-12)
    np.testing.assert_allclose(motions["base"].positions, np.tile([1.0, 0, 0], (21, 1)), atol=1e-12)


def test_the_robot_may_stand_turned_and_still(robot):
    """At one time, all links stand; the base is turned by 0.7 about x."""
    base = Rotation.from_euler("x", 0.7)
    given = {"base_position": (1, 0, 0), "base_orientation": base.as_quat()}
    motions = link_motions(robot, ["tip", "turn"], [0.5], [[0.1, 0.4]], **given)
    knob = motions["visual_only"]
    np.testing.assert_allclose(knob.times, [0.5, 0.501])
    place = base.apply([0.3 * np.cos(0.4), 0.3 * np.sin(0.4), 0.55]) + [1, 0, 0]
    np.testing.assert_allclose(knob.positions, [place, place], atol=1e-12)
    turned = (base * Rotation.from_euler("z", 0.4)).as_quat()
    np.testing.assert_allclose(knob.orientations, [turned, turned], atol=1e-12)


def test_of_the_centre_of_mass(robot):
    turn = [[0.0], [np.pi / 2]]
    hand = link_motions(robot, ["turn"], [0.0, 1.0], turn, links=["hand"], period=None)["hand"]
    moved = of_com(hand, (-0.1, 0, -0.02)).positions
    np.testing.assert_allclose(moved, [[0.1, 0, 0.57], [0, 0.1, 0.57]], atol=1e-12)


@pytest.mark.parametrize(
    ("joint", "moving"),
    [(("tip", [[0.0], [1e-6]]), {"visual_only"}), (("turn", [[0.0], [1e-6]]), {"hand", "visual_only"})],
)
def test_a_link_that_slides_or_turns_a_little_is_not_fixed(robot, joint, moving):
    name, positions = joint
    found = load_robot_motion(robot, [name], [0.0, 1.0], positions, spheres=5)
    assert {body.name for body in found.bodies if body.trajectory is not None} == moving
    assert {body.name for body in found.bodies if body.fixed} == set(found.beliefs)
    assert set(found.beliefs) | moving == {"base", "post", "hand", "visual_only"}


@pytest.mark.parametrize(
    ("names", "times", "positions", "said"),
    [
        (["trun"], [0.0], [[0.0]], "did you mean 'turn'"),
        (["turn"], [0.0, 0.0], [[0.0], [1.0]], "times must ascend"),
        (["turn"], [0.0, 1.0], [[0.0, 1.0]], "must have 2 rows, one for each time, and 1 columns"),
        (["turn"], [0.0], [[np.nan]], "finite|NaN"),
        (["turn"], [-1.0, 0.0], [[0.0], [1.0]], "times must ascend from 0 or later"),
        (["turn"], [], [], "times must be a list of times, at least one"),
        (["turn"], [[0.0]], [[0.0]], "times must be a list of times"),
    ],
)
def test_bad_trajectories_get_one_sentence(robot, names, times, positions, said):
    with pytest.raises(UncPhysicsError, match=said):
        link_motions(robot, names, times, positions)
    with pytest.raises(UncPhysicsError, match=r"links is no link of the robot \(got 'foot'\)"):
        link_motions(robot, [], [0.0], [[]], links=["foot"])


def test_a_robot_pushes_what_is_in_its_way(robot):
    """Its hand turns by a right angle, and carries a box along that stands where it goes."""
    found = load_robot_motion(robot, ["turn"], [0.0, 0.6], [[0.0], [0.8]], spheres=40, links=["base", "hand"])
    base, hand = found.bodies
    assert base.fixed and hand.trajectory is not None and set(found.beliefs) == {"base"}
    box = RigidBody("box", load_model("salt_box").prefix(30).scaled(0.3), 0.05)
    floating = Scene.everyday([base, hand, box], exact=True, gravity=(0, 0, 0))
    start = found.beliefs | {"box": BodyBelief(position=(0.1, 0.06, 0.57), position_std=0.001)}
    pushed = predict(floating, Belief.of(floating, start), "sigma_points", 0.6)
    np.testing.assert_allclose(pushed["hand"].position, hand.trajectory.positions[-1], atol=1e-6)
    assert pushed["box"].position[1] > 0.08 and pushed.probability(Touches("box", "hand")).estimate > 0.9
