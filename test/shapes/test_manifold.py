"""Contacts of pieces: they support a body as its outline does. Seams and stacks: test/physics."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pieces_at_random import distance_of_pieces
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from unc_physics import load_model
from unc_physics.compiler import kernel
from unc_physics.compiler.arrays import empty
from unc_physics.shapes.columns import CONTACT, GAP, HALF_SPACE, KIND, NORMAL, POINT, POLYGON, POSITION
from unc_physics.shapes.manifold import MOST_OF_PIECES, contacts_of_pieces
from unc_physics.shapes.pieces import HalfSpace, Lathe, box, capsule, cylinder, piece_arrays
from unc_physics.shapes.support import center, unit
from unc_physics.spatial.vectors import minus, plus, triple

FAR = 1e-3
FLOOR = [HalfSpace()]
TABLE = [box((1.0, 1.0, 0.1), (0.0, 0.0, -0.05))]


def frame(position=(0.0, 0.0, 0.0), rotation=None):
    R = np.eye(3) if rotation is None else rotation
    return np.concatenate([np.asarray(position, float), np.ravel(R)])


def yaw(angle):
    return Rotation.from_euler("z", angle).as_matrix()


@kernel
def contacts_of_all(frames, pieces, rows, first, far, lean):
    """Contacts (n, CONTACT) of all pairs of two bodies' pieces, with normals from the first body."""
    out, work, polygons = empty((256, CONTACT)), empty((12, 3)), empty((3, POLYGON, 3))
    base, end = triple(frames[0], POSITION), 0
    for i in range(first[0], first[1]):
        for j in range(first[1], first[2]):
            a, b, side = (j, i, -1.0) if pieces[j, KIND] == HALF_SPACE else (i, j, 1.0)
            away = minus(center(b, base, frames, pieces), center(a, base, frames, pieces))
            n = unit(plus(away, (0.0, 0.0, 1e-12)))
            load = lean[0], lean[1], lean[2]
            found, _, _ = contacts_of_pieces(
                a, b, n, False, far, load, base, frames, pieces, rows, work, polygons, out, end
            )
            for k in range(end, end + found):
                for c in range(NORMAL, NORMAL + 3):
                    out[k, c] *= side
            end += found
    return out[:end].copy()


def contacts(a, frame_a, b, frame_b, lean=(1.0, 0.0, 0.0), far=FAR):
    """Points (n, 3) in world axes, gaps and normals of contacts."""
    arrays = piece_arrays([a, b])
    frames, lean = np.array([frame_a, frame_b]), np.asarray(lean, float)
    rows = contacts_of_all(frames, arrays.pieces, arrays.rows, arrays.first, far, lean)
    return rows[:, POINT : POINT + 3] + frame_a[:3], rows[:, GAP], rows[:, NORMAL : NORMAL + 3]


def supports(points, at):
    """Whether the outline of points (n, 2) contains a point."""
    hull = ConvexHull(points)
    return bool((hull.equations[:, :2] @ at + hull.equations[:, 2]).max() < 0.0)


@pytest.mark.parametrize("ground", [FLOOR, TABLE])
@given(angle=st.floats(0.0, 6.3), load=st.floats(0.0, 6.3))
@settings(deadline=None, max_examples=30)
def test_a_can_is_supported_by_its_true_rim_at_every_yaw(ground, angle, load):
    """It tips when gravity's line leaves the circle of its rim, whatever its yaw and the load's direction."""
    lean = np.array([np.cos(load), np.sin(load), 0.0])
    for top in ([cylinder(0.03, 0.1)], [cylinder(0.03, 0.05), cylinder(0.02, 0.1)]):
        low = 0.05 if len(top) == 1 else 0.025
        if len(top) == 2:
            top[1] = top[1].moved((0.0, 0.0, 0.06), np.eye(3))
        points, gaps, normals = contacts(ground, frame(), top, frame((0.1, 0.2, low), yaw(angle)), lean)
        assert 3 <= len(points) <= 4
        assert ((points - [0.1, 0.2, 0.0]) @ lean).max() == pytest.approx(0.03, abs=1e-9)
        assert np.abs(gaps).max() < 1e-12
        np.testing.assert_allclose(normals, np.tile([0.0, 0.0, 1.0], (len(points), 1)), atol=1e-9)
        assert np.linalg.norm(points[:, :2] - [0.1, 0.2], axis=1).max() < 0.03 + 1e-12


