"""How a step is divided where contacts ask for it: chosen before the step is taken."""

import math
from typing import NamedTuple

from ..layout import P, V, W
from .compiled import inner, kernel
from .laws import QUIET, RATE
from .pairs import may_touch, near_pairs
from .surroundings import element_distance
from .world import BOX

_RESOLVED = 0.5  # most that a contact's oscillation may turn in a piece [rad]
_CROSSED = 0.25  # most that a piece may move a body, of the thickness of what it approaches
_MOST_PIECES = 1000
_LONGEST_CALM = 64  # steps for which a scene is left alone at most


class Piece(NamedTuple):
    """A time step, or a piece of one.

    Attributes
    ----------
    dt : float
        Its length [s].
    decay : float
        Factor on all velocities in it.
    before, after : float
        How long bodies drift before their contacts act, and after [s].
    left : float
        What remains of the step after it [s].
    """

    dt: float
    decay: float
    before: float
    after: float
    left: float


@inner(forceinline=True)
def next_piece(x, memory, world, laws, left, work):
    """The next piece of a step of which ``left`` seconds remain."""
    if laws is None:
        return Piece(world.dt, world.decay, world.dt, 0.0, 0.0)
    else:
        after = 0.5 * world.dt if laws.robust else 0.0
        if work.calm[0] > 0:
            work.calm[0] -= 1
            return Piece(world.dt, world.decay, world.dt - after, after, 0.0)
        return next_piece_of_laws(x, memory, world, laws, left, work)


@inner
def next_piece_of_laws(x, memory, world, laws, left, work):
    """As `next_piece`, where something may be near."""
    work.patches.count[0] = 0
    if left == world.dt and work.touching[0] == 0:
        if _calm_for(x, world, laws, work.calm[1], work):
            after = 0.5 * world.dt if laws.robust else 0.0
            work.calm[0] = work.calm[1] - 1
            work.calm[1] = min(2 * work.calm[1], _LONGEST_CALM)
            return Piece(world.dt, world.decay, world.dt - after, after, 0.0)
        work.calm[1] = max(work.calm[1] // 2, 1)
    if not laws.robust:
        return Piece(world.dt, world.decay, world.dt, 0.0, 0.0)
    rate = _approach(x, memory, world, laws, left, work)
    count = min(math.ceil(rate * left / _RESOLVED), _MOST_PIECES)
    dt = left / max(count, 1)
    decay = world.decay if dt == world.dt else world.decay ** (dt / world.dt)
    return Piece(dt, decay, 0.5 * dt, 0.5 * dt, left - dt if count > 1 else 0.0)


@inner
def _calm_for(x, world, laws, steps, work):
    """Whether no body can touch anything for some steps; only leaves out searches, so that no result depends on it."""
    time = steps * world.dt
    _write_reach(x, world, time, work)
    if near_pairs(x, work.reach, work.coming, world.bodies.moving, work) > 0:
        return False
    moving, reach = world.bodies.moving, work.reach
    for i in range(len(x)):
        if moving[i]:
            for e in range(len(laws.kind)):
                if element_distance(laws, e, x[i, P], x[i, P + 1], x[i, P + 2]) < reach[i]:
                    return False
    return True


@inner
def _write_reach(x, world, time, work):
    """Balls in which bodies stay for a time without contacts, and how far their points travel."""
    radius, moving, reach, coming = world.bodies.radius, world.bodies.moving, work.reach, work.coming
    fall = time * (abs(world.gravity[0]) + abs(world.gravity[1]) + abs(world.gravity[2]))
    for i in range(len(x)):
        reach[i], coming[i] = radius[i], 0.0
        if moving[i]:
            travel = time * (fall + abs(x[i, V]) + abs(x[i, V + 1]) + abs(x[i, V + 2]))
            reach[i] += travel
            coming[i] = travel + time * radius[i] * (abs(x[i, W]) + abs(x[i, W + 1]) + abs(x[i, W + 2]))


@inner
def _approach(x, memory, world, laws, left, work):
    """Highest frequency [1/s] of bodies that touch, or may come to touch in ``left`` seconds."""
    radius, moving, inverse_mass, thickness = world.bodies.radius, world.bodies.moving, world.bodies.inverse_mass, laws.thickness
    rate = 0.0
    for i in range(len(x)):
        for j in range(memory.shape[1]):
            rate = max(rate, memory[i, j, RATE])
    _write_reach(x, world, left, work)
    near = work.near
    for k in range(near_pairs(x, work.reach, work.coming, moving, work)):
        i, j = near[k, 0], near[k, 1]
        # which pairs rest is not remembered, and leaves out only what this does: so no result depends on it
        if memory[i, j, RATE] == QUIET or not may_touch(x, i, j, world, work):
            continue
        v = _speed(x[j, V] - x[i, V], x[j, V + 1] - x[i, V + 1], x[j, V + 2] - x[i, V + 2]) + _spin(x, i, radius) + _spin(x, j, radius)
        curvature = radius[i] * radius[j] / (radius[i] + radius[j])
        rate = max(rate, impact_rate(v, inverse_mass[i] + inverse_mass[j], curvature, world.stiffness))
        rate = max(rate, _RESOLVED * v / (_CROSSED * min(thickness[i], thickness[j])))
    kind, half, reach = laws.kind, laws.half, work.reach
    for i in range(len(x)):
        if not moving[i]:
            continue
        for e in range(len(kind)):
            if memory[i, len(x) + e, RATE] == QUIET or element_distance(laws, e, x[i, P], x[i, P + 1], x[i, P + 2]) >= reach[i]:
                continue
            v = _speed(x[i, V], x[i, V + 1], x[i, V + 2]) + _spin(x, i, radius)
            rate = max(rate, impact_rate(v, inverse_mass[i], radius[i], world.stiffness))
            wall = thickness[i]
            if kind[e] == BOX:
                wall = min(wall, min(half[e, 0], min(half[e, 1], half[e, 2])))
            rate = max(rate, _RESOLVED * v / (_CROSSED * wall))
    return rate


@inner
def _speed(x, y, z):
    return math.sqrt(x * x + y * y + z * z)


@inner
def _spin(x, i, radius):
    """Most that a body's rotation adds to the speed of its points [m/s]."""
    return radius[i] * _speed(x[i, W], x[i, W + 1], x[i, W + 2])


@kernel(_nrt=False)
def impact_rate(v, inverse_mass, curvature, stiffness):
    """Highest frequency in the impact of two balls at speed ``v`` [1/s].

    With a lens of about ``pi R d^2`` at depth d, R being the reduced radius, ``kappa pi R d^3 / 3`` takes up the whole
    energy, and the stiffness there is ``2 pi kappa R d``.
    """
    if v == 0.0 or stiffness == 0.0:
        return 0.0
    depth = (1.5 * v * v / (inverse_mass * math.pi * stiffness * curvature)) ** (1.0 / 3.0)
    return math.sqrt(2.0 * math.pi * stiffness * curvature * depth * inverse_mass)
