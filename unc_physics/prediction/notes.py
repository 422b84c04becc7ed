"""Notes of a status: facts about a body that raise no flag by themselves, in words."""

from __future__ import annotations

import numpy as np

from ..scene.scene import Scene
from ..shapes.mesh_pieces import NOTED
from ..shapes.packing_file import HULL

_SIZES = 1e-3, 10.0  # below and above the sizes of what robots handle and stand on [m]
_DENSITIES = 0.1, 1e5  # below and above the densities of all materials [kg/m^3]


def inexact_pieces(scene: Scene, body: int) -> str | None:
    """Return how far a body, by its index, is from its mesh if its pieces are coarse; else None.

    Pieces are coarse if they are only the hull, or `NOTED` by `pack`. Recipes state their error in the docs.
    """
    model = scene.bodies[body].model
    if model.pieces_error is None or model.pieces_kind == "recipe" or scene.integrator == "explicit":
        return None
    _, high, *largest = 1e3 * model.pieces_error
    if model.pieces_kind == HULL:
        return f"has the convex hull of its mesh as its piece, up to {max(largest):.1f} mm off"
    if model.bounds is None or high <= NOTED * 1e3 * np.ptp(model.bounds, axis=0).max():
        return None
    return (
        f"has pieces that are {high:.1f} mm or more off 1 % of its mesh's surface, and up to"
        f" {max(largest):.1f} mm; pack it with a smaller tolerance"
    )


def odd_density(scene: Scene, body: int) -> str | None:
    """Return that a body, by its index, is lighter than foams or heavier than metals; None if it is not.

    Scenes of the explicit integrator choose their units themselves.
    """
    own, (low, high) = scene.bodies[body], _DENSITIES
    if scene.integrator == "explicit" or not own.free or low <= own.mass / own.model.volume <= high:
        return None
    return (
        f"has a mass that does not fit its size, {own.mass:.3g} kg and {own.model.volume:.3g} m^3; is its"
        " mesh in millimetres? Scale it to metres, or correct the mass"
    )


def odd_size(scene: Scene, body: int) -> str | None:
    """Return that a body, by its index, is larger than 10 m or smaller than 1 mm; None if it is not.

    Scenes of the explicit integrator choose their units themselves.
    """
    size, (low, high) = 2.0 * scene.bodies[body].model.bounding_radius, _SIZES
    if scene.integrator == "explicit" or low <= size <= high:
        return None
    return f"has a size of {size:.3g} m; lengths are in metres, is it given in another unit?"


def endless(scene: Scene, body: int) -> str | None:
    """Return that a body, by its index, falls or flies for ever, as nothing can stop it; else None."""
    if scene.environment or not all(one.free for one in scene.bodies):
        return None
    if scene.gravity.any():
        return "falls for ever, as the scene has no environment; give it a plane or a box to land on"
    if len(scene.bodies) == 1:
        return "meets nothing, as the scene has neither gravity nor an environment; should it be everyday?"
    return None
