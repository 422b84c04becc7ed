"""The demo's picture: objects as shaded sphere packings before and after, the uncertainty, and samples
behind.
"""

from __future__ import annotations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from ..cli.scene_picture import COLORS, ellipse, pixel_window, shaded_balls
from ..geometry.library import load_model
from ..physics.rotation import rotation_matrix
from .durations import seconds

_PIXEL = 0.005  # m
_CLOUD_SPHERES = 200
_BODY_SPHERES = 5000
_ELLIPSE_EVERY = 1.0  # s
_HALO = [withStroke(linewidth=3.4, foreground=(1.0, 1.0, 1.0, 0.6))]


def draw(path, objects, answers) -> None:
    """Draw the scene, seen along the world's y axis.

    Parameters
    ----------
    path : path-like
        PNG to write.
    objects : list of ObjectState
        As they were sent.
    answers : dict of Prediction
        Of two propagators, by their labels: the first with a trajectory, the second with pose samples.
    """
    gaussian, drawn = answers.values()
    figure = Figure(figsize=(9.6, 6.4))
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.075, 0.08, 0.915, 0.81))
    for k, message in enumerate(objects):
        model = load_model(message.model).scaled(message.scale)
        color = np.array(COLORS[k % len(COLORS)])
        states = gaussian.objects[k].states
        _draw_cloud(axes, model, drawn.objects[k].states[-1].pose_samples, color)
        _draw_body(axes, model, message.pose.pose, color, alpha=0.38, order=2)
        _draw_body(axes, model, states[-1].pose.pose, color, alpha=0.95, order=3)
        _draw_path(axes, message, states, 0.5 * color)
        samples = np.array([_seen(pose.position) for pose in drawn.objects[k].states[-1].pose_samples])
        axes.plot(*samples.T, ".", color=0.3 * color, markersize=3.0, zorder=6)
    _label(axes, objects, gaussian, drawn, *answers)
    figure.savefig(path, dpi=120)


def _draw_path(axes, message, states, color):
    """The path of the mean, and ellipses of the position at the start, every second, and at the end."""
    poses = [message.pose, *(state.pose for state in states)]
    times = [0.0, *(seconds(state.time_from_start) for state in states)]
    path = np.array([_seen(pose.pose.position) for pose in poses])
    axes.plot(*path.T, color=color, linewidth=1.2, zorder=4, path_effects=_HALO)
    for time, pose in zip(times, poses, strict=True):
        last = pose is poses[-1]
        if last or abs(time / _ELLIPSE_EVERY - round(time / _ELLIPSE_EVERY)) < 1e-6:
            axes.add_patch(
                _ellipse(pose, edgecolor=color, linewidth=2.4 if last else 1.2, zorder=5, path_effects=_HALO)
            )


def _ellipse(pose, **style):
    """The ellipse of the position, as seen."""
    P = np.reshape(pose.covariance, (6, 6))[np.ix_([0, 2], [0, 2])]
    return ellipse(_seen(pose.pose.position), P, **style)


def _seen(point):
    """Right and up in the picture: the world's x and z."""
    return point.x, point.z


def _draw_body(axes, model, pose, color, alpha, order):
    """Draw a model at the pose of its origin."""
    centers, radii = _placed(model, pose, _BODY_SPHERES)
    image, extent = shaded_balls(centers, radii, color, _PIXEL)
    image[..., 3] *= alpha
    axes.imshow(image, extent=extent, origin="lower", interpolation="bilinear", zorder=order)


def _draw_cloud(axes, model, poses, color):
    """Draw how often each place is covered by the model at one of the poses."""
    bodies = [_placed(model, pose, _CLOUD_SPHERES) for pose in poses]
    centers, radii = (np.concatenate(part) for part in zip(*bodies, strict=True))
    window = pixel_window(centers, radii, _PIXEL)
    drawn = [shaded_balls(*body, color, _PIXEL, window) for body in bodies]
    covered = np.mean([image[..., 3] for image, _ in drawn], axis=0)
    image = np.empty((*covered.shape, 4))
    image[..., :3] = 0.5 + 0.5 * color
    image[..., 3] = 0.85 * np.sqrt(covered)  # so that rare places show, too
    axes.imshow(image, extent=drawn[0][1], origin="lower", interpolation="bilinear", zorder=1)


def _placed(model, pose, spheres):
    """Centres (n, 3) [right, up, towards the eye] and radii (n,) of the largest spheres, at the pose of the
    origin.
    """
    q = pose.orientation
    R = rotation_matrix(np.array([q.x, q.y, q.z, q.w]))
    centers = (model.centers[:spheres] - model.origin) @ R.T + [
        pose.position.x,
        pose.position.y,
        pose.position.z,
    ]
    return centers[:, [0, 2, 1]] * [1.0, 1.0, -1.0], model.radii[:spheres]


def _label(axes, objects, gaussian, drawn, name, reference):
    horizon = seconds(gaussian.objects[0].states[-1].time_from_start)
    samples = len(drawn.objects[0].states[-1].pose_samples)
    axes.set_title(
        f"Two bunnies collide: where will they be after {horizon:g} s?\n"
        f"Pale: known now. Solid: predicted mean pose, with 2-sigma ellipses of its path ({name}).\n"
        f"Behind: {samples} {reference} samples (dots: their origins).",
        fontsize=10,
    )
    axes.set_xlabel("x [m]")
    axes.set_ylabel("z [m]")
    axes.set_aspect("equal")
    axes.autoscale()
    axes.margins(0.03)
    axes.grid(color="0.93")
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
