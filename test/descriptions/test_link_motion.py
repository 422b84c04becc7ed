"""A robot's links along a trajectory of its joints."""

import numpy as np
import pytest
from files import write_descriptions

from unc_physics import UncPhysicsError, link_motions

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
    hand = link_motions(robot, ["turn"], [0.0, 1.0], [[0.0], [np.pi / 2]], links=["hand"], period=None)[
        "hand"
    ]
    np.testing.assert_allclose(
        hand.of_com((-0.1, 0, -0.02)).positions, [[0.1, 0, 0.57], [0, 0.1, 0.57]], atol=1e-12
    )


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
