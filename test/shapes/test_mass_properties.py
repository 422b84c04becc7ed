"""Mass properties of pieces against closed forms, tetrahedra and each other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pieces_at_random import piece, turn
from scipy.spatial import ConvexHull

from unc_physics.checks.errors import InvalidModelError
from unc_physics.shapes.mass_properties import mass_properties
from unc_physics.shapes.pieces import HalfSpace, Hull, Lathe, ball, box, capsule, cylinder, frustum

ROUND_OFF = 1e-12


def assert_same(found, volume, center, inertia, tolerance=ROUND_OFF):
    assert found.volume == pytest.approx(volume, rel=tolerance)
    size = np.sqrt(np.abs(inertia).max())
    np.testing.assert_allclose(found.center, center, atol=tolerance * max(size, np.abs(center).max()))
    np.testing.assert_allclose(found.inertia, inertia, atol=tolerance * size**2 * 10.0)


def test_closed_forms():
    r, h = 0.3, 0.7
    assert_same(mass_properties([ball(r)]), 4 / 3 * np.pi * r**3, np.zeros(3), 0.4 * r**2 * np.eye(3))
    a, b, c = 0.1, 0.2, 0.5
    assert_same(
        mass_properties([box((a, b, c), (1.0, 2.0, 3.0))]),
        a * b * c,
        [1.0, 2.0, 3.0],
        np.diag([b * b + c * c, a * a + c * c, a * a + b * b]) / 12.0,
        1e-11,
    )
    across = r * r / 4.0 + h * h / 12.0
    assert_same(
        mass_properties([cylinder(r, h)]),
        np.pi * r * r * h,
        np.zeros(3),
        np.diag([across, across, r * r / 2.0]),
    )
    cone = 0.15 * r * r + 0.0375 * h * h
    assert_same(
        mass_properties([frustum(r, 0.0, h)]),
        np.pi * r * r * h / 3.0,
        [0.0, 0.0, -0.25 * h],
        np.diag([cone, cone, 0.3 * r * r]),
    )


def test_a_capsule_is_a_cylinder_with_halves_of_a_ball():
    found = mass_properties([capsule(0.1, 0.4)])
    volume, middle, ends = np.pi * 0.01 * 0.4 + 4 / 3 * np.pi * 0.001, np.pi * 0.004, 4 / 3 * np.pi * 0.001
    assert found.volume == pytest.approx(volume)
    assert found.inertia[2, 2] == pytest.approx((middle * 0.005 + ends * 0.004) / volume)
    across = middle * (0.0025 + 0.16 / 12.0) + ends * (0.004 + 0.04 + 0.375 * 0.4 * 0.1)
    assert found.inertia[0, 0] == pytest.approx(across / volume)


@given(st.integers(0, 10_000), st.integers(4, 30))
@settings(deadline=None, max_examples=50)
def test_hulls_are_sums_of_tetrahedra(seed, count):
    points = np.random.default_rng(seed).normal(0.0, 0.1, (count, 3)) + [0.3, 0.0, -0.2]
    hull = ConvexHull(points)
    volume, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for simplex, plane in zip(hull.simplices, hull.equations, strict=True):
        corners = points[simplex]
        six = np.linalg.det(corners)
        if np.cross(corners[1] - corners[0], corners[2] - corners[0]) @ plane[:3] < 0.0:
            six = -six
        s = corners.sum(axis=0)
        volume, first = volume + six / 6.0, first + six / 24.0 * s
        second = second + six / 120.0 * (corners.T @ corners + np.outer(s, s))
    center = first / volume
    covariance = second / volume - np.outer(center, center)
    inertia = np.trace(covariance) * np.eye(3) - covariance
    assert_same(mass_properties([Hull(points)]), volume, center, inertia, 1e-9)


@given(st.sampled_from(["hull", "capsule", "rounded lathe", "bottle", "disc"]), st.integers(0, 999))
@settings(deadline=None, max_examples=40)
def test_a_turned_piece_has_turned_properties(kind, seed):
    rng = np.random.default_rng(seed)
    one, R, p = piece(kind, rng), turn(rng), rng.normal(size=3)
    found = mass_properties([one])
    moved = mass_properties([one.moved(p, R)])
    assert_same(moved, found.volume, R @ found.center + p, R @ found.inertia @ R.T, 1e-9)
    scaled = mass_properties([one.scaled(2.0)])
    assert_same(scaled, 8.0 * found.volume, 2.0 * found.center, 4.0 * found.inertia, 1e-11)


def test_a_rounded_lathe_is_the_limit_of_fine_profiles():
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 400)
    fine = np.column_stack([0.05 + 0.01 * np.cos(angles), 0.01 * np.sin(angles)])
    profile = np.concatenate([[[0.0, -0.01]], fine, [[0.0, 0.01]]])
    expected = mass_properties([Lathe(profile)])
    assert_same(mass_properties([Lathe([[0.0, 0.0], [0.05, 0.0]], 0.01)]), *expected, 1e-5)


def test_two_halves_are_the_whole():
    halves = [box((0.1, 0.2, 0.15), (0.0, 0.0, z)) for z in (-0.075, 0.075)]
    assert_same(mass_properties(halves), *mass_properties([box((0.1, 0.2, 0.3))]))


@pytest.mark.parametrize(
    ("piece", "kind"),
    [
        (HalfSpace(), "half-space"),
        (Lathe([[1, 0], [2, 0], [2, 1], [1, 1]], half_angle=0.3), "sector"),
        (box((1.0, 1.0, 1.0), rounding=0.1), "rounded hull"),
    ],
)
def test_pieces_without_mass_are_refused(piece, kind):
    with pytest.raises(InvalidModelError, match=rf"pieces\[1\] is a {kind}"):
        mass_properties([ball(1.0), piece])
