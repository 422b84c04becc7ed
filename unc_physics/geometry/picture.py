"""Pictures of packings: shaded balls in orthographic view, and the mesh's bounding box."""

from __future__ import annotations

import numpy as np

from ..checks.shown import drawn_text, plain_digits

PIXELS = 640
VIEW = np.array([0.62, -0.70, 0.36])  # towards the eye, z up
LIGHT = np.array([-0.35, 0.55, 0.76])  # right, up, towards the eye


def draw_levels(path, packings, up="z") -> None:
    """Draw packings of one body, its levels of detail, side by side into a PNG.

    The body axis ``up``, 'x', 'y' or 'z', points up in the picture.
    """
    from matplotlib.figure import Figure

    axes_of_view = view_axes(up)
    box = box_corners(packings[0]) @ axes_of_view.T
    middle = 0.5 * (box.min(axis=0) + box.max(axis=0))
    half = 0.53 * float(np.ptp(box[:, :2], axis=0).max())
    sizes = np.log(np.concatenate([packing.radii for packing in packings]))
    figure = Figure(figsize=(3.6 * len(packings), 4.4))
    figure.subplots_adjust(left=0.035, right=0.995, bottom=0.09, top=0.86, wspace=0.03)
    for k, packing in enumerate(packings):
        axes = figure.add_subplot(1, len(packings), k + 1)
        centers = packing.centers @ axes_of_view.T - middle
        image = shaded_balls(centers, packing.radii, half, (sizes.min(), sizes.max()))
        extent = -1e3 * half, 1e3 * half, -1e3 * half, 1e3 * half
        axes.imshow(image, extent=extent, origin="lower", interpolation="bilinear")
        for edge in box_edges(box - middle):
            axes.plot(*(1e3 * edge[:, :2].T), color="0.55", linewidth=0.7)
        count = f"{len(packing):,}".replace(",", "\u202f")
        axes.set_title(
            f"{count} sphere{'s' * (len(packing) > 1)}, {100.0 * packing.fill:.1f} % filled", fontsize=10
        )
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
