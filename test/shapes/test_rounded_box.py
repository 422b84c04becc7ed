"""A rounded box: its mass properties and its reach are the solid's."""

import numpy as np
import pytest

from unc_physics import UncPhysicsError, rounded_box
from unc_physics.shapes import household_meshes as meshes
from unc_physics.shapes.quality import extent_losses
from unc_physics.shapes.solid_mesh import make_solid


def test_a_sharp_box_and_a_ball_are_its_limits():
    a, b, c = 0.2, 0.3, 0.5
    box = rounded_box((a, b, c), 1e-9)
    assert box.volume == pytest.approx(a * b * c)
    np.testing.assert_allclose(
        box.inertia, np.diag([b * b + c * c, a * a + c * c, a * a + b * b]) / 12.0, atol=1e-9
    )
    ball = rounded_box(0.2, 0.1)
    assert ball.volume == pytest.approx(4.0 / 3.0 * np.pi * 1e-3)
    np.testing.assert_allclose(ball.inertia, 0.4 * 0.01 * np.eye(3), rtol=1e-12, atol=1e-15)


def test_between_them_by_counting_points():
    size, radius = np.array([0.2, 0.3, 0.4]), 0.06
    box = rounded_box(size, radius, "b", mass=2.0)
    points = (np.random.default_rng(0).random((400_000, 3)) - 0.5) * size
    beyond = np.maximum(np.abs(points) - (0.5 * size - radius), 0.0)
    inside = points[np.linalg.norm(beyond, axis=1) <= radius]
    assert box.volume == pytest.approx(len(inside) / 400_000 * size.prod(), rel=3e-3)
    squares = np.mean(inside**2, axis=0)
    np.testing.assert_allclose(np.diagonal(box.inertia), squares.sum() - squares, rtol=5e-3)
    assert (box.name, box.mass) == ("b", 2.0)


def test_it_reaches_as_far_as_the_solid():
    size, radius = np.array([0.2, 0.3, 0.4]), 0.05
    box = rounded_box(size, radius).prefix(8)
    directions = np.random.default_rng(1).standard_normal((200, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    reach = np.max(box.centers @ directions.T + box.radii[:, None], axis=0)
    np.testing.assert_allclose(reach, np.abs(directions) @ (0.5 * size - radius) + radius)
    np.testing.assert_allclose(box.bounds, [-0.5 * size, 0.5 * size])


@pytest.mark.parametrize("size, radius", [(0.1048, 0.005), ((0.2, 0.1, 0.06), 0.003)])
def test_it_carries_a_ball_on_faces_and_edges(size, radius):
    box = rounded_box(size, radius)
    spheres = np.column_stack([box.centers, box.radii])
    distances = np.linalg.norm(box.centers[:, None] - box.centers, axis=2) + 3.0 * radius * np.eye(len(box))
    assert distances.min() >= 2.0 * radius * (1.0 - 1e-12)
    mesh = make_solid("box", *meshes.rounded_box(np.broadcast_to(size, 3), radius))
    assert extent_losses(mesh.corners, spheres, [8])[0] <= 1e-6


@pytest.mark.parametrize("size, radius", [((1, 1, 0), 0.1), (1.0, 0.6), (1.0, 0.0), ((1, 1), 0.1)])
def test_refused(size, radius):
    with pytest.raises(UncPhysicsError):
        rounded_box(size, radius)
