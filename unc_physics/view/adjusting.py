"""Quantities that a viewer can adjust: uncertainty of bodies, and materials."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..scene.belief import Belief
from ..scene.scene import Scene
from ..spatial.layout import ERR_ANGULAR_VELOCITY, ERR_POSITION, ERR_ROTATION, ERR_VELOCITY, ERROR

#: Standard deviations of a belief: index in the error state, least upper end of the range, unit.
STDS = {
    "position_std": (ERR_POSITION, 0.02, "m"),
    "orientation_std": (ERR_ROTATION, 0.2, "rad"),
    "linear_velocity_std": (ERR_VELOCITY, 0.1, "m/s"),
    "angular_velocity_std": (ERR_ANGULAR_VELOCITY, 1.0, "rad/s"),
}
_MATERIALS = ("friction", "friction_std", "restitution", "restitution_std")
#: Labels of the sliders.
LABELS = {
    "position_std": "std of positions",
    "orientation_std": "std of orientations",
    "linear_velocity_std": "std of velocities",
    "angular_velocity_std": "std of angular velocities",
    "friction": "friction",
    "friction_std": "std of friction",
    "restitution": "restitution",
    "restitution_std": "std of restitution",
}
_RANGE = 3.0  # upper end of a range, relative to the current value


class AdjustableQuantity(NamedTuple):
    """Quantity that a slider sets: key of scene files, value, upper end of the range, and unit."""

    key: str
    value: float
    most: float
    unit: str


def adjustable(scene: Scene, belief: Belief) -> list[AdjustableQuantity]:
    """Return the adjustable quantities; standard deviations are root mean squares over moving bodies."""
    found = []
    for key, (place, least, unit) in STDS.items():
        value = _spread(belief, place)
        found.append(AdjustableQuantity(key, value, _round(max(_RANGE * value, least)), unit))
    if scene.integrator != "explicit":
        for key in _MATERIALS:
            value = float(getattr(scene, key) or 0.0)
            most = 1.0 if key.startswith("restitution") else _round(max(1.0, _RANGE * value))
            found.append(AdjustableQuantity(key, value, 0.3 if key.endswith("_std") else most, ""))
    return found


def _round(value):
    """Round up to 1, 2 or 5 times a power of ten, for readable slider ends and steps."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(digit * power for digit in (1.0, 2.0, 5.0, 10.0) if value <= digit * power * (1.0 + 1e-9))


def adjusted(scene: Scene, belief: Belief, values: dict[str, float]) -> tuple[Scene, Belief]:
    """Return the scene and the belief with new values of quantities, by key.

    A new standard deviation scales the belief's own and keeps correlations. If the belief has none, all
    moving bodies get the new value. Raises `UncPhysicsError` if the values are invalid for the scene.
    """
    materials = {key: values[key] for key in _MATERIALS if key in values}
    if materials:
        for key in ("friction", "restitution"):  # an uncertain material needs a nonzero value
            if materials.get(f"{key}_std") and not materials.get(key, getattr(scene, key)):
                materials[f"{key}_std"] = 0.0
            elif f"{key}_std" in materials:
                most = materials.get(key, getattr(scene, key)) or 0.0
                materials[f"{key}_std"] = min(materials[f"{key}_std"], most)
        scene = replace(scene, **materials)
    factors, added = np.ones(ERROR), np.zeros(ERROR)
    for key, (place, _, _) in STDS.items():
        if key in values:
            spread = _spread(belief, place)
            if spread > 0.0:
                factors[place] = values[key] / spread
            else:
                added[place] = values[key] ** 2
    count = len(belief.moving)
    D, extra = np.tile(factors, count), np.tile(added, count)
    if belief.independent:
        P = belief.blocks * np.outer(factors, factors) + np.diag(added)
    else:
        P = belief.joint * np.outer(D, D) + np.diag(extra)
    return scene, Belief(belief.mean, P, belief.moving)


def _spread(belief, place):
    """Return the root mean square of standard deviations at an index of the error state."""
    if not len(belief.moving):
        return 0.0
    variances = [belief.marginal(k).diagonal()[place] for k in belief.moving]
    return float(np.sqrt(max(np.mean(variances), 0.0)))
