"""Real pushes: their data, the scene of one, and the experiment."""

import math

import numpy as np
import pytest
from scipy.stats import chi2

from unc_physics_evaluation.methods import MARGINAL, STILL
from unc_physics_evaluation.push_predictions import push_outcomes, push_predictions
from unc_physics_evaluation.recorded_pushes import (
    FOLDER,
    PATCH,
    REPEATS_STD,
    block,
    edges,
    feet_of,
    measured_frictions,
    planar,
    planar_before,
    push_scene,
    recorded_pushes,
    seen,
    uncertain_push,
)


def test_the_block_is_the_documented_one():
    pushes, model = recorded_pushes(), block(0)
    radii = model.radii[:, None]
    low, high = (model.centers - radii).min(axis=0), (model.centers + radii).max(axis=0)
    np.testing.assert_allclose(low[:2], -pushes.com, atol=1e-9)
    assert (high[:2] < pushes.polygon[[1, 2], [0, 1]] - pushes.com).all()  # sharp corners are left out
    assert low[2] == pytest.approx(-0.5 * pushes.height, abs=1e-12)
    np.testing.assert_allclose(feet_of(PATCH).mean(axis=0), pushes.com, atol=1e-6)


def test_the_blocks_pieces_have_its_sides_and_feet():
    model, low = block(0), -0.5 * recorded_pushes().height
    side, *feet = model.pieces
    for foot, place in zip(feet, feet_of(0) - recorded_pushes().com, strict=True):
        np.testing.assert_allclose(foot.points[0], (*place, low + foot.rounding))
    for edge in edges():
        line = edge.start - recorded_pushes().com
        reach = (side.points[:, :2] - line) @ edge.inward - side.rounding
        np.testing.assert_allclose(np.sort(reach)[:4], 0.0, atol=1e-12)
        assert (reach > -1e-12).all()
    spheres = model.centers[:-3]
    np.testing.assert_allclose(spheres[:, 2], side.points[:, 2].mean())


@pytest.mark.parametrize("kind, tip", [(0, 0.55), (2, 0.34)])
def test_frictions_of_a_push_are_those_of_its_contacts(kind, tip):
    """Contacts have geometric means: the tip on the block and the block on the table as measured."""
    k = int(np.flatnonzero(recorded_pushes().kind == kind)[0])
    found = measured_frictions(k)
    block_, pusher, table = uncertain_push(k).scene.materials.friction
    assert math.sqrt(block_ * pusher) == pytest.approx(found.tip) == pytest.approx(tip)
    assert math.sqrt(block_ * table) == pytest.approx(found.table)
    assert 0.25 < found.table < 0.4


def test_predictions_are_states_of_what_planar_reads():
    k = int(np.flatnonzero(recorded_pushes().kind == 2)[0])
    (pose,) = push_outcomes(FOLDER, [k])
    state = np.concatenate([pose[:3], np.zeros(3), pose[3:], np.zeros(3)])
    np.testing.assert_allclose(planar(state), seen(k))
    (without,) = push_predictions(FOLDER, [k], [k, k + 1, k + 2], MARGINAL, False, 0)
    assert without[MARGINAL].shape == (2, 13)
    np.testing.assert_allclose(planar(without[STILL]), planar_before(k)[None])


def test_engines_with_one_outcome_have_the_spread_of_repeated_pushes():
    pytest.importorskip("mujoco")
    k = int(np.flatnonzero(recorded_pushes().kind == 0)[0])
    (found,) = push_predictions(FOLDER, [k], [k], "mujoco", False, 0)
    places = planar(found["mujoco"])
    low, high = np.sqrt(chi2.ppf([1e-4, 1.0 - 1e-4], len(places) - 1) / (len(places) - 1))
    ratio = places.std(axis=0, ddof=1) / REPEATS_STD
    assert (low < ratio).all() and (ratio < high).all()


def test_a_pusher_ends_at_the_edge():
    """The tip is where the block is, when the push ends: at its edge, to the calibration's errors."""
    k = int(np.flatnonzero(recorded_pushes().kind == 0)[0])
    push = push_scene(k, measured_frictions(k))
    path = push.scene.bodies[1].trajectory
    x, y, theta = seen(k)
    c, s = math.cos(theta), math.sin(theta)
    tip = np.array([[c, s], [-s, c]]) @ (path.positions[-1, :2] - [x, y]) + recorded_pushes().com
    gaps = [tip[0], tip[1], (0.15 - tip[0] - tip[1]) / math.sqrt(2.0)]
    assert min(abs(gap) for gap in gaps) < 2e-3
    assert planar(push.belief.mean[0]).shape == (3,)
