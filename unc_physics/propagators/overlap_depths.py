"""Depths by which bodies overlap each other and the environment."""

from __future__ import annotations

import math

import numpy as np

from ..compiler import inner, kernel
from ..physics.paper.broad_phase import near_pairs
from ..physics.paper.element_contacts import element_distance, next_element_contacts, open_element
from ..physics.paper.free_motion import integrate_position, integrate_rotation
from ..physics.paper.narrow_phase import DISTANCE, VOLUME, next_contacts, open_pair
from ..physics.paper.workspace import workspace
from ..scene.contact_world import depths_of_pairs
from ..scene.scene import Scene
from ..spatial.layout import POSITION, P, V, W

_NUDGE = 1e-9  # of the largest body's radius: coincident spheres have no normal
#: Poses while two things pass each other, and most of them in a step for their rotation.
_POSES, _MOST_POSES = 8.0, 500.0


def overlaps(scene: Scene, states: np.ndarray, *, among_moving: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Return the depth [m] and an upper bound of the energy [J] of each body's overlap.

    Each is (N, B), of states (N, B, 13). Without ``among_moving``, only overlap with the environment and with
    fixed bodies counts.
    """
    if scene.integrator == "implicit":
        depths = depths_of_pairs(scene, states)
        if not among_moving:
            depths[:, scene.moving[:, None], scene.moving] = 0.0
        return depths.max(axis=2), np.zeros(states.shape[:2])
    depth, work = np.zeros((*states.shape[:2], 1)), np.zeros(states.shape[:2])
    _add_overlaps(_nudged(scene, states), scene.world, scene.world.environment, among_moving, depth, work)
    assert scene.stiffness is not None  # chosen when a prediction begins
    return depth[:, :, 0], scene.stiffness * work


def pair_overlaps(scene: Scene, states: np.ndarray) -> np.ndarray:
    """Return the depth of each overlap in states (N, B, 13), with bodies and elements: (N, B, B + E) [m]."""
    if scene.integrator == "implicit":
        return depths_of_pairs(scene, states)
    bodies = len(scene.bodies)
    depth = np.zeros((len(states), bodies, bodies + len(scene.environment)))
    work = np.zeros(states.shape[:2])
    _add_overlaps(_nudged(scene, states), scene.world, scene.world.environment, True, depth, work)
    return depth


def _nudged(scene, states):
    """Return states in which no two bodies have the same position."""
    nudged, radii = states.copy(), [body.model.bounding_radius for body in scene.bodies]
    nudged[:, :, POSITION.start] += _NUDGE * max(radii) * np.arange(len(radii))
    return nudged


@kernel
def _add_overlaps(states, world, environment, among_moving, depths, works):
    """Add depths (N, B, B + E), and depth times volume, half for each of two bodies (N, B), of states.

    With a last axis of length 1 the depths are those of each body's deepest overlap.
    """
    by_pair = depths.shape[2] > 1
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
                    for body, other in ((i, j), (j, i)):
                        column = other if by_pair else 0
                        out[body, column] = max(out[body, column], depth)
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
                                column = len(x) + e if by_pair else 0
                                out[i, column] = max(out[i, column], depth)
                                energy[i] += depth * records[c, VOLUME]


@kernel
def find_meetings(states, pair, first, second, size, world, environment, found):
    """Find the first of some explicit steps in which each of several pairs overlaps, also between its ends.

    Parameters
    ----------
    states : (n, B, 13) float64
        At the beginning of each step; changed.
    pair : (n,) int64
        Index of the pair of each step; the steps of a pair ascend.
    first, second : (P,) int64
        Bodies of each pair; ``-1 - e`` in place of a second body for element e.
    size : (P,) float64
        Travel by which two things pass each other, without spin [m].
    world : World
    environment : Environment or None
    found : (P,) int64
        Index of the first step in which they overlap; only negative ones are changed.
    """
    for n in range(len(states)):
        p = pair[n]
        if found[p] < 0 and _meet(states[n], first[p], second[p], size[p], world, environment):
            found[p] = n


@inner
def _meet(x, i, j, size, world, environment):
    """Return whether body i meets j within a step that begins at state ``x``, which is changed."""
    work, radius, dt = workspace(x, world), world.bodies.radius, world.dt
    way = spin = 0.0
    for k in range(3):
        v = x[i, V + k]
        if j >= 0:
            v -= x[j, V + k]
            spin += abs(x[j, W + k]) * radius[j]
        way += v * v
        spin += abs(x[i, W + k]) * radius[i]
    way, done, last = dt * math.sqrt(way), 0.0, False
    least = 1.0 / (_POSES * way / size + min(_POSES * dt * spin / size, _MOST_POSES) + 1.0)
    while not last:
        share, gap = least, _bounding_gap(x, i, j, radius, environment)
        if gap > 0.0:
            if gap >= (1.0 - done) * way:
                return False
            share = max(share, gap / way)
        last = done + share >= 1.0
        share = min(share, 1.0 - done)
        done += share
        integrate_rotation(x, i, share * dt, radius, work.R)
        integrate_position(x, i, share * dt)
        if j >= 0:
            integrate_rotation(x, j, share * dt, radius, work.R)
            integrate_position(x, j, share * dt)
        if _bounding_gap(x, i, j, radius, environment) <= 0.0 and _overlap(x, i, j, world, environment, work):
            return True
    return False


@inner
def _bounding_gap(x, i, j, radius, environment):
    """Return the gap between the balls about two bodies, or between that of body i and an element [m]."""
    if j >= 0:
        dx, dy, dz = x[j, P] - x[i, P], x[j, P + 1] - x[i, P + 1], x[j, P + 2] - x[i, P + 2]
        return math.sqrt(dx * dx + dy * dy + dz * dz) - radius[i] - radius[j]
    if environment is not None:
        return element_distance(environment, -1 - j, x[i, P], x[i, P + 1], x[i, P + 2]) - radius[i]
    return math.inf


@inner
def _overlap(x, i, j, world, environment, work):
    """Return whether a sphere of body i overlaps one of body j, or an element."""
    count = 0
    if j >= 0:
        t_ij, slack, top = open_pair(x, i, j, world, work)
        while top > 0 and count == 0:
            count, top = next_contacts(world.tree, work.R_ij, t_ij, slack, work.search, top)
    elif environment is not None:
        t, top = open_element(x, i, -1 - j, world, environment, work)
        while top > 0 and count == 0:
            count, top = next_element_contacts(
                world.tree, environment, -1 - j, work.R_ij, t, world.bodies.radius[i], work.search, top
            )
    return count > 0
