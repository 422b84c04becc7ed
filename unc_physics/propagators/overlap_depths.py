"""Depths by which bodies overlap each other and the environment."""

from __future__ import annotations

import numpy as np

from ..collision.broad_phase import near_pairs
from ..collision.element_contacts import next_element_contacts, open_element
from ..collision.narrow_phase import DISTANCE, VOLUME, next_contacts, open_pair
from ..compiler import kernel
from ..dynamics.workspace import workspace
from ..scene.scene import Scene
from ..spatial.layout import POSITION

_NUDGE = 1e-9  # of the body's radius: coincident spheres have no normal


def overlaps(scene: Scene, states: np.ndarray, *, among_moving: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Return the depth [m] and an upper bound of the energy [J] of each body's overlap.

    Each is (N, B), of states (N, B, 13). Without ``among_moving``, only overlap with the environment and with
    fixed bodies counts.
    """
    nudged = states.copy()
    radii = [body.model.bounding_radius for body in scene.bodies]
    nudged[:, :, POSITION.start] += _NUDGE * np.arange(len(radii)) * radii
    depth, work = np.zeros(states.shape[:2]), np.zeros(states.shape[:2])
    _add_overlaps(nudged, scene.world, scene.world.environment, among_moving, depth, work)
    assert scene.stiffness is not None  # chosen when a prediction begins
    return depth, scene.stiffness * work


@kernel
def _add_overlaps(states, world, environment, among_moving, depths, works):
    """Add depths, and depth times volume, half for each of two bodies, of states (N, B, 13): (N, B)."""
    for n in range(len(states)):
        x, out, energy = states[n], depths[n], works[n]
        work = workspace(x, world)
        radii, pairs, records = world.tree.radii, work.search.pairs, work.search.records
        for k in range(near_pairs(x, world.bodies.radius, work.zero_travel, world.bodies.moving, work)):
            i, j = work.near[k, 0], work.near[k, 1]
            if not among_moving and world.bodies.moving[i] and world.bodies.moving[j]:
                continue
            t_ij, slack, top = open_pair(x, i, j, world, work)
            while top > 0:
                count, top = next_contacts(world.tree, work.R_ij, t_ij, slack, work.search, top)
                for c in range(count):
                    depth = radii[pairs[c, 0]] + radii[pairs[c, 1]] - records[c, DISTANCE]
                    for body in (i, j):
                        out[body] = max(out[body], depth)
                        energy[body] += 0.5 * depth * records[c, VOLUME]
        if environment is not None:
            for i in range(len(x)):
                if world.bodies.moving[i]:
                    for e in range(len(environment.kind)):
                        t, top = open_element(x, i, e, world, environment, work)
                        while top > 0:
                            count, top = next_element_contacts(
                                world.tree,
                                environment,
                                e,
                                work.R_ij,
                                t,
                                world.bodies.radius[i],
                                work.search,
                                top,
                            )
                            for c in range(count):
                                depth = radii[pairs[c, 0]] - records[c, DISTANCE]
                                out[i] = max(out[i], depth)
                                energy[i] += depth * records[c, VOLUME]
