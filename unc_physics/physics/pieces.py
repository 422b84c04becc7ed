"""How a step is divided where contacts ask for it: chosen before the step is taken."""

import math
from typing import NamedTuple

import numpy as np

from ..layout import P, V, W
from .compiled import inner, kernel
from .element_contacts import element_distance, in_element
from .laws import QUIET, RATE
from .pairs import may_touch, near_pairs
from .shapes import bounds, thickness as element_thickness
from .so3 import rotate_back

_RESOLVED = 0.5  # most that a contact's oscillation may turn in a piece [rad]
_CROSSED = 0.25  # most that a piece may move a body, of the thickness of what it approaches
_MOST_PIECES = 1000
_LONGEST_CALM = 64  # steps for which a scene is left alone at most
UNKNOWN = -1  # number of calm steps ahead, of a rollout that begins
#: What the last piece was: without contact, with soft contacts, with patches, which leave rates to be resolved.
APART, TOUCHED, RESISTED = 0, 1, 2


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
    fall : float
        Factor on gravity in the drift's displacement [s^2].
    left : float
        What remains of the step after it [s].
    """

    dt: float
    decay: float
    before: float
    after: float
    fall: float
    left: float


@inner(forceinline=True)
def next_piece(x, memory, world, laws, left, work):
    """The next piece of a step of which ``left`` seconds remain."""
    if laws is None:
        return Piece(world.dt, world.decay, world.dt, 0.0, 0.0, 0.0)
    else:
        if work.calm[0] > 0:
            work.calm[0] -= 1
            return undisturbed(world, laws)
        work.patches.count[0] = 0
        # what touched a moment ago is near; only a rollout that begins has to ask
        if left == world.dt and (work.touching[1] == APART or work.calm[0] == UNKNOWN) and _calm(x, world, laws, work):
            return undisturbed(world, laws)
        work.calm[0] = 0
        if not laws.robust:
            return Piece(world.dt, world.decay, world.dt, 0.0, 0.0, 0.0)
        if left == world.dt and work.touching[1] < RESISTED and _fastest_approach(x, world) <= work.slow[0]:
            return Piece(world.dt, world.decay, 0.5 * world.dt, 0.5 * world.dt, 0.0, 0.0)
        return _divided(x, memory, world, laws, left, work)


@inner(forceinline=True)
def undisturbed(world, laws):
    """A whole step in which nothing touches: in the robust integrator, its two drifts in one."""
    if laws.robust:
        return Piece(world.dt, world.decay, 0.5 * world.dt * (1.0 + world.decay), 0.0, 0.5 * world.dt * world.dt, 0.0)
    return Piece(world.dt, world.decay, world.dt, 0.0, 0.0, 0.0)


@inner
def _divided(x, memory, world, laws, left, work):
    """The next piece where something may be too fast for the step."""
    rate = _approach(x, memory, world, laws, left, work)
    count = min(math.ceil(rate * left / _RESOLVED), _MOST_PIECES)
    dt = left / max(count, 1)
    decay = world.decay if dt == world.dt else world.decay ** (dt / world.dt)
    return Piece(dt, decay, 0.5 * dt, 0.5 * dt, 0.0, left - dt if count > 1 else 0.0)


@inner(forceinline=True)
def _fastest_approach(x, world):
    """No two points of the bodies approach each other faster than this [m/s]."""
    radius, moving = world.bodies.radius, world.bodies.moving
    first = second = 0.0
    for i in range(len(x)):
        if moving[i]:
            pace = (
                abs(x[i, V]) + abs(x[i, V + 1]) + abs(x[i, V + 2])
                + radius[i] * (abs(x[i, W]) + abs(x[i, W + 1]) + abs(x[i, W + 2]))
            )
            if pace > first:
                first, second = pace, first
            elif pace > second:
                second = pace
    return first + second


@inner
def _calm(x, world, laws, work):
    """Whether nothing can touch anything in this step; ``work.calm`` learns for how many more."""
    steps = work.calm[1]
    if not _apart_for(x, world, laws, 1, work):
        work.calm[1] = 1
        return False
    if steps == 1 or _apart_for(x, world, laws, steps, work):
        work.calm[0], work.calm[1] = steps - 1, min(2 * steps, _LONGEST_CALM)
    else:
        work.calm[1] = steps // 2
    return True


@inner
def _apart_for(x, world, laws, steps, work):
    """Whether nothing can touch for some steps.

    The answer for one step depends on the state alone; a yes for many is one for each of them.
    """
    _write_reach(x, world, steps * world.dt, work)
    near, moving, reach = work.near, world.bodies.moving, work.reach
    for i in range(len(x)):
        if moving[i]:
            for e in range(len(laws.kind)):
                if element_distance(laws, e, x[i, P], x[i, P + 1], x[i, P + 2]) < reach[i]:
                    return False
    for k in range(near_pairs(x, reach, work.coming, moving, work)):
        # for many steps a search would seldom pay: pairs that rest are left out already
        if steps > 1 or may_touch(x, near[k, 0], near[k, 1], world, work):
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
        if not may_touch(x, i, j, world, work):
            continue
        if memory[i, j, RATE] == QUIET:  # what rests may still rock, and then comes down elsewhere
            v = _speed(x[j, W] - x[i, W], x[j, W + 1] - x[i, W + 1], x[j, W + 2] - x[i, W + 2]) * (_arm(i, world, laws) + _arm(j, world, laws))
        else:
            v = _speed(x[j, V] - x[i, V], x[j, V + 1] - x[i, V + 1], x[j, V + 2] - x[i, V + 2]) + _spin(x, i, world, laws) + _spin(x, j, world, laws)
            if not (moving[i] and moving[j]):
                v += left * _speed(world.gravity[0], world.gravity[1], world.gravity[2])
        curvature = radius[i] * radius[j] / (radius[i] + radius[j])
        rate = max(rate, impact_rate(v, inverse_mass[i] + inverse_mass[j], curvature, world.stiffness))
        rate = max(rate, _RESOLVED * v / (_CROSSED * min(thickness[i], thickness[j])))
    kind, size, reach = laws.kind, laws.size, work.reach
    for i in range(len(x)):
        if not moving[i]:
            continue
        for e in range(len(kind)):
            if element_distance(laws, e, x[i, P], x[i, P + 1], x[i, P + 2]) >= reach[i]:
                continue
            falling = 0.0 if memory[i, len(x) + e, RATE] == QUIET else left  # what rests does not fall, but may rock
            v = _closing(x, i, e, world, laws, falling) + _spin(x, i, world, laws)
            rate = max(rate, impact_rate(v, inverse_mass[i], radius[i], world.stiffness))
            wall = min(thickness[i], element_thickness(kind, size, e))
            rate = max(rate, _RESOLVED * v / (_CROSSED * wall))
    return rate


@inner
def _speed(x, y, z):
    return math.sqrt(x * x + y * y + z * z)


@inner
def _spin(x, i, world, laws):
    """Most that a body's rotation adds to the speed of its spheres' centres [m/s]."""
    return _arm(i, world, laws) * _speed(x[i, W], x[i, W + 1], x[i, W + 2])


@inner
def _arm(i, world, laws):
    """No sphere's centre is farther from the centre of mass of body i [m]."""
    return world.bodies.radius[i] - laws.smallest[i]


