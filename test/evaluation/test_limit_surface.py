"""An ellipsoidal limit surface: what a push does, and to which side it turns."""

import math

import numpy as np
import pytest

from unc_physics_evaluation.limit_surface import Contact, load_reach, motion_of, point_motion, pushed, step
from unc_physics_evaluation.recorded_pushes import PATCH, planar_before, recorded_pushes, seen
from unc_physics_evaluation.tip_friction import force_shares, two_tip_friction

REACH, WAY = 0.05, np.array([1e-4, 0.0])
RIGHT = np.array([1.0, 0.0])


def touching(y, gap=0.0):
    return Contact(gap, RIGHT, np.array([-0.04, y]))


def test_a_push_through_the_centre_does_not_turn():
    np.testing.assert_allclose(step([touching(0.0)], WAY[None], REACH, 0.5), [*WAY, 0.0], atol=1e-15)


@pytest.mark.parametrize("y", [-0.02, 0.005, 0.03])
def test_a_push_beside_the_centre_turns_to_the_other_side(y):
    motion = step([touching(y)], WAY[None], REACH, 0.5)
    assert np.sign(motion[2]) == -np.sign(y)
    # the tip sticks to the edge, or at least does not sink in
    assert point_motion(motion, touching(y).arm)[0] == pytest.approx(WAY[0])


def test_the_motion_is_the_ellipsoid_s_normal():
    """No other load on the ellipsoid has more power in the motion than the one that it comes from."""
    rng = np.random.default_rng(0)
    force, arm = np.array([0.6, -0.3]), np.array([-0.04, 0.02])
    motion = motion_of(force, arm, REACH)
    load = np.array([*force, arm[0] * force[1] - arm[1] * force[0]])
    axes = np.array([1.0, 1.0, REACH])
    others = rng.normal(size=(1000, 3))
    others *= axes * np.linalg.norm(load / axes) / np.linalg.norm(others, axis=1)[:, None]
    assert (others @ motion <= load @ motion + 1e-15).all()
    assert (others @ motion).max() > 0.98 * (load @ motion)


def test_a_tip_slides_where_friction_does_not_hold_it():
    across = np.array([2e-5, 1e-4])
    held, slides = (
        point_motion(step([touching(0.0)], across[None], REACH, mu), touching(0.0).arm) for mu in (9.0, 0.1)
    )
    np.testing.assert_allclose(held, across, atol=1e-15)
    assert slides[0] == pytest.approx(across[0]) and 0.0 < slides[1] < 0.5 * across[1]


def test_a_tip_neither_pulls_nor_pushes_from_afar():
    assert (step([touching(0.01)], -WAY[None], REACH, 0.5) == 0.0).all()
    assert (step([touching(0.01, gap=2e-4)], WAY[None], REACH, 0.5) == 0.0).all()


def test_two_tips_do_not_turn_an_edge_that_they_press():
    tips = [touching(-0.025), touching(0.025)]
    np.testing.assert_allclose(step(tips, np.array([WAY, WAY]), REACH, 0.5), [*WAY, 0.0], atol=1e-8)
    turn = np.array([point_motion(np.array([1e-4, 0.0, 1e-3]), tip.arm) for tip in tips])
    np.testing.assert_allclose(step(tips, turn, REACH, 0.5)[[0, 2]], [1e-4, 1e-3], rtol=1e-3)


def test_real_pushes_come_out_about_as_they_were():
    pushes = recorded_pushes()
    for kind in (0, 1):
        k = int(np.flatnonzero(pushes.kind == kind)[1])
        stays, found = planar_before(k) - seen(k), pushed(k) - seen(k)
        assert math.hypot(*found[:2]) < 0.3 * math.hypot(*stays[:2])


def test_the_load_is_where_statics_puts_it():
    """Support 0 carries evenly; support 3 is the same, half as far out; a face is between the two."""
    even = (math.hypot(0.04, 0.04) + 2.0 * math.hypot(0.08, 0.04)) / 3.0
    assert load_reach(0) == pytest.approx(even) and load_reach(3) == pytest.approx(0.5 * even)
    assert load_reach(3) < load_reach(PATCH) < load_reach(0)


def test_forces_tell_the_two_tips_friction():
    """Most shares of the force along the tips lie close to each other, and oppose the sliding."""
    shares = force_shares()
    assert len(shares) > 100 and (shares > 0.0).mean() > 0.7
    assert two_tip_friction() == pytest.approx(0.34, abs=0.01)
