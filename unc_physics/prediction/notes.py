"""Notes of a status: facts about a body that raise no flag by themselves, in words."""

from __future__ import annotations

from ..scene.scene import Scene
from ..shapes.packing_file import HULL

_DENSITIES = 0.1, 1e5  # below and above the densities of all materials [kg/m^3]


def hull_of_mesh(scene: Scene, body: int) -> str | None:
    """Return how far a body, by its index, is from its mesh if its piece is only the hull; else None."""
    model = scene.bodies[body].model
    if model.pieces_kind != HULL or model.pieces_error is None:
        return None
    return f"has the convex hull of its mesh as its piece, up to {1e3 * model.pieces_error.max():.1f} mm off"


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
