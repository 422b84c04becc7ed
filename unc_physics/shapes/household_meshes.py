"""Parametric meshes of a bowling pin and of what a kitchen or a bin-picking cell holds.

Functions of bodies return vertices (n, 3) in metres, z up, and triangles (m, 3), counter-clockwise from
outside; functions of profiles (k, 2) return radii and heights.
"""

from __future__ import annotations

import numpy as np

INCH = 0.0254
#: Mug: radius, height, thickness of the wall and of the base; half axes of its handle's section [m].
MUG, HANDLE = (0.041, 0.095, 0.004, 0.006), (0.0045, 0.0065)
#: Larger half axis of the loop of a mug's handle [m].
HANDLE_LOOP = 0.030
#: Bin: edges, thickness of the walls, width of the flange [m].
BIN = (0.300, 0.200, 0.147, 0.004, 0.006)


def pin_profile():
    """Return the profile of a tenpin, 15 in high.

    The diameter is 4.77 in at the belly, 1.80 in at the neck, 2.55 in at the head and 2.03 in at the base. A
    cubic spline joins the gauge points of the tenpin's specification. The head ends in a ball.
    """
    from scipy.interpolate import CubicSpline

    height = np.array(
        [0.0, 0.75, 2.25, 3.375, 4.5, 5.875, 7.25, 8.625, 9.375, 10.0, 10.875, 11.75, 12.625, 13.5]
    )
    diameter = np.array(
        [2.031, 2.828, 3.906, 4.510, 4.766, 4.563, 3.703, 2.472, 1.965, 1.797, 1.870, 2.094, 2.406, 2.547]
    )
    head = 0.5 * diameter[-1]
    ball = 15.0 - head
    z = np.linspace(0.0, 13.5, 96)
    angle = np.linspace(np.arcsin((13.5 - ball) / head), 0.5 * np.pi, 25)[1:-1]
    r = np.concatenate([CubicSpline(height, 0.5 * diameter)(z), head * np.cos(angle)])
    z = np.concatenate([z, ball + head * np.sin(angle)])
    return closed(np.column_stack([r, z]) * INCH, 0.0, 15.0 * INCH)


def can_profile():
    """Return the profile of a 400 g food can, full, with rims."""
    r, h, rim, deep = 0.0365, 0.110, 0.0015, 0.003
    end = np.array(
        [
            [r - 0.002, deep],
            [r - 0.0015, 0.0],
            [r + rim - 0.0005, 0.0],
            [r + rim, 0.0005],
            [r + rim, 0.0025],
            [r, 0.004],
        ]
    )
    return closed(np.concatenate([end, mirrored(end, h)]), deep, h - deep)


def bottle_profile():
    """Return the profile of a full half-litre drinks bottle with a waist, a neck and a ring."""
    profile = np.array(
        [
            [0.018, 0.003],
            [0.021, 0.000],
            [0.026, 0.001],
            [0.0295, 0.004],
            [0.0305, 0.010],
            [0.0305, 0.095],
            [0.0285, 0.105],
            [0.0285, 0.125],
            [0.0305, 0.135],
            [0.0305, 0.150],
            [0.0290, 0.163],
            [0.0250, 0.177],
            [0.0195, 0.189],
            [0.0150, 0.198],
            [0.0130, 0.205],
            [0.0130, 0.212],
            [0.0150, 0.213],
            [0.0150, 0.229],
            [0.0145, 0.230],
        ]
    )
    return closed(profile, 0.006, 0.230)


def mug():
    """Return a stoneware mug with a handle."""
    import trimesh

    body = revolved(mug_profile(), segments=128)
    middle, out = handle_loop(49)
    around = 2.0 * np.pi * np.arange(32) / 32
    rings = (
        middle[:, None]
        + HANDLE[0] * np.cos(around)[None, :, None] * out[:, None]
        + HANDLE[1] * np.sin(around)[None, :, None] * np.array([0.0, 1.0, 0.0])
    )
    handle = lofted(list(rings), middle[0], middle[-1])
    union = trimesh.boolean.union(
        [trimesh.Trimesh(*body, process=False), trimesh.Trimesh(*handle, process=False)], engine="manifold"
    )
    return np.asarray(union.vertices), np.asarray(union.faces, dtype=np.int64)


def mug_profile():
    """Return the profile of a mug without its handle."""
    r, h, wall, base = MUG
    lip = rounded_edge(r - wall, r, h)
    outside = np.array([[r - 0.003, 0.0], [r - 0.001, 0.001], [r, 0.003]])
    inside = np.array([[r - wall, base + 0.004], [r - wall - 0.001, base + 0.001], [r - wall - 0.004, base]])
    return closed(np.concatenate([outside, lip, inside]), 0.0, base)


def handle_loop(count):
    """Return points (count, 3) along the middle of a mug's handle, and unit vectors out of its loop.

    The ends lie in the middle of the wall. The loop is an ellipse, and so is the section, with half axes
    `HANDLE`.
    """
    turn = np.linspace(-0.5 * np.pi, 0.5 * np.pi, count)
    across, along = HANDLE_LOOP * np.cos(turn), 0.029 * np.sin(turn)
    middle = np.column_stack([MUG[0] - 0.0028 + across, np.zeros(count), 0.0475 + along])
    out = np.column_stack([0.029 * np.cos(turn), np.zeros(count), HANDLE_LOOP * np.sin(turn)])
    return middle, out / np.linalg.norm(out, axis=1, keepdims=True)


