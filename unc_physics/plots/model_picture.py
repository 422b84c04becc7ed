"""Pictures of models: shaded pieces and balls in orthographic view, and the mesh's bounding box."""

from __future__ import annotations

import numpy as np

from ..checks.shown import counted, drawn_text, plain_digits
from ..shapes.piece_mesh import piece_mesh

PIXELS = 640
VIEW = np.array([0.62, -0.70, 0.36])  # towards the eye, z up
LIGHT = np.array([-0.35, 0.55, 0.76])  # right, up, towards the eye
_ROUND_OFF = 1e-9  # share of a triangle by which its edge may pass a pixel's middle
_COINCIDENT = 1e-5  # share of a picture's half width: distance of surfaces that coincide


def draw_levels(path, packings, up="z") -> None:
    """Draw a body's pieces, if it has any, and its packings, its levels of detail, side by side into a PNG.

    The body axis ``up``, 'x', 'y' or 'z', points up in the picture.
    """
    from matplotlib.figure import Figure

    axes_of_view = view_axes(up)
    box = box_corners(packings[0]) @ axes_of_view.T
    middle = 0.5 * (box.min(axis=0) + box.max(axis=0))
    half = 0.53 * float(np.ptp(box[:, :2], axis=0).max())
    sizes = np.log(np.concatenate([packing.radii for packing in packings]))
    shapes = [] if packings[0].has_only_spheres else [packings[0].pieces]
    panels = [*shapes, *packings]
    figure = Figure(figsize=(3.6 * len(panels), 4.4))
    figure.subplots_adjust(left=0.035, right=0.995, bottom=0.09, top=0.86, wspace=0.03)
    for k, shown in enumerate(panels):
        axes = figure.add_subplot(1, len(panels), k + 1)
        if k < len(shapes):
            draw_triangles(axes, [piece_mesh(piece) @ axes_of_view.T - middle for piece in shown], half)
            axes.set_title(counted(len(shown), "piece"), fontsize=10)
        else:
            draw_balls(axes, shown, axes_of_view, middle, half, (sizes.min(), sizes.max()))
            count = f"{len(shown):,}".replace(",", "\u202f")
            axes.set_title(
                f"{count} sphere{'s' * (len(shown) > 1)}, {100.0 * shown.fill:.1f} % filled", fontsize=10
            )
        for edge in box_edges(box - middle):
            axes.plot(*(1e3 * edge[:, :2].T), color="0.55", linewidth=0.7)
        axes.set_aspect("equal")
        axes.tick_params(labelsize=7)
        axes.set_xlabel("mm", fontsize=8)
        axes.spines[["top", "right"]].set_visible(False)
        if k:
            axes.set_yticks([])
            axes.spines["left"].set_visible(False)
    sides = " x ".join(plain_digits(1e3 * side) for side in np.ptp(box_corners(packings[0]), axis=0))
    figure.suptitle(f"{drawn_text(packings[0].name)}: {sides} mm", fontsize=11)
    figure.savefig(path, dpi=130, bbox_inches="tight")


def draw_balls(axes, packing, axes_of_view, middle, half, size_range) -> None:
    """Draw the spheres of a packing [mm]; ``half`` is half of the picture's width [m]."""
    centers = packing.centers @ axes_of_view.T - middle
    image = shaded_balls(centers, packing.radii, half, size_range)
    extent = -1e3 * half, 1e3 * half, -1e3 * half, 1e3 * half
    axes.imshow(image, extent=extent, origin="lower", interpolation="bilinear")


def draw_triangles(axes, parts, half) -> None:
    """Draw parts, each of triangles (m, 3, 3) in view coordinates [m], each part in a colour of its own [mm].

    ``half`` is half of the picture's width [m].
    """
    from matplotlib import colormaps

    part = np.repeat(np.arange(len(parts)), [len(some) for some in parts])
    colors = colormaps["tab20"](part % 20)[:, :3] if len(parts) > 1 else np.full((len(part), 3), 0.7)
    extent = -1e3 * half, 1e3 * half, -1e3 * half, 1e3 * half
    grid = (np.arange(PIXELS) + 0.5) * 2.0 * half / PIXELS - half
    image = shaded_triangles(np.concatenate(parts), colors, grid, grid)
    axes.imshow(image, extent=extent, origin="lower", interpolation="bilinear")


