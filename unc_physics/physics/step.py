"""One time step of a scene: drift, damp, gravity, contacts, kick, in this order (the paper's Eqs. 3 to 6)."""

import math
from typing import NamedTuple

import numpy as np

from ..layout import P, Q, V, W
from .compiled import inner, kernel
from .contact import DISTANCE, NORMAL, POINT, RECORD, contact_sums, next_contacts
from .laws import FIRST, RATE, Patches, add_patch, kick_patches, make_patches, soft_contact
from .pairs import FIRST_REST, ROOTS_ALONE, SINGLE_PRECISION, let_rest, near_pairs, relative_pose
from .pieces import APART, RESISTED, TOUCHED, UNKNOWN, next_piece, slow_approach, undisturbed
from .so3 import exp, multiply, renormalized, rotate, rotate_back, write_matrix
from .element_contacts import next_element_contacts, open_element
from .tree import WIDTH, Scratch

_PAIRS_AT_ONCE = 1024
_TURN, _SMALL_TURN, _MOST_TURNS = 0.25, 0.02, 1000  # angles with the gyroscopic term [rad], and pieces of a turn


class Workspace(NamedTuple):
    """What a rollout computes anew in each step; no state.

    Attributes
    ----------
    R : (B, 3, 3) float64
        ``R_world_body`` at the current pose.
    wrench : (B, 6) float64
        Force [N] and torque about the centre of mass [N m], world frame.
    touched : (B,) bool
        Whether a contact force acts on the body in this step.
    order : (B,) int64
        Bodies sorted along x.
    reach : (B,) float64
        Radius of a ball that a body stays in for the rest of a step [m].
    coming, still : (B,) float64
        The most that a body travels in the rest of a step [m]; zeros.
    calm : (2,) int64
        Steps ahead in which nothing can touch, and for how many that is next asked; of scenes with laws.
    slow : (1,) float64
        `pieces.slow_approach`; of scenes with laws.
    soft : (1,) float64
        `laws.soft_contact`; of scenes with laws.
    agility : (B,) float64
        No torque of 1 N m turns the body faster [1/(kg m^2)]; of scenes with laws.
    touching : (2,) int64
        Whether anything touches in the piece at hand, and what the last one was (`pieces.APART`); of scenes with laws.
    low : (B,) float64
        Where each body's ball begins along x [m].
    near : (B (B - 1) / 2, 2) int64
        Pairs of bodies that may touch.
    speed : (B,) float64
        The most that a point of the body moves in a step [m].
    travel : (B,) float64
        Sum of ``speed`` since the rollout began [m].
    rest : (B, B, 2) float64
        For a pair i < j: up to which sum of their travels they can't touch [m], and the number of steps for which
        they are next asked to be apart.
    R_ij : (3, 3) float64
        Rotation from body j's to body i's coordinates, of the pair at hand.
    search, glance : Scratch
        The latter has so little room that a search ends at the first candidates.
    momentum : (B, 3) float64
        Angular momentum in world axes during a drift with the gyroscopic term [kg m^2/s].
    patches : Patches or None
        Of scenes with laws beyond the paper's.
    """

    R: np.ndarray
    wrench: np.ndarray
    touched: np.ndarray
    order: np.ndarray
    reach: np.ndarray
    coming: np.ndarray
    still: np.ndarray
    calm: np.ndarray
    slow: np.ndarray
    soft: np.ndarray
    agility: np.ndarray
    touching: np.ndarray
    low: np.ndarray
    near: np.ndarray
    speed: np.ndarray
    travel: np.ndarray
    rest: np.ndarray
    R_ij: np.ndarray
    search: Scratch
    glance: Scratch
    momentum: np.ndarray
    patches: Patches