def bowl_profile():
    """Return the profile of a stoneware cereal bowl on a foot ring."""
    wall, foot = 0.005, 0.004
    t = np.linspace(0.0, 1.0, 24)
    outer = np.column_stack(
        [0.030 + 0.050 * np.sin(0.5 * np.pi * t), foot + 0.058 * (1.0 - np.cos(0.5 * np.pi * t))]
    )
    slope = np.gradient(outer, axis=0)
    inward = np.column_stack([-slope[:, 1], slope[:, 0]])
    inner = outer + wall * inward / np.linalg.norm(inward, axis=1, keepdims=True)
    lip = rounded_edge(inner[-1, 0], outer[-1, 0], outer[-1, 1] + 0.5 * wall)
    ring = np.array([[0.024, foot], [0.025, 0.0], [0.029, 0.0]])
    return closed(np.concatenate([ring, outer[:-1], lip, inner[-2::-1]]), foot, foot + wall)


def plate_profile():
    """Return the profile of a stoneware dinner plate on a foot ring."""
    under = np.array(
        [[0.073, 0.003], [0.074, 0.000], [0.078, 0.000], [0.080, 0.003], [0.096, 0.011], [0.127, 0.017]]
    )
    upper = np.array([[0.127, 0.022], [0.095, 0.0162], [0.078, 0.008], [0.073, 0.008]])
    edge = np.array([[0.1290, 0.0178], [0.1298, 0.0195], [0.1290, 0.0212]])
    return closed(np.concatenate([under, edge, upper]), 0.003, 0.008)


def bin():
    """Return a small load carrier of 300 x 200 x 147 mm, open at the top, with a flange and 4 mm walls."""
    x, y, h, wall, flange = BIN
    u, v = x - 2.0 * flange, y - 2.0 * flange
    return lofted(
        [
            rectangle(u, v, 0.0),
            rectangle(u, v, h - wall),
            rectangle(x, y, h - wall),
            rectangle(x, y, h),
            rectangle(u - 2.0 * wall, v - 2.0 * wall, h),
            rectangle(u - 2.0 * wall, v - 2.0 * wall, wall),
        ],
        0.0,
        wall,
    )


def rounded_box(size=(0.1048, 0.1048, 0.1048), radius=0.005, segments=6):
    """Return a box with rounded edges and corners [m]; by default the cube of the recorded tosses."""
    core = 0.5 * np.asarray(size, float) - radius
    around = 0.5 * np.pi * (np.arange(segments + 1) / segments + np.arange(4)[:, None])
    signs = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    corners = np.repeat(signs * core[:2], segments + 1, axis=0)
    circle = np.stack([np.cos(around), np.sin(around)], axis=-1).reshape(-1, 2)
    # from just off the flat ends, where the rings' corners would be points
    up = np.radians(np.concatenate([[89.0], np.linspace(90.0, 0.0, segments + 1)[1:]]))
    below = radius * (1.0 - np.sin(up))
    below[0] = 0.0
    heights = np.concatenate([below, size[2] - below[::-1]])
    reach = radius * np.concatenate([np.cos(up), np.cos(up[::-1])])
    rings = [
        np.column_stack([corners + r * circle, np.full(len(corners), z)])
        for r, z in zip(reach, heights, strict=True)
    ]
    return lofted(rings, heights[0], heights[-1])


def closed(profile, first, last):
    """Return a profile (k, 2) of radius and height with the heights of its ends on the axis."""
    return np.concatenate([[[0.0, first]], profile, [[0.0, last]]])


def revolved(profile, segments):
    """Return the solid of revolution of a profile (k, 2) that begins and ends on the axis."""
    angle = 2.0 * np.pi * np.arange(segments) / segments
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    rings = [np.column_stack([r * circle, np.full(segments, z)]) for r, z in profile[1:-1]]
    return lofted(rings, float(profile[0, 1]), float(profile[-1, 1]))


def lofted(rings, first, last):
    """Return the solid through rings (k, 3) of equally many points.

    Seen from the last ring towards the first, the points are counter-clockwise. Fans of triangles close the
    ends at the points ``first`` and ``last``; a number is a height on the z axis.
    """
    k = len(rings[0])
    ends = [np.array([0.0, 0.0, end]) if np.isscalar(end) else end for end in (first, last)]
    vertices = np.concatenate([*rings, ends])
    this = np.arange(k)
    following = (this + 1) % k
    faces = []
    for ring in range(len(rings) - 1):
        a, b = ring * k + this, ring * k + following
        faces += [np.column_stack([a, b, b + k]), np.column_stack([a, b + k, a + k])]
    top = (len(rings) - 1) * k
    faces.append(np.column_stack([following, this, np.full(k, len(vertices) - 2)]))
    faces.append(np.column_stack([top + this, top + following, np.full(k, len(vertices) - 1)]))
    return vertices, np.concatenate(faces)


def rectangle(x, y, z):
    """Return the corners (4, 3) of a rectangle about the z axis, at height z."""
    return np.array([[x, y], [-x, y], [-x, -y], [x, -y]]) @ np.diag([0.5, 0.5]) @ np.eye(2, 3) + [0.0, 0.0, z]


def rounded_edge(inner, outer, top):
    """Return the profile (9, 2) of a half-round edge from the outer to the inner radius."""
    angle = np.linspace(0.0, np.pi, 9)
    r = 0.5 * (outer - inner)
    return np.column_stack([0.5 * (inner + outer) + r * np.cos(angle), top - r + r * np.sin(angle)])


def mirrored(profile, height):
    """Return a profile upside down, in a body of a height."""
    return (profile * [1.0, -1.0] + [0.0, height])[::-1]
