"""Predictions as plain values and as text."""

from __future__ import annotations

import html
import math
import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..checks.shown import printable
from ..scene.physics_summary import physics_as_text, physics_of
from ..spatial.layout import (
    ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    POSITION,
    QUATERNION,
    VELOCITY,
)
from .body_status import BodyStatus, Status
from .prediction_data import PredictionData

#: Lines of a table that is printed where nobody asked for all of it.
FEW_LINES = 30


def as_dict(
    prediction: PredictionData, seed: int | None = None, samples: np.ndarray | None = None
) -> dict[str, Any]:
    """Return a prediction as plain Python values, which JSON can hold.

    The keys are those of ``unc_physics schema prediction``. Each body's ``start`` is its belief at time 0
    that was really used (`Prediction.start`). A body has ``modes`` if its state splits. ``samples``
    (N, B, 13) at the horizon are added if they are given.
    """
    scene = prediction.scene
    result = {
        "propagator": prediction.propagator.name,
        "physics": physics_of(prediction.scene),
        "left_out": list(prediction.left_out),
        "seed": seed,
        "time": prediction.time,
        "wall_time": prediction.wall_time,
        "bodies": _bodies(scene, prediction.belief),
    }
    starts = _bodies(scene, prediction.start)
    at_origins = _bodies(scene, prediction.at().at_model_origins(scene))
    keys = ("position", "linear_velocity", "covariance")
    for found, body, start, other in zip(result["bodies"], scene.bodies, starts, at_origins, strict=True):
        del start["name"]
        found |= {"at_rest": body.at_rest, "model_origin": {key: other[key] for key in keys}, "start": start}
    for k in range(len(scene.bodies)):
        if len(modes := prediction.at().modes(scene, k)) > 1:
            result["bodies"][k]["modes"] = [
                {"probability": mode.weight, **_values(mode.mean, mode.covariance)} for mode in modes
            ]
    if samples is not None:
        for k, body in enumerate(result["bodies"]):
            body["samples"] = samples[:, k].tolist()
    if len(prediction.times) > 1:
        result["trajectory"] = [
            {"time": time, "bodies": _bodies(scene, belief)}
            for time, belief in zip(prediction.times, prediction.beliefs, strict=True)
        ]
    return result


def _bodies(scene, belief):
    return [
        {"name": body.name, **_values(belief.mean[k], belief.marginal(k) if body.free else None)}
        for k, body in enumerate(scene.bodies)
    ]


def _values(state, P):
    return {
        "position": state[POSITION].tolist(),
        "orientation": state[QUATERNION].tolist(),
        "linear_velocity": state[VELOCITY].tolist(),
        "angular_velocity": state[ANGULAR_VELOCITY].tolist(),
        "covariance": None if P is None else P.tolist(),
    }


