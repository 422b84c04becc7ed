"""Pictures of a prediction, from the side and from above: initial and final bodies, and position ellipses."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..checks.shown import drawn_text
from ..propagators.modes import Mode
from ..scene.belief import Belief
from ..scene.environment import Plane
from ..scene.scene import Scene
from ..shapes.piece_mesh import piece_mesh
from ..spatial.layout import ERR_POSITION, ERR_ROTATION, POSITION, QUATERNION
from ..spatial.rotation import rotation_matrix
from .model_picture import shaded_triangles
from .palette import body_color

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIGMAS = 2.0  # half axes of the ellipses
_LIGHT = np.array([-0.40, 0.65, 0.65])  # light direction: right, up, towards the eye
_FIXED_ALPHA = 0.35  # of fixed bodies, which may hide others
_SPHERES = 10_000  # of each body, the first
_PIXELS = 900  # along the longer side
_AROUND = 48  # corners around a round piece
_MARGIN = 0.06  # relative to the longer side
SIDE, _ABOVE = (
    np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    np.eye(3),
)  # right, up and towards the eye, as rows
_OUTLINE = 180  # number of outline points
_LEGEND = 1.0  # inches of height, below the views
_NAMED = 12  # most bodies in the legend
_WIDE = 0.5  # rad, of a rotation: a body whose rotation spreads wider is drawn as samples, too
_OUTCOMES = 6  # samples drawn of a body with several outcomes
_FEW_SPHERES = 300  # spheres drawn of each such sample
_SOLID = {"facecolor": "0.90", "edgecolor": "0.55", "linewidth": 0.8}


def draw_prediction(
    scene: Scene,
    beliefs: Sequence[Belief],
    samples: np.ndarray | None,
    modes: Sequence[Sequence[Mode]],
    caption: str,
    title: str = "",
) -> Figure:
    """Draw a scene and its prediction, from the side and from above; no window is opened.

    The first belief is drawn pale, the last solid, with an ellipse for each of a body's modes. A body with
    several modes is drawn as samples, since its mean is not a possible pose. Paths connect the positions at
    three times or more, of bodies with one mode.

    Parameters
    ----------
    scene : Scene
    beliefs : sequence of Belief
        At time 0 and at each time.
    samples : (N, B, 13) array or None
        At the last time.
    modes : sequence
        Of each body at the last time.
    caption : str
        How the prediction was made, the end of the subtitle.
    title : str
    """
    from matplotlib.figure import Figure

    last = beliefs[-1]
    shown = [_shown(body, k, last, samples, modes[k]) for k, body in enumerate(scene.bodies)]
    low, high = bounds(scene, beliefs, shown)
    wide, deep, tall = high - low
    height = 1.3 + _LEGEND + min(9.0, 9.2 * (tall + deep) / wide)
    figure = Figure(figsize=(10.0, height))
    grid = figure.add_gridspec(
        2, 1, height_ratios=[tall, deep], hspace=0.12, top=1.0 - 0.6 / height, bottom=(0.6 + _LEGEND) / height
    )
    for row, (view, label) in enumerate(((SIDE, "z [m]"), (_ABOVE, "y [m]"))):
        axes = figure.add_subplot(grid[row])
        _draw_view(axes, scene, beliefs, shown, view, low, high)
        axes.set_ylabel(label)
    axes.set_xlabel("x [m]")
    subtitle = f"From the side and from above, {caption}"
    figure.suptitle(
        f"{drawn_text(title)}\n{subtitle}" if title else subtitle, fontsize=10, y=1.0 - 0.1 / height, va="top"
    )
    _draw_legend(figure, scene, (0.1 + _LEGEND) / height, has_path=len(beliefs) > 2)
    return figure


def _draw_legend(figure, scene, top, has_path):
    """Draw the legend of colors and lines below the views."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    gray = (0.4, 0.4, 0.4)
    entries = []
    if len(scene.bodies) <= _NAMED:
        for k, body in enumerate(scene.bodies):
            name = drawn_text(body.name) + " (fixed)" * body.fixed
            entries.append(Patch(color=body_color(k, body.fixed), label=name))
    entries += [
        Patch(color=gray, alpha=0.35, label="pale: now"),
        Patch(color=gray, label="solid: predicted mean pose; several of one body: samples"),
    ]
    if has_path:
        label = "path of the mean, unless outcomes split"
        entries.append(Line2D([], [], color=gray, linewidth=0.8, label=label))
    round_line = {"linestyle": "none", "marker": "o", "markersize": 8, "markerfacecolor": "none"}
    for label, width in (
        (f"position now, {SIGMAS:g} standard deviations", 0.9),
        ("position predicted, of each outcome", 1.8),
    ):
        entries.append(Line2D([], [], markeredgecolor=gray, markeredgewidth=width, label=label, **round_line))
    figure.legend(
        handles=entries,
        loc="upper center",
        bbox_to_anchor=(0.5, top),
        ncol=3,
        fontsize=8,
        frameon=False,
        handlelength=1.6,
    )