@pytest.mark.parametrize("ground", [FLOOR, TABLE])
@pytest.mark.parametrize(
    ("name", "upside_down"), [("can", False), ("can", True), ("mug", False), ("plate", False)]
)
def test_a_round_body_tips_at_the_same_angle_at_every_yaw(ground, name, upside_down):
    """Also where it still leans by a millionth, and where its centre of mass is off the axis of its rim."""
    model = load_model(name)
    stand = Rotation.from_euler("x", 180.0 * upside_down, degrees=True).as_matrix()
    rng = np.random.default_rng(4)
    for angle in np.arange(8) * np.pi / 8.0 + 0.1:
        direction = rng.uniform(0.0, 2.0 * np.pi)
        lean = np.array([np.cos(direction), np.sin(direction), 0.0])
        tilt = Rotation.from_rotvec(rng.normal(0.0, 1e-6, 3)).as_matrix()
        at = np.array([0.1, 0.2, 0.0])
        high = at + [0.0, 0.0, 1.0]
        R = tilt @ yaw(angle) @ stand
        lowest = distance_of_pieces(ground, frame(), model.pieces, frame(high, R)).distance
        points, gaps, _ = contacts(ground, frame(), model.pieces, frame(high - [0, 0, lowest], R), lean)
        flat = (points - at)[gaps < 1e-6, :2]
        axis = (R @ model.origin)[:2]
        across = lean[:2] * (axis @ lean[:2])
        radius = np.linalg.norm(flat - axis, axis=1).max()
        reach = axis @ lean[:2] + np.sqrt(radius**2 - np.linalg.norm(axis - across) ** 2)
        assert supports(flat, (reach - 1e-6) * lean[:2])
        assert not supports(flat, (reach + 1e-6) * lean[:2])


def test_a_can_on_a_can_is_supported_by_the_smaller_rim():
    for k in range(12):
        lean = np.array([np.cos(k), np.sin(k), 0.0])
        points, _, normals = contacts(
            [cylinder(0.04, 0.1)], frame(), [cylinder(0.03, 0.1)], frame((0.0, 0.0, 0.1), yaw(0.3 * k)), lean
        )
        assert (points @ lean).max() == pytest.approx(0.03, abs=1e-9)
        assert normals[:, 2].min() > 1.0 - 1e-12


def test_a_sector_on_its_inner_edge_touches_along_its_axis():
    """A wedge of a cylinder stands on the edge between its two flat sides."""
    wedge = Lathe([[0, -0.05], [0.04, -0.05], [0.04, 0.05], [0, 0.05]], half_angle=math.pi / 6)
    up = np.array([[0.0, 0, 1], [0, -1, 0], [1, 0, 0]])  # its middle looks up, its axis lies along x
    for ground in (HalfSpace(), box((0.3, 0.3, 0.02), (0, 0, -0.01))):
        points, gaps, normals = contacts([wedge], frame((0, 0, 1e-4), up), [ground], frame())
        np.testing.assert_allclose(np.sort(points[:, 0]), [-0.05, 0.05], atol=1e-9)
        np.testing.assert_allclose(gaps, 1e-4, atol=1e-9)
        np.testing.assert_allclose(np.abs(normals[:, 2]), 1, atol=1e-9)


@pytest.mark.parametrize("ground", [FLOOR, TABLE])
@pytest.mark.parametrize("angle", np.linspace(0.0, 3.0, 7))
def test_a_can_on_its_side_touches_along_its_length(ground, angle):
    R = yaw(angle) @ Rotation.from_euler("y", 90, degrees=True).as_matrix()
    points, gaps, normals = contacts(ground, frame(), [cylinder(0.03, 0.1)], frame((0.0, 0.0, 0.03), R))
    assert len(points) == 2
    assert np.linalg.norm(points[0] - points[1]) == pytest.approx(0.1, abs=1e-9)
    assert np.abs(gaps).max() < 1e-9 and normals[:, 2].min() > 1.0 - 1e-12
    points, *_ = contacts(ground, frame(), [capsule(0.03, 0.1)], frame((0.0, 0.0, 0.03), R))
    assert np.linalg.norm(points[0] - points[-1]) == pytest.approx(0.1, abs=1e-9)


