"""Few spheres do not change the body: extent and flat faces of the models, against their meshes.

The measures share no code with `shapes.quality`, whose own tests are here too.
"""

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.optimize import linprog
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from unc_physics.shapes import library
from unc_physics.shapes.library import load_model
from unc_physics.shapes.packing import pack_solid
from unc_physics.shapes.primitive_models import primitive_model
from unc_physics.shapes.primitives import primitive
from unc_physics.shapes.quality import extent_losses
from unc_physics.shapes.recipes import RECIPES, recipe_solid
from unc_physics.shapes.solid_mesh import make_solid

MODELS = Path(library.__file__).resolve().parents[2] / "models"
HOUSEHOLD = [name for name, recipe in RECIPES.items() if not recipe.largest_first]
#: The faces of the meshes on which things are put down, by their outward normals.
FACES = {
    "bin": [(0, 0, -1), (0, 0, 1)],
    "bottle": [(0, 0, -1), (0, 0, 1)],
    "bowl": [(0, 0, -1), (0, 0, 1)],
    "brick": [(0, 0, -1), (1, 0, 0), (0, 1, 0)],
    "can": [(0, 0, -1), (0, 0, 1)],
    "mug": [(0, 0, -1), (0, 0, 1)],
    "plate": [(0, 0, -1), (0, 0, 1)],
    "rounded_box": [(0, 0, -1), (1, 0, 0), (0, -1, 0)],
    "salt_box": [(0, 0, -1), (0, 0, 1), (1, 0, 0), (0, 1, 0)],
}


def reach(points, radii, directions):
    """How far points with radii reach in directions (d, 3)."""
    return (directions @ np.asarray(points).T + radii).max(axis=1)


def tilt(packing, normal):
    """Angle by which a packing that is put down on a face comes to rest beside it [rad].

    Its centre of mass goes as low as it can: a linear programme in the small turn about the two axes across.
    """
    frame = np.linalg.svd(np.array([normal], float))[2]
    frame, normal = frame[1:], np.array(normal, float)
    rows = np.column_stack([packing.centers @ frame.T, -np.ones(len(packing))])
    limits = -(packing.centers @ normal + packing.radii)
    found = linprog([0, 0, 1], rows, limits, bounds=[(-0.3, 0.3)] * 2 + [(None, None)])
    assert found.status == 0
    return float(np.hypot(*found.x[:2]))


def corners_of(name):
    solid = recipe_solid(name)[0]
    return solid.corners.reshape(-1, 3), solid


