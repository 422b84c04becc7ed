"""Scene of the demo: a can is thrown at a carton on a table."""

from __future__ import annotations

from ..scene.belief import Belief
from ..scene.body import RigidBody
from ..scene.body_belief import BodyBelief
from ..scene.environment import Box
from ..scene.scene import Scene
from ..shapes.library import load_model

HORIZON = 0.8  # s
PERIOD = 0.05  # s


def table_scene() -> tuple[Scene, Belief]:
    """Return the scene and the belief at the time of the throw."""
    names = "carton", "can"
    carton, can = (
        RigidBody(name, load_model(model), at_rest=name == "carton")
        for name, model in zip(names, ("salt_box", "can"), strict=True)
    )
    table = Box((0.9, 0.6, 0.04), (0.0, 0.0, -0.02), name="table")
    scene = Scene.everyday([carton, can], environment=[table], restitution=0.2)
    thrown = BodyBelief(
        position=(-0.25, 0.0, 0.20),
        orientation=(0.0, 0.2, 0.0, 0.98),
        linear_velocity=(1.6, 0.0, 0.0),
        position_std=0.01,
        orientation_std=0.05,
        linear_velocity_std=0.03,
    )
    standing = BodyBelief(
        position=(0.12, 0.0, 0.062), position_std=(0.005, 0.005, 0.0), orientation_std=(0.0, 0.0, 0.03)
    )
    return scene, Belief.of(scene, {"carton": standing, "can": thrown})
