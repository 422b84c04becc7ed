"""The scene files of what a robot does come out as the how-to pages say."""

from pathlib import Path

import numpy as np
import pytest

from unc_physics import BoxRegion, load_scene, make_propagator, predict

SCENES = Path(__file__).resolve().parents[2] / "examples" / "scenes"


def predicted(name, propagator="sigma_points", **options):
    scene, belief, horizon = load_scene(SCENES / f"{name}.yaml")
    return predict(scene, belief, make_propagator(propagator, **options), horizon)


def test_a_finger_pushes_a_box_along_a_line():
    """It goes as far as the finger does after it touches, and turns, since it is pushed beside its middle."""
    box = predicted("push_box").body("salt_box")
    assert 0.080 < box.position[0] < 0.095 and -0.03 < box.position[1] < 0.0
    assert box.position_std[0] < 0.004 < box.position_std[1]


def test_two_fingers_bring_a_mug_to_the_middle():
    """Known to 1 cm before, to less than 1 mm after along the way that they close; not across it."""
    mug = predicted("close_fingers").body("mug")
    assert mug.position_std[1] < 1.5e-3
    assert mug.position_std[0] > 8e-3
    assert mug.position[1] == pytest.approx(0.0, abs=1e-3)


def test_a_hand_drops_a_box_into_a_bin():
    prediction = predicted("release_over_bin", "monte_carlo", samples=60)
    inside = BoxRegion("inside", (0.30, 0.20, 0.15), (0.0, 0.0, 0.075))
    assert inside.contains(prediction.samples()[:, 0, :3]).mean() > 0.9
    np.testing.assert_allclose(prediction.body("hand").position, [0.1, 0, 0.4], atol=1e-9)


def test_a_bottle_that_is_let_go_1_cm_too_high_stands():
    bottle = predicted("put_bottle_down").body("bottle")
    assert bottle.position[2] == pytest.approx(0.0973, abs=5e-4) and bottle.position_std[2] < 5e-4
    assert np.abs(bottle.orientation[:2]).max() < 0.01


def test_a_belt_carries_a_can_along_a_fence():
    """It slides along the fence, at less than the belt's speed."""
    can = predicted("belt_against_fence").body("can")
    vx, vy, _ = can.linear_velocity
    assert 0.05 < vx < 0.25 and vy == pytest.approx(-vx * np.tan(np.radians(30)), rel=0.05)
