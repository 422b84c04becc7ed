"""Meshes of elements: made from the signed distance where a shape has no mesh of its own."""

import numpy as np
import pytest

from unc_physics import Box, Capsule, Cylinder, Sphere

pytest.importorskip("trimesh")

from unc_physics.view.meshes import element_mesh, quaternion_of, surface_mesh

TURNED = {"position": (0.3, -0.2, 0.1), "orientation": (0.5, -0.5, 0.1, 0.7)}
SOLIDS = {
    "box": (Box((0.2, 0.3, 0.4), **TURNED), 0.2 * 0.3 * 0.4),
    "sphere": (Sphere(0.2, (1.0, 2.0, 3.0)), 4.0 / 3.0 * np.pi * 0.2**3),
    "cylinder": (Cylinder(0.1, 0.5, **TURNED), np.pi * 0.1**2 * 0.5),
    "capsule": (Capsule(0.1, 0.3, **TURNED), np.pi * 0.1**2 * 0.3 + 4.0 / 3.0 * np.pi * 0.1**3),
}


def volume(vertices, faces):
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return np.einsum("nk,nk->", np.cross(a, b), c) / 6.0


@pytest.mark.parametrize("name", SOLIDS)
def test_a_mesh_from_the_distance_is_the_solid(name):
    element, exact = SOLIDS[name]
    vertices, faces = surface_mesh(element)
    distance, _ = element.surface(vertices @ element.rotation.T + element.position)
    assert np.abs(distance).max() < 1e-9
    assert volume(vertices, faces) == pytest.approx(exact, rel=0.03)
    assert volume(*element_mesh(element, 1.0)) == pytest.approx(exact, rel=0.01)
    assert vertices.min(axis=0) == pytest.approx(element_mesh(element, 1.0)[0].min(axis=0), abs=0.02)


def test_a_quaternion_is_that_of_its_matrix():
    assert quaternion_of(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])) == pytest.approx(
        [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]
    )
