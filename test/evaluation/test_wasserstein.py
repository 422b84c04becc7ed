"""W1 against closed forms, and the paper's metric against that of Python Optimal Transport."""

import numpy as np
import ot
import pytest
from scipy.spatial.transform import Rotation

from unc_physics.checks.errors import InvalidRequestError
from unc_physics_evaluation.wasserstein import (
    RegularisedDistance,
    SinkhornDivergence,
    euclidean,
    geodesic,
    geodesic_of_pairs,
    state_distance,
    wasserstein,
)

ROUND_OFF = 1e-12


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def test_of_a_translation_is_its_length(rng):
    x, t = rng.standard_normal((300, 3)), np.array([0.3, -1.2, 0.4])
    assert wasserstein(x, x + t) == pytest.approx(np.linalg.norm(t), rel=ROUND_OFF)


def test_of_a_few_points_against_many():
    """One point against many: the mean distance."""
    x = np.array([[1.0, 0, 0], [0, 2.0, 0], [0, 0, 3.0]])
    assert wasserstein(np.zeros((1, 3)), x) == pytest.approx(2.0, rel=ROUND_OFF)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 30.0, 179.9999, 180.0])
def test_geodesic_is_the_angle(angle, rng):
    start = Rotation.random(20, random_state=3)
    axes = rng.standard_normal((20, 3))
    turned = start * Rotation.from_rotvec(np.radians(angle) * axes / np.linalg.norm(axes, axis=1)[:, None])
    angles = np.diag(geodesic(start.as_quat(), turned.as_quat()))
    unit_quaternions = 1e-13  # degrees: round-off of their entries
    pairs = geodesic_of_pairs(start.as_quat(), -turned.as_quat())  # q and -q are one rotation
    for found in (angles, pairs, np.diag(geodesic(start.as_quat(), -turned.as_quat()))):
        assert found == pytest.approx(np.full(20, angle), rel=1e-6, abs=unit_quaternions)


def test_geodesic_w1_of_a_common_rotation():
    """A small cloud turned as a whole by 40 degrees on the body side is 40 degrees away."""
    cloud = Rotation.from_rotvec(1e-3 * np.random.default_rng(5).standard_normal((200, 3)))
    turned = cloud * Rotation.from_rotvec(np.radians([0.0, 40.0, 0.0]))
    spread_of_the_cloud = 0.05
    assert wasserstein(cloud.as_quat(), turned.as_quat(), geodesic) == pytest.approx(
        40.0, abs=spread_of_the_cloud
    )


def test_states_are_compared_body_by_body(rng):
    x = rng.standard_normal((50, 2, 13))
    x[:, :, 6:10] /= np.linalg.norm(x[:, :, 6:10], axis=2, keepdims=True)
    y = x + 0.5 * np.eye(13)[0] * np.eye(2)[1][:, None]
    distance = state_distance(x, y)
    assert distance.position == pytest.approx([0.0, 0.5], abs=ROUND_OFF)
    assert distance.rotation == pytest.approx([0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("regularisation", [0.1, 1.0, 10.0])
def test_the_paper_s_metric_is_pot_s_sinkhorn_divergence(regularisation, rng):
    x, y = rng.standard_normal((60, 3)), 0.5 + 1.3 * rng.standard_normal((40, 3))
    expected = ot.bregman.empirical_sinkhorn_divergence(
        x, y, regularisation, metric="euclidean", numIterMax=100_000, stopThr=1e-9
    )
    found = SinkhornDivergence(x, euclidean, regularisation).to(y)
    assert found == pytest.approx(expected, rel=1e-3)  # where Sinkhorn's iteration ends


def test_the_paper_s_metric_of_points_far_away_is_finite(rng):
    """A plain Sinkhorn kernel underflows there."""
    x = rng.standard_normal((30, 3))
    assert SinkhornDivergence(x, euclidean, 0.1).to(x + 1e3) == pytest.approx(np.sqrt(3.0) * 1e3, rel=1e-4)


def test_the_paper_s_metric_of_states_is_that_of_their_parts(rng):
    x, y = rng.standard_normal((2, 40, 2, 13))
    for states in (x, y):
        states[..., 6:10] /= np.linalg.norm(states[..., 6:10], axis=-1, keepdims=True)
    found = RegularisedDistance(x).to(y)
    position = SinkhornDivergence(x[:, 1, 0:3], euclidean, 0.1).to(y[:, 1, 0:3])
    rotation = SinkhornDivergence(x[:, 1, 6:10], geodesic, 180.0).to(y[:, 1, 6:10])
    assert (found.position[1], found.rotation[1]) == pytest.approx((position, rotation))


def test_bad_samples_are_refused():
    good = np.zeros((2, 3))
    with pytest.raises(InvalidRequestError, match="x must hold at least one sample"):
        wasserstein(np.zeros((0, 3)), good)
    with pytest.raises(InvalidRequestError, match="y must be finite"):
        wasserstein(good, np.full((2, 3), np.nan))


@pytest.mark.parametrize("factor", [0.5, 1.0, 3.0])
def test_of_a_distribution_and_its_enlargement(factor, rng):
    """|x| is 1-Lipschitz, so nothing is shorter than moving along the rays: W1(x, c x) = |c - 1| E|x|."""
    x = rng.standard_normal((250, 3))
    expected = abs(factor - 1.0) * np.mean(np.linalg.norm(x, axis=1))
    assert wasserstein(x, factor * x) == pytest.approx(expected, rel=ROUND_OFF, abs=ROUND_OFF)
    expectation_of_the_norm = 2.0 * np.sqrt(2.0 / np.pi)  # of a standard normal vector in three dimensions
    assert expected == pytest.approx(abs(factor - 1.0) * expectation_of_the_norm, rel=0.1)
