"""Notes of a status: facts about a body that raise no flag by themselves, in words."""

from __future__ import annotations

from ..scene.scene import Scene
from ..shapes.packing_file import HULL


def hull_of_mesh(scene: Scene, body: int) -> str | None:
    """Return how far a body, by its index, is from its mesh if its piece is only the hull; else None."""
    model = scene.bodies[body].model
    if model.pieces_kind != HULL or model.pieces_error is None:
        return None
    return f"has the convex hull of its mesh as its piece, up to {1e3 * model.pieces_error.max():.1f} mm off"
