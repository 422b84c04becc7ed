"""Twin of the environment's shapes: distance and normal by projection onto the solid; points all over a
surface.
"""

import numpy as np


def box(point, half):
    """Signed distance and normal at a point (3,) of a box of half edge lengths (3,)."""
    return _convex(
        point,
        np.clip(point, -half, half),
        [(half[k] - abs(point[k]), np.copysign(np.eye(3)[k], point[k])) for k in range(3)],
    )


def sphere(point, radius):
    length = np.linalg.norm(point)
    return length - radius, _direction(point)


def cylinder(point, radius, half):
    along = point * [0.0, 0.0, 1.0]
    across = point - along
    rho = np.linalg.norm(across)
    nearest = across * min(1.0, radius / rho if rho > 0.0 else 1.0) + np.clip(along, -half, half)
    end = np.copysign([0.0, 0.0, 1.0], along)
    return _convex(point, nearest, [(radius - rho, _direction(across)), (half - abs(point[2]), end)])


def capsule(point, radius, half):
    nearest = np.array([0.0, 0.0, np.clip(point[2], -half, half)])
    return sphere(point - nearest, radius)


def plane(point):
    return point[2], np.array([0.0, 0.0, 1.0])


def _convex(point, nearest, faces):
    """Outside by the nearest point of the solid; inside by the first of the nearest of some
    (depth, normal).
    """
    away = point - nearest
    length = np.linalg.norm(away)
    if length > 0.0:
        return length, away / length
    depth, normal = min(faces, key=lambda face: face[0])
    return -depth, normal


def _direction(v):
    length = np.linalg.norm(v)
    return v / length if length > 0.0 else np.array([1.0, 0.0, 0.0])


def box_surface(half, spacing):
    """(n, 3): points of a box's surface, no farther than about ``spacing`` from each other."""
    grids = [np.linspace(-h, h, int(2.0 * h / spacing) + 2) for h in half]
    points = []
    for k in range(3):
        a, b = (grids[j] for j in range(3) if j != k)
        for side in (-half[k], half[k]):
            face = np.stack(np.meshgrid(a, b, indexing="ij"), -1).reshape(-1, 2)
            points.append(np.insert(face, k, side, axis=1))
    return np.concatenate(points)


def turned_surface(outline, spacing):
    """(n, 3): points of the surface that an outline of points (rho, z) makes about the z axis."""
    points = []
    for rho, z in outline:
        angle = np.linspace(0.0, 2.0 * np.pi, int(2.0 * np.pi * rho / spacing) + 2)
        points.append(np.stack([rho * np.cos(angle), rho * np.sin(angle), np.full(len(angle), z)], -1))
    return np.concatenate(points)


def cylinder_surface(radius, half, spacing):
    rho = np.linspace(0.0, radius, int(radius / spacing) + 2)
    z = np.linspace(-half, half, int(2.0 * half / spacing) + 2)
    ends = [(a, side) for a in rho for side in (-half, half)]
    return turned_surface([*ends, *((radius, b) for b in z)], spacing)


def capsule_surface(radius, half, spacing):
    angle = np.linspace(0.0, 0.5 * np.pi, int(0.5 * np.pi * radius / spacing) + 2)
    ends = [(radius * np.cos(a), side * (half + radius * np.sin(a))) for a in angle for side in (-1.0, 1.0)]
    z = np.linspace(-half, half, int(2.0 * half / spacing) + 2)
    return turned_surface([*ends, *((radius, b) for b in z)], spacing)
