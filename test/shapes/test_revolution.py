"""Profiles cut into convex parts, and surfaces of the library's models."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unc_physics import load_model
from unc_physics.shapes import household_meshes as meshes
from unc_physics.shapes.distance import distance_of_bodies, identity_frame
from unc_physics.shapes.pieces import Hull, Lathe, ball, box, convex_outline, piece_arrays
from unc_physics.shapes.recipes import RECIPES
from unc_physics.shapes.revolution import convex_parts, lathe_pieces, turns
from unc_physics.shapes.surface_error import distances_of_points, surface_error

TOLERANCE = 7e-4
OUTSIDE, INSIDE = 5e-5, 7e-4  # agreed surface errors [m]
FILLED = {"can": 3e-3}  # the depth of its lids below the rims


def contains(polygon, points):
    """Whether a simple polygon contains each point (k, 2)."""
    a, b = polygon, np.roll(polygon, -1, axis=0)
    above = (a[:, 1] > points[:, None, 1]) != (b[:, 1] > points[:, None, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        at = a[:, 0] + (points[:, None, 1] - a[:, 1]) / (b - a)[:, 1] * (b - a)[:, 0]
    return np.sum(above & (points[:, None, 0] < at), axis=1) % 2 == 1


@st.composite
def star_polygons(draw):
    """Simple polygons, star-shaped about (0.1, 0.1), often far from convex."""
    rng = np.random.default_rng(draw(st.integers(0, 99_999)))
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, draw(st.integers(5, 25))))
    if np.diff(angles, append=angles[0] + 2.0 * np.pi).max() > 0.9 * np.pi:
        angles = np.linspace(0.0, 2.0 * np.pi, len(angles), endpoint=False)
    radii = rng.uniform(0.02, 0.09, len(angles))
    return np.column_stack([0.1 + radii * np.cos(angles), 0.1 + radii * np.sin(angles)])


@given(star_polygons())
@settings(deadline=None, max_examples=60)
def test_parts_are_convex_cover_the_polygon_and_stick_out_little(polygon):
    rng = np.random.default_rng(0)
    points = rng.uniform(polygon.min(axis=0), polygon.max(axis=0), (1500, 2))
    parts = convex_parts(polygon, TOLERANCE)
    covered = np.any([contains(part, points) for part in parts], axis=0)
    assert covered[contains(polygon, points)].all()
    for part in parts:
        assert len(convex_outline(part)) == len(part)
        inside = points[contains(part, points) & ~contains(polygon, points)]
        a, along = polygon, np.roll(polygon, -1, axis=0) - polygon
        share = np.clip(((inside[:, None] - a) * along).sum(axis=2) / (along**2).sum(axis=1), 0.0, 1.0)
        away = np.linalg.norm(inside[:, None] - a - share[..., None] * along, axis=2).min(axis=1)
        assert away.max(initial=0.0) < TOLERANCE * 1.05


def test_a_convex_profile_is_one_piece_and_a_tube_is_a_ring():
    solid = lathe_pieces(np.array([[0, 0], [0.05, 0], [0.04, 0.1], [0, 0.1]]), TOLERANCE)
    assert len(solid) == 1 and solid[0].whole
    tube = lathe_pieces(np.array([[0.04, 0], [0.05, 0], [0.05, 0.1], [0.04, 0.1]]), TOLERANCE)
    assert not any(sector.whole for sector in tube)
    assert len(tube) == np.ceil(np.pi / np.arccos(1.0 - TOLERANCE / 0.04))


def test_a_hollow_half_ball_takes_few_more_pieces_than_its_facets_need():
    """A facet on a sphere of radius R that sticks out by d has an area of at most 4 R d."""
    radius, wall = 0.06, 0.005
    turn = np.linspace(0.0, 0.5 * np.pi, 48)
    circle = np.column_stack([np.sin(turn), -np.cos(turn)])
    shell = lathe_pieces(np.concatenate([(radius + wall) * circle, radius * circle[::-1]]), TOLERANCE)
    needed = 2.0 * np.pi * radius**2 / (4.0 * radius * TOLERANCE)
    assert len(shell) < 1.25 * needed


@pytest.mark.parametrize("profile", [meshes.bowl_profile, meshes.mug_profile, meshes.plate_profile])
def test_pieces_of_hollow_bodies_cover_the_solid(profile):
    polygon = profile()
    rng = np.random.default_rng(1)
    flat = rng.uniform(polygon.min(axis=0), polygon.max(axis=0), (4000, 2))
    flat = flat[contains(polygon, flat)][:400]
    angle = rng.uniform(0.0, 2.0 * np.pi, len(flat))
    points = np.column_stack([flat[:, 0] * np.cos(angle), flat[:, 0] * np.sin(angle), flat[:, 1]])
    assert distances_of_points(lathe_pieces(polygon, TOLERANCE), points).max() < 1e-9


@pytest.mark.parametrize("name", [name for name, recipe in RECIPES.items() if recipe.pieces])
def test_surface_errors_of_household_models(name):
    vertices, triangles = RECIPES[name].mesh()
    model = load_model(name)
    pieces = [piece.moved(-model.origin, np.eye(3)) for piece in model.pieces]
    assert len(pieces) == len(RECIPES[name].pieces())
    error = surface_error(pieces, vertices[triangles], 2000)
    assert error.outside < OUTSIDE
    assert error.inside < FILLED.get(name, INSIDE) + 1e-9
    assert error.mean <= error.high <= max(error.outside, error.inside)


def test_a_can_stands_on_one_piece_and_lies_on_its_two_rims():
    can = load_model("can")
    low = can.bounds[0, 2]
    ends = [piece.profile[:, 1] + piece.origin[2] for piece in can.pieces]
    assert sum(heights.min() < low + 1e-9 for heights in ends) == 1
    radii = [piece.profile[:, 0].max() for piece in can.pieces]
    assert sorted(radii) == pytest.approx([0.0365, 0.038, 0.038], abs=1e-9)


def test_a_surface_error_is_the_distance_by_which_a_piece_is_off():
    vertices, triangles = RECIPES["brick"].mesh()
    long = [Lathe([[0.0, 0.0], [0.5, 0.0], [0.5, 0.071], [0.0, 0.071]])]
    assert surface_error(long, vertices[triangles], 200).outside < 1e-12
    small = RECIPES["brick"].pieces()[0].scaled(0.9)
    corner = 0.1 * np.linalg.norm(np.abs(vertices).max(axis=0))
    assert surface_error([small], vertices[triangles], 2000).outside == pytest.approx(corner, rel=1e-12)


@pytest.mark.parametrize("radius", [0.01, 0.02])
def test_a_ball_rolls_around_a_bowl_without_a_ridge(radius):
    """Inner sides are chords: they rise into the hollow by the tolerance, and meet in valleys only."""
    bowl = load_model("bowl")
    pieces = [piece.moved(-bowl.origin, np.eye(3)) for piece in bowl.pieces]
    arrays = piece_arrays([pieces, [ball(radius)]])
    for share in (0.2, 0.5, 0.7):
        turn = 0.5 * np.pi * share  # the inner wall, as in `bowl_profile`
        along = np.array([0.050 * np.cos(turn), 0.058 * np.sin(turn)])
        normal = np.array([-along[1], along[0]]) / np.linalg.norm(along)
        outer = np.array([0.030 + 0.050 * np.sin(turn), 0.004 + 0.058 * (1.0 - np.cos(turn))])
        r, z = outer + (0.005 + radius) * normal
        gaps, slopes = [], []
        for azimuth in np.linspace(0.0, 2.0, 230):
            out, side = np.array([np.cos(azimuth), np.sin(azimuth), 0.0]), [-np.sin(azimuth), np.cos(azimuth)]
            at = np.array([identity_frame(), identity_frame()])
            at[1, :3] = r * out + [0.0, 0.0, z]
            gap, found = distance_of_bodies(at, arrays.pieces, arrays.rows, arrays.first)
            gaps.append(gap)
            slopes.append(float(found[0, :2] @ side))
        assert -INSIDE < min(gaps) and max(gaps) < OUTSIDE
        assert np.abs(slopes).max() < np.sin(0.25)  # half of a sector, and of a facet across it
        # the gap widens up to a seam and narrows behind it: a ridge would do the opposite
        jumps = np.flatnonzero(np.abs(np.diff(slopes)) > 0.1)
        assert len(jumps) > 3
        for k in jumps:
            assert slopes[k] > 0.0 > slopes[k + 1]


@pytest.mark.parametrize("name", ["can", "bottle", "plate", "bowl"])
def test_turns_about_the_axis_leave_round_models_unchanged(name):
    np.testing.assert_allclose(turns(load_model(name).pieces), np.diag([0.0, 0.0, 1.0]), atol=1e-12)


def test_only_bodies_of_revolution_about_the_origin_have_such_turns():
    along_x = Hull(np.array([[-0.1, 0.0, 0.0], [0.1, 0.0, 0.0]]), 0.02)
    sector = Lathe(((0.05, 0.0), (0.1, 0.0), (0.1, 0.1)), half_angle=1.0)
    np.testing.assert_allclose(turns((ball(0.1),)), np.eye(3))
    np.testing.assert_allclose(turns((ball(0.1), along_x)), np.diag([1.0, 0.0, 0.0]))
    for pieces in (
        (box((0.1, 0.1, 0.1)),),
        (sector,),
        (along_x, ball(0.1, (0.0, 0.01, 0.0))),
        load_model("mug").pieces,
    ):
        assert not turns(tuple(pieces)).any()