def _shown(body, k, belief, samples, modes):
    """Return the final states that are drawn of body k, samples or its mean, and its modes.

    There are samples where outcomes split or rotations spread too far for a mean pose.
    """
    if not body.free:
        return belief.mean[k : k + 1], ()
    turned = float(np.sqrt(np.trace(belief.marginal(k)[ERR_ROTATION, ERR_ROTATION])))
    if samples is not None and (len(modes) > 1 or turned > _WIDE):
        return samples[:_OUTCOMES, k], modes
    return belief.mean[k : k + 1], modes


def bounds(scene, beliefs, shown=()):
    """Return the lowest and the highest corner of a picture: bodies, final ellipses, nearby elements.

    ``shown`` has further states (n, 13) and modes of each body.
    """
    radius = np.array([body.model.bounding_radius for body in scene.bodies])[:, None]
    places = np.concatenate([belief.mean[:, POSITION] for belief in beliefs])
    reach = np.tile(radius, (len(beliefs), 1))
    low, high = (places - reach).min(axis=0), (places + reach).max(axis=0)
    for k, body in enumerate(scene.bodies):
        if body.free:
            variance = beliefs[-1].marginal(k)[ERR_POSITION, ERR_POSITION].diagonal()
            half = np.maximum(SIGMAS * np.sqrt(np.maximum(variance, 0.0)), body.model.bounding_radius)
            low = np.minimum(low, beliefs[-1].mean[k, POSITION] - half)
            high = np.maximum(high, beliefs[-1].mean[k, POSITION] + half)
    for body, (states, modes) in zip(scene.bodies, shown, strict=False):
        centers = [*states[:, POSITION], *(mode.mean[POSITION] for mode in modes)]
        variances = [mode.covariance[ERR_POSITION, ERR_POSITION].diagonal() for mode in modes]
        halves = [SIGMAS * np.sqrt(np.maximum(variance, 0.0)) for variance in variances]
        reached = np.concatenate(
            [np.full((len(states), 3), body.model.bounding_radius), *(h[None] for h in halves)]
        )
        low = np.minimum(low, (centers - reached).min(axis=0))
        high = np.maximum(high, (centers + reached).max(axis=0))
    for element in scene.environment:
        if element.finite:
            ends = element.outermost(np.concatenate([np.eye(3), -np.eye(3)]))
        else:  # of a plane, what is nearest to the bodies
            ends = places - np.outer(places @ element.normal - element.offset, element.normal)
        span = (high - low).max()  # a table may be much larger than the objects on it
        low = np.minimum(low, np.maximum(ends.min(axis=0), low - 0.3 * span))
        high = np.maximum(high, np.minimum(ends.max(axis=0), high + 0.3 * span))
    margin = _MARGIN * (high - low).max()
    return low - margin, high + margin


def _draw_view(axes, scene, beliefs, shown, view, low, high):
    from matplotlib.patheffects import withStroke

    left, bottom = view[:2] @ low
    right, top = view[:2] @ high
    halo = [withStroke(linewidth=3.0, foreground=(1.0, 1.0, 1.0, 0.6))]
    draw_environment(axes, scene.environment, view, (left, right, bottom, top))
    pixel = max(right - left, top - bottom) / _PIXELS
    for k, body in enumerate(scene.bodies):
        color = np.array(body_color(k, body.fixed))
        states, outcomes = shown[k]
        drawn = [] if body.fixed else [(beliefs[0].mean[k], 0.35, _SPHERES)]
        if len(states) > 1:
            drawn += [(state, 0.6, _FEW_SPHERES) for state in states]
        else:
            drawn.append((states[0], _FIXED_ALPHA if body.fixed else 0.95, _SPHERES))
        for state, alpha, count in drawn:
            spheres = count if scene.integrator == "explicit" else None
            draw_body(axes, body.model, state, view, color, pixel, alpha, spheres)
        if not body.fixed:
            # a mean between outcomes is no possible place, and two places are no path
            if len(outcomes) < 2 < len(beliefs):
                path = np.array([belief.mean[k, POSITION] for belief in beliefs]) @ view[:2].T
                axes.plot(*path.T, color=0.5 * color, linewidth=0.8, zorder=4, path_effects=halo)
            now = Mode(1.0, beliefs[0].mean[k], beliefs[0].marginal(k))
            for mode, width in ((now, 0.9), *((mode, 1.8) for mode in outcomes)) if body.free else ():
                P = view[:2] @ mode.covariance[ERR_POSITION, ERR_POSITION] @ view[:2].T
                axes.add_patch(
                    ellipse(
                        view[:2] @ mode.mean[POSITION],
                        P,
                        edgecolor=0.5 * color,
                        linewidth=width,
                        zorder=5,
                        path_effects=halo,
                    )
                )
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def draw_body(axes, model, state, view, color, pixel, alpha, count=None) -> None:
    """Draw a model in the pose of a state (13,): its pieces, or the ``count`` largest of its spheres.

    The rows of ``view`` (3, 3) point right, up and towards the eye. A pixel is so large [m]; ``alpha`` is the
    opacity.
    """
    R = rotation_matrix(state[QUATERNION])
    if count is None:
        triangles = (_surface(model) @ R.T + state[POSITION]) @ view.T
        xs, ys, extent = _window(triangles.reshape(-1, 3)[:, :2], 0.0, pixel)
        image = shaded_triangles(triangles, np.tile(color, (len(triangles), 1)), xs, ys)
    else:
        centers = (model.centers[:count] @ R.T + state[POSITION]) @ view.T
        image, extent = shaded_balls(centers, model.radii[:count], color, pixel)
    image[..., 3] *= alpha
    axes.imshow(image, extent=extent, origin="lower", interpolation="bilinear", zorder=3)


