"""Notes of a status: facts about a body that raise no flag by themselves, in words."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..scene.scene import Scene
from ..shapes.mesh_pieces import NOTED
from ..shapes.packing_file import HULL

ENDLESS = "falls for ever, as the scene has no environment; give it a plane or a box to land on"
_SIZES = 1e-3, 10.0  # below and above the sizes of what robots handle and stand on [m]
_DENSITIES = 0.1, 1e5  # below and above the densities of all materials [kg/m^3]


def notes_of(scene: Scene, body: int) -> Iterator[str]:
    """Yield the notes of a body, by its index.

    They are about pieces that are coarse, mass and size of no usual thing, and falls that nothing ends.
    Scenes of the explicit integrator choose their units themselves, and have no pieces.
    """
    own, size = scene.bodies[body], 2.0 * scene.bodies[body].model.bounding_radius
    if scene.integrator != "explicit":
        yield from _inexact_pieces(own.model)
        if own.free and not _DENSITIES[0] <= own.mass / own.model.volume <= _DENSITIES[1]:
            yield (
                f"has a mass that does not fit its size, {own.mass:.3g} kg and {own.model.volume:.3g} m^3; is"
                " its mesh in millimetres? Scale it to metres, or correct the mass"
            )
        if not _SIZES[0] <= size <= _SIZES[1]:
            yield f"has a size of {size:.3g} m; lengths are in metres, is it given in another unit?"
    if not scene.environment and all(one.free for one in scene.bodies):
        if scene.gravity.any():
            yield ENDLESS
        elif len(scene.bodies) == 1:
            yield "meets nothing, as the scene has neither gravity nor an environment; should it be everyday?"


def _inexact_pieces(model):
    """Yield how far a body is from its mesh if its pieces are only the hull, or `NOTED` by `pack`.

    Recipes state their error in the docs.
    """
    if model.pieces_error is None or model.pieces_kind == "recipe":
        return
    _, high, *largest = 1e3 * model.pieces_error
    if model.pieces_kind == HULL:
        yield f"has the convex hull of its mesh as its piece, up to {max(largest):.1f} mm off"
    elif model.bounds is not None and high > NOTED * 1e3 * np.ptp(model.bounds, axis=0).max():
        yield (
            f"has pieces that are {high:.1f} mm or more off 1 % of its mesh's surface, and up to"
            f" {max(largest):.1f} mm; pack it with a smaller tolerance"
        )