def as_table(prediction: PredictionData, most: int | None = None) -> str:
    """Return the physics and a table of poses and standard deviations.

    Of at most ``most`` lines, the last times are shown, and of one time the first bodies.
    """
    first = f"{prediction.propagator.name}; {physics_as_text(prediction.scene)}"
    times, size = len(prediction.times), 2 + len(prediction.scene.bodies)
    hidden = 0 if most is None else times - min(times, max(1, (most - 2) // size))
    lines = [first]
    if hidden:
        lines.append(f"... {hidden} earlier times are not shown")
    for k in range(hidden, times):
        lines += _block(prediction, k)
    if most is not None and len(lines) > most:
        hidden = len(lines) - most + 1
        lines = [*lines[: most - 1], f"... {hidden} more bodies"]
    return "\n".join(lines)


def as_text(prediction: PredictionData, statuses: Sequence[BodyStatus], most: int | None = None) -> str:
    """Return the table, the flags with their reasons, and the outcomes where a mean is not a possible pose.

    Of at most ``most`` lines in the table, and as many after it.
    """
    table = as_table(prediction, most)
    rest = [*_statuses_as_lines(statuses), *_outcomes_as_lines(prediction, statuses)]
    if most is not None and len(rest) > most:
        rest = [*rest[: most - 1], f"... {len(rest) - most + 1} more lines about flags"]
    return "\n".join([table, *rest])


def _statuses_as_lines(statuses):
    """Return each flagged body with its flags, followed by the reasons, one per line."""
    lines = []
    for status in statuses:
        if status.flags:
            lines.append(f"{printable(status.body)}: {status.flags}")
            for reason in status.reasons:
                lines += textwrap.wrap(reason, 100, initial_indent="  - ", subsequent_indent="    ")
    return lines or ["status: fine"]


def _outcomes_as_lines(prediction, statuses):
    """Return a table of the outcomes of each body whose mean is not a possible pose."""
    lines, last = [], prediction.at()
    for k, status in enumerate(statuses):
        modes = last.modes(prediction.scene, k) if status.flags & Status.MEAN_NOT_POSSIBLE else ()
        if len(modes) < 2:
            continue
        lines.append(f"{printable(status.body)}: {len(modes)} outcomes")
        lines.append(
            f"{'probability':>13}  {'position [m]':^26}  {'orientation (x, y, z, w)':^31}"
            "  std of position [m]"
        )
        for mode in modes:
            std = np.sqrt(np.maximum(mode.covariance.diagonal(), 0.0))[ERR_POSITION]
            lines.append(
                f"{mode.weight:13.3f}  {in_a_row(mode.mean[POSITION], '8.4f')}"
                f"  {in_a_row(mode.mean[QUATERNION], '7.4f')}  {in_a_row(std, '8.4f')}"
            )
    return lines


def preformatted(text: str) -> str:
    """Return text as HTML that keeps its columns."""
    return f"<pre>{html.escape(text)}</pre>"


def _block(prediction, k):
    """Return the lines of the time with index ``k``."""
    scene, time, belief = prediction.scene, prediction.times[k], prediction.beliefs[k]
    names = [printable(body.name) for body in scene.bodies]
    width = max(4, *map(len, names))
    lines = [
        f"t = {time:g} s  ({prediction.propagator.name}, {duration_text(prediction.wall_time)})",
        f"{'body':<{width}}  {'position [m]':^26}  {'orientation (x, y, z, w)':^31}"
        + f"  {'std of position [m]':^26}  std of rotation [deg]",
    ]
    for b, body in enumerate(scene.bodies):
        state, P = belief.mean[b], belief.marginal(b)
        if (reason := why_no_pose(prediction, k, b)) is not None:
            lines.append(f"{names[b]:<{width}}  {reason}")
            continue
        row = f"{names[b]:<{width}}  {in_a_row(state[POSITION], '8.4f')}"
        row += f"  {in_a_row(state[QUATERNION], '7.4f')}  "
        if not body.free:
            row += "fixed" if body.fixed else "prescribed"
        else:
            std = np.sqrt(np.maximum(P.diagonal(), 0.0))
            row += f"{in_a_row(std[ERR_POSITION], '8.4f')}  "
            row += in_a_row(np.degrees(std[ERR_ROTATION]), "7.2f")
        lines.append(row)
    return lines


def why_no_pose(prediction: PredictionData, k: int, body: int) -> str | None:
    """Return why a body's pose at the time with index ``k`` is meaningless; None if it is not.

    A linear map through many contacts can grow without bounds. The pose is meaningless if a standard
    deviation exceeds the size of the scene: the extent of all bodies at the start, and how far bodies fly.
    """
    scene, belief = prediction.scene, prediction.beliefs[k]
    if prediction.propagator.traits.mean_update != "nominal" or not scene.bodies[body].free:
        return None
    std = math.sqrt(max(float(belief.marginal(body).diagonal()[ERR_POSITION].max()), 0.0))
    start, time = prediction.start, prediction.times[k]
    reach = np.array([one.model.bounding_radius for one in scene.bodies])[:, None]
    corners = [start.mean[:, POSITION] - reach, start.mean[:, POSITION] + reach]
    corners += [element.position[None] for element in scene.environment]
    size = float(np.ptp(np.concatenate(corners), axis=0).max())
    spread = np.sqrt(np.maximum(np.einsum("mii->mi", start.blocks), 0.0).max(initial=0.0, axis=0))
    speed = np.linalg.norm(start.mean[:, VELOCITY], axis=1).max() + spread[ERR_VELOCITY].max()
    size += speed * time + 0.5 * float(np.linalg.norm(scene.gravity)) * time**2 + spread[ERR_POSITION].max()
    if std <= size:
        return None
    return (
        f"no pose: the standard deviation of {std:.3g} m exceeds the size of the scene, {size:.3g} m; the"
        " linear map does not hold, take a propagator with samples"
    )


def in_a_row(values, spec: str) -> str:
    """Return numbers, each formatted by ``spec``, with a space between them."""
    return " ".join(f"{value:{spec}}" for value in values)


def duration_text(seconds: float) -> str:
    """Return a duration with its unit."""
    return f"{1e3 * seconds:.3g} ms" if seconds < 0.9995 else f"{seconds:.3g} s"
