"""The laws of a packing, checked by code that shares nothing with the packer."""

import tracemalloc

import numpy as np
import pytest
import trimesh
from example_meshes import MESHES
from scipy.optimize import brentq
from test_distance import brute_distances, solid_angles

from unc_physics.checks.errors import InvalidOptionError, InvalidRequestError
from unc_physics.shapes.distance import even_directions
from unc_physics.shapes.packing import pack_solid
from unc_physics.shapes.quality import extent_losses
from unc_physics.shapes.solid_mesh import make_solid
from unc_physics.shapes.supports import few_corners

TOUCH = 1e-12  # of the bounding radius: what overlap and protrusion may come to


def overlap(packing):
    """Deepest overlap of two spheres [m]."""
    distance = np.linalg.norm(packing.centers[:, None] - packing.centers, axis=2)
    depth = packing.radii[:, None] + packing.radii - distance
    np.fill_diagonal(depth, -np.inf)
    return depth.max()


def assert_is_packing(packing, solid):
    touch = TOUCH * solid.bounding_radius
    assert overlap(packing) <= touch
    assert np.max(packing.radii - brute_distances(solid.corners, packing.centers)) <= touch
    np.testing.assert_allclose(solid_angles(solid.corners, packing.centers), 1.0, atol=1e-9)
    largest_first = packing.radii[packing.radii.argmax() :]  # what comes before gives the extent
    smallest_before = np.minimum.accumulate(largest_first)[:-1]
    assert np.mean(largest_first[1:] > 1.01 * smallest_before) <= 0.001


def test_laws(any_solid):
    packing = pack_solid(any_solid, 60, threads=2)
    assert len(packing) == 60
    assert_is_packing(packing, any_solid)
    np.testing.assert_array_equal(packing.inertia, any_solid.inertia)
    np.testing.assert_array_equal(packing.origin, any_solid.origin)
    assert packing.bounding_radius == any_solid.bounding_radius
    assert 0.0 < packing.fill < 1.0 and packing.surface_gap > 0.0


def test_the_first_spheres_of_a_cube_are_the_known_ones():
    """One in the middle, one in each corner, and on each edge two that touch the middle's and a corner's."""
    mesh = trimesh.creation.box()
    packing = pack_solid(make_solid("cube", mesh.vertices, mesh.faces), 33, largest_first=True)
    middle, corner = 0.5, 0.5 * (2.0 - np.sqrt(3.0))

    def overlap_with_corner(r):  # of a sphere that touches two faces and the middle's
        along = np.sqrt((middle + r) ** 2 - 2.0 * (0.5 - r) ** 2)
        return (corner + r) ** 2 - 2.0 * (corner - r) ** 2 - (0.5 - corner - along) ** 2

    edge = brentq(overlap_with_corner, 0.5 * (3.0 - 2.0 * np.sqrt(2.0)) + 1e-9, corner)
    np.testing.assert_allclose(packing.radii, [middle] + 8 * [corner] + 24 * [edge], rtol=1e-4)
    np.testing.assert_allclose(np.abs(packing.centers[1:9]), 0.5 - corner, atol=1e-4)


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("two balls", 0.98),
        ("box", 0.74),
        ("torus", 0.755),
        ("hollow ball", 0.655),
        ("L", 0.715),
        ("needle", 0.71),
    ],
)
def test_fill_is_what_greedy_packing_reaches(name, least):
    """Starting from many times as many points gains no more than one percentage point."""
    assert pack_solid(make_solid(name, *MESHES[name]()), 400, largest_first=True).fill > least


def test_corners_of_fine_hulls_are_chosen_evenly():
    """Of a ball of 10 242 corners every third one stays; other bodies keep all points, inner ones too."""
    fine = np.asarray(trimesh.creation.icosphere(subdivisions=5).vertices)
    few = few_corners(fine)
    assert 3000 < len(few) <= 4000
    reach = (few @ even_directions(200).T).max(axis=0)
    assert reach.min() > 0.996  # without a hole
    cube = np.concatenate([fine, trimesh.creation.box((4.0, 4.0, 4.0)).vertices])
    assert few_corners(cube) is cube


def test_same_bits_for_any_number_of_threads():
    solid = make_solid("L", *MESHES["L"]())
    one, two = pack_solid(solid, 100, threads=1), pack_solid(solid, 100, threads=2)
    np.testing.assert_array_equal(one.centers, two.centers)
    np.testing.assert_array_equal(one.radii, two.radii)
    assert one.surface_gap == two.surface_gap