@kernel
def workspace(x, world, laws):
    """Workspace of one rollout that begins at state ``x`` (B, 13)."""
    count = len(x)
    slow, soft, agility = np.zeros(1), np.zeros(1), np.zeros(count)
    if laws is None:
        patches = None
    else:
        patches = make_patches(count, len(laws.kind), _PAIRS_AT_ONCE)
        slow[0] = slow_approach(world, laws)
        soft[0] = soft_contact(world, laws)
        for i in range(count):
            square = 0.0
            for r in range(3):
                for c in range(3):
                    square += world.bodies.inverse_inertia[i, r, c] ** 2
            agility[i] = math.sqrt(square)
    R = np.empty((count, 3, 3))
    for i in range(count):
        write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), R, i)
    stack = np.empty((world.stack_size, 2), np.int32)
    search = Scratch(stack, np.empty((_PAIRS_AT_ONCE, 2), np.int32), np.empty((_PAIRS_AT_ONCE, RECORD)))
    glance = Scratch(stack, np.empty((WIDTH * WIDTH, 2), np.int32), search.records)
    rest = np.zeros((count, count, 2))
    for i in range(count):
        for j in range(i + 1, count):
            rest[i, j, 1] = FIRST_REST
    return Workspace(
        R,
        np.zeros((count, 6)),
        np.zeros(count, np.bool_),
        np.arange(count),
        np.empty(count),
        np.zeros(count),
        np.zeros(count),
        np.array([UNKNOWN, 1]),
        slow,
        soft,
        agility,
        np.array([0, RESISTED]),
        np.empty(count),
        np.empty((count * (count - 1) // 2, 2), np.int64),
        np.zeros(count),
        np.zeros(count),
        rest,
        np.empty((3, 3)),
        search,
        glance,
        np.empty((count, 3)),
        patches,
    )


@inner(forceinline=True)
def drift(x, world, laws, piece, work):
    """Move all bodies freely until a piece's contacts, then damp their velocities and apply gravity; ``work.R`` follows."""
    for i in range(len(x)):
        if world.bodies.moving[i]:
            drift_body(x, i, world, laws, piece, work)


@inner(forceinline=True)
def drift_body(x, i, world, laws, piece, work):
    """`drift` of body i, which moves."""
    fall_on(x, i, move(x, i, piece.before, world, laws, work), world.gravity, piece, work)


@inner(forceinline=True)
def fall_on(x, i, pace, gravity, piece, work):
    """Note at which pace body i moved in a piece's drift, and let damping and gravity act."""
    dt, decay, fall = piece.dt, piece.decay, piece.fall
    work.speed[i] = dt * pace
    work.travel[i] += piece.before * pace
    if fall > 0.0:
        for k in range(3):
            x[i, P + k] += fall * gravity[k]
            work.travel[i] += fall * abs(gravity[k])
    for k in range(3):
        x[i, V + k] = decay * x[i, V + k] + dt * gravity[k]
        x[i, W + k] *= decay


@inner
def fly(x, steps, world, laws, work):
    """Advance all bodies by steps in which nothing touches."""
    piece, radius, R, gravity = undisturbed(world, laws), world.bodies.radius, work.R, world.gravity
    for i in range(len(x)):
        if world.bodies.moving[i]:
            if laws.gyroscopic:
                for _ in range(steps):
                    drift_body(x, i, world, laws, piece, work)
            else:
                for _ in range(steps):
                    fall_on(x, i, slide(x, i, piece.before, radius, R), gravity, piece, work)


@inner(forceinline=True)
def glide(x, world, laws, piece, work):
    """Move all bodies freely from a piece's contacts to its end."""
    travel, moving = work.travel, world.bodies.moving
    for i in range(len(x)):
        if moving[i]:
            travel[i] += piece.after * move(x, i, piece.after, world, laws, work)


@inner(forceinline=True)
def move(x, i, dt, world, laws, work):
    """Move body i freely; returns the most that a point of it moves in a second [m/s]."""
    if laws is not None:
        if laws.gyroscopic:
            pace = tumble(x, i, world, laws, dt, work)
            return pace + shift(x, i, dt)
    return slide(x, i, dt, world.bodies.radius, work.R)


@inner(forceinline=True)
def slide(x, i, dt, radius, R):
    """`move` without the gyroscopic term."""
    pace = turn(x, i, dt, radius, R)
    return pace + shift(x, i, dt)


@inner(forceinline=True)
def shift(x, i, dt):
    """Shift body i by what its velocity does in a time; returns a bound of its speed [m/s]."""
    for k in range(3):
        x[i, P + k] += dt * x[i, V + k]
    return abs(x[i, V]) + abs(x[i, V + 1]) + abs(x[i, V + 2])


@inner(forceinline=True)
def turn(x, i, dt, radius, R):
    """Turn body i about its angular velocity; returns a bound of what that moves its points in a second [m/s]."""
    q = multiply(exp(dt * x[i, W], dt * x[i, W + 1], dt * x[i, W + 2]), (x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]))
    q = renormalized(q)
    x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3] = q
    write_matrix(q, R, i)
    return radius[i] * (abs(x[i, W]) + abs(x[i, W + 1]) + abs(x[i, W + 2]))