def view_axes(up):
    """Return the axes right, up and towards the eye, as rows (3, 3) in body axes."""
    shift = "zxy".index(up)
    towards = np.roll(VIEW / np.linalg.norm(VIEW), shift)
    right = np.cross(np.roll([0.0, 0.0, 1.0], shift), towards)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(towards, right), towards])


def box_corners(packing):
    """Return the corners (8, 3) of the mesh's bounding box, or of the spheres' if the mesh is unknown."""
    bounds = packing.bounds
    if bounds is None:
        r = packing.radii[:, None]
        bounds = np.stack([(packing.centers - r).min(axis=0), (packing.centers + r).max(axis=0)])
    return np.stack(np.meshgrid(*bounds.T, indexing="ij"), axis=-1).reshape(8, 3)


def box_edges(corners):
    """Return the twelve edges of a box, (2, 3) each, from its corners in the order of `box_corners`."""
    return [corners[[i, i | bit]] for i in range(8) for bit in (1, 2, 4) if not i & bit]


def shaded_balls(centers, radii, half, size_range):
    """Return an image (PIXELS, PIXELS, 3) of balls in view coordinates, coloured by log radius."""
    from matplotlib import colormaps

    low, high = size_range
    colors = colormaps["viridis"]((np.log(radii) - low) / max(high - low, 1e-9) * 0.9 + 0.05)[:, :3]
    light = LIGHT / np.linalg.norm(LIGHT)
    pixel = 2.0 * half / PIXELS
    grid = (np.arange(PIXELS) + 0.5) * pixel - half
    depth = np.full((PIXELS, PIXELS), -np.inf)
    image = np.ones((PIXELS, PIXELS, 3))
    for (x, y, z), r, color in zip(centers, radii, colors, strict=True):
        i0, i1 = np.searchsorted(grid, [y - r, y + r])
        j0, j1 = np.searchsorted(grid, [x - r, x + r])
        dy, dx = (grid[i0:i1] - y)[:, None] / r, (grid[j0:j1] - x)[None, :] / r
        nz = np.sqrt(np.maximum(1.0 - dx * dx - dy * dy, 0.0))
        front = z + r * nz
        seen = (nz > 0.0) & (front > depth[i0:i1, j0:j1])
        shade = 0.30 + 0.70 * np.maximum(dx * light[0] + dy * light[1] + nz * light[2], 0.0)
        depth[i0:i1, j0:j1][seen] = front[seen]
        image[i0:i1, j0:j1][seen] = shade[seen][:, None] * color
    return image


def shaded_triangles(triangles, colors, xs, ys):
    """Return an RGBA image (len(ys), len(xs), 4) of triangles (m, 3, 3) in view coordinates.

    ``colors`` are (m, 3), and pixels have their middles at ``xs`` and ``ys``. Where surfaces coincide, as
    where pieces overlap, the first one is seen.
    """
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = normals[:, 2]  # twice, as seen
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    fill = (0.45 + 0.55 * np.maximum(normals @ (LIGHT / np.linalg.norm(LIGHT)), 0.0))[:, None] * colors
    depth = np.full((len(ys), len(xs)), -np.inf)
    image, coincident = np.zeros((*depth.shape, 4)), _COINCIDENT * 0.5 * np.ptp(xs)
    first, last = (
        np.stack([np.searchsorted(grid, end[:, k]) for k, grid in enumerate((xs, ys))], axis=1)
        for end in (triangles.min(axis=1), triangles.max(axis=1))
    )
    for k in np.flatnonzero((areas > 0.0) & (last > first).all(axis=1)):
        (j0, i0), (j1, i1) = first[k], last[k]
        x, y = xs[None, j0:j1], ys[i0:i1, None]
        a, b, c = triangles[k]
        v = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / areas[k]
        w = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / areas[k]
        front = a[2] + v * (b[2] - a[2]) + w * (c[2] - a[2])
        seen = np.minimum(np.minimum(v, w), 1.0 - v - w) >= -_ROUND_OFF
        seen &= front > depth[i0:i1, j0:j1] + coincident
        depth[i0:i1, j0:j1][seen] = front[seen]
        image[i0:i1, j0:j1][seen] = *fill[k], 1.0
    return image
