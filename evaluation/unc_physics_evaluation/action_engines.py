"""A scene with actions in another engine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

from unc_physics.scene.scene import Scene

from .action_engine_base import ActionEngine, Settings, Shape
from .mujoco_actions import MuJoCoActions
from .pybullet_actions import PyBulletActions

#: What engines do unless told otherwise, and what is fine enough for slow pushes.
OWN = {"mujoco": Settings(0.002), "pybullet": Settings(1.0 / 240.0)}
FINE = {
    "mujoco": Settings(0.001, contact_time=0.002, firm_friction=100.0),
    "pybullet": Settings(0.001, iterations=200),
}
_ENGINES = {"mujoco": MuJoCoActions, "pybullet": PyBulletActions}


@contextmanager
def opened(
    engine: str, scene: Scene, settings: Settings, shapes: Mapping[str, Sequence[Shape]] | None = None
) -> Iterator[ActionEngine]:
    """Return a scene in an engine.

    Parameters
    ----------
    engine : {'mujoco', 'pybullet'}
    scene : Scene
    settings : Settings
    shapes : mapping of str to sequence of Shape, optional
        Shapes of the bodies that `shapes_of` refuses, by name.
    """
    made = _ENGINES[engine](scene, settings, shapes)
    try:
        yield made
    finally:
        made.close()
