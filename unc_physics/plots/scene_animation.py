"""Animated picture of a prediction, seen from the side."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from ..checks.shown import drawn_text
from ..scene.belief import Belief
from ..scene.scene import Scene
from ..spatial.layout import ERR_POSITION, POSITION
from .palette import body_color
from .scene_picture import SIDE, bounds, draw_body, draw_environment, ellipse

GHOSTS = 15  # number of samples drawn of each body
_PALE = 0.10  # opacity of a sample
_WIDTH, _DOTS = 7.0, 90  # inches, and dots per inch
_HEAD, _LINE = 0.35, 0.22  # height of the title and of a probability [inches]
_BAR = 0.25  # relative to the picture's width
_MOST_BARS, _CHANGE = 4, 0.05  # most bars, and least change of a probability that is shown
_PIXELS = 420  # pixels along the longer side, of balls
_LAST = 1200  # ms, duration of the last picture
_FEWEST = 20  # least number of spheres drawn of a body, the largest ones


def draw_animation(
    path: str | Path,
    scene: Scene,
    times: Sequence[float],
    beliefs: Sequence[Belief],
    rollouts: Sequence[np.ndarray | None],
    probabilities: Mapping[str, Sequence[float]],
    title: str = "",
) -> None:
    """Draw a prediction as an animated GIF: a picture of the start and one of each time.

    One sample is drawn solid and others pale, since the mean of different outcomes is not a possible pose.
    Without samples the mean is solid, and samples of the Gaussian are pale.

    Parameters
    ----------
    path : str or Path
    scene : Scene
    times : sequence of float
        After the start [s].
    beliefs : sequence of Belief
        At the start, and at each time.
    rollouts : sequence of (R, B, 13) array or None
        States at each time.
    probabilities : mapping
        Of events at each time, by their texts. At most the first four that change are shown, as bars.
    title : str
    """
    from PIL import Image

    times = [0.0, *times]
    corners = bounds(scene, beliefs)
    states = _states(beliefs, rollouts)
    courses = _changing(probabilities)
    pictures = []
    for k, time in enumerate(times):
        bars = [(words, course[k - 1] if k else None) for words, course in courses.items()]
        head = f"{title}  t = {time:.2f} s".strip()
        picture = _picture(scene, beliefs[k], states[k], corners, head, bars)
        pictures.append(
            Image.open(io.BytesIO(picture)).convert("P", palette=Image.Palette.ADAPTIVE, colors=96)
        )
    shown = [round(1e3 * (after - before)) for before, after in pairwise(times)]
    pictures[0].save(
        path, save_all=True, append_images=pictures[1:], duration=[*shown, _LAST], loop=0, optimize=True
    )


def _changing(probabilities):
    """Return the probabilities that change and differ from each other."""
    found = {}
    for event, course in probabilities.items():
        if max(course) - min(course) > _CHANGE and course not in found.values():
            found[event] = course
    return dict(list(found.items())[:_MOST_BARS])


def _states(beliefs, rollouts):
    """Return the solid states (B, 13) and the pale ones (N, B, 13) for time 0 and each time."""
    first, *later = beliefs
    found = [(first.mean, first.sample(GHOSTS, np.random.default_rng(0)))]
    typical = None
    if all(states is not None for states in rollouts):
        # the rollout that ends nearest to the median
        ends = rollouts[-1][:, :, POSITION]
        typical = int(np.linalg.norm(ends - np.median(ends, axis=0), axis=-1).sum(axis=1).argmin())
    for belief, states in zip(later, rollouts, strict=True):
        if typical is None:
            found.append((belief.mean, belief.sample(GHOSTS, np.random.default_rng(0))))
        else:
            found.append((states[typical], states[:GHOSTS]))
    return found


def _picture(scene, belief, states, corners, title, bars):
    """Return one picture as PNG bytes."""
    from matplotlib.figure import Figure

    low, high = corners
    wide, tall = (SIDE[:2] @ (high - low)).tolist()
    scene_height, head = _WIDTH * tall / wide, _HEAD + _LINE * len(bars)
    figure = Figure(figsize=(_WIDTH, scene_height + head))
    axes = figure.add_axes((0.0, 0.0, 1.0, scene_height / (scene_height + head)))
    (left, bottom), (right, top) = SIDE[:2] @ low, SIDE[:2] @ high
    draw_environment(axes, scene.environment, SIDE, (left, right, bottom, top))
    pixel = max(right - left, top - bottom) / _PIXELS
    solid, pale = states
    is_typical = not np.array_equal(solid, belief.mean)
    for k, body in enumerate(scene.bodies):
        color = np.array(body_color(k, body.fixed))
        few, all_spheres = None, None
        if scene.integrator == "explicit":
            few, all_spheres = max(_FEWEST, len(body.model) // 4), len(body.model)
        for state in () if body.fixed else pale[:, k]:
            draw_body(axes, body.model, state, SIDE, color, pixel, _PALE, few)
        draw_body(axes, body.model, solid[k], SIDE, color, pixel, 0.95, all_spheres)
        if not body.fixed and not is_typical:
            P = SIDE[:2] @ belief.marginal(k)[ERR_POSITION, ERR_POSITION] @ SIDE[:2].T
            place = SIDE[:2] @ belief.mean[k, POSITION]
            axes.add_patch(ellipse(place, P, edgecolor=0.5 * color, linewidth=1.5, zorder=5))
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    axes.set_axis_off()
    figure.suptitle(drawn_text(title), fontsize=10, y=0.99, va="top")
    if bars:
        _draw_bars(figure, bars, scene_height + head)
    written = io.BytesIO()
    figure.savefig(written, dpi=_DOTS)
    return written.getvalue()


def _draw_bars(figure, bars, height):
    """Draw the probabilities below the title, each as text, a bar from 0 to 1, and a number."""
    from matplotlib.patches import Rectangle

    for row, (words, value) in enumerate(bars):
        y = 1.0 - (_HEAD + _LINE * row) / height
        figure.text(0.48, y, drawn_text(words), fontsize=9, ha="right", va="top")
        size = {"height": 0.6 * _LINE / height, "transform": figure.transFigure, "linewidth": 0.0}
        place = (0.5, y - 0.7 * _LINE / height)
        figure.add_artist(Rectangle(place, _BAR, facecolor="0.88", **size))
        if value is not None:
            figure.add_artist(Rectangle(place, _BAR * value, facecolor=body_color(0), **size))
            figure.text(0.51 + _BAR, y, f"{value:.2f}", fontsize=9, va="top")
