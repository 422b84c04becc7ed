"""Shapes that are recognised in meshes, against the sizes from which the meshes were made."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from unc_physics.shapes import household_meshes as meshes
from unc_physics.shapes.mass_properties import mass_properties
from unc_physics.shapes.pieces import Hull, Lathe
from unc_physics.shapes.recipes import RECIPES
from unc_physics.shapes.recognition import CORNERS, recognized
from unc_physics.shapes.surface_error import distances_of_points, surface_error

MOST = 32
lengths = st.floats(0.01, 1.0)


def triangles(vertices, faces):
    return np.asarray(vertices, float)[np.asarray(faces)]


def of(mesh):
    return triangles(mesh.vertices, mesh.faces)


@st.composite
def motions(draw):
    """A rotation and a shift."""
    rng = np.random.default_rng(draw(st.integers(0, 99_999)))
    return Rotation.random(random_state=rng).as_matrix(), rng.uniform(-1.0, 1.0, 3)


def moved(corners, motion):
    turn, shift = motion
    return corners @ turn.T + shift


def found(corners, kind):
    name, pieces = recognized(corners, MOST)
    assert name == kind
    return pieces


@given(lengths, lengths, lengths, motions())
@settings(deadline=None, max_examples=20)
def test_boxes(x, y, z, motion):
    (piece,) = found(moved(of(trimesh.creation.box((x, y, z))), motion), "box")
    size = max(x, y, z)
    np.testing.assert_allclose(piece.points.mean(axis=0), motion[1], atol=1e-9 * size)
    assert mass_properties([piece]).volume == pytest.approx(x * y * z, rel=1e-9)
    corners = moved(np.array([[x, y, z]]) / 2.0, motion)
    assert np.linalg.norm(piece.points - corners, axis=1).min() < 1e-9 * size


@given(lengths, motions())
@settings(deadline=None, max_examples=20)
def test_balls(radius, motion):
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    (piece,) = found(moved(of(mesh), motion), "sphere")
    assert isinstance(piece, Hull) and piece.rounding == pytest.approx(radius, rel=1e-9)
    np.testing.assert_allclose(piece.points[0], motion[1], atol=1e-9 * radius)


@given(lengths, lengths, st.integers(24, 90), motions())
@settings(deadline=None, max_examples=20)
def test_cylinders(radius, length, sections, motion):
    mesh = trimesh.creation.cylinder(radius, length, sections=sections)
    (piece,) = found(moved(of(mesh), motion), "cylinder")
    size = max(2.0 * radius, length)
    assert isinstance(piece, Lathe)
    assert piece.profile[:, 0].max() == pytest.approx(radius, abs=CORNERS * size)
    assert np.ptp(piece.profile[:, 1]) == pytest.approx(length, abs=CORNERS * size)
    assert abs(piece.axes[:, 2] @ motion[0][:, 2]) > 1.0 - 1e-6
    middle = piece.origin + piece.axes[:, 2] * piece.profile[:, 1].mean()
    np.testing.assert_allclose(middle, motion[1], atol=CORNERS * size)


@given(lengths, lengths, motions())
@settings(deadline=None, max_examples=20)
def test_capsules(radius, length, motion):
    mesh = trimesh.creation.capsule(height=length + 0.1 * radius, radius=radius, count=[32, 48])
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    (piece,) = found(moved(of(mesh), motion), "capsule")
    size = length + 2.1 * radius
    assert piece.rounding == pytest.approx(radius, abs=CORNERS * size)
    straight = piece.points[1] - piece.points[0]
    assert np.linalg.norm(straight) == pytest.approx(length + 0.1 * radius, abs=2.0 * CORNERS * size)
    assert abs(straight @ motion[0][:, 2]) > (1.0 - 1e-5) * np.linalg.norm(straight)


def test_a_cylinder_of_equal_moments_has_its_axis_from_its_ends():
    """The principal moments of r = 1, h = sqrt(3) are equal."""
    mesh = trimesh.creation.cylinder(1.0, np.sqrt(3.0), sections=64)
    (piece,) = found(of(mesh), "cylinder")
    assert abs(piece.axes[2, 2]) == pytest.approx(1.0)


def test_a_side_with_points_all_over_is_a_cylinder():
    mesh = trimesh.creation.cylinder(0.03, 0.1, sections=96).subdivide_to_size(0.013)
    on_side = np.abs(mesh.vertices[:, 2]) < 0.0499
    angle = np.arctan2(mesh.vertices[:, 1], mesh.vertices[:, 0])
    vertices = np.array(mesh.vertices)
    vertices[on_side, :2] = 0.03 * np.column_stack([np.cos(angle), np.sin(angle)])[on_side]
    (piece,) = found(triangles(vertices, mesh.faces), "cylinder")
    assert piece.profile[:, 0].max() == pytest.approx(0.03, rel=1e-3)


def bevelled(bevel):
    """A cube of edge 1 with flat bevels: what is cut off of each edge is so wide."""
    cut = 1.0 - 2.0 * bevel
    sizes = np.ones((3, 3)) * cut + np.eye(3) * (1.0 - cut)
    corners = np.concatenate([trimesh.creation.box(size).vertices for size in sizes])
    return of(trimesh.convex.convex_hull(corners))


def test_a_bevelled_cube_is_no_box():
    assert recognized(bevelled(0.05), MOST) is None
    assert recognized(bevelled(0.005), MOST) is None
    found(bevelled(1e-4), "box")  # within the tolerance


@pytest.mark.parametrize(
    "mesh",
    [
        trimesh.creation.cylinder(0.1, 0.2, sections=6),  # a nut
        trimesh.creation.cylinder(0.1, 0.2, sections=16),
        trimesh.creation.icosphere(subdivisions=1, radius=0.1),
        trimesh.creation.cylinder(0.1, 0.2).slice_plane([0.0, 0.0, 0.0], [1.0, 0.0, 0.0]).convex_hull,
        trimesh.creation.icosphere(subdivisions=3).slice_plane([0.0] * 3, [0.0, 0.0, 1.0]).convex_hull,
    ],
    ids=["nut", "16 sides", "coarse ball", "half a cylinder", "half a ball"],
)
def test_shapes_that_are_not_round(mesh):
    name = (recognized(of(mesh), MOST) or [None])[0]
    assert name in (None, "surface of revolution")
    if name is not None:  # half a ball is one
        assert mesh.volume == pytest.approx(2.0 / 3.0 * np.pi, rel=0.02)


def test_meshes_of_faces_along_three_axes_are_boxes():
    foot, back = trimesh.creation.box((0.12, 0.06, 0.008)), trimesh.creation.box((0.008, 0.06, 0.09))
    back.apply_translation([-0.056, 0.0, 0.041])
    bracket = foot.union(back)
    table = trimesh.creation.box((1.0, 0.6, 0.03))
    for x, y in ((0.46, 0.26), (0.46, -0.26), (-0.46, 0.26), (-0.46, -0.26)):
        leg = trimesh.creation.box((0.05, 0.05, 0.7))
        leg.apply_translation([x, y, -0.355])
        table = table.union(leg)
    motion = Rotation.from_rotvec([0.3, -1.0, 0.4]).as_matrix(), np.array([0.1, 0.2, -0.3])
    for mesh, count in ((bracket, 2), (table, 5), (bracket.subdivide().subdivide(), 2)):
        corners = moved(of(mesh), motion)
        pieces = found(corners, "boxes")
        assert len(pieces) == count and surface_error(pieces, corners, 1000).largest < 1e-12
        assert recognized(corners, count - 1) is None, "too many"
    assert len(found(triangles(*meshes.bin()), "boxes")) == 9
    leaning = trimesh.creation.box((0.12, 0.06, 0.02))
    leaning.apply_transform(trimesh.transformations.rotation_matrix(0.01, (0.0, 1.0, 0.0)))
    assert recognized(of(leaning.union(back)), MOST) is None


def test_a_box_with_a_small_hole_is_no_box():
    plate = trimesh.creation.box((0.1, 0.1, 0.01))
    drill = trimesh.creation.cylinder(0.002, 0.05)
    assert recognized(of(plate.difference(drill)), MOST) is None


@pytest.mark.parametrize("name", ["bottle", "bowl", "can", "pin", "plate"])
def test_household_models_are_surfaces_of_revolution(name):
    motion = Rotation.from_rotvec([0.3, -1.0, 0.4]).as_matrix(), np.array([0.1, 0.2, -0.3])
    corners = moved(triangles(*RECIPES[name].mesh()), motion)
    pieces = found(corners, "surface of revolution")
    assert len(pieces) <= MOST
    error = surface_error(pieces, corners, 1000)
    extent = np.ptp(corners, axis=(0, 1)).max()
    assert error.outside < 0.015 * extent and error.high < 0.03 * extent
    hull = trimesh.convex.convex_hull(corners.reshape(-1, 3)).vertices
    assert distances_of_points(pieces, hull).max() < 0.002 * extent, "the body stands and rolls as its mesh"


def test_cones_and_tubes():
    (cone,) = found(of(trimesh.creation.cone(0.04, 0.1, sections=64)), "surface of revolution")
    assert mass_properties([cone]).volume == pytest.approx(np.pi * 0.04**2 * 0.1 / 3.0, rel=1e-9)
    tube = found(of(trimesh.creation.annulus(0.03, 0.05, 0.1, sections=64)), "surface of revolution")
    assert distances_of_points(tube, np.zeros((1, 3)))[0] == pytest.approx(0.03, rel=0.03)
    turn = np.linspace(0.0, 2.0 * np.pi, 90)
    wall = 0.04 * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(90)])
    depth = -distances_of_points(tube, wall)  # in the nearest sector; 0 where two meet
    assert depth.min() > -1e-9 and depth.max() > 0.004


def test_a_mug_is_no_surface_of_revolution():
    assert recognized(triangles(*meshes.mug()), MOST) is None
