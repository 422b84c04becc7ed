"""Meshes of several topologies, small enough for brute force."""

import numpy as np
import pytest
import trimesh

from unc_physics.shapes.solid_mesh import make_solid


def joined(*meshes):
    """Several meshes as one, without uniting them."""
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    return (
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]),
    )


def raw(mesh):
    return np.array(mesh.vertices, dtype=float), np.array(mesh.faces)


def moved(mesh, offset):
    mesh.apply_translation(offset)
    return mesh


def turned_inside_out(mesh):
    mesh.invert()
    return mesh


def ball(radius, subdivisions=2):
    return trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)


MESHES = {
    "box": lambda: raw(trimesh.creation.box([1.0, 0.7, 0.4])),
    "ball": lambda: raw(ball(1.0)),
    "torus": lambda: raw(trimesh.creation.torus(1.0, 0.3, major_sections=24, minor_sections=12)),
    "two balls": lambda: joined(ball(1.0), moved(ball(0.5), [2.0, 0.0, 0.0])),
    "hollow ball": lambda: joined(ball(1.0), turned_inside_out(ball(0.6))),
    "ball in a cavity": lambda: joined(ball(1.0), turned_inside_out(ball(0.6)), ball(0.3)),
    "L": lambda: raw(
        trimesh.creation.extrude_triangulation(
            np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2.0]]),
            np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]),
            height=0.5,
        )
    ),
    "needle": lambda: raw(trimesh.creation.cone(radius=0.02, height=2.0, sections=12)),
}


@pytest.fixture(params=MESHES)
def any_solid(request):
    return make_solid(request.param, *MESHES[request.param]())
