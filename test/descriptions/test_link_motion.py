"""A robot's links along a trajectory of its joints."""

import numpy as np
import pytest
from files import write_descriptions

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


def test_of_the_centre_of_mass(robot):
    turn = [[0.0], [np.pi / 2]]
    hand = link_motions(robot, ["turn"], [0.0, 1.0], turn, links=["hand"], period=None)["hand"]
    moved = of_com(hand, (-0.1, 0, -0.02)).positions
    np.testing.assert_allclose(moved, [[0.1, 0, 0.57], [0, 0.1, 0.57]], atol=1e-12)


@pytest.mark.parametrize(
    ("names", "times", "positions", "said"),
    [
        (["trun"], [0.0], [[0.0]], "did you mean 'turn'"),
        (["turn"], [0.0, 0.0], [[0.0], [1.0]], "times must ascend"),
        (["turn"], [0.0, 1.0], [[0.0, 1.0]], "must have 2 rows, one for each time, and 1 columns"),
        (["turn"], [0.0], [[np.nan]], "finite|NaN"),
    ],
)
def test_bad_trajectories_get_one_sentence(robot, names, times, positions, said):
    with pytest.raises(UncPhysicsError, match=said):
        link_motions(robot, names, times, positions)


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
