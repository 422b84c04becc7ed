"""Everyday scenes whose beliefs reach into a table, into a wall, and into each other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from unc_physics.geometry.library import load_model
from unc_physics.physics.layout import VELOCITY
from unc_physics.scene.belief import Belief
from unc_physics.scene.body import RigidBody
from unc_physics.scene.environment import Box, Plane
from unc_physics.scene.scene import Scene

from .scenarios import resting, spread

OBJECTS = ("salt_box", "mug", "can", "brick")
PAIRS = (("salt_box", "mug"), ("can", "brick"))  # side by side
STACKS = (("brick", "salt_box"), ("brick", "mug"), ("can", "can"))  # the lower one first
GAP = 0.005  # m, between things that stand side by side
INSIDE = 0.003  # m, how deep a mean reaches into walls
INTO = 0.05  # m/s, speed of a mean into the contact
SPEED_STD, SPIN_STD = 0.05, 0.5  # m/s, rad/s
OWN_STD = 0.001, 0.5  # m, degrees: what bodies do not share where they share an error
NARROWER = (0.002, 0.010)  # m, by how much slots are too narrow
STILL = (
    "on a plane",
    "on a board",
    "side by side, 5 mm",
    "side by side, touching",
    "stacked",
    "in a corner",
    "in a wall",
)
SHARED, MOVING, SLOTS = "common error", "moving", "no room"
GROUPS = (*STILL, SHARED, MOVING, SLOTS)

_FLOOR = Plane((0.0, 0.0, 1.0), 0.0, name="table")
_BOARD = (
    Box((0.8, 0.6, 0.018), (0.0, 0.0, -0.009), name="board"),
    Plane((0.0, 0.0, 1.0), -0.3, name="floor"),
)
_THICK = 0.02  # m, of walls


class Arrangement(NamedTuple):
    """Some things and what is around them.

    Attributes
    ----------
    group : str
        One of `GROUPS`.
    models : tuple of str
    positions : (B, 3) array
        Means of the centres of mass [m].
    environment : tuple of Element
    """

    group: str
    models: tuple[str, ...]
    positions: np.ndarray
    environment: tuple = (_FLOOR,)

    @property
    def name(self) -> str:
        """Group and models, which tell it from all others."""
        return f"{self.group}: {' and '.join(self.models).replace('_', ' ')}"


def arrangements() -> Iterator[Arrangement]:
    """All of them."""
    for model in OBJECTS:
        yield Arrangement("on a plane", (model,), _standing(model))
    for model in OBJECTS:
        yield Arrangement("on a board", (model,), _standing(model), _BOARD)
    for group, gap in (("side by side, 5 mm", GAP), ("side by side, touching", 0.0)):
        for pair in PAIRS:
            yield Arrangement(group, pair, _beside(*pair, gap))
    for stack in STACKS:
        yield Arrangement("stacked", stack, _stacked(*stack))
    for model in OBJECTS:
        yield Arrangement("in a corner", (model,), _standing(model), (_FLOOR, *_walls(model, (0, 1))))
    for model in OBJECTS:
        yield Arrangement("in a wall", (model,), _standing(model), (_FLOOR, *_walls(model, (0,))))
    yield Arrangement(SHARED, PAIRS[0], _beside(*PAIRS[0], GAP))
    yield Arrangement(SHARED, STACKS[0], _stacked(*STACKS[0]))
    for model in OBJECTS:
        yield Arrangement(MOVING, (model,), _standing(model))
    yield Arrangement(MOVING, PAIRS[1], _beside(*PAIRS[1], 0.0))


def slots() -> Iterator[Arrangement]:
    """What has no room: a box between two walls, a can inside a mug."""
    for less in NARROWER:
        low, high = load_model("salt_box").bounds
        walls = _walls("salt_box", (1,), 0.5 * less)
        other = replace(walls[0], position=walls[0].position * [1.0, -1.0, 1.0], name="right")
        yield Arrangement(
            f"{SLOTS}, {1e3 * less:g} mm", ("salt_box",), _standing("salt_box"), (_FLOOR, *walls, other)
        )
    mug, (low, high) = _standing("mug"), load_model("mug").bounds
    inside = np.array([low[0] + high[1], 0.0, 0.015 + _height("can")])  # the mug's axis: its handle is at +x
    yield Arrangement(SLOTS, ("mug", "can"), np.vstack([mug, inside]))


def scene_and_belief(
    arrangement: Arrangement, position_std: float, angle_std: float, **options
) -> tuple[Scene, Belief]:
    """An everyday scene and what is known of it.

    Parameters
    ----------
    arrangement : Arrangement
    position_std : float
        Along each axis [m]. Of bodies that share an error it is that of the shared one.
    angle_std : float
        About each axis [rad].
    **options
        Of the scene; ``at_rest`` is of the bodies.
    """
    fields = {key: options.pop(key) for key in ("at_rest",) if key in options}
    bodies = []
    for k, model in enumerate(map(load_model, arrangement.models)):
        name = model.name if arrangement.models.count(model.name) == 1 else f"{model.name}_{k}"
        bodies.append(RigidBody(name, model, **fields))
    scene = Scene.everyday(bodies, environment=arrangement.environment, **options)
    mean = resting(arrangement.positions)
    shared = arrangement.group == SHARED
    own = (OWN_STD[0], np.radians(OWN_STD[1])) if shared else (position_std, angle_std)
    deviations = {"position": own[0], "rotation": own[1]}
    if arrangement.group == MOVING:
        deviations |= {"velocity": SPEED_STD, "spin": SPIN_STD}
        mean[:, VELOCITY] = [[0.0, 0.0, -INTO]] if len(bodies) == 1 else [[INTO, 0.0, 0.0], [-INTO, 0.0, 0.0]]
    belief = Belief(mean, spread(len(bodies), **deviations))
    if shared:
        belief = belief.with_common_pose_std([position_std] * 3 + [angle_std] * 3)
    return scene, belief


def _height(model):
    """Of the centre of mass above the underside [m]."""
    return -load_model(model).bounds[0][2]


def _standing(model):
    return np.array([[0.0, 0.0, _height(model)]])


def _beside(left, right, gap):
    """Centres of two things whose sides along x are that far from each other."""
    (_, a), (b, _) = load_model(left).bounds, load_model(right).bounds
    return np.array([[-a[0] - 0.5 * gap, 0.0, _height(left)], [-b[0] + 0.5 * gap, 0.0, _height(right)]])


def _stacked(lower, upper):
    top = _height(lower) + load_model(lower).bounds[1][2]
    return np.array([[0.0, 0.0, _height(lower)], [0.0, 0.0, top + _height(upper)]])


def _walls(model, axes, inside=INSIDE):
    """A wall at the far side of each of these axes, into which the thing reaches."""
    walls = []
    for axis in axes:
        position, size = np.array([0.0, 0.0, 0.1]), np.array([0.5, 0.5, 0.2])
        position[axis] = load_model(model).bounds[1][axis] - inside + 0.5 * _THICK
        size[axis] = _THICK
        walls.append(Box(size, position, name="xy"[axis] + "_wall"))
    return tuple(walls)
