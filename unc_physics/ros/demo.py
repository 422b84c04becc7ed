"""``python -m unc_physics.ros.demo``: a node and a client predict two colliding bunnies.

The node is a process of its own. The client prints a table and draws the objects as shaded sphere packings
before and after, with the uncertainty and samples.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import rclpy
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from unc_physics_msgs.msg import Prediction, PredictionRequest, Result, Scene
from unc_physics_msgs.srv import Predict

from ..checks.errors import OutputError
from ..geometry.library import load_model
from ..plots.palette import body_color
from ..plots.scene_picture import ellipse, pixel_window, shaded_balls
from ..propagators.names import ANYTIME, REFERENCE
from ..spatial.rotation import rotation_matrix
from .demo_stream import bunnies
from .messages.fields import duration, seconds, xyz, xyzw

NODE = "unc_physics_demo"
HORIZON = 5.0  # s
PERIOD = 0.1  # s
SEED = 1
SAMPLES = 200
SHOWN_SAMPLES = 40
_LABELS = {ANYTIME: ANYTIME, REFERENCE: "Monte Carlo"}
_START_TIMEOUT = 120.0  # s; a node that starts for the first time compiles its kernels
_POLL_PERIOD = 0.5  # s
_END_TIMEOUT = 10.0  # s
_PHYSICS = {  # the paper's
    "dt": 0.01,
    "stiffness": 1e4,
    "damping": 0.3,
    "gravity": [0.0, 0.0, 0.0],
    "integrator": "explicit",
    "friction": 0.0,
    "restitution": 1.0,
    "gyroscopic": "false",
    "islands": "false",
}
_PIXEL = 0.005  # m
_CLOUD_SPHERES = 200
_BODY_SPHERES = 5000
_ELLIPSE_EVERY = 1.0  # s
_HALO = [withStroke(linewidth=3.4, foreground=(1.0, 1.0, 1.0, 0.6))]


def main(arguments=None) -> int:
    """Run the demo; return the exit status."""
    parser = argparse.ArgumentParser(prog="unc_physics.ros.demo", description=__doc__)
    parser.add_argument(
        "--output", default="demo.png", metavar="FILE.png", help="picture to write (default demo.png)"
    )
    options = parser.parse_args(arguments)
    output = Path(options.output).resolve()
    if not output.parent.is_dir():
        error = OutputError("is no folder", field="--output", value=str(output.parent))
        print(f"demo: {error}", file=sys.stderr)
        return int(error.code)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    print(f"Starting the node /{NODE} and a client ...", flush=True)
    with tempfile.TemporaryFile("w+") as log:
        node = subprocess.Popen(node_command(), stdout=log, stderr=subprocess.STDOUT)
        status = 1
        try:
            answers = ask(node)
            print(table(answers), flush=True)
            draw(output, bunnies(), {name: answer for name, (answer, _) in answers.items()})
            print(f"Picture: {output}", flush=True)
            status = 0
        except RuntimeError as error:
            print(f"demo: {error}", file=sys.stderr)
        except KeyboardInterrupt:  # the node received it, too
            status = 130
        finally:
            node_status = _end(node)
        if status or node_status:
            log.seek(0)
            print(f"demo: failed; the node's log:\n{log.read()}", file=sys.stderr)
            return status or 1
    print("The node has shut down cleanly.")
    return 0


def node_command() -> list[str]:
    """Return the command line of a node without gravity that reads zero covariances as exact."""
    parameters = _PHYSICS | {"zero_covariance": "exact", "warm_up": f"[{ANYTIME}, {REFERENCE}]"}
    options = [part for name, value in parameters.items() for part in ("-p", f"{name}:={value}")]
    return [sys.executable, "-m", "unc_physics.ros.node", "--ros-args", "-r", f"__node:={NODE}", *options]


def requests() -> dict[str, PredictionRequest]:
    """Return the same request for two propagators: one with a trajectory, the reference with samples."""
    common = {"scene": Scene(objects=bunnies()), "horizon": duration(HORIZON), "seed": SEED}
    return {
        _LABELS[ANYTIME]: PredictionRequest(propagator=ANYTIME, trajectory_period=duration(PERIOD), **common),
        _LABELS[REFERENCE]: PredictionRequest(
            propagator=REFERENCE, samples=SAMPLES, return_samples=SHOWN_SAMPLES, **common
        ),
    }


def ask(process: subprocess.Popen) -> dict[str, tuple[Prediction, float]]:
    """Return each propagator's answer and the time that it took over ROS [s].

    Raises
    ------
    RuntimeError
        If the node's process ends, or if it does not answer.
    """
    rclpy.init()
    node = rclpy.create_node("demo_client")
    try:
        client = node.create_client(Predict, f"/{NODE}/predict")
        _wait(process, lambda: client.wait_for_service(_POLL_PERIOD))
        answers = {}
        for name, request in requests().items():
            started = time.perf_counter()
            future = client.call_async(Predict.Request(request=request))

            def is_answered(future=future):
                rclpy.spin_until_future_complete(node, future, timeout_sec=_POLL_PERIOD)
                return future.done()

            _wait(process, is_answered)
            answer = future.result()
            if answer is None or answer.result.error_code != Result.NONE:
                raise RuntimeError(answer.result.error_msg if answer else "no answer came")
            answers[name] = answer.prediction, time.perf_counter() - started
        return answers
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def _wait(process, is_done):
    """Poll until something is done; raise RuntimeError after a while, or if the node's process ends."""
    deadline = time.monotonic() + _START_TIMEOUT
    while not is_done():
        if process.poll() is not None or time.monotonic() > deadline:
            raise RuntimeError(f"the node /{NODE} does not answer")


