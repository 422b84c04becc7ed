"""Notes of a status: facts about a body that raise no flag by themselves, in words."""

from __future__ import annotations

from ..scene.environment import Capsule, Cylinder, Sphere
from ..scene.scene import Scene
from ..shapes.packing_file import EXTENT_LOSS, HULL, SINK

_SMOOTH = 2e-4  # m; bumps above change how far a round body rolls
_SMALL = 0.015  # m; bodies without a larger ball inside may sink in between spheres, as a ball of 10 mm does
_ENOUGH = "take all spheres of its model, or pack its mesh with more (pack -n)"


def few_spheres(scene: Scene, body: int) -> str | None:
    """Return what a body, by its index, lacks because it has few spheres; None where it has enough.

    Contacts of the explicit integrator are soft, and its scenes choose their spheres themselves.
    """
    if scene.integrator != "implicit":
        return None
    model = scene.bodies[body].model
    loss, sink, count = model.extent_loss, model.sink, len(model)
    if loss is not None and loss > EXTENT_LOSS:
        spheres = "1 sphere, which reaches" if count == 1 else f"{count} spheres, which reach"
        return f"has {spheres} up to {1e3 * loss:.1f} mm less far than its mesh; {_ENOUGH}"
    if sink is None or sink <= SINK or not _has_small_parts(scene, body):
        return None
    bumps = ""
    if loss is not None and loss > _SMOOTH:
        bumps = f"; bumps of up to {1e3 * loss:.1f} mm change how far it rolls"
    depth = f"{1e3 * sink:.1f} mm"
    return (
        f"has {count} spheres, between which a ball of 10 mm radius sinks by up to {depth}{bumps}; {_ENOUGH}"
    )


def hull_of_mesh(scene: Scene, body: int) -> str | None:
    """Return how far a body, by its index, is from its mesh if its piece is only the hull; else None."""
    model = scene.bodies[body].model
    if model.pieces_kind != HULL or model.pieces_error is None:
        return None
    return f"has the convex hull of its mesh as its piece, up to {1e3 * model.pieces_error.max():.1f} mm off"


def _has_small_parts(scene, body):
    """Return whether another body or a round element is small or thin, so that it may sink in."""
    others = [other.model.radii.max() for k, other in enumerate(scene.bodies) if k != body]
    round_ = [element for element in scene.environment if isinstance(element, (Capsule, Cylinder, Sphere))]
    return min([*others, *(element.radius for element in round_)], default=_SMALL) < _SMALL
