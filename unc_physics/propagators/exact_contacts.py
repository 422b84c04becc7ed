"""The surrogate and local sampling on the step over exact shapes, from its states and contacts.

The equations of both methods take balls that touch. A contact stands for two balls, with the impulse of the
step: they touch at its point, and their centres are the points of its normal nearest to the centres of mass.
Contacts with the environment move the mean alone. Lasting contacts that stick are left out, because friction
balances the tangential force of a tilted normal.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..collision.narrow_phase import DISTANCE, NORMAL, RECORD, VOLUME
from ..collision.sphere_tree import Scratch, Tree
from ..compiler import kernel
from ..dynamics.contact_history import ContactHistory
from ..physics.everyday import columns as c
from ..scene.contact_world import bearing_pairs, recorded_contacts, remembered
from ..scene.environment import thing_names
from ..scene.marks import whole
from ..scene.scene import Scene
from ..spatial.layout import P, Q, V, W
from ..spatial.rotation import rotate_back, write_matrix
from .solved_contacts import SolvedContacts, drift, push_pair, stop

_AT_ONCE = 120  # steps whose contacts are kept at a time
_NEAREST = 1e-6  # m, least radius of a ball
_STICKS = 0.999  # share of the cone of friction below which a contact sticks


class Steps(NamedTuple):
    """What the methods read of T steps."""

    states: np.ndarray  # (T + 1, B, 13): before and after each step
    count: np.ndarray  # (T,) int64: number of contacts
    pair: np.ndarray  # (T, K, 2) int64: bodies i and j, contacts of one pair after each other
    normal: np.ndarray  # (T, K, 3): from i to j
    point: np.ndarray  # (T, K, 3): middle of the gap [m]
    gap: np.ndarray  # (T, K) [m]
    impulse: np.ndarray  # (T, K): along the normal [N s]


def advance_over_steps(
    mean: np.ndarray,
    history: ContactHistory,
    scene: Scene,
    begun: int,
    steps: int,
    own: Any,
    blocks: np.ndarray,
) -> ContactHistory:
    """Advance a nominal state (B, 13) and, by a method's state ``own``, its blocks (M, 12, 12) in place.

    Returns the history of the rollout.
    """
    z, done = np.zeros((1, len(scene.uncertain))), 0
    while done < steps:
        some = min(_AT_ONCE, steps - done)
        marks = [whole(begun + done + k, scene.dt) for k in range(1, some + 1)]
        found = recorded_contacts(mean[None], history, scene, z, begun + done, marks)
        states = np.stack([mean, *(x[0] for x, _ in found)])
        read = _read(scene, states, [history, *(own for _, own in found)])
        room = max(read.pair.shape[1], 1)
        world = scene.world._replace(stiffness=1.0 / scene.dt, tree=_balls(room))
        _carry(own, blocks, read, begun + done, scene.sleep, world, _contacts(len(mean), room))
        history, done = found[-1][1], done + some
        mean[:] = states[-1]
    return history


def _read(scene, states, histories):
    """Return the contacts between bodies that push on the methods' blocks."""
    bodies, friction = len(scene.bodies), _friction(scene)
    steps = len(histories) - 1
    bore = [bearing_pairs(scene, history)[0] for history in histories]
    own = [_pushing(scene, histories[t + 1].solver, bore[t], bodies, friction) for t in range(steps)]
    count = np.array([len(rows) for _, rows in own], np.int64)
    most = max(int(count.max(initial=0)), 1)
    pair = np.zeros((steps, most, 2), np.int64)
    normal, point = np.zeros((2, steps, most, 3))
    gap, impulse = np.zeros((2, steps, most))
    for t, (pairs, rows) in enumerate(own):
        n = rows[:, c.NORMAL : c.NORMAL + 3]
        pair[t, : len(rows)], normal[t, : len(rows)] = pairs, n
        point[t, : len(rows)] = rows[:, c.POINT : c.POINT + 3]
        gap[t, : len(rows)] = rows[:, c.GAP0]
        impulse[t, : len(rows)] = np.einsum("ki,ki->k", n, rows[:, c.IMPULSE : c.IMPULSE + 3])
    return Steps(states, count, pair, normal, point, gap, impulse)