@functools.lru_cache(maxsize=64)
def _surface(model):
    """Return the triangles (m, 3, 3) of a model's pieces."""
    return np.concatenate([piece_mesh(piece, _AROUND) for piece in model.pieces])


def _window(points, margins, pixel):
    """Return the pixels' middles along both axes, and the extent: left, right, bottom and top [m].

    The window holds points (n, 2) with ``margins`` [m] around each.
    """
    margins = np.broadcast_to(margins, len(points))[:, None]
    low = np.floor((points - margins).min(axis=0) / pixel) - 1
    high = np.ceil((points + margins).max(axis=0) / pixel) + 1
    window = np.array([low, high], int)  # first and last pixel, columns and rows
    xs, ys = ((np.arange(*window[:, k]) + 0.5) * pixel for k in range(2))
    (left, bottom), (right, top) = window * pixel
    return xs, ys, (left, right, bottom, top)


def draw_environment(axes, environment, view, window):
    """Draw solids as outlines, far ones first.

    Half-spaces seen from the edge are drawn as their solid side.
    """
    from matplotlib.patches import Polygon

    left, right, bottom, top = window
    frame = np.array([[left, bottom], [right, bottom], [right, top], [left, top]])
    for element in environment:
        if isinstance(element, Plane):
            normal = view @ element.normal
            if abs(normal[2]) < 0.5:
                solid = _below(frame, normal[:2], element.offset)
                if len(solid):
                    axes.add_patch(Polygon(solid, zorder=0, **_SOLID))
    solids = [element for element in environment if not isinstance(element, Plane)]
    for element in sorted(solids, key=lambda element: (element.outermost(view[2:]) @ view[2]).item()):
        axes.add_patch(Polygon(outline(element, view), zorder=1, alpha=0.7, **_SOLID))


def _below(polygon, normal, offset):
    """Return the part of a convex polygon (n, 2) where ``normal . x <= offset``."""
    kept = []
    height = polygon @ normal - offset
    for k, a in enumerate(polygon):
        b = polygon[(k + 1) % len(polygon)]
        h_a, h_b = height[k], height[(k + 1) % len(polygon)]
        if h_a <= 0.0:
            kept.append(a)
        if h_a * h_b < 0.0:
            kept.append(a + (b - a) * h_a / (h_a - h_b))
    return np.array(kept)


def outline(element, view):
    """(n, 2): outline of a finite element, seen from far away: a convex polygon, right and up [m]."""
    angle = 2.0 * np.pi * (np.arange(_OUTLINE) + 0.5) / _OUTLINE
    directions = np.cos(angle)[:, None] * view[0] + np.sin(angle)[:, None] * view[1]
    return element.outermost(directions) @ view[:2].T


def ellipse(center, P, **style):
    """Return the `SIGMAS` ellipse of a covariance (2, 2), not filled, in a style of Matplotlib."""
    from matplotlib.patches import Ellipse

    variances, axes = np.linalg.eigh(P)
    width, height = 2.0 * SIGMAS * np.sqrt(np.maximum(variances[::-1], 0.0))
    angle = np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))
    return Ellipse(center, width, height, angle=angle, fill=False, **style)


def shaded_balls(centers, radii, color, pixel):
    """Draw balls in orthographic view.

    ``centers`` (n, 3) are right, up and towards the eye, and a pixel is so large [m]. Returns an RGBA image,
    transparent outside the balls, and its extent: left, right, bottom and top [m].
    """
    xs, ys, extent = _window(centers[:, :2], radii, pixel)
    light = _LIGHT / np.linalg.norm(_LIGHT)
    depth = np.full((len(ys), len(xs)), -np.inf)
    shade = np.zeros(depth.shape)
    for (x, y, z), r in zip(centers, radii, strict=True):
        i = slice(*np.searchsorted(ys, [y - r, y + r]))
        j = slice(*np.searchsorted(xs, [x - r, x + r]))
        up, right = (ys[i] - y)[:, None] / r, (xs[j] - x)[None, :] / r
        out = np.sqrt(np.maximum(1.0 - up * up - right * right, 0.0))
        front = z + r * out
        seen = (out > 0.0) & (front > depth[i, j])
        depth[i, j][seen] = front[seen]
        shade[i, j][seen] = np.maximum(right * light[0] + up * light[1] + out * light[2], 0.0)[seen]
    image = np.zeros((*depth.shape, 4))
    image[..., :3] = (0.35 + 0.65 * shade)[..., None] * color + 0.25 * shade[..., None] ** 2
    image[..., 3] = depth > -np.inf
    return image.clip(0.0, 1.0), extent