@inner
def tumble(x, i, world, laws, dt, work):
    """As `turn`, with the angular momentum kept instead of the angular velocity.

    The angular velocity in the middle of a turn is found from the momentum, with the inertia half turned along; long
    turns are divided, since this keeps the energy to the third order of their angle only.
    """
    R, momentum = work.R[i], work.momentum[i]
    a, b, c = rotate_back(R, x[i, W], x[i, W + 1], x[i, W + 2])
    a, b, c = rotate(laws.inertia[i], a, b, c)
    momentum[0], momentum[1], momentum[2] = rotate(R, a, b, c)
    angle = dt * math.sqrt(x[i, W] ** 2 + x[i, W + 1] ** 2 + x[i, W + 2] ** 2)
    count = min(math.ceil(angle / _TURN), _MOST_TURNS)
    dt, rounds, pace = dt / max(count, 1), 1 if angle < _SMALL_TURN else 3, 0.0
    for _ in range(max(count, 1)):
        q = (x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3])
        for _ in range(rounds):
            write_matrix(multiply(exp(0.5 * dt * x[i, W], 0.5 * dt * x[i, W + 1], 0.5 * dt * x[i, W + 2]), q), work.R, i)
            keep_momentum(x, i, world, work)
        pace = max(pace, turn(x, i, dt, world.bodies.radius, work.R))
        keep_momentum(x, i, world, work)
    return pace


@inner
def keep_momentum(x, i, world, work):
    """The angular velocity that belongs to body i's angular momentum on record, at ``work.R``, into the state."""
    R, momentum = work.R[i], work.momentum[i]
    a, b, c = rotate_back(R, momentum[0], momentum[1], momentum[2])
    a, b, c = rotate(world.bodies.inverse_inertia[i], a, b, c)
    x[i, W], x[i, W + 1], x[i, W + 2] = rotate(R, a, b, c)


@inner(forceinline=True)
def open_pair(x, i, j, world, work):
    """Begin the search for the contacts of bodies i and j.

    Returns
    -------
    t_ij : tuple of 3 floats
        Body j's centre of mass in body i's frame [m]; ``work.R_ij`` has the rotation.
    slack : float
    top : int
        What `contact.next_contacts` takes.
    """
    t_ij = relative_pose(x, i, j, work)
    work.search.stack[0, 0], work.search.stack[0, 1] = world.bodies.root[i], world.bodies.root[j]
    return t_ij, SINGLE_PRECISION * (world.bodies.radius[i] + world.bodies.radius[j]), ROOTS_ALONE


@inner(forceinline=True)
def pairs_to_search(x, world, work):
    """Find the pairs of bodies that may touch now, into ``work.near``; returns their number."""
    if work.calm[0] > 0:
        return np.int64(0)
    return near_pairs(x, world.bodies.radius, work.still, world.bodies.moving, work)


@inner(forceinline=True)
def part(i, j, t_ij, slack, world, work):
    """Let two bodies rest whose contacts were searched for in vain."""
    let_rest(i, j, t_ij, slack, work.speed[i] + work.speed[j], world, work)


@inner(forceinline=True)
def add_wrench(x, i, j, count, stiffness, work):
    """Add the forces of the first ``count`` contacts on record to the wrenches of bodies i and j."""
    force, moment = contact_sums(work.search.records, count)
    fx, fy, fz = rotate(work.R[i], force[0], force[1], force[2])
    mx, my, mz = rotate(work.R[i], moment[0], moment[1], moment[2])
    fx, fy, fz = stiffness * fx, stiffness * fy, stiffness * fz
    mx, my, mz = stiffness * mx, stiffness * my, stiffness * mz
    dx, dy, dz = x[j, P] - x[i, P], x[j, P + 1] - x[i, P + 1], x[j, P + 2] - x[i, P + 2]
    on_i, on_j = work.wrench[i], work.wrench[j]
    on_i[0] -= fx
    on_i[1] -= fy
    on_i[2] -= fz
    on_i[3] -= mx
    on_i[4] -= my
    on_i[5] -= mz
    on_j[0] += fx
    on_j[1] += fy
    on_j[2] += fz
    on_j[3] += mx - (dy * fz - dz * fy)  # the same forces, with the lever arm from body j's centre of mass
    on_j[4] += my - (dz * fx - dx * fz)
    on_j[5] += mz - (dx * fy - dy * fx)
    work.touched[i] = work.touched[j] = True


