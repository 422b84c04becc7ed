"""The kernels under the packer against brute force."""

import numpy as np
import pytest
import trimesh
from example_meshes import MESHES

from unc_physics.shapes import surface_gap as module
from unc_physics.shapes.solid_mesh import make_solid
from unc_physics.shapes.sphere_grid import nearest_sphere
from unc_physics.shapes.surface_gap import surface_gap
from unc_physics.shapes.triangle_tree import build_triangle_tree, nearest_on_mesh, winding_numbers

ROUND_OFF = 1e-13


def brute_distances(corners, points):
    """Distance of each point to each triangle, by trimesh."""
    pairs = np.broadcast_to(points[:, None], (len(points), len(corners), 3)).reshape(-1, 3)
    triangles = np.broadcast_to(corners, (len(points), *corners.shape)).reshape(-1, 3, 3)
    nearest = trimesh.triangles.closest_point(np.ascontiguousarray(triangles), pairs)
    return np.linalg.norm(nearest - pairs, axis=1).reshape(len(points), len(corners)).min(axis=1)


def solid_angles(corners, points):
    """Winding numbers about points as sums of solid angles (Van Oosterom and Strackee 1983)."""
    arms = corners[None] - points[:, None, None]
    a, b, c = np.moveaxis(arms, 2, 0)
    la, lb, lc = np.moveaxis(np.linalg.norm(arms, axis=3), 2, 0)
    along = la * lb * lc + (a * b).sum(axis=2) * lc + (b * c).sum(axis=2) * la + (c * a).sum(axis=2) * lb
    return np.arctan2(np.linalg.det(arms), along).sum(axis=1) / (2.0 * np.pi)


def test_winding_numbers(any_solid):
    """Also about points in cavities, beside corners and on lines through corners."""
    corners, rng = any_solid.corners, np.random.default_rng(2)
    points = rng.uniform(-1.2, 1.2, (200, 3)) * any_solid.bounding_radius
    points = np.concatenate([points, 0.999 * corners[:50, 0], corners[:50].mean(axis=1) * (1.0 - 1e-7)])
    found = winding_numbers(build_triangle_tree(corners), points)
    np.testing.assert_allclose(found, solid_angles(corners, points), atol=1e-6)


def test_distance_to_the_mesh(any_solid):
    tree = build_triangle_tree(any_solid.corners)
    points = np.random.default_rng(1).uniform(-1.5, 1.5, (100, 3))
    expected = brute_distances(any_solid.corners, points)
    for point, distance in zip(points, expected, strict=True):
        found, *q = nearest_on_mesh(tree, *point, 10.0)
        assert found == pytest.approx(distance, abs=ROUND_OFF)
        assert np.linalg.norm(point - q) == pytest.approx(distance, abs=ROUND_OFF)
        assert nearest_on_mesh(tree, *point, 0.9 * distance)[0] == 0.9 * distance


def test_degenerate_triangles_are_points_and_segments():
    corners = np.array([[[0.0, 0, 0]] * 3, [[1.0, 0, 0], [2.0, 0, 0], [3.0, 0, 0]]])
    tree = build_triangle_tree(corners)
    assert nearest_on_mesh(tree, 0.0, 0.4, 0.0, 10.0)[0] == pytest.approx(0.4, abs=ROUND_OFF)
    assert nearest_on_mesh(tree, 2.7, 0.0, 0.1, 10.0)[0] == pytest.approx(0.1, abs=ROUND_OFF)


def test_surface_gap_of_a_cube_with_its_inscribed_sphere():
    solid = make_solid("cube", *raw_cube())
    gap = surface_gap(solid.corners, np.array([[0.0, 0.0, 0.0, 0.5]]))
    assert 0.5 * (np.sqrt(3.0) - 1.0) <= gap <= 0.5 * (np.sqrt(3.0) - 1.0) * 1.01


def test_surface_gap_is_no_less_than_at_any_point():
    solid = make_solid("torus", *MESHES["torus"]())
    rng = np.random.default_rng(3)
    spheres = np.column_stack([0.6 * rng.normal(size=(30, 3)), rng.uniform(0.05, 0.2, 30)])
    u, v = np.sort(rng.random((2, 200)), axis=0)
    weights = np.stack([u, v - u, 1.0 - v], axis=1)
    points = np.einsum("pk,tkx->tpx", weights, solid.corners).reshape(-1, 3)
    distances = (np.linalg.norm(points[:, None] - spheres[:, :3], axis=2) - spheres[:, 3]).min(axis=1)
    assert distances.max() <= surface_gap(solid.corners, spheres) <= distances.max() * 1.05


@pytest.mark.parametrize("subdivisions", [2, 4])
def test_surface_gap_of_a_fine_ball_takes_a_few_queries_for_each_triangle(monkeypatch, subdivisions):
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    corners = np.asarray(mesh.triangles)
    radius = np.abs((corners[:, 0] * mesh.face_normals).sum(axis=1)).min()
    queries = []

    def counted(*args):
        queries.append(args)
        return nearest_sphere.py_func(*args)

    for name in ("bounded_gap", "copy_triangle", "distance_squared"):
        monkeypatch.setattr(module, name, getattr(module, name).py_func)
    monkeypatch.setattr(module, "nearest_sphere", counted)
    gap = module.surface_gap(corners, np.array([[0.0, 0.0, 0.0, radius]]))
    # the corners are at 1, and nothing is farther
    assert 1.0 - radius <= gap <= (1.0 - radius) * 1.01
    assert len(queries) <= 2 * len(corners) + 100


def raw_cube():
    mesh = trimesh.creation.box()
    return mesh.vertices, mesh.faces
