"""Quasi-random rollouts with a response surface: the parts against plain NumPy, and the answers."""

import numpy as np
import pytest
from plain_scenes import BALL, independent, state
from scipy.spatial.distance import cdist
from scipy.special import ndtri
from scipy.stats import norm, qmc

from unc_physics import RigidBody, Scene, predict
from unc_physics.prediction.status import assess
from unc_physics.propagators import emission, response_surface, sobol
from unc_physics.propagators.reduction import reduction
from unc_physics.spatial.moments import symmetric_root

# -- points ------------------------------------------------------------------------------------------


def test_quantile_is_that_of_the_normal_distribution():
    p = np.array([1e-12, 1e-5, 0.02, 0.3, 0.5, 0.77, 0.999, 1.0 - 1e-9])
    np.testing.assert_allclose([sobol.quantile(x) for x in p], ndtri(p), rtol=1e-12, atol=1e-14)


def test_direction_numbers_are_those_of_joe_and_kuo():
    directions, expected = sobol._directions(), qmc.Sobol(32, scramble=False, bits=32).random(64)
    for n in range(64):
        gray, point = n ^ (n >> 1), np.zeros(32, np.uint64)
        for bit in range(6):
            if gray >> bit & 1:
                point ^= directions[:, bit]
        np.testing.assert_array_equal(point / 2.0**32, expected[n])


@pytest.mark.parametrize("dimensions", [3, 40])
def test_points_are_stratified_and_nested(dimensions):
    """Each 64 of them have one in each 64th, in every dimension, and 8 x 8 boxes hold one each."""
    z = sobol.normal_points(128, dimensions, 3)
    np.testing.assert_array_equal(sobol.normal_points(64, dimensions, 3), z[:64])
    np.testing.assert_array_equal(sobol.normal_points(128, 2, 3), z[:, :2])
    u = norm.cdf(z[:64])
    assert all(len(set((64 * column).astype(int))) == 64 for column in u.T)
    assert len(set(map(tuple, (8 * u[:, :2]).astype(int)))) == 64
    assert np.abs(sobol.normal_points(64, dimensions, 4) - z[:64]).min(axis=0).max() > 1e-3
    assert np.abs(np.corrcoef(sobol.normal_points(1024, dimensions, 5).T) - np.eye(dimensions)).max() < 0.15


# -- reduction ---------------------------------------------------------------------------------------


def test_reduction_splits_a_belief_into_what_matters_and_what_all_share():
    rng = np.random.default_rng(0)
    root = np.zeros((24, 8))
    root[[0, 1, 2, 12, 13, 14], range(6)] = 0.1, 0.2, 0.3, 0.2, 0.2, 0.5
    root[3:6, 6:8] = root[15:18, 6:8] = rng.standard_normal((3, 2))  # a velocity that both have
    found = reduction(root, parameters=1)
    assert found.relative.shape == (9, 4) and found.common.shape == (9, 5)
    both = np.concatenate([found.relative, found.common], axis=1)
    np.testing.assert_allclose(both.T @ both, np.eye(9), atol=1e-12)
    common = root @ found.common[:8]
    np.testing.assert_allclose(common[:12], common[12:], atol=1e-12)
    np.testing.assert_allclose(common[:6], found.motion, atol=1e-12)
    np.testing.assert_allclose(common[6:12], 0.0, atol=1e-12)
    assert found.relative[8].any() and not found.common[8].any(), "a parameter is no motion"


# -- the surface -------------------------------------------------------------------------------------


def surface_twin(x, y, length, nugget, linear, at):
    """Universal kriging in plain NumPy, and what leaving each point out gives, one by one."""

    def through(x, y, at):
        K = np.exp(-0.5 * (cdist(x, x) / length) ** 2) + nugget * np.eye(len(x))
        H, h = (np.column_stack([np.ones(len(p)), p]) if linear else np.ones((len(p), 1)) for p in (x, at))
        Ki = np.linalg.inv(K)
        trend = np.linalg.solve(H.T @ Ki @ H, H.T @ Ki @ y)
        k = np.exp(-0.5 * (cdist(at, x) / length) ** 2)
        return h @ trend + k @ Ki @ (y - H @ trend)

    left_out = [
        y[n] - through(np.delete(x, n, 0), np.delete(y, n, 0), x[n : n + 1])[0] for n in range(len(x))
    ]
    return through(x, y, at), np.array(left_out)


@pytest.mark.parametrize("count, linear", [(14, True), (10, False)])
def test_the_surface_is_that_of_its_twin(count, linear):
    x = sobol.normal_points(count, 3, 0)
    y = np.column_stack([np.sin(2.0 * x[:, 0]), x[:, 1] * x[:, 2], x[:, 0] ** 2])
    at = sobol.normal_points(5, 3, 1)
    found = response_surface.fit(x, y)
    assert (len(found.trend) == 4) == linear
    best = np.inf
    for length in response_surface._LENGTHS * max(1.0, np.linalg.norm(x.std(axis=0)) / np.sqrt(3.0)):
        for nugget in response_surface._NUGGETS:
            values, left_out = surface_twin(x, y, length, nugget, linear, at)
            if (left_out**2).sum() < best:
                best, expected, errors = (left_out**2).sum(), values, left_out
    made, near = response_surface.predicted(
        found.weights, found.trend, found.length, np.ascontiguousarray(found.points.T), at
    )
    np.testing.assert_array_equal(near, cdist(at, x).argmin(axis=1))
    np.testing.assert_allclose(made, expected, atol=1e-6)
    np.testing.assert_allclose(found.left_out, errors, atol=1e-6)