@pytest.mark.parametrize("name", HOUSEHOLD)
def test_household_models_keep_their_extent(name):
    points, solid = corners_of(name)
    packing = load_model(name, MODELS).prefix(300)
    around = Rotation.random(1000, rng=np.random.default_rng(3)).apply([0.0, 0.0, 1.0])
    cross = np.cross(*(solid.corners[:, k] - solid.corners[:, 0] for k in (1, 2)))
    normals = cross / np.linalg.norm(cross, axis=1, keepdims=True)
    directions = np.concatenate([around, normals[:: max(1, len(normals) // 1000)]])
    corners = points[ConvexHull(points).vertices]
    loss = (reach(corners, 0.0, directions) - reach(packing.centers, packing.radii, directions)).max()
    assert loss <= packing.extent_loss * (1.0 + 1e-6) + 1e-9
    assert packing.extent_loss <= 0.001


@pytest.mark.parametrize("name", HOUSEHOLD)
@pytest.mark.parametrize("count", [300, None])
def test_household_models_stand_flat(name, count):
    packing = load_model(name, MODELS)
    packing = packing.prefix(count or len(packing))
    for normal in FACES[name]:
        assert math.degrees(tilt(packing, normal)) <= 0.1


# -- the measures ----------------------------------------------------------------------------------


def box_corners(*size):
    box = trimesh.creation.box(size)
    return np.asarray(box.triangles)


def test_loss_of_a_ball_in_a_cube_is_that_at_its_corners():
    corners = box_corners(0.2, 0.2, 0.2)
    balls = np.array([[0, 0, 0, 0.1], *([*(0.09 * np.array(s)), 0.01] for s in np.ndindex(2, 2, 2))], float)
    balls[1:, :3] = np.array(list(np.ndindex(2, 2, 2))) * 0.18 - 0.09
    found = extent_losses(corners, balls, [1, 9])
    np.testing.assert_allclose(found, (math.sqrt(3.0) - 1.0) * np.array([0.1, 0.01]), rtol=1e-4)


def test_loss_between_two_balls_is_found_where_neither_is_support():
    """A flat cylinder's rim with balls at four places: the mesh's corner half-way between sticks out most."""
    rod = trimesh.creation.cylinder(0.1, 1e-3, sections=64)
    angle = 0.5 * np.pi * np.arange(4)
    balls = np.column_stack([0.0999 * np.cos(angle), 0.0999 * np.sin(angle), 0 * angle, 0 * angle + 1e-4])
    expected = 0.1 - (0.0999 * math.cos(math.pi / 4) + 1e-4)
    assert extent_losses(rod.triangles, balls, [4])[0] == pytest.approx(expected, rel=1e-2)


def test_measures_of_a_prefix_are_those_of_the_last_length_measured():
    box = trimesh.creation.box([0.1, 0.06, 0.04])
    packing = pack_solid(make_solid("box", box.vertices, box.faces), 60)
    assert packing.extent_loss == packing.extent_losses[-1] == packing.prefix(60).extent_loss
    at = int(np.searchsorted(packing.measured_spheres, 35, side="right")) - 1
    assert packing.measured_spheres[at] == 35
    assert packing.prefix(37).extent_loss == packing.prefix(35).extent_loss == packing.extent_losses[at]
    assert packing.scaled(0.5).extent_loss == 0.5 * packing.extent_loss


def test_the_first_eight_spheres_of_a_box_are_in_its_corners():
    box = trimesh.creation.box([0.1, 0.06, 0.04])
    packing = pack_solid(make_solid("box", box.vertices, box.faces), 100)
    r = packing.radii[:8, None]
    np.testing.assert_allclose(np.abs(packing.centers[:8]), [[0.05, 0.03, 0.02]] - r, rtol=1e-9)
    assert len({tuple(np.sign(c)) for c in packing.centers[:8]}) == 8
    assert packing.prefix(8).extent_loss == pytest.approx((math.sqrt(3.0) - 1.0) * r[0, 0], rel=1e-3)


def test_a_ball_is_its_largest_sphere():
    ball = pack_solid(make_solid("ball", *primitive("sphere", (0.05,))), 30)
    assert ball.radii[0] > 0.99 * 0.05


def test_a_cylinder_is_lined_evenly_and_rolls_on_nothing_else():
    radius = 0.03
    solid = make_solid("cylinder", *primitive("cylinder", (radius, 0.1)))
    packing = pack_solid(solid, 300)
    reached = np.hypot(*packing.centers[:, :2].T) + packing.radii
    rims, others = reached[: packing.radii.argmax()], reached[packing.radii.argmax() :]
    assert rims.min() > 0.9998 * radius and others.max() < radius - 1e-4
    upper = packing.centers[: len(rims)][packing.centers[: len(rims), 2] > 0.0]
    turns = np.diff(np.sort(np.degrees(np.arctan2(upper[:, 1], upper[:, 0]))))
    np.testing.assert_allclose(turns, 7.5, atol=0.5)
    assert math.degrees(tilt(packing, (0, 0, -1))) <= 0.1


@pytest.mark.parametrize("length", [0.02, 0.1, 0.3])
def test_a_capsule_is_a_row_of_balls(length):
    radius, capsule = 0.03, primitive_model("capsule", radius=0.03, length=length)
    balls = int(np.sum(capsule.radii > 0.99 * radius))
    reached = np.hypot(*capsule.centers[:, :2].T) + capsule.radii
    assert reached[:balls].min() > 0.998 * radius and reached[balls:].max() < radius - 5e-5
    assert capsule.prefix(balls).extent_loss < 0.002 * radius
