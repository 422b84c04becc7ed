"""Pieces of meshes: hulls and convex decompositions, and the surface error that judges them."""

import numpy as np
import pytest
import trimesh
from example_meshes import MESHES
from scipy.spatial.transform import Rotation

from unc_physics import Sphere, SpherePacking
from unc_physics.checks.errors import InvalidMeshError, InvalidOptionError, NotSupportedError
from unc_physics.descriptions.parts import Shape
from unc_physics.descriptions.shape_solid import shape_solid
from unc_physics.shapes import household_meshes as meshes
from unc_physics.shapes import mesh_pieces as module
from unc_physics.shapes.distance import even_directions, signed_distance
from unc_physics.shapes.mass_properties import mass_properties
from unc_physics.shapes.mesh_pieces import hull_piece, hull_pieces, mesh_pieces, simple_pieces
from unc_physics.shapes.packing import pack_solid
from unc_physics.shapes.pieces import ball, box
from unc_physics.shapes.solid_mesh import make_solid
from unc_physics.shapes.surface_error import distances_of_points, distances_outside, surface_error


def solid_of(name, *meshes):
    mesh = trimesh.util.concatenate(meshes)
    return make_solid(name, mesh.vertices, mesh.faces)


def bracket():
    """A bent sheet of two plates, 100 x 50 x 10 mm and 10 x 50 x 90 mm, at 100 degrees: not of boxes."""
    foot = trimesh.creation.box((0.1, 0.05, 0.01))
    wall = trimesh.creation.box((0.01, 0.05, 0.09))
    wall.apply_translation([0.005, 0.0, 0.045])
    wall.apply_transform(trimesh.transformations.rotation_matrix(np.radians(-10.0), (0.0, 1.0, 0.0)))
    wall.apply_translation([-0.05, 0.0, 0.0])
    return solid_of("bracket", foot.union(wall))


def test_parts_of_a_body_are_recognised_one_by_one():
    ball_mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.02)
    ball_mesh.apply_translation([0.0, 0.0, 0.1])
    solid = solid_of("two", trimesh.creation.box((0.1, 0.1, 0.1)), ball_mesh)
    pieces, kind = simple_pieces(solid)
    assert len(pieces) == 2 and set(kind.split(", ")) == {"box", "sphere"}
    assert pack_solid(solid, 20).pieces[0].points.shape == pieces[0].points.shape


def test_a_sealed_cavity_is_filled():
    pieces, kind = simple_pieces(make_solid("hollow ball", *MESHES["hollow ball"]()))
    assert kind == "hull" and len(pieces) == 1  # too coarse for a sphere