@pytest.mark.parametrize("scale", [1e-6, 1e3])
@pytest.mark.parametrize("offset", [0.0, 1e3])
def test_scale_and_offset_change_nothing_else(scale, offset):
    vertices, faces = MESHES["L"]()
    solid = make_solid("L", (vertices + offset) * scale, faces)
    packing, plain = pack_solid(solid, 100), pack_solid(make_solid("L", vertices, faces), 100)
    assert_is_packing(packing, solid)
    assert packing.fill == pytest.approx(plain.fill, rel=0.03)  # ties in a wall fall differently
    # about the mesh's own origin, the spheres lie in the mesh as it was read
    in_mesh = packing.centers - packing.origin
    lost = 4.0 * np.finfo(float).eps * np.abs((vertices + offset) * scale).max()
    distances = brute_distances(((vertices + offset) * scale)[faces], in_mesh)
    assert np.max(packing.radii - distances) <= TOUCH * solid.bounding_radius + lost


@pytest.mark.parametrize("thickness", [1e-3, 1e-6])
def test_plates_of_a_thousand_and_of_a_million_to_one(thickness):
    plate = trimesh.creation.box([1.0, 1.0, thickness])
    solid = make_solid("plate", plate.vertices, plate.faces)
    packing = pack_solid(solid, 500)
    assert len(packing) == 500
    assert_is_packing(packing, solid)
    np.testing.assert_allclose(packing.radii, 0.5 * thickness, rtol=1e-4)


def test_a_first_part_of_equal_spheres_spreads_over_the_body():
    bar = trimesh.creation.box([1.0, 0.02, 0.02])
    packing = pack_solid(make_solid("bar", bar.vertices, bar.faces), 48, largest_first=True)
    for k in (4, 8, 16, 32):
        along = np.sort(packing.centers[:k, 0])
        assert np.diff(np.concatenate([[-0.5], along, [0.5]])).max() < 2.5 / k


@pytest.mark.parametrize("count", [0, -1, 2.5, True])
def test_a_count_that_is_no_positive_integer_is_refused(count):
    mesh = trimesh.creation.box()
    with pytest.raises(InvalidOptionError, match="positive integer"):
        pack_solid(make_solid("cube", mesh.vertices, mesh.faces), count)


def test_progress_tells_spheres_and_fill():
    seen = []
    solid = make_solid("ball", *MESHES["ball"]())
    packing = pack_solid(solid, 50, progress=lambda *now: seen.append(now))
    assert [now[0] for now in seen] == sorted(now[0] for now in seen)
    assert seen[-1] == (50, pytest.approx(packing.fill))


def test_the_pair_of_load_solid_is_refused_with_what_to_write():
    mesh = trimesh.creation.box([1.0, 1.0, 1.0])
    solid = make_solid("cube", mesh.vertices, mesh.faces)
    with pytest.raises(
        InvalidRequestError, match=r"solid must be a SolidMesh, .* solid, repairs = load_solid\(file\)"
    ):
        pack_solid((solid, []), 10)
    with pytest.raises(InvalidRequestError, match="solid must be a SolidMesh, not a str"):
        pack_solid("cube.stl", 10)


def test_the_quality_of_a_fine_mesh_needs_little_memory():
    """Heights of all corners along all faces' normals would take 26 GiB."""
    mesh = trimesh.creation.icosphere(subdivisions=6, radius=0.1)
    corners, ball = np.asarray(mesh.triangles), np.array([[0.0, 0.0, 0.0, 0.09]])
    tracemalloc.start()
    try:
        (loss,) = extent_losses(corners, ball, np.ones(1, int))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(corners) == 81_920 and loss == pytest.approx(0.01, rel=1e-3)
    assert peak < 5e8


def test_a_fine_mesh_of_a_ball_is_one_sphere_and_takes_little_memory():
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=0.05)
    solid = make_solid("ball", mesh.vertices + [1.0, 2.0, 3.0], mesh.faces)
    tracemalloc.start()
    packing = pack_solid(solid, 600, threads=1)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(packing) == 1 and len(packing.pieces) == 1
    height = np.linalg.norm(mesh.triangles_center, axis=1).min()  # of the faces
    assert packing.radii[0] == pytest.approx(height, rel=1e-6)
    assert packing.centers[0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-7)
    assert packing.extent_loss == pytest.approx(0.05 - height, rel=1e-2)
    assert most < 300e6  # of 20 480 triangles; a table of all pairs of triangles had 3 GB
