"""Join the carries of islands: positions of each island's bodies among all bodies, and joined arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..dynamics import contact_history as histories
from ..dynamics.contact_history import ContactHistory
from ..dynamics.world import World


class Part(NamedTuple):
    """Positions of an island's bodies, moving bodies and parameters in the joint island."""

    bodies: np.ndarray  # (b,) int: indices of its bodies
    moving: np.ndarray  # (m,) int: of its moving bodies among the moving ones
    parameters: np.ndarray  # (k,) int: of its uncertain parameters


class JointIsland(NamedTuple):
    """The island that several islands are joined to."""

    mean: np.ndarray  # (B, 13): states of its bodies at time 0, which the fixed ones keep
    #: moving, parameters: how many bodies move, and how many parameters are uncertain
    moving: int
    world: World
    parameters: int


def joined_means(carries: Sequence[Any], parts: Sequence[Part], joint: JointIsland) -> np.ndarray:
    """Return the joint ``mean`` (B, 13) of carries that have one."""
    mean = joint.mean.copy()
    for carry, part in zip(carries, parts, strict=True):
        mean[part.bodies] = carry.mean
    return mean


def joined_blocks(blocks: Sequence[np.ndarray], parts: Sequence[Part], joint: JointIsland) -> np.ndarray:
    """Return values of all moving bodies (M, ...) from those of the islands (m, ...)."""
    values = np.empty((joint.moving, *blocks[0].shape[1:]))
    for own, part in zip(blocks, parts, strict=True):
        values[part.moving] = own
    return values


def joined_history(
    carries: Sequence[Any],
    parts: Sequence[Part],
    joint: JointIsland,
    rows: Sequence[np.ndarray] | None = None,
) -> ContactHistory:
    """Return the contact history of joint rollouts; ``rows`` are the rollouts of each carry (None: all)."""
    found = [carry.contact_history for carry in carries]
    if rows is None:
        rows = [np.arange(len(history.first_time)) for history in found]
    return histories.joined(found, rows, [part.bodies for part in parts], joint.world)
