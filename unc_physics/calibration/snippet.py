"""Result of a calibration as text: a table, and lines of a scene file."""

from __future__ import annotations

import dataclasses

import numpy as np
import yaml

from ..scene.environment import quantities
from ..scene.scene import IMPACT_STDS, Scene
from .calibrate import Calibration

_GRAVITY_OFF = 0.01  # relative, by which gravity may differ from the scene's
_SLANT = 5e-3  # rad, likewise
_SURE = 3.0  # standard deviations that they differ by at least
_MATERIAL = ("friction", "friction_std", "restitution", "restitution_std")
_PHYSICS = (*_MATERIAL, "impact_friction_speed", *IMPACT_STDS)


def as_table(found: Calibration) -> str:
    """Return a table of fitted values with their uncertainty, with lines on scores, gravity and doubts."""
    rows = [["", "before", "fitted", "std", "unit"]]
    for one in found.fitted:
        std = f"{one.std:.3g}" if one.determined else f"({one.std:.3g})"
        rows.append([one.name, f"{one.before:.3g}", f"{one.value:.3g}", std, one.unit])
    widths = [max(len(row[k]) for row in rows) for k in range(5)]
    lines = ["  ".join(f"{cell:<{w}}" for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]
    lines.append(
        f"score {found.objective[0]:.3f} before, {found.objective[1]:.3f} after, of {len(found.recorded)}"
        f" motions and {found.evaluations} parameter sets; the lower the better"
    )
    for what, quantity in (("positions", "position_rank"), ("rotations", "rotation_rank")):
        shares = [
            100.0 * float(np.mean(np.concatenate([getattr(one, quantity) for one in own]) <= 0.9))
            for own in (found.scores_before, found.scores_after)
        ]
        lines.append(f"regions of 90 % hold {shares[0]:.0f} % of {what} before, {shares[1]:.0f} % after")
    lines += _about_gravity(found)
    lines += found.doubts
    return "\n".join(lines)


def _about_gravity(found):
    """Return a line if the acceleration of free flights differs from the scene's gravity; else none."""
    if found.gravity is None:
        return []
    own, (seen, std) = found.before.scene.gravity, found.gravity
    sizes = np.linalg.norm(own), np.linalg.norm(seen)
    off = float(np.arccos(np.clip(own @ seen / (sizes[0] * sizes[1]), -1.0, 1.0)))
    text = f"put gravity: [{', '.join(f'{value:.4g}' for value in seen)}] into the scene as it was recorded"
    along = np.linalg.norm(std * seen) / sizes[1]
    if abs(sizes[1] - sizes[0]) > max(_GRAVITY_OFF * sizes[0], _SURE * along):
        line = f"free flights fall with {sizes[1]:.3f} +- {along:.3f} m/s^2, the scene with {sizes[0]:.3f}"
        return [f"{line}: the recording's scale or frame rate may be off; {text}"]
    if off > max(_SLANT, _SURE * np.linalg.norm(std) / sizes[1]):
        return [f"free flights fall {1e3 * off:.0f} mrad aslant of the scene's gravity: {text}"]
    return []


def as_scene_file(scene: Scene) -> str:
    """Return the lines of a scene file with all values that can be fitted."""
    body = scene.bodies[0]
    content: dict = {key: value for key in _PHYSICS if (value := getattr(scene, key))}
    content["environment"] = [_element(element) for element in scene.environment]
    inertia: dict = {"name": body.name}
    if body.inertia is not None:
        rounding = 1e-9 * np.abs(body.inertia).max()
        inertia["inertia"] = [[0.0 if abs(v) < rounding else float(v) for v in row] for row in body.inertia]
    content["bodies"] = [inertia]
    return yaml.safe_dump(_rounded(content), sort_keys=False, default_flow_style=None)


def _element(element):
    """Return an element's entry in a scene file."""
    own = {}
    for name in quantities(type(element)):
        if name != "orientation" or not np.allclose(element.orientation, [0, 0, 0, 1]):
            value = np.asarray(getattr(element, name), float)
            own[name] = value.tolist() if value.ndim else float(value)
    entry = ({"name": element.name} if element.name else {}) | {element.shape: own}
    spreads = ("friction", "friction_std", "restitution", "restitution_std", "surface_tilt_std")
    known = {field.name for field in dataclasses.fields(element)}
    return entry | {key: getattr(element, key) for key in spreads if key in known and getattr(element, key)}


def _rounded(value):
    if isinstance(value, dict):
        return {key: _rounded(own) for key, own in value.items()}
    if isinstance(value, list):
        return [_rounded(own) for own in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value
