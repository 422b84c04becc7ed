"""Signed distances of pieces, judged by support functions: points and a plane between them prove each one."""

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pieces_at_random import KINDS, distance_of_pieces, gap_along, piece, reach, turn
from scipy.spatial.transform import Rotation

from unc_physics.shapes.pieces import HalfSpace, ball, box, cylinder

APART, DEEP = 1e-6, 1e-4  # agreed errors of distances apart, and of depths down to 5 mm [m]
TURN = (
    1e-5  # error of normals [rad], of pieces that touch: round-off of points over the distance of the cores
)
GAPS = (0.05, 0.01, 1e-3, 1e-4, 1e-6, 1e-9, 0.0, -1e-9, -1e-6, -1e-4, -1e-3, -5e-3, -0.02)


def frame(p, R):
    return np.concatenate([p, R.ravel()])


def measured(a, Ra, pa, b, Rb, pb):
    return distance_of_pieces([a], frame(pa, Ra), [b], frame(pb, Rb))


def moved_to_gap(a, Ra, pa, b, Rb, direction, gap):
    """A position of b at which the pieces are a wanted distance apart, coming along a direction."""
    along = 0.4
    for _ in range(60):
        found = measured(a, Ra, pa, b, Rb, pa + along * direction)
        slope = found.normal @ direction
        if abs(found.distance - gap) < 1e-12 or abs(slope) < 0.05:
            break
        along -= (found.distance - gap) / (slope if found.distance > 0.0 else max(slope, 0.3))
    return pa + along * direction


def poses(kind_a, kind_b, seed):
    rng = np.random.default_rng(seed)
    a, b = piece(kind_a, rng), piece(kind_b, rng)
    Ra, Rb, pa = turn(rng), turn(rng), rng.normal(size=3)
    direction = rng.normal(size=3)
    if rng.random() < 0.3:
        direction = np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
    direction /= np.linalg.norm(direction)
    return a, Ra, pa, b, Rb, moved_to_gap(a, Ra, pa, b, Rb, direction, GAPS[seed % len(GAPS)])


@pytest.mark.parametrize("kinds", [*itertools.combinations_with_replacement(KINDS, 2)], ids="-".join)
def test_a_plane_between_the_points_proves_the_distance(kinds):
    rng = np.random.default_rng(sum(map(len, kinds)))
    directions = rng.normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for seed in range(2 * len(GAPS)):
        a, Ra, pa, b, Rb, pb = pose = poses(*kinds, seed)
        found = measured(*pose)
        n, d = found.normal, found.distance
        tolerance = APART if d > 0.0 else DEEP
        assert abs(np.linalg.norm(n) - 1.0) < 1e-12
        # the points are d apart along the normal, and each is the farthest of its piece
        assert np.abs(found.point_b - found.point_a - d * n).max() < tolerance
        assert abs(found.point_a @ n - reach(a, Ra, pa, n)[0]) < tolerance + TURN
        assert abs(-found.point_b @ n - reach(b, Rb, pb, -n)[0]) < tolerance + TURN
        assert abs(gap_along(a, Ra, pa, b, Rb, pb, n)[0] - d) < tolerance
        # no direction shows a wider gap: of overlapping pieces the depth is the least one
        assert gap_along(a, Ra, pa, b, Rb, pb, directions).max() < d + tolerance


def test_depths_of_boxes_are_those_along_their_15_axes():
    """The separating axes of two boxes are the normals of their faces and the products of their edges."""
    rng = np.random.default_rng(1)
    overlapping = 0
    for _ in range(600):
        size_a, size_b = rng.uniform(0.02, 0.12, (2, 3))
        Ra, Rb = turn(rng), turn(rng)
        pb = rng.normal(0.0, 0.03, 3)
        axes = np.array([*Ra.T, *Rb.T, *(np.cross(u, v) for u in Ra.T for v in Rb.T)])
        lengths = np.linalg.norm(axes, axis=1)
        axes = axes[lengths > 1e-9] / lengths[lengths > 1e-9, None]
        gap = (np.abs(axes @ pb) - 0.5 * (np.abs(axes @ Ra) @ size_a + np.abs(axes @ Rb) @ size_b)).max()
        if gap < 0.0:
            overlapping += 1
            found = measured(box(size_a), Ra, np.zeros(3), box(size_b), Rb, pb)
            assert found.distance == pytest.approx(gap, abs=1e-9)
    assert overlapping > 300


