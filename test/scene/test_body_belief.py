"""Beliefs by the names of bodies, with the keys of scene files."""

import numpy as np
import pytest

from unc_physics import Belief, BodyBelief, RigidBody, Scene, UncPhysicsError, load_model

PIN = load_model("pin").prefix(20)
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
            {"left": LEFT, "post": BodyBelief(position_std=0.1), "right": RIGHT},
            "position_std of body 'post' must be zero or absent: the body is fixed",
        ),
        (
            {"left": LEFT, "post": BodyBelief(angular_velocity=(0, 0, 1)), "right": RIGHT},
            "angular_velocity of body 'post' must be zero",
        ),
    ],
)
def test_what_does_not_fit_is_named(bodies, words):
    with pytest.raises(UncPhysicsError, match=words):
        Belief.of(SCENE, bodies)


@pytest.mark.parametrize(
    "fields, words",
    [
        ({"position": (1, 2)}, r"^position must have shape \(3,\)"),
        ({"orientation": (0, 0, 0, 2)}, "^orientation must have unit length"),
        ({"position_std": -0.1}, "^position_std must not be negative"),
        ({"orientation_std": (0, 0, float("nan"))}, "^orientation_std must be finite"),
        ({"linear_velocity_std": 1e200}, "^linear_velocity_std is too large"),
        ({"orientation_std": 20.0}, "^orientation_std is more than a full turn; it is in rad"),
        ({"covariance": np.eye(6)}, r"^covariance must have shape \(12, 12\)"),
        (
            {"covariance": np.eye(12), "position_std": 0.1},
            "^covariance must not be given beside position_std",
        ),
    ],
)
def test_wrong_fields_are_named(fields, words):
    with pytest.raises(UncPhysicsError, match=words):
        BodyBelief(**fields)


def test_a_belief_without_the_fixed_body_says_how_to_make_one_that_fits():
    with pytest.raises(UncPhysicsError, match=r"moving=\[0, 2\].*Belief.of"):
        Belief(np.tile(POST.state, (3, 1)), np.zeros((3, 12, 12))).check_fits(SCENE)