@inner
def _closing(x, i, e, world, laws, left):
    """How fast the centre of mass of body i moves against element e, now or when it has fallen for ``left`` seconds [m/s].

    Against those faces of the element's bounds that parts of the body are beyond; against two that face away from
    each other, either way.
    """
    R = laws.R
    a, b, c = in_element(laws.position, R, e, x[i, P], x[i, P + 1], x[i, P + 2])
    u, v, w = rotate_back(R[e], x[i, V], x[i, V + 1], x[i, V + 2])
    du, dv, dw = rotate_back(R[e], left * world.gravity[0], left * world.gravity[1], left * world.gravity[2])
    low, high = bounds(laws.kind, laws.size, e)
    if low[2] == -np.inf:  # a half-space
        return max(-w, -w - dw, 0.0)
    total, arm = 0.0, world.bodies.radius[i]
    for place, now, then, half in ((a, u, u + du, high[0]), (b, v, v + dv, high[1]), (c, w, w + dw, high[2])):
        inwards = max(-now, -then) if place > 0.0 else max(now, then)
        if arm - abs(place) > half:
            total += max(abs(now), abs(then)) ** 2
        elif abs(place) + arm > half and inwards > 0.0:
            total += inwards * inwards
    return math.sqrt(total)


@kernel
def slow_approach(world, laws):
    """Speed of approach up to which no impact asks for a division of a step, whichever bodies meet [m/s] (`_approach`)."""
    radius, inverse_mass = world.bodies.radius, world.bodies.inverse_mass
    weight, wall = 0.0, np.inf  # of two bodies, reduced radius times inverse reduced mass is at most the larger weight twice
    for i in range(len(radius)):
        weight = max(weight, radius[i] * inverse_mass[i])
        wall = min(wall, laws.thickness[i])
    for e in range(len(laws.kind)):
        wall = min(wall, element_thickness(laws.kind, laws.size, e))
    crossed = _CROSSED * wall / world.dt
    rate = impact_rate(1.0, 2.0 * weight, 1.0, world.stiffness)  # grows with the cube root of the speed
    resolved = np.inf if rate == 0.0 else (_RESOLVED / (world.dt * rate)) ** 3
    return min(crossed, resolved) - world.dt * _speed(world.gravity[0], world.gravity[1], world.gravity[2])


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