@pytest.mark.parametrize("kind", KINDS)
def test_a_half_space_is_reached_by_the_lowest_point(kind):
    for seed in range(8):
        rng = np.random.default_rng(seed)
        b, R, p, plane = (
            piece(kind, rng),
            turn(rng),
            rng.normal(size=3),
            HalfSpace((0.1, 0.2, 0.3), rng.normal(size=3)),
        )
        lowest = -reach(b, R, p, -plane.normal)[0]
        for first in (True, False):
            at = frame(np.zeros(3), np.eye(3)), frame(p, R)
            found = (
                distance_of_pieces([plane], at[0], [b], at[1])
                if first
                else distance_of_pieces([b], at[1], [plane], at[0])
            )
            assert found.distance == pytest.approx(lowest - plane.normal @ plane.point, abs=1e-12)
            assert found.normal == pytest.approx(plane.normal if first else -plane.normal, abs=1e-12)


@given(
    kinds=st.tuples(st.sampled_from(KINDS), st.sampled_from(KINDS)),
    gap=st.sampled_from([g for g in GAPS if g > -1e-3]),
    seed=st.integers(0, 2**32 - 1),
)
@settings(deadline=None, max_examples=200)
def test_the_order_of_bodies_the_world_and_mirrors_do_not_matter(kinds, gap, seed):
    """Where nearest points are unique, and a shift of 1e-7 m does not move them a hundred times as far."""
    rng = np.random.default_rng(seed)
    a, b = piece(kinds[0], rng), piece(kinds[1], rng)
    Ra, Rb, Q = (Rotation.random(random_state=rng).as_matrix() for _ in range(3))
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    pa, shift = np.zeros(3), 0.3 * rng.normal(size=3)
    pb = moved_to_gap(a, Ra, pa, b, Rb, direction, gap)
    found = measured(a, Ra, pa, b, Rb, pb)
    moved = measured(a, Ra, pa, b, Rb, pb + 1e-7 * rng.normal(size=3))
    assume(np.abs(moved.point_a - found.point_a).max() < 1e-5 and moved.normal @ found.normal > 1.0 - 1e-10)
    swapped = measured(b, Rb, pb, a, Ra, pa)
    turned = measured(a, Q @ Ra, Q @ pa + shift, b, Q @ Rb, Q @ pb + shift)
    for other, normal, points in (
        (swapped, -swapped.normal, (swapped.point_b, swapped.point_a)),
        (turned, turned.normal @ Q, ((turned.point_a - shift) @ Q, (turned.point_b - shift) @ Q)),
    ):
        assert other.distance == pytest.approx(found.distance, abs=1e-9)
        np.testing.assert_allclose(normal, found.normal, atol=1e-8)
        np.testing.assert_allclose(points, (found.point_a, found.point_b), atol=1e-8)


def test_bodies_of_several_pieces_have_the_distance_of_the_nearest():
    wall, post = box((0.1, 0.1, 0.02), (0.0, 0.0, -0.2)), cylinder(0.02, 0.3)
    at = frame(np.zeros(3), np.eye(3)), frame(np.array([0.1, 0.0, 0.0]), np.eye(3))
    found = distance_of_pieces([wall, post], at[0], [ball(0.03), ball(0.01, (0.0, 0.0, 5.0))], at[1])
    assert found.distance == pytest.approx(0.1 - 0.02 - 0.03, abs=1e-9)
    assert found.point_a == pytest.approx([0.02, 0.0, 0.0], abs=1e-6)