def test_noise_has_no_surface_and_a_plane_is_one():
    x, rng = sobol.normal_points(32, 4, 0), np.random.default_rng(0)
    assert response_surface.fit(x, rng.standard_normal((32, 6))).error > 0.9
    assert response_surface.fit(x, x @ rng.standard_normal((4, 6)) + 1.0).error < 1e-9
    assert response_surface.fit(x, np.ones((32, 6))).error == 0.0


def test_active_directions_are_those_in_which_the_surface_changes():
    x = sobol.normal_points(32, 3, 0)
    a = np.array([0.6, 0.0, 0.8])
    surface = response_surface.fit(x, np.sin(x @ a)[:, None])
    found = response_surface.active_directions(surface)
    np.testing.assert_allclose(np.abs(found[:, 0]), np.abs(a), atol=0.15)
    assert np.linalg.norm(found[:, 0]) == pytest.approx(1.0) and np.linalg.norm(found[:, 2]) < 0.7
    flat = response_surface.fit(x, np.ones((32, 1)))
    np.testing.assert_array_equal(response_surface.active_directions(flat), np.eye(3))


def test_moments_are_those_of_outcomes():
    """Where there is nothing but noise, the rollouts'; on a plane, the plane's, whatever rollouts know."""
    rng, x = np.random.default_rng(0), sobol.normal_points(32, 3, 0)
    at = sobol.normal_points(1000, 3, 1)
    plane, noise = rng.standard_normal((3, 12)), rng.standard_normal((32, 12))
    for outcomes, expected in ((x @ plane, (at @ plane).var(axis=0)), (noise, noise.var(axis=0, ddof=1))):
        surface = response_surface.fit(x, outcomes)
        columns = np.ascontiguousarray(surface.points.T)
        found, near = response_surface.smoother(surface, columns, at)
        means, expected_near = response_surface.predicted(
            surface.weights, surface.trend, surface.length, columns, at
        )
        np.testing.assert_allclose(found @ outcomes, means, atol=1e-9)
        np.testing.assert_array_equal(near, expected_near)
        here = response_surface.smoother(surface, columns, x)[0]
        mean_row = 1.0 / 32 + found.mean(axis=0) - here.mean(axis=0)
        root = symmetric_root(np.cov(found.T, bias=True))
        mean, P, left_out, factors = response_surface.surface_moments(
            outcomes, surface.kriging, mean_row, root, 2.0
        )
        np.testing.assert_allclose(left_out, surface.left_out, atol=1e-9)
        np.testing.assert_allclose(
            mean, means.mean(axis=0) + (outcomes - here @ outcomes).mean(axis=0), atol=1e-9
        )
        np.testing.assert_allclose(
            np.diagonal(P).reshape(-1, 3).sum(axis=1), expected.reshape(-1, 3).sum(axis=1), rtol=0.25
        )
        assert np.linalg.eigvalsh(P)[0] > -1e-12 and ((0.5 <= factors) & (factors <= 2.0)).all()


def test_times_share_a_surface_where_the_same_bodies_have_met(loaded, monkeypatch):
    """Ten times after the collision and five before have one fit, and about the moments of their own."""
    scene, belief, _ = loaded("two_bodies")
    fits, whole = [], emission._fit
    monkeypatch.setattr(emission, "_fit", lambda *what: fits.append(1) or whole(*what))
    times = list(np.linspace(0.1, 1.5, 15))
    together = predict(scene, belief, "cloud", times=times)
    assert len(fits) <= 2
    for time in (1.2, 1.5):
        alone = predict(scene, belief, "cloud", time).belief
        own = together.at(time).belief
        std = np.sqrt(np.diagonal(alone.blocks, axis1=1, axis2=2))
        np.testing.assert_allclose(np.sqrt(np.diagonal(own.blocks, axis1=1, axis2=2)), std, rtol=0.2)
        assert (np.abs(own.mean - alone.mean)[:, :3] < 0.2 * std[:, :3]).all()


# -- the propagator ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["cloud", "auto"])
def test_bodies_that_overlap_in_empty_space_keep_their_common_motion(name):
    """Removal of overlap does not notice it: it is that of two free bodies, as of Monte Carlo."""
    bodies = [RigidBody("a", BALL, 1.0), RigidBody("b", BALL, 2.0), RigidBody("c", BALL, 1.0)]
    scene = Scene.everyday(bodies, exact=True)
    start = independent(state(), state((0.09, 0, 0)), state((2, 0, 0)), position=0.01, velocity=0.1)
    found, expected = (predict(scene, start, own, 0.2) for own in (name, "monte_carlo"))
    for one in "abc":
        np.testing.assert_allclose(found[one].position_std, expected[one].position_std, rtol=0.12)
    together = (found.samples()[:, :2, 1] @ [1.0, 2.0] / 3.0).std()
    assert together == pytest.approx(np.hypot(0.01, 0.02) * np.sqrt(5.0) / 3.0, rel=0.05)


def test_what_is_fitted_is_fitted_once_and_goes_with_its_carry(loaded, monkeypatch):
    scene, belief, _ = loaded("two_bodies")
    fits, whole = [], emission._fit
    monkeypatch.setattr(emission, "_fit", lambda *what: fits.append(1) or whole(*what))
    prediction = predict(scene, belief, "cloud", 0.8)
    assess(prediction)
    prediction.propagator.standard_errors(prediction.carry, prediction.scene)
    assert len(fits) == len(prediction.carry.moments) == 1 and "errors" in prediction.carry.kept
    later = prediction.propagator.advance(prediction.carry, prediction.scene, 1)
    assert not later.moments and not later.kept, "other states begin without"
