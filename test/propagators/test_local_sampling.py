"""Local sampling's inner loop runs in single precision: how near it stays to double, and where it could
break.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics import Belief, RigidBody, Scene, SpherePacking, make_propagator
from unc_physics.propagators import sampled_contacts
from unc_physics.spatial.random import RUN, normal_table, places

SINGLE_PRECISION = 1e-5  # of second moments, relative to the largest
TABLE = normal_table()


def moments(draws, factors, n, arms, d):
    """Second moments of force and torques about the nominal ones, (3, 3, 3), in double precision."""
    displaced = draws[:, :3] @ factors[0].T
    turned = [
        Rotation.from_rotvec(draws[:, 3 * k : 3 * k + 3] @ factors[k].T).apply(arms[k - 1]) for k in (1, 2)
    ]
    D = d * n + displaced + (turned[1] - arms[1]) - (turned[0] - arms[0])
    normals = D / np.linalg.norm(D, axis=1)[:, None]
    changes = [normals - n, *(np.cross(turned[k], normals) - np.cross(arms[k], n) for k in (0, 1))]
    return np.array([e.T @ e for e in changes])


@pytest.mark.parametrize("count", [RUN, 7, 1])
@pytest.mark.parametrize("angle", [0.0, 1e-5, 0.03, 0.2, 3.0, 30.0])
@pytest.mark.parametrize("distance", [1e-6, 1e-3, 0.1, 10.0])
def test_moments_equal_those_in_double_precision(angle, distance, count):
    rng = np.random.default_rng(5)
    n, *arms = rng.standard_normal((3, 3))
    n /= np.linalg.norm(n)
    sizes = (distance, angle, 0.5 * angle)
    factors = [size * np.tril(rng.uniform(0.5, 1.0, (3, 3))) for size in sizes]
    d = 0.4
    starts = tuple(np.uint64(start) for start in places(np.uint64(3)))
    single = [tuple(np.float32(x) for x in factor.flat) for factor in factors]
    shape = tuple(tuple(np.float32(x) for x in v) for v in (n, *arms))
    largest = sampled_contacts._LARGEST * max(np.linalg.norm(factors[1]), np.linalg.norm(factors[2]))
    series = [sampled_contacts._SERIES]
    if largest < sampled_contacts._SMALL:
        series.append(sampled_contacts._SMALL_SERIES)
    draws = np.array([TABLE[int(start) : int(start) + count] for start in starts], float).T
    expected = moments(draws, factors, n, arms, d)
    for terms in series:
        spread = np.zeros((3, 6))
        sampled_contacts.add_spread(
            TABLE, starts, np.uint64(count), tuple(single), (*shape, np.float32(d)), terms, (1.0, 1.0), spread
        )
        xx, yy, zz, xy, xz, yz = spread.T
        ours = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).transpose(2, 0, 1)
        for a, b in zip(ours, expected, strict=True):
            tolerance = SINGLE_PRECISION * max(1.0, largest)  # an angle of many turns is only so exact
            np.testing.assert_allclose(a, b, rtol=0, atol=tolerance * np.abs(b).max())


def test_the_table_is_normal():
    numbers = TABLE[: len(TABLE) - RUN].astype(float)
    assert abs(numbers.mean()) < 1e-7 and abs(np.mean(numbers**2) - 1.0) < 1e-7
    assert np.mean(numbers**4) == pytest.approx(3.0, abs=0.05)
    neighbours = [np.mean(numbers * np.roll(numbers, k)) for k in range(1, RUN)]
    STATISTICS = 4.0 / np.sqrt(len(numbers))
    assert np.abs(neighbours).max() < STATISTICS
    np.testing.assert_array_equal(TABLE[-RUN:], TABLE[:RUN])


def test_runs_begin_anywhere_and_independently():
    starts = np.array([places(np.uint64(key)) for key in range(4000)], float)
    assert starts.min() >= 0 and starts.max() <= len(TABLE) - RUN - 1
    STATISTICS = 4.5 / np.sqrt(len(starts))
    scaled = (starts - 2047.5) / (4096 / np.sqrt(12.0))
    assert np.abs(scaled.mean(axis=0)).max() < STATISTICS
    assert np.abs(scaled.T @ scaled / len(starts) - np.eye(9)).max() < STATISTICS


def ball(radius, arm):
    return SpherePacking(
        "ball",
        np.array([arm]),
        np.array([radius]),
        radius**2 * np.diag([0.3, 0.4, 0.5]),
        1.0,
        np.zeros(3),
        2.0 * radius,
    )


def collided(scale, P, offset=0.5):
    """Covariances (2, 12, 12) after one step of two overlapping balls of the size ``scale``."""
    bodies = [
        RigidBody("left", ball(scale, [0.3 * scale, 0.1 * scale, 0.0]), 1.0),
        RigidBody("right", ball(0.7 * scale, [0.3 * scale, 0.1 * scale, 0.0]), 1.0),
    ]
    mean = np.zeros((2, 13))
    mean[:, 9] = 1.0
    mean[1, 0] = offset * scale
    scene = Scene(bodies, 0.01, 1e4 / scale**2)
    propagator = make_propagator("local_sampling", samples=64)
    return propagator.belief(
        propagator.advance(propagator.init(scene, Belief(mean, P)), scene, 1), scene
    ).blocks


def covariance(position, rotation):
    return np.tile(np.diag([position**2] * 3 + [0.0] * 3 + [rotation**2] * 3 + [0.0] * 3), (2, 1, 1))


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1e2, 1e9])
def test_the_unit_of_length_does_not_matter(scale):
    """The same contact, larger or smaller: velocities of its spheres scale with it."""
    one, other = collided(1.0, covariance(0.05, 0.1)), collided(scale, covariance(0.05 * scale, 0.1))
    units = np.array([scale] * 6 + [1.0] * 6)
    assert one[0, 3, 3] > 1e-6 and one[0, 9, 9] > 1e-6
    np.testing.assert_allclose(other / np.outer(units, units), one, atol=SINGLE_PRECISION * np.abs(one).max())


@pytest.mark.parametrize(
    "position, rotation", [(0.0, 0.0), (1e12, 0.0), (0.0, 1e3), (1e25, 1e25), (1e-25, 1e-25)]
)
@pytest.mark.parametrize("offset", [0.5, 1e-12, 0.0])
def test_extreme_uncertainty_and_coincident_centres_stay_finite(position, rotation, offset):
    P = collided(1.0, covariance(position, rotation), offset)
    assert np.isfinite(P).all()
    added = P[:, 3:6, 3:6]
    if offset == 0.0 or position == 0.0 == rotation:
        np.testing.assert_array_equal(added, 0.0)
    elif max(position, rotation) > 1.0:
        assert added[0].trace() > 0.0
        if position > 1.0:  # any direction: the force's change has twice its square as second moment
            whole = collided(1.0, covariance(1e3, 0.0), offset)[0, 3:6, 3:6].trace()
            assert added[0].trace() == pytest.approx(whole, rel=0.5)
