"""Recorded pushes in other engines: walls along the block's edges, three feet, and one or two tips."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from .action_engine_base import Settings, Shape
from .action_engines import opened
from .recorded_pushes import EDGE, FOOT, HEIGHT, Push, edges, feet_of, planar, recorded_pushes


def block_shapes(support: int) -> list[Shape]:
    """Return the shapes of our block: boxes as thick as our spheres' radius along its edges, and its feet."""
    pushes = recorded_pushes()
    low, shapes = -0.5 * pushes.height, []
    for a, along, inward, length, margin in edges():
        middle = a + 0.5 * length * along + 0.5 * EDGE * inward - pushes.com
        turned = Rotation.from_rotvec([0.0, 0.0, math.atan2(along[1], along[0])])
        place = np.array([*middle, low + HEIGHT])
        shapes.append(Shape("box", (length - 2.0 * margin, EDGE, 2.0 * EDGE), place, turned))
    feet = feet_of(support) - pushes.com
    return shapes + [Shape("sphere", (FOOT,), np.array([*foot, low + FOOT])) for foot in feet]


def pushed_in(engine: str, settings: Settings, push: Push, support: int) -> np.ndarray:
    """Return the block's final pose (3,) after a push in an engine, on some of its feet, as `planar`."""
    shapes = {"block": block_shapes(support)}
    with opened(engine, push.scene, settings, shapes) as made:
        return planar(made.run(push.belief.mean, push.horizon)[0][0])