@inner(forceinline=True)
def press(x, i, j, count, world, laws, work):
    """Let the first ``count`` contacts on record act on bodies i and j."""
    if laws is None:
        add_wrench(x, i, j, count, world.stiffness, work)
    elif work.soft[0] > 0.0 and _yield(x, i, j, count, world, work) <= work.soft[0]:
        work.touching[0] = 1
        add_wrench(x, i, j, count, world.stiffness, work)
    else:
        press_by_laws(x, (i, j), count, world, laws, work)


@inner(forceinline=True)
def _yield(x, i, j, count, world, work):
    """Bound of the square of a contact's frequency, over ``2 pi kappa`` [m^2/kg].

    The circle in which two spheres meet has no larger squared radius than twice the depth times the smaller sphere's radius.
    """
    radii, pairs, records, agility = world.tree.radii, work.search.pairs, work.search.records, work.agility
    mobility = world.bodies.inverse_mass[i] + world.bodies.inverse_mass[j]
    tx, ty, tz = rotate_back(work.R[i], x[j, P] - x[i, P], x[j, P + 1] - x[i, P + 1], x[j, P + 2] - x[i, P + 2])
    total = 0.0
    for k in range(count):
        ri, rj = radii[pairs[k, 0]], radii[pairs[k, 1]]
        nx, ny, nz = records[k, NORMAL], records[k, NORMAL + 1], records[k, NORMAL + 2]
        ax, ay, az = records[k, POINT], records[k, POINT + 1], records[k, POINT + 2]
        bx, by, bz = ax - tx, ay - ty, az - tz
        u, v, w = ay * nz - az * ny, az * nx - ax * nz, ax * ny - ay * nx
        arms = agility[i] * (u * u + v * v + w * w)
        u, v, w = by * nz - bz * ny, bz * nx - bx * nz, bx * ny - by * nx
        arms += agility[j] * (u * u + v * v + w * w)
        total += min(ri, rj) * (ri + rj - records[k, DISTANCE]) * (mobility + arms)
    return total


@inner
def press_by_laws(x, bodies, count, world, laws, work):
    """As `press`, for a scene with laws; the second body is ``-1 - e`` for element e of the environment."""
    i, j = bodies
    stiffness = world.stiffness * (1.0 - laws.dissipation)
    if j >= 0:
        add_wrench(x, i, j, count, stiffness, work)
        arm = (x[j, P] - x[i, P], x[j, P + 1] - x[i, P + 1], x[j, P + 2] - x[i, P + 2])
    else:
        add_element_wrench(i, count, stiffness, work)
        arm = (0.0, 0.0, 0.0)
    work.touching[0] = 1
    if laws.robust or laws.friction > 0.0 or laws.dissipation > 0.0:
        add_patch(bodies, arm, count, world, laws, work)


@inner(forceinline=True)
def press_elements(x, memory, world, laws, time, work):
    """Let all elements of the environment act on all moving bodies."""
    if len(laws.kind) > 0 and work.calm[0] <= 0:
        moving = world.bodies.moving
        for i in range(len(x)):
            if moving[i]:
                for e in range(len(laws.kind)):
                    press_element(x, i, e, memory, world, laws, time, work)


@inner
def press_element(x, i, e, memory, world, laws, time, work):
    """Let element e act on body i."""
    t, top = open_element(x, i, e, world, laws, work)
    while top > 0:
        count, top = next_element_contacts(world.tree, laws, e, work.R_ij, t, work.search, top)
        if count > 0:
            note_contact(memory, i, len(x) + e, time)
            press_by_laws(x, (i, np.int64(-1 - e)), count, world, laws, work)


@inner(forceinline=True)
def note_contact(memory, i, j, time):
    """Record that body i touches body j, or element j - B."""
    memory[i, j, FIRST] = min(memory[i, j, FIRST], time)


