"""Between distributions and points: factors, sigma points, draws, means."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from twins import states as twin

from unc_physics import Belief, RigidBody, Scene, make_propagator
from unc_physics.spatial import moments

ROUND_OFF = 1e-12  # relative to the largest entry

seeds = st.integers(0, 2**32 - 1)


def random_covariance(rng, size, rank):
    """A semidefinite matrix of some rank, its blocks of unlike sizes, as metres and radians may be."""
    root = rng.standard_normal((size, rank)) * np.repeat(10.0 ** rng.uniform(-3, 0, size // 3), 3)[:, None]
    return root @ root.T


def random_states(rng, count):
    x = rng.standard_normal((count, 13))
    x[:, 6:10] = Rotation.random(count, rng=rng).as_quat()
    return x


@given(seeds, st.integers(0, 24))
def test_pivoted_cholesky_rebuilds_the_matrix_and_equals_the_twin(seed, rank):
    A = random_covariance(np.random.default_rng(seed), 24, rank)
    L, rest = moments.pivoted_cholesky(A, 1e-14)
    scale = np.abs(A).max(initial=1e-300)
    np.testing.assert_allclose(L @ L.T, A, atol=ROUND_OFF * scale)
    np.testing.assert_allclose(rest, A - L @ L.T, atol=ROUND_OFF * scale)
    reference = twin.pivoted_cholesky(A)
    shared = min(L.shape[1], reference.shape[1])
    assert min(rank, 24) == 0 or shared > 0
    # round-off alone decides about what is left at the end
    np.testing.assert_allclose(
        L[:, :shared] @ L[:, :shared].T,
        reference[:, :shared] @ reference[:, :shared].T,
        atol=ROUND_OFF * scale,
    )


def test_pivoted_cholesky_of_a_diagonal_takes_the_largest_first_ties_to_the_lowest_index():
    L, _ = moments.pivoted_cholesky(np.diag([1.0, 4.0, 0.0, 4.0, 1e-15]), 1e-14)
    np.testing.assert_array_equal(L.T, [[0, 2, 0, 0, 0], [0, 0, 0, 2, 0], [1, 0, 0, 0, 0]])


@pytest.fixture(scope="module")
def scene(loaded):
    left, right = loaded("two_bodies").scene.bodies
    return Scene([left, RigidBody("floor", left.model, fixed=True), right])


@given(seeds, st.integers(0, 24), st.sampled_from(["minimal", "full"]))
def test_sigma_points_equal_the_twin_and_rebuild_the_belief(scene, seed, rank, points):
    rng = np.random.default_rng(seed)
    P = 0.01 * random_covariance(rng, 24, rank)
    belief = Belief(random_states(rng, 3), P, [0, 2])
    propagator = make_propagator("sigma_points", points=points)
    carry = propagator.init(scene, belief)

    rebuilt = propagator.belief(carry, scene)
    np.testing.assert_allclose(rebuilt.joint, P, atol=1e-9 * np.abs(P).max() + 1e-25)
    error = twin.boxminus(rebuilt.mean, belief.mean)
    np.testing.assert_allclose(error, 0.0, atol=1e-12)

    if points == "full":
        assert len(carry.states) == 49
    else:
        assert len(carry.states) % 2 == 1 and len(carry.states) <= 2 * rank + 1 + 2 * (rank > 0)
    reference = twin.sigma_points(belief.mean, belief.joint, [0, 2], points)
    if len(reference) == len(carry.states):  # round-off alone decides whether a last, tiny direction counts
        # a symmetric root is only as sharp as the root of round-off where the matrix has no rank
        np.testing.assert_allclose(
            twin.boxminus(carry.states, reference), 0.0, atol=1e-6 * np.sqrt(np.abs(P).max(initial=0)) + 1e-14
        )


def test_one_certain_body_beside_an_uncertain_one(scene):
    """Only the directions that are uncertain get points, and only they spread."""
    P = np.zeros((2, 12, 12))
    P[1, :3, :3] = 0.01 * np.eye(3)
    belief = Belief(random_states(np.random.default_rng(0), 3), P, [0, 2])
    states = make_propagator("sigma_points").init(scene, belief).states
    assert len(states) == 7
    np.testing.assert_allclose(states[:, :2], np.broadcast_to(belief.mean[:2], (7, 2, 13)), atol=1e-15)
    assert np.ptp(states[:, 2, 0]) > 0.1


@given(seeds, st.integers(1, 30), st.floats(0.0, 2.5))
def test_mean_and_errors_equal_the_twin(seed, count, spread):
    rng = np.random.default_rng(seed)
    center = random_states(rng, 2)
    errors = spread * rng.uniform(-0.5, 0.5, (count, 2, 12))
    states = twin.boxplus(np.broadcast_to(center, (count, 2, 13)), errors)
    states[rng.random((count, 2)) < 0.5, 6:10] *= -1.0  # the other quaternion of the same rotation
    mean, errors = moments.mean_and_errors(states, np.array([0, 1]))
    reference, P = twin.moments(states, [0, 1])
    np.testing.assert_allclose(twin.boxminus(mean, reference), 0.0, atol=1e-10)
    np.testing.assert_allclose(moments.second_moment(errors), P, atol=1e-9)


def test_karcher_mean_of_opposite_rotations_is_finite():
    """Two rotations half a turn apart have two means; one of them it must be."""
    states = np.zeros((2, 1, 13))
    states[0, 0, 6:10], states[1, 0, 6:10] = [0, 0, 0, 1], [0, 0, 1, 0]
    mean, errors = moments.mean_and_errors(states, np.array([0]))
    assert np.isfinite(mean).all() and np.isfinite(errors).all()
    assert np.linalg.norm(mean[0, 6:10]) == pytest.approx(1.0)


def test_draws_have_the_belief_s_moments(loaded):
    """Mean and covariance of many draws, within what chance leaves."""
    _, belief, _ = loaded("two_bodies")
    count = 40_000
    rng = np.random.default_rng(5)
    P = 0.01 * random_covariance(rng, 24, 10)
    belief = Belief(belief.mean, P)
    errors = twin.boxminus(belief.sample(count, rng), belief.mean).reshape(count, -1)
    std = np.sqrt(P.diagonal())
    STATISTICS = 5.0 / np.sqrt(count)
    assert np.abs(errors.mean(axis=0) / std).max() < STATISTICS
    assert np.abs((errors.T @ errors / count - P) / np.outer(std, std)).max() < np.sqrt(2) * STATISTICS