@given(x=st.floats(-0.1, 0.1), y=st.floats(-0.1, 0.1), angle=st.floats(0.0, 6.3), world=st.integers(0, 50))
@settings(deadline=None, max_examples=60)
def test_a_box_on_a_box_is_supported_by_their_overlap(x, y, angle, world):
    """The contacts are all corners of the overlap: it tips where its outline does under any load."""
    Q = Rotation.random(random_state=world).as_matrix()
    lower, upper = [box((0.2, 0.2, 0.1))], [box((0.1, 0.16, 0.1))]
    points, gaps, normals = contacts(
        lower, frame(rotation=Q), upper, frame(Q @ [x, y, 0.1 + 1e-6], Q @ yaw(angle))
    )
    assert len(points) <= MOST_OF_PIECES and np.abs(gaps - 1e-6).max() < 1e-9
    np.testing.assert_allclose(normals @ Q, np.tile([0.0, 0.0, 1.0], (len(points), 1)), atol=1e-6)
    flat = (points @ Q)[:, :2]
    corners = np.array([[0.05, 0.08], [-0.05, 0.08], [-0.05, -0.08], [0.05, -0.08]])
    overlap = clipped(corners @ yaw(angle)[:2, :2].T + [x, y], 0.1)
    assert len(overlap) > 2  # the boxes are too near each other to miss
    assert np.linalg.norm(flat[:, None] - overlap, axis=2).min(axis=0).max() < 1e-6
    assert np.linalg.norm(flat[:, None] - overlap, axis=2).min(axis=1).max() < 1e-6


def clipped(polygon, half):
    """A convex polygon within a square of half side ``half`` (Sutherland and Hodgman)."""
    for axis in range(2):
        for side in (1.0, -1.0):
            kept = []
            for p, q in zip(np.roll(polygon, 1, axis=0), polygon, strict=True):
                a, b = half - side * p[axis], half - side * q[axis]
                if (a < 0.0) != (b < 0.0):
                    kept.append(p + a / (a - b) * (q - p))
                if b >= 0.0:
                    kept.append(q)
            polygon = np.array(kept)
    return polygon


@given(seed=st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=150)
def test_the_order_of_bodies_and_the_world_do_not_matter(seed):
    rng = np.random.default_rng(seed)
    a, b = [box((0.1, 0.12, 0.14))], [cylinder(0.03, 0.1)]
    Ra, Rb, Q = (Rotation.random(random_state=rng).as_matrix() for _ in range(3))
    direction, lean, shift = rng.normal(size=(3, 3))
    direction /= np.linalg.norm(direction)
    along = 0.3
    for _ in range(30):
        along -= distance_of_pieces(a, frame(rotation=Ra), b, frame(along * direction, Rb)).distance - 2e-4
    at = frame(rotation=Ra), frame(along * direction, Rb)
    points, gaps, normals = contacts(a, at[0], b, at[1], lean)
    swapped = contacts(b, at[1], a, at[0], lean)
    assert len(points) >= 1
    turned = contacts(a, frame(shift, Q @ Ra), b, frame(Q @ at[1][:3] + shift, Q @ Rb), Q @ lean)
    mirror = np.diag([1.0, -1.0, 1.0])  # both shapes are their own mirror images
    mirrored = contacts(
        a,
        frame(rotation=mirror @ Ra @ mirror),
        b,
        frame(mirror @ at[1][:3], mirror @ Rb @ mirror),
        mirror @ lean,
    )
    order = np.lexsort(points.round(7).T)
    for other, back, sign in (
        (swapped, lambda x: x, -1.0),
        ((turned[0] - shift, *turned[1:]), lambda x: x @ Q, 1.0),
        (mirrored, lambda x: x @ mirror, 1.0),
    ):
        found = back(other[0])
        same = np.lexsort(found.round(7).T)
        np.testing.assert_allclose(found[same], points[order], atol=1e-9)
        np.testing.assert_allclose(other[1][same], gaps[order], atol=1e-9)
        np.testing.assert_allclose(sign * back(other[2])[same], normals[order], atol=1e-9)
