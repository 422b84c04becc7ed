"""A prediction as an animated picture, from the side."""

from __future__ import annotations

import io
from itertools import pairwise

import numpy as np

from ..checks.shown import drawn_text
from ..spatial.layout import ERR_POSITION, POSITION, QUATERNION
from ..spatial.rotation import rotation_matrix
from .scene_picture import _SIDE, _bounds, _color, _draw_environment, ellipse, shaded_balls

GHOSTS = 15  # samples of each body that are drawn
_PALE = 0.10  # opacity of a sample
_WIDTH, _DOTS = 7.0, 90  # inches, and dots per inch
_PIXELS = 420  # along the longer side, of balls
_COLORS = 96
_LAST = 1200  # ms, that the end is shown
_FEWEST = 20  # spheres of a body that are drawn, at least: the largest


def draw_animation(path, prediction, title="") -> None:
    """Draw a prediction into an animated GIF: a picture for the start, and one for each of its times.

    Parameters
    ----------
    path : path-like
        File to write.
    prediction : Prediction
        Means are drawn solid, samples pale: the propagator's own where they were kept, or some of the
        Gaussian.
    title : str
    """
    from PIL import Image

    beliefs, times = [prediction.start, *prediction.beliefs], [0.0, *prediction.times]
    low, high = _bounds(prediction.scene, beliefs)
    pictures = []
    for k, (belief, time) in enumerate(zip(beliefs, times, strict=True)):
        ghosts = belief.sample(GHOSTS, np.random.default_rng(0))
        if k > 0 and (own := prediction.snapshots[k - 1].samples) is not None:
            ghosts = own[:GHOSTS]
        picture = _picture(
            prediction.scene, belief, ghosts, (low, high), f"{title}  t = {time:.2f} s".strip()
        )
        pictures.append(
            Image.open(io.BytesIO(picture)).convert("P", palette=Image.Palette.ADAPTIVE, colors=96)
        )
    shown = [round(1e3 * (after - before)) for before, after in pairwise(times)]
    pictures[0].save(
        path, save_all=True, append_images=pictures[1:], duration=[*shown, _LAST], loop=0, optimize=True
    )


def _picture(scene, belief, ghosts, corners, title):
    """One picture, as the bytes of a PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    low, high = corners
    wide, tall = (_SIDE[:2] @ (high - low)).tolist()
    figure = Figure(figsize=(_WIDTH, _WIDTH * tall / wide + 0.35))
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, tall / (tall + 0.35 * wide / _WIDTH)))
    (left, bottom), (right, top) = _SIDE[:2] @ low, _SIDE[:2] @ high
    _draw_environment(axes, scene.environment, _SIDE, (left, right, bottom, top))
    pixel = max(right - left, top - bottom) / _PIXELS
    for k, body in enumerate(scene.bodies):
        pale = [] if body.fixed else [(state, _PALE) for state in ghosts[:, k]]
        for state, alpha in (*pale, (belief.mean[k], 0.95)):
            _draw_body(axes, body, state, _color(body, k), pixel, alpha)
        if not body.fixed:
            P = _SIDE[:2] @ belief.marginal(k)[ERR_POSITION, ERR_POSITION] @ _SIDE[:2].T
            place = _SIDE[:2] @ belief.mean[k, POSITION]
            axes.add_patch(ellipse(place, P, edgecolor=0.5 * _color(body, k), linewidth=1.5, zorder=5))
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    axes.set_axis_off()
    figure.suptitle(drawn_text(title), fontsize=10, y=0.99, va="top")
    written = io.BytesIO()
    figure.savefig(written, dpi=_DOTS)
    return written.getvalue()


def _draw_body(axes, body, state, color, pixel, alpha):
    """A body's balls in its pose."""
    count = max(_FEWEST, len(body.model) // (1 if alpha > _PALE else 4))
    R = rotation_matrix(state[QUATERNION])
    centers = (body.model.centers[:count] @ R.T + state[POSITION]) @ _SIDE.T
    image, extent = shaded_balls(centers, body.model.radii[:count], color, pixel)
    image[..., 3] *= alpha
    axes.imshow(image, extent=extent, origin="lower", interpolation="bilinear", zorder=3)
