"""What can be adjusted while looking at a scene: how uncertain its bodies are, and its materials."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..scene.belief import Belief
from ..scene.scene import Scene
from ..spatial.layout import ERR_ANGULAR_VELOCITY, ERR_POSITION, ERR_ROTATION, ERR_VELOCITY, ERROR

#: Standard deviations of a belief: their places in the error state, the least end of their range, their unit.
STDS = {
    "position_std": (ERR_POSITION, 0.02, "m"),
    "orientation_std": (ERR_ROTATION, 0.2, "rad"),
    "linear_velocity_std": (ERR_VELOCITY, 0.1, "m/s"),
    "angular_velocity_std": (ERR_ANGULAR_VELOCITY, 1.0, "rad/s"),
}
_MATERIALS = ("friction", "friction_std", "restitution", "restitution_std")
#: The sliders' names.
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
_RANGE = 3.0  # times the value that a quantity has


class AdjustableQuantity(NamedTuple):
    """Something that a slider sets: a key of scene files, its value, the highest it may get, and its unit."""

    key: str
    value: float
    most: float
    unit: str


def adjustable(scene: Scene, belief: Belief) -> list[AdjustableQuantity]:
    """What can be adjusted; of standard deviations the root mean square over all bodies that move."""
    found = []
    for key, (place, least, unit) in STDS.items():
        value = _spread(belief, place)
        found.append(AdjustableQuantity(key, value, _round(max(_RANGE * value, least)), unit))
    if scene.integrator == "implicit":
        for key in _MATERIALS:
            value = float(getattr(scene, key) or 0.0)
            most = 1.0 if key.startswith("restitution") else _round(max(1.0, _RANGE * value))
            found.append(AdjustableQuantity(key, value, 0.3 if key.endswith("_std") else most, ""))
    return found


def _round(value):
    """The next 1, 2 or 5 times a power of ten, for sliders whose ends and steps can be read."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(digit * power for digit in (1.0, 2.0, 5.0, 10.0) if value <= digit * power * (1.0 + 1e-9))


def adjusted(scene: Scene, belief: Belief, values: dict[str, float]) -> tuple[Scene, Belief]:
    """The scene and the belief with other values of some quantities, by their keys.

    A standard deviation scales the belief's own, correlations kept; where the belief had none, all bodies
    that move get it.

    Raises
    ------
    UncPhysicsError
        If the scene cannot have them.
    """
    materials = {key: values[key] for key in _MATERIALS if key in values}
    if materials:
        for key in ("friction", "restitution"):  # what is uncertain varies about a value that is not 0
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
    """Root mean square of the standard deviations at a place of the error state."""
    if not len(belief.moving):
        return 0.0
    variances = [belief.marginal(k).diagonal()[place] for k in belief.moving]
    return float(np.sqrt(max(np.mean(variances), 0.0)))
