"""Notes of a status: facts about a body that raise no flag by themselves, in words."""

from __future__ import annotations

from ..geometry.packing_file import EXTENT_LOSS, SINK
from ..scene.environment import may_meet
from ..scene.scene import Scene

_SMOOTH = 2e-4  # m; bumps above change how far a round body rolls
_ENOUGH = "take all of its model (in a scene file spheres: auto takes enough), or pack it with more"


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
    if sink is None or sink <= SINK or not may_meet(len(scene.bodies), scene.environment):
        return None
    bumps = ""
    if loss is not None and loss > _SMOOTH:
        bumps = f"; bumps of up to {1e3 * loss:.1f} mm change how far it rolls"
    depth = f"{1e3 * sink:.1f} mm"
    return (
        f"has {count} spheres, between which a ball of 10 mm radius sinks by up to {depth}{bumps}; {_ENOUGH}"
    )