@inner
def add_element_wrench(i, count, stiffness, work):
    """Add the forces of the first ``count`` contacts on record, of body i with the environment, to its wrench."""
    force, moment = contact_sums(work.search.records, count)
    fx, fy, fz = rotate(work.R[i], force[0], force[1], force[2])
    mx, my, mz = rotate(work.R[i], moment[0], moment[1], moment[2])
    on_i = work.wrench[i]
    on_i[0] -= stiffness * fx
    on_i[1] -= stiffness * fy
    on_i[2] -= stiffness * fz
    on_i[3] -= stiffness * mx
    on_i[4] -= stiffness * my
    on_i[5] -= stiffness * mz
    work.touched[i] = True


@inner(forceinline=True)
def kick(x, memory, world, laws, piece, work):
    """Change the velocities of all touched bodies by what acts on them over a piece of a step; clears the wrenches."""
    if laws is None:
        kick_each(x, world, piece.dt, work)
    elif work.patches.count[0] == 0 and work.touching[1] != RESISTED:
        kick_each(x, world, piece.dt, work)
        work.touching[1] = TOUCHED if work.touching[0] else APART
        work.touching[0] = 0
    else:
        kick_by_laws(x, memory, world, laws, piece.dt, work)


@inner
def kick_by_laws(x, memory, world, laws, dt, work):
    """As `kick`, where there are patches or the last piece had some."""
    work.touching[1] = TOUCHED if work.touching[0] else APART
    work.touching[0] = 0
    if laws.robust:
        for i in range(len(x)):
            for j in range(memory.shape[1]):
                memory[i, j, RATE] = 0.0
    if work.patches.count[0] > 0:
        work.touching[1] = RESISTED
        kick_patches(x, memory, world, laws, dt, work)
        clear_wrenches(work)
    else:
        kick_each(x, world, dt, work)


@inner
def clear_wrenches(work):
    """Forget what acted on the bodies; the patches stay until the next piece."""
    for i in range(len(work.touched)):
        work.touched[i] = False
        for k in range(6):
            work.wrench[i, k] = 0.0


@inner(forceinline=True)
def kick_each(x, world, dt, work):
    """Change the velocities of each touched body by its wrench; clears the wrenches."""
    for i in range(len(x)):
        if not work.touched[i]:
            continue
        work.touched[i] = False
        f = work.wrench[i]
        if world.bodies.moving[i]:
            a = dt * world.bodies.inverse_mass[i]
            x[i, V] += a * f[0]
            x[i, V + 1] += a * f[1]
            x[i, V + 2] += a * f[2]
            bx, by, bz = rotate_back(work.R[i], f[3], f[4], f[5])
            bx, by, bz = rotate(world.bodies.inverse_inertia[i], bx, by, bz)
            wx, wy, wz = rotate(work.R[i], bx, by, bz)
            x[i, W] += dt * wx
            x[i, W + 1] += dt * wy
            x[i, W + 2] += dt * wz
        for k in range(6):
            f[k] = 0.0


@inner
def march(x, memory, world, laws, begin, steps, work):
    """Advance the state ``x`` (B, 13) of one rollout in place (`rollout.advance`), in its workspace."""
    step = begin
    while step < begin + steps:
        if laws is not None:
            if work.calm[0] > 0:
                alone = min(work.calm[0], begin + steps - step)
                fly(x, alone, world, laws, work)
                work.calm[0] -= alone
                step += alone
                continue
        left, time = world.dt, (step + 1) * world.dt
        step += 1
        while left > 0.0:
            piece = next_piece(x, memory, world, laws, left, work)
            left = piece.left
            drift(x, world, laws, piece, work)
            for k in range(pairs_to_search(x, world, work)):
                i, j = work.near[k, 0], work.near[k, 1]
                t_ij, slack, top = open_pair(x, i, j, world, work)
                touching = False
                while top > 0:
                    count, top = next_contacts(world.tree, work.R_ij, t_ij, slack, work.search, top)
                    if count > 0:
                        touching = True
                        press(x, i, j, count, world, laws, work)
                if touching:
                    note_contact(memory, i, j, time)
                else:
                    part(i, j, t_ij, slack, world, work)
            if laws is not None:
                press_elements(x, memory, world, laws, time, work)
            kick(x, memory, world, laws, piece, work)
            if laws is not None:
                if piece.after > 0.0:
                    glide(x, world, laws, piece, work)
