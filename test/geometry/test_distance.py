"""The kernels under the packer against brute force."""

import numpy as np
import pytest
import trimesh
from example_meshes import MESHES
from hypothesis import given
from hypothesis import strategies as st

from unc_physics.geometry.ascent import Space, climb_all, starts_around, starts_at_surface
from unc_physics.geometry.solid_mesh import make_solid, winding_number
from unc_physics.geometry.sphere_grid import empty_grid, grown, insert_spheres, nearest_sphere
from unc_physics.geometry.surface_gap import surface_gap
from unc_physics.geometry.triangle_tree import build_triangle_tree, nearest_on_mesh

ROUND_OFF = 1e-13


def brute_distances(corners, points):
    """Distance of each point to each triangle, by trimesh."""
    pairs = np.broadcast_to(points[:, None], (len(points), len(corners), 3)).reshape(-1, 3)
    triangles = np.broadcast_to(corners, (len(points), *corners.shape)).reshape(-1, 3, 3)
    nearest = trimesh.triangles.closest_point(np.ascontiguousarray(triangles), pairs)
    return np.linalg.norm(nearest - pairs, axis=1).reshape(len(points), len(corners)).min(axis=1)


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


@given(seed=st.integers(0, 1000), reach=st.floats(0.05, 2.0), width=st.floats(0.1, 1.0))
def test_distance_to_spheres(seed, reach, width):
    rng = np.random.default_rng(seed)
    spheres = np.column_stack([rng.random((40, 3)), 0.2 * rng.random(40) ** 2 + 0.01])
    grid = empty_grid(np.zeros(3), np.ones(3), width, reach, 16)
    inserted = 0
    while inserted < len(spheres):
        inserted = insert_spheres(grid, spheres, inserted, len(spheres))
        if inserted < len(spheres):
            grid = grown(grid)
    for point in rng.random((30, 3)):
        distances = np.linalg.norm(spheres[:, :3] - point, axis=1) - spheres[:, 3]
        found, index = nearest_sphere(grid, spheres, *point, -1)
        if distances.min() <= 0.0:
            assert found <= 0.0
        else:
            assert found == pytest.approx(min(distances.min(), reach), abs=ROUND_OFF)
            assert index == (np.argmin(distances) if distances.min() < reach else -1)
            if index >= 0:
                others = np.delete(distances, index)
                assert nearest_sphere(grid, spheres, *point, index)[0] == pytest.approx(
                    min(others.min(), reach), abs=ROUND_OFF
                )


def test_climbing_ends_at_local_maxima_inside():
    solid = make_solid("L", *MESHES["L"]())
    spheres = np.array([[*-solid.corners.mean(axis=(0, 1)), 0.1], [0.3, -0.3, 0.0, 0.15]])
    low, high = solid.bounds
    grid = empty_grid(low, high, 0.5, 5.0, 1000)
    assert insert_spheres(grid, spheres, 0, 2) == 2
    space = Space(build_triangle_tree(solid.corners), grid, spheres)

    def free_distance(points):
        gaps = np.linalg.norm(points[:, None] - spheres[:, :3], axis=2) - spheres[:, 3]
        return np.minimum(brute_distances(solid.corners, points), gaps.min(axis=1))

    rng = np.random.default_rng(2)
    inside = rng.uniform(low, high, (200, 3))
    inside = inside[(free_distance(inside) > 0.01) & (np.abs(inside[:, 2]) < 0.25)]

    inside = inside[winding_number(solid.corners, inside) > 0.5][:40]
    tops = inside.copy()
    values = climb_all(space, tops)
    np.testing.assert_allclose(values, free_distance(tops), atol=ROUND_OFF)
    assert np.all(values >= free_distance(inside))
    assert np.all(winding_number(solid.corners, tops) > 0.99)
    for top, value in zip(tops, values, strict=True):
        steps = rng.normal(size=(50, 3))
        steps *= 0.01 * value / np.linalg.norm(steps, axis=1, keepdims=True)
        assert free_distance(top + steps).max() <= value * (1.0 + 1e-4)  # the climb's own tolerance

    points = solid.corners.mean(axis=1)
    cross = np.cross(solid.corners[:, 1] - solid.corners[:, 0], solid.corners[:, 2] - solid.corners[:, 0])
    inward = -cross / np.linalg.norm(cross, axis=1, keepdims=True)
    for starts in (
        starts_at_surface(space, points, inward, 0.5),
        starts_around(space, np.arange(2), np.concatenate([np.eye(3), -np.eye(3)])),
    ):
        assert len(starts) > 0
        assert np.all(free_distance(starts) > 0.0)
        assert np.all(winding_number(solid.corners, starts) > 0.99)


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


def raw_cube():
    mesh = trimesh.creation.box()
    return mesh.vertices, mesh.faces