def _end(process):
    """End a process with SIGINT, or by force if it does not react; return its exit status."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    with contextlib.suppress(subprocess.TimeoutExpired):
        return process.wait(_END_TIMEOUT)
    process.kill()
    return process.wait()


def table(answers) -> str:
    """Return the predicted pose and standard deviations of each object as a table."""
    lines = [
        f"Predicted after {HORIZON:g} s, poses of the models' origins in the world frame:",
        (
            f"{'object':8}{'propagator':14}{'position [m]':^26}{'std [m]':^21}"
            f"{'rotation [deg]':^24}{'std [deg]':^21}"
        ),
    ]
    for k, predicted in enumerate(bunnies()):
        for name, (answer, _) in answers.items():
            pose = answer.objects[k].states[-1].pose
            std = np.sqrt(np.reshape(pose.covariance, (6, 6)).diagonal())
            rotation = np.degrees(_rotation_vector(pose.pose.orientation))
            lines.append(
                f"{predicted.id:8}{name:14}"
                f"{_row(xyz(pose.pose.position), '8.3f')}  {_row(std[:3], '6.3f')}   "
                f"{_row(rotation, '7.1f')}  {_row(np.degrees(std[3:]), '6.1f')}"
            )
    for name, (answer, wall) in answers.items():
        lines.append(
            f"{name}: {answer.rollouts} rollouts, computed in"
            f" {1e3 * seconds(answer.computation_time):.1f} ms, answered over ROS in {1e3 * wall:.1f} ms"
        )
    whole, end = answers
    lines.append(f"{whole} was asked for a pose every {PERIOD:g} s; {end} for the last one alone.")
    return "\n".join(lines)


def _row(values, form):
    return "".join(f"{value:{form}}" for value in values)


def _rotation_vector(q):
    """Return the rotation vector [rad] of a quaternion message."""
    *axis, w = xyzw(q)
    axis = np.array(axis)
    if w < 0.0:
        axis, w = -axis, -w
    length = np.linalg.norm(axis)
    return 2.0 * math.atan2(length, w) / length * axis if length > 0.0 else np.zeros(3)


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
        color = np.array(body_color(k))
        states = gaussian.objects[k].states
        _draw_cloud(axes, model, drawn.objects[k].states[-1].pose_samples, color)
        _draw_body(axes, model, message.pose.pose, color, alpha=0.38, order=2)
        _draw_body(axes, model, states[-1].pose.pose, color, alpha=0.95, order=3)
        _draw_path(axes, message, states, 0.5 * color)
        samples = np.array([_seen(pose.position) for pose in drawn.objects[k].states[-1].pose_samples])
        axes.plot(*samples.T, ".", color=0.3 * color, markersize=3.0, zorder=6)
    _label(axes, gaussian, drawn, *answers)
    figure.savefig(path, dpi=120)


def _draw_path(axes, message, states, color):
    """Draw the path of the mean, and ellipses of the position at the start, every second, and at the end."""
    poses = [message.pose, *(state.pose for state in states)]
    times = [0.0, *(seconds(state.time_from_start) for state in states)]
    path = np.array([_seen(pose.pose.position) for pose in poses])
    axes.plot(*path.T, color=color, linewidth=1.2, zorder=4, path_effects=_HALO)
    for when, pose in zip(times, poses, strict=True):
        last = pose is poses[-1]
        if last or abs(when / _ELLIPSE_EVERY - round(when / _ELLIPSE_EVERY)) < 1e-6:
            axes.add_patch(
                _ellipse(pose, edgecolor=color, linewidth=2.4 if last else 1.2, zorder=5, path_effects=_HALO)
            )


def _ellipse(pose, **style):
    """Return the ellipse of the position in the picture."""
    P = np.reshape(pose.covariance, (6, 6))[np.ix_([0, 2], [0, 2])]
    return ellipse(_seen(pose.pose.position), P, **style)


def _seen(point):
    """Return a point in the picture, right and up: the world's x and z."""
    return point.x, point.z


def _draw_body(axes, model, pose, color, alpha, order):
    """Draw a model at the pose of its origin."""
    centers, radii = _placed(model, pose, _BODY_SPHERES)
    image, extent = shaded_balls(centers, radii, color, _PIXEL)
    image[..., 3] *= alpha
    axes.imshow(image, extent=extent, origin="lower", interpolation="bilinear", zorder=order)


def _draw_cloud(axes, model, poses, color):
    """Draw the fraction of the poses at which the model covers each pixel."""
    bodies = [_placed(model, pose, _CLOUD_SPHERES) for pose in poses]
    centers, radii = (np.concatenate(part) for part in zip(*bodies, strict=True))
    window = pixel_window(centers, radii, _PIXEL)
    drawn = [shaded_balls(*body, color, _PIXEL, window) for body in bodies]
    covered = np.mean([image[..., 3] for image, _ in drawn], axis=0)
    image = np.empty((*covered.shape, 4))
    image[..., :3] = 0.5 + 0.5 * color
    image[..., 3] = 0.85 * np.sqrt(covered)  # rarely covered pixels stay visible
    axes.imshow(image, extent=drawn[0][1], origin="lower", interpolation="bilinear", zorder=1)


def _placed(model, pose, spheres):
    """Return centres (n, 3) [right, up, towards the viewer] and radii (n,) of the largest spheres [m]."""
    R = rotation_matrix(np.array(xyzw(pose.orientation)))
    centers = (model.centers[:spheres] - model.origin) @ R.T + xyz(pose.position)
    return centers[:, [0, 2, 1]] * [1.0, 1.0, -1.0], model.radii[:spheres]


def _label(axes, gaussian, drawn, name, reference):
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


if __name__ == "__main__":
    sys.exit(main())