def _pushing(scene, memory, bore, bodies, friction):
    """Return pairs and rows of the contacts of one step that push; ``bore`` are pairs of the step before."""
    _, a, b, rows = remembered(scene, memory)
    normal, impulse = rows[:, c.NORMAL : c.NORMAL + 3], rows[:, c.IMPULSE : c.IMPULSE + 3]
    along = np.einsum("ki,ki->k", normal, impulse)
    across = np.linalg.norm(impulse - along[:, None] * normal, axis=1)
    sticks = bore[np.minimum(a, b), np.maximum(a, b)] & (across < _STICKS * friction[a, b] * along)
    some = (a < bodies) & (along > 0.0) & ~sticks
    return np.column_stack([a, b])[some], rows[some]


def _friction(scene):
    """Return the friction of contacts between all surfaces (S, S)."""
    own, names = scene.materials.friction, thing_names(scene)
    found = np.sqrt(own[:, None] * own)
    for pair in scene.pairs:
        if pair.friction is not None:
            i, j = map(names.index, pair.between)
            found[i, j] = found[j, i] = pair.friction
    return found


def _balls(room):
    """Return a tree with room for the balls of contacts, which is not searched."""
    return Tree(
        np.zeros((1, 4, 8), np.float32),
        np.zeros((1, 8), np.int32),
        np.zeros((2 * room, 3)),
        np.zeros(2 * room),
    )


def _contacts(bodies, room):
    """Return rotations and records with room for the contacts of a step."""
    nothing = np.zeros((1, 2), np.int32)
    search = Scratch(
        nothing, np.zeros((room, 2), np.int32), nothing, np.zeros(1, np.int64), np.zeros((room, RECORD))
    )
    return SolvedContacts(np.zeros((bodies, 3, 3)), search)


@kernel
def _carry(own, blocks, steps, begin, sleeps, world, contacts):
    """Carry a method's blocks through steps: the drift, then the contacts of each pair."""
    for t in range(len(steps.count)):
        _turn(steps.states[t], contacts.R)
        drift(own, steps.states[t], begin + t, world, contacts)
        x = steps.states[t + 1]
        _turn(x, contacts.R)
        first = 0
        while first < steps.count[t]:
            i, j, last = steps.pair[t, first, 0], steps.pair[t, first, 1], first
            while last < steps.count[t] and steps.pair[t, last, 0] == i and steps.pair[t, last, 1] == j:
                _write_balls(x, i, j, steps, t, last, last - first, world.tree.centers, contacts)
                last += 1
            push_pair(own, i, j, last - first, world, contacts)
            first = last
        for i in range(len(x)):
            if sleeps and world.bodies.moving[i] and _is_still(x, i):
                stop(own, blocks[own.error_block[i]])


@kernel
def _turn(x, R):
    """Write the rotation matrices of all bodies."""
    for i in range(len(x)):
        write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), R, i)


@kernel
def _is_still(x, i):
    """Return whether a body has no velocity at all, as those that sleep."""
    for k in range(3):
        if x[i, V + k] != 0.0 or x[i, W + k] != 0.0:
            return False
    return True


@kernel
def _write_balls(x, i, j, steps, t, k, place, centers, contacts):
    """Write contact k as the record of two balls that touch at its point."""
    R, p, n = contacts.R, steps.point[t, k], steps.normal[t, k]
    distance = 0.0
    for side in range(2):
        body, sign = (i, -1.0) if side == 0 else (j, 1.0)
        radius = 0.0
        for a in range(3):
            radius += sign * n[a] * (x[body, P + a] - p[a])
        radius = max(abs(radius) - 0.5 * steps.gap[t, k], _NEAREST)
        distance += radius
        arm = (
            p[0] + sign * radius * n[0] - x[body, P],
            p[1] + sign * radius * n[1] - x[body, P + 1],
            p[2] + sign * radius * n[2] - x[body, P + 2],
        )
        centers[2 * place + side, 0], centers[2 * place + side, 1], centers[2 * place + side, 2] = (
            rotate_back(R[body], arm[0], arm[1], arm[2])
        )
        contacts.search.pairs[place, side] = 2 * place + side
    record = contacts.search.records[place]
    record[NORMAL], record[NORMAL + 1], record[NORMAL + 2] = rotate_back(R[i], n[0], n[1], n[2])
    record[DISTANCE], record[VOLUME] = distance, steps.impulse[t, k]