def test_a_nearly_convex_mesh_is_its_hull():
    rng = np.random.default_rng(2)
    points = rng.normal(size=(500, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    mesh = trimesh.convex.convex_hull(points * [0.1, 0.05, 0.02])
    found = mesh_pieces(solid_of("pebble", mesh))
    assert found.kind == "hull" and len(found.pieces) == 1 and found.note is None
    assert found.error.outside < 0.002 * found.extent and found.error.inside < 1e-6


def test_without_coacd_a_mesh_is_not_cut(monkeypatch):
    monkeypatch.setattr(module, "find_spec", lambda _: None)
    with pytest.raises(NotSupportedError, match="coacd, which cuts it into convex pieces, is not installed"):
        mesh_pieces(bracket())


@pytest.mark.parametrize("depth", [0.05, 0.01])
def test_a_hull_of_many_points_has_the_corners_that_its_depth_needs(depth):
    """Of n points, evenly on a unit ball, the triangles are 2.42 / n deep; without evenness it takes more."""
    mesh = trimesh.creation.icosphere(subdivisions=4)
    hull = hull_piece(np.asarray(mesh.vertices), depth)
    assert 1.0 < len(hull.points) / (2.42 / depth) < 2.1
    assert surface_error([hull], np.asarray(mesh.triangles), 500).outside < 1.001 * depth


def test_an_egg_of_many_triangles_is_as_near_as_an_ellipsoid_of_a_world():
    """Both are hulls, within 0.2 % of the extent."""
    mesh = trimesh.creation.icosphere(subdivisions=5)
    mesh.vertices *= np.array([0.05, 0.035, 0.025])
    (hull,) = mesh_pieces(solid_of("egg", mesh)).pieces
    radii = np.linalg.norm(hull.points / [0.05, 0.035, 0.025], axis=1)
    np.testing.assert_allclose(radii, 1.0, atol=1e-6)
    own = shape_solid(Shape("ellipsoid", np.eye(4), (0.05, 0.035, 0.025))).pieces
    for pieces in ([hull], own):
        assert surface_error(pieces, np.asarray(mesh.triangles)).outside < module.HULL_DEPTH * 0.1
    assert len(own[0].points) < len(hull.points) < 1.4 * len(own[0].points)


def test_a_tolerance_makes_a_ring_finer():
    """n sectors are off the hole by half of its radius times 1 - cos(pi / n), 0.1 mm of 40 mm with 32."""
    ring = solid_of("ring", trimesh.creation.torus(0.045, 0.005, major_sections=100, minor_sections=32))
    coarse = mesh_pieces(ring)
    assert coarse.error.largest > 1e-4 and len(coarse.pieces) <= module.PIECES
    found = mesh_pieces(ring, tolerance=5e-5)
    assert found.error.largest <= 5e-5 and 45 <= len(found.pieces) < 60
    with pytest.raises(
        InvalidMeshError, match=r"mm off its \d+ pieces, and 0.05 mm are allowed; most=64 asks"
    ):
        mesh_pieces(ring, 32, 5e-5)
    assert 30 <= len(mesh_pieces(ring, 32).pieces) <= 32, "as many as allowed"
    assert len(mesh_pieces(ring, tolerance=0.005).pieces) == len(coarse.pieces), "no coarser"


def test_a_bowl_is_round_inside_whatever_its_number_of_pieces():
    """32 facets on half a ball of radius R are pi R / 64 deep at least, 3.6 mm here."""
    turn = 0.5 * np.pi * np.linspace(0.0, 1.0, 33)[1:]
    circle = np.column_stack([np.sin(turn), -np.cos(turn)])
    profile = np.concatenate([0.08 * circle, 0.074 * circle[::-1]])
    solid = make_solid("bowl", *meshes.revolved(meshes.closed(profile, -0.08, -0.074), 64))
    found = mesh_pieces(solid)
    assert 0.9 * module.PIECES <= len(found.pieces) <= module.PIECES and found.note is None
    middle = solid.origin  # of the ball
    points = middle + 0.073 * even_directions(600)
    points = points[points[:, 2] < middle[2] - 0.01]
    np.testing.assert_allclose(distances_of_points(found.pieces, points), 1e-3, rtol=0, atol=1e-5)
    bowl = SpherePacking(
        "bowl", np.zeros((1, 3)), [0.1], np.eye(3), 1.0, np.zeros(3), 0.1, pieces=found.pieces
    )
    turn = Rotation.from_rotvec([0.4, 0.1, 0.0])
    for pose in (([0.0, 0.0, 0.0], turn.as_quat()), None):
        matrix = turn.as_matrix() if pose else np.eye(3)
        out = matrix @ [0.3, 0.0, -np.sqrt(0.91)]
        ball_in_it = Sphere(0.019, matrix @ middle + 0.054 * out)
        pairs = ((bowl, pose), (ball_in_it, None), 1), ((ball_in_it, None), (bowl, pose), -1)
        for (a, at), (b, to), side in pairs:
            found = signed_distance(a, at, b, to)
            assert found.distance == pytest.approx(1e-3, abs=1e-5)
            np.testing.assert_allclose(found.normal, -side * out, atol=1e-3)
            np.testing.assert_allclose(
                found.point_b - found.point_a, found.distance * found.normal, atol=1e-12
            )


def test_a_tolerance_decides_whether_few_sides_are_round():
    """The chords of 24 sides are 0.86 % of the radius deep."""
    solid = solid_of("rod", trimesh.creation.cylinder(0.05, 0.2, sections=24))
    assert mesh_pieces(solid).kind == "cylinder"
    assert mesh_pieces(solid, tolerance=5e-4).kind == "cylinder"
    found = mesh_pieces(solid, tolerance=3e-4)
    assert found.kind == "hull" and found.error.largest < 1e-6


def test_the_surface_error_sees_both_surfaces():
    """A hull over a bowl's opening is far from the mesh, though no point of the mesh is deep inside it."""
    pan = trimesh.creation.box((1.0, 1.0, 0.2)).difference(
        trimesh.creation.box(
            (0.9, 0.9, 0.2), transform=trimesh.transformations.translation_matrix([0, 0, 0.05])
        )
    )
    corners = np.asarray(pan.triangles)
    found = surface_error([box((1.0, 1.0, 0.2))], corners, 2000)
    assert found.outside < 1e-6
    assert found.inside == pytest.approx(0.15, rel=0.02)  # the lid over the bottom
    assert found.mean <= found.high <= found.largest


def test_distances_outside_are_those_of_a_ball():
    mesh = trimesh.creation.icosphere(subdivisions=4)
    points = np.random.default_rng(1).uniform(-2.0, 2.0, (3000, 3))
    expected = np.maximum(np.linalg.norm(points, axis=1) - 1.0, 0.0)
    np.testing.assert_allclose(distances_outside(np.asarray(mesh.triangles), points), expected, atol=3e-3)


def test_errors_of_a_shifted_ball():
    mesh = trimesh.creation.icosphere(subdivisions=4)
    found = surface_error([ball(1.0, (0.1, 0.0, 0.0))], np.asarray(mesh.triangles))
    assert found.outside == pytest.approx(0.1, abs=3e-3) and found.inside == pytest.approx(0.1, abs=3e-3)
    assert found.mean == pytest.approx(0.05, abs=3e-3)  # the mean of 0.1 |cos|


@pytest.mark.parametrize("value", [0, -1, 1.5, True, 20_000])
def test_numbers_of_pieces(value):
    with pytest.raises(InvalidOptionError, match="pieces must be an integer from 1"):
        mesh_pieces(bracket(), most=value)


def test_a_tolerance_that_the_pieces_miss(monkeypatch):
    monkeypatch.setattr(module, "_decomposed", lambda solid, *_: hull_pieces(solid))
    with pytest.raises(
        InvalidMeshError, match="mesh bracket is .* mm off its 1 piece, and 11.6 mm are allowed"
    ):
        mesh_pieces(bracket())
    assert mesh_pieces(bracket(), tolerance=0.1).kind == "hull of a mesh that is not convex"
    assert "of the extent" in hull_pieces(bracket()).note


def test_a_bracket_is_two_plates():
    pytest.importorskip("coacd")
    found = mesh_pieces(bracket())
    assert found.kind == "convex decomposition" and len(found.pieces) == 2
    assert mass_properties(found.pieces).volume == pytest.approx(bracket().volume, rel=0.02)
    assert found.error.largest < 0.01 * found.extent


def test_a_bin_with_thin_walls_gets_fine_pieces():
    """The coarse cuts close the bin: finer ones are tried until the error deserves no note."""
    pytest.importorskip("coacd")
    vertices, faces = meshes.bin()
    vertices[:, :2] *= 1.0 + vertices[:, 2:]  # walls that lean are no boxes
    found = mesh_pieces(make_solid("bin", vertices, faces), seconds=300.0)
    assert len(found.pieces) <= module.PIECES and found.note is None


def test_the_same_pieces_on_any_number_of_threads_and_no_time():
    pytest.importorskip("coacd")
    one, two = (mesh_pieces(bracket(), threads=threads) for threads in (1, 2))
    for a, b in zip(one.pieces, two.pieces, strict=True):
        np.testing.assert_array_equal(a.points, b.points)
    with pytest.raises(TimeoutError):
        mesh_pieces(bracket(), seconds=0.0)


def test_a_mesh_that_stops_the_cutting_program(monkeypatch):
    pytest.importorskip("coacd")
    from unc_physics.shapes import convex_parts

    monkeypatch.setattr(convex_parts, "__name__", "unc_physics.shapes.no_such_program")
    with pytest.raises(InvalidMeshError, match="cannot be cut into convex parts: coacd ends with"):
        mesh_pieces(bracket())
