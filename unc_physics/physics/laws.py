"""Contact laws beyond the paper's: friction, restitution, and kicks that stay stable however stiff the contact is.

All contacts of two bodies form a patch. Its motion is that of body j relative to body i at body i's centre of mass,
``xi = (w, Omega)``: a point at ``a`` from there slips at ``w + Omega x a``. Forces that depend on velocity, and the
change of the penalty force with depth, act on a patch as 6 x 6 matrices, and one linear system for all touched
bodies gives the kick. Everything that it adds takes energy away: it cannot make a step unstable.

* Friction: ``-mu |F|`` along the slip, in the sense of the patch's force-weighted mean square of slip (an ellipsoidal
  limit surface, Howe and Cutkosky 1996), regularised below `CREEP`.
* Restitution: while a contact closes its force is that of the penalty, while it opens ``e^2`` of that, which gives
  back ``e^2`` of the energy; so it is friction along the normal, with the coefficient ``(1 - e^2) / 2``, below `SETTLING`
  in proportion to the speed.
* Robust kick: a quarter of the penalty's stiffness acts on the velocities (as in implicit midpoint: stable for every
  stiffness, without loss for an oscillation). Vibrations as small as gravity's own indentation are damped.
"""

import math
from typing import NamedTuple

import numpy as np

from ..layout import ERROR, EV, EW, V, W
from .compiled import inner, kernel
from .contact import DISTANCE, NORMAL, POINT, VOLUME
from .so3 import rotate, rotate_back

#: Slip below which friction grows with it instead of being constant [m/s]: how fast what sticks may creep.
CREEP = 1e-5
#: The same for restitution's drag along the normal [m/s]: it must not hold up what stands off balance.
SETTLING = 0.01
_SOFT = 0.25  # square of the angle that a contact's oscillation turns in a step which needs no division (`pieces._RESOLVED`)
_ROUNDS = 3  # of the search for the drag that Coulomb's law asks for
_SLOW = 3.0  # of the speed g / omega at which a contact vibrates about its rest
_DAMPING_RATIO = 0.7  # of such vibrations
#: What is remembered of a pair: the time of its first contact [s], infinite without, and, in the robust integrator,
#: its frequency in the last kick [1/s], 0 without contact.
FIRST, RATE = 0, 1
QUIET = np.float32(1e-9)  # in place of the frequency of a contact at rest
_QUIET = 0.03  # change of depth in a step, relative to the depth, below which a contact is at rest: less than at any turn
TANGENTIAL, ACROSS, STIFF = 0, 1, 2  # matrices of a patch: slip and closing weighted by force, closing by stiffness


class Patches(NamedTuple):
    """The touching pairs of one step.

    Attributes
    ----------
    count : (1,) int64
    bodies : (C, 2) int64
        Body i, and body j or ``-1 - e`` for element e of the environment.
    arm : (C, 3) float64
        From body i's to body j's centre of mass, world axes [m].
    load : (C, 3) float64
        Sums over the contacts of the force [N], of the stiffness [N/m], and the square of the patch's frequency
        [1/s^2].
    matrix : (C, 3, 6, 6) float64
        Sums over contacts, world axes, by `TANGENTIAL`, `ACROSS` and `STIFF`.
    drag : (C, 2, 2) float64
        For slip and for closing: the coefficient in this kick [s/m], and the speed without drag [m/s].
    weight : (capacity of a search,) float64
        Of the contacts at hand: their stiffness [N/m], then their force [N].
    local : (3, 6, 6) float64
        The same matrices in body i's axes, for the contacts at hand.
    place : (B,) int64
        First unknown of each touched body.
    system : (2, 6 B, 6 B) float64
        Matrix of the linear system without drag, and the factor of the one with it.
    impulse, step : (6 B,) float64
        Its right-hand side without drag, and its solution: the change of all touched bodies' velocities.
    before, velocities : (B, 6) float64
        Before a kick, and at present.
    motion : (6,) float64
    moved : (3, 6, 6) float64
    """

    count: np.ndarray
    bodies: np.ndarray
    arm: np.ndarray
    load: np.ndarray
    matrix: np.ndarray
    drag: np.ndarray
    weight: np.ndarray
    local: np.ndarray
    place: np.ndarray
    system: np.ndarray
    impulse: np.ndarray
    step: np.ndarray
    before: np.ndarray
    velocities: np.ndarray
    motion: np.ndarray
    moved: np.ndarray


@kernel
def make_patches(bodies, elements, contacts):
    """Room for all pairs among some bodies and elements, and for so many contacts at a time."""
    capacity = bodies * (bodies - 1) // 2 + bodies * elements
    return Patches(
        np.zeros(1, np.int64),
        np.empty((capacity, 2), np.int64),
        np.empty((capacity, 3)),
        np.empty((capacity, 3)),
        np.empty((capacity, 3, 6, 6)),
        np.empty((capacity, 2, 2)),
        np.empty(contacts),
        np.empty((3, 6, 6)),
        np.empty(bodies, np.int64),
        np.empty((2, 6 * bodies, 6 * bodies)),
        np.empty(6 * bodies),
        np.empty(6 * bodies),
        np.empty((bodies, 6)),
        np.empty((bodies, 6)),
        np.empty(6),
        np.empty((3, 6, 6)),
    )


@inner(error_model="numpy")
def circle(ri, rj, d):
    """Area of the circle in which two overlapping spheres meet [m^2]: how fast the lens grows with depth.

    Of a sphere inside the other, whose force is constant, it is that of its great circle: what it soon will be.
    """
    if d <= abs(ri - rj):
        return math.pi * min(ri, rj) ** 2
    across = (d * d + ri * ri - rj * rj) / (2.0 * d)
    return math.pi * max(ri * ri - across * across, 0.0)


@kernel
def soft_contact(world, laws):
    """What a contact's frequency squared may be, over ``2 pi kappa``, where a robust kick needs no patch [m^2/kg].

    0 where all contacts need one: for drag, or for the damping of rest.
    """
    gravity = abs(world.gravity[0]) + abs(world.gravity[1]) + abs(world.gravity[2])
    if not laws.robust or laws.friction > 0.0 or laws.dissipation > 0.0 or gravity > 0.0 or world.stiffness == 0.0:
        return 0.0
    return _SOFT / (2.0 * math.pi * world.stiffness * world.dt**2)


@inner
def add_patch(bodies, arm, count, world, laws, work):
    """Add the first ``count`` contacts on record to the patch of two bodies (the second ``-1 - e`` for element e)."""
    p = work.patches
    frictional = laws.friction > 0.0 or laws.dissipation > 0.0
    local, pairs, records, radii = p.local, work.search.pairs, work.search.records, world.tree.radii
    clear(local)
    stiffness = world.stiffness * (1.0 - laws.dissipation)
    on_element = bodies[1] < 0
    force = stiff = 0.0
    if laws.robust:
        for k in range(count):
            r = radii[pairs[k, 0]]
            if on_element:
                depth = r - records[k, DISTANCE]
                area = math.pi * (depth * (2.0 * r - depth) if depth < 2.0 * r else r * r)
            else:
                area = circle(r, radii[pairs[k, 1]], records[k, DISTANCE])
            p.weight[k] = stiffness * area
            stiff += p.weight[k]
        _add_squares(records, count, p.weight, local[STIFF])
    if frictional:
        for k in range(count):
            p.weight[k] = stiffness * records[k, VOLUME]
        _add_squares(records, count, p.weight, local[ACROSS])
        for k in range(count):
            ax, ay, az = records[k, POINT], records[k, POINT + 1], records[k, POINT + 2]
            f = stiffness * records[k, VOLUME]
            force += f
            square = ax * ax + ay * ay + az * az
            m = local[TANGENTIAL]
            m[0, 3 + 1] += f * az  # of f H^T H with H = [I, -[a]x]: the off-diagonal block -[a]x
            m[0, 3 + 2] -= f * ay
            m[1, 3 + 2] += f * ax
            m[3, 3] += f * (square - ax * ax)
            m[4, 4] += f * (square - ay * ay)
            m[5, 5] += f * (square - az * az)
            m[3, 4] -= f * ax * ay
            m[3, 5] -= f * ax * az
            m[4, 5] -= f * ay * az
    else:
        for k in range(count):
            force += stiffness * records[k, VOLUME]
    if frictional:
        m = local[TANGENTIAL]
        m[1, 3], m[2, 3], m[2, 4] = -m[0, 4], -m[0, 5], -m[1, 5]
        for r in range(3):
            m[r, r] += force
        for r in range(6):
            for c in range(r, 6):
                m[r, c] -= local[ACROSS, r, c]
    for q in range(3):
        for r in range(6):
            for c in range(r):
                local[q, r, c] = local[q, c, r]
    index = _patch_of(p, bodies, arm)
    p.load[index, 0] += force
    p.load[index, 1] += stiff
    for q in range(3):
        if (q == STIFF and laws.robust) or (q != STIFF and frictional):
            _add_turned(work.R[bodies[0]], local[q], p.matrix[index, q])


@inner(error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _add_squares(records, count, weight, out):
    """Add ``f N N^T`` of the contacts, ``N = (n, a x n)`` and ``f`` in ``weight``, to ``out``'s upper triangle."""
    s00 = s01 = s02 = s03 = s04 = s05 = s11 = s12 = s13 = s14 = s15 = 0.0
    s22 = s23 = s24 = s25 = s33 = s34 = s35 = s44 = s45 = s55 = 0.0
    for k in range(count):
        x, y, z = records[k, NORMAL], records[k, NORMAL + 1], records[k, NORMAL + 2]
        a, b, c = records[k, POINT], records[k, POINT + 1], records[k, POINT + 2]
        f = weight[k]
        u, v, w = b * z - c * y, c * x - a * z, a * y - b * x
        fx, fy, fz, fu, fv = f * x, f * y, f * z, f * u, f * v
        s00 += fx * x
        s01 += fx * y
        s02 += fx * z
        s03 += fx * u
        s04 += fx * v
        s05 += fx * w
        s11 += fy * y
        s12 += fy * z
        s13 += fy * u
        s14 += fy * v
        s15 += fy * w
        s22 += fz * z
        s23 += fz * u
        s24 += fz * v
        s25 += fz * w
        s33 += fu * u
        s34 += fu * v
        s35 += fu * w
        s44 += fv * v
        s45 += fv * w
        s55 += f * w * w
    out[0, 0], out[0, 1], out[0, 2], out[0, 3], out[0, 4], out[0, 5] = s00, s01, s02, s03, s04, s05
    out[1, 1], out[1, 2], out[1, 3], out[1, 4], out[1, 5] = s11, s12, s13, s14, s15
    out[2, 2], out[2, 3], out[2, 4], out[2, 5] = s22, s23, s24, s25
    out[3, 3], out[3, 4], out[3, 5] = s33, s34, s35
    out[4, 4], out[4, 5], out[5, 5] = s44, s45, s55


@inner(forceinline=True)
def _patch_of(p, bodies, arm):
    """Index of a pair's patch: a new one, unless the last is of the same pair, whose search came in parts."""
    index = p.count[0] - 1
    if index >= 0 and p.bodies[index, 0] == bodies[0] and p.bodies[index, 1] == bodies[1]:
        return index
    index += 1
    p.count[0] += 1
    p.bodies[index, 0], p.bodies[index, 1] = bodies[0], bodies[1]
    p.arm[index, 0], p.arm[index, 1], p.arm[index, 2] = arm
    for k in range(3):
        p.load[index, k] = 0.0
    clear(p.matrix[index])
    return index


@inner
def clear(matrices):
    """Set (3, 6, 6) matrices to zero."""
    for q in range(3):
        for r in range(6):
            for c in range(6):
                matrices[q, r, c] = 0.0


@inner
def _add_turned(R, G, out):
    """Add a 6 x 6 matrix, its four blocks turned by ``R``, to ``out``."""
    for first in (0, 3):
        for second in (0, 3):
            for c in range(3):  # column c of R G_block, then its share of (R G_block) R^T
                x, y, z = rotate(R, G[first, second + c], G[first + 1, second + c], G[first + 2, second + c])
                for k in range(3):
                    out[first, second + k] += x * R[k, c]
                    out[first + 1, second + k] += y * R[k, c]
                    out[first + 2, second + k] += z * R[k, c]


@inner(forceinline=True)
def relative_motion(p, index, velocities, out):
    """A patch's motion ``xi`` from all bodies' ``velocities`` (B, 6) into ``out`` (6,)."""
    i, j = p.bodies[index, 0], p.bodies[index, 1]
    for k in range(6):
        out[k] = -velocities[i, k]
    if j >= 0:
        d, w = p.arm[index], velocities[j]
        out[0] += w[0] + d[1] * w[5] - d[2] * w[4]
        out[1] += w[1] + d[2] * w[3] - d[0] * w[5]
        out[2] += w[2] + d[0] * w[4] - d[1] * w[3]
        for k in range(3, 6):
            out[k] += w[k]


@inner
def product(G, xi, zeta):
    """``xi^T G zeta``."""
    total = 0.0
    for r in range(6):
        line = 0.0
        for c in range(6):
            line += G[r, c] * zeta[c]
        total += xi[r] * line
    return total


@inner(forceinline=True)
def mean_square(G, xi):
    """``xi^T G xi``, not below zero."""
    return max(product(G, xi, xi), 0.0)


@inner
def _moved_to_j(G, d, out):
    """``G X`` into ``out``, with X what takes body j's velocities to its motion at body i's centre of mass."""
    for r in range(6):
        a, b, c = G[r, 0], G[r, 1], G[r, 2]
        out[r, 0], out[r, 1], out[r, 2] = a, b, c
        out[r, 3] = G[r, 3] + b * d[2] - c * d[1]
        out[r, 4] = G[r, 4] + c * d[0] - a * d[2]
        out[r, 5] = G[r, 5] + a * d[1] - b * d[0]


@inner
def _moved_to_j_twice(GX, d, out):
    """``X^T G X`` into ``out`` from ``G X``."""
    for c in range(6):
        a, b, e = GX[0, c], GX[1, c], GX[2, c]
        out[0, c], out[1, c], out[2, c] = a, b, e
        out[3, c] = GX[3, c] + b * d[2] - e * d[1]
        out[4, c] = GX[4, c] + e * d[0] - a * d[2]
        out[5, c] = GX[5, c] + a * d[1] - b * d[0]


@inner(forceinline=True)
def add_to_system(p, index, G, A, work6):
    """Add a patch's 6 x 6 matrix ``G`` to the system of all touched bodies; ``work6`` (2, 6, 6) is room."""
    i, j = p.bodies[index, 0], p.bodies[index, 1]
    a = p.place[i]
    if a >= 0:
        for r in range(6):
            for c in range(6):
                A[a + r, a + c] += G[r, c]
    if j < 0 or p.place[j] < 0:
        return
    b = p.place[j]
    GX, XGX = work6[0], work6[1]
    _moved_to_j(G, p.arm[index], GX)
    _moved_to_j_twice(GX, p.arm[index], XGX)
    for r in range(6):
        for c in range(6):
            A[b + r, b + c] += XGX[r, c]
            if a >= 0:
                A[a + r, b + c] -= GX[r, c]
                A[b + c, a + r] -= GX[r, c]


@inner(forceinline=True)
def add_drag_impulse(p, index, G, xi, factor, out):
    """Add what ``-factor G xi`` does to both bodies of a patch to the impulses ``out`` (n,)."""
    i, j = p.bodies[index, 0], p.bodies[index, 1]
    a = p.place[i]
    b = p.place[j] if j >= 0 else np.int64(-1)
    d = p.arm[index]
    fx = fy = fz = mx = my = mz = 0.0
    for c in range(6):
        s = factor * xi[c]
        fx += G[0, c] * s
        fy += G[1, c] * s
        fz += G[2, c] * s
        mx += G[3, c] * s
        my += G[4, c] * s
        mz += G[5, c] * s
    if a >= 0:
        out[a] += fx
        out[a + 1] += fy
        out[a + 2] += fz
        out[a + 3] += mx
        out[a + 4] += my
        out[a + 5] += mz
    if b >= 0:
        out[b] -= fx
        out[b + 1] -= fy
        out[b + 2] -= fz
        out[b + 3] -= mx - (d[1] * fz - d[2] * fy)
        out[b + 4] -= my - (d[2] * fx - d[0] * fz)
        out[b + 5] -= mz - (d[0] * fy - d[1] * fx)


@inner
def factorize(A, n):
    """Cholesky factor of a positive definite matrix (n, n), into its lower triangle."""
    for c in range(n):
        pivot = A[c, c]
        for k in range(c):
            pivot -= A[c, k] * A[c, k]
        pivot = math.sqrt(max(pivot, 1e-300))
        A[c, c] = pivot
        for r in range(c + 1, n):
            s = A[r, c]
            for k in range(c):
                s -= A[r, k] * A[c, k]
            A[r, c] = s / pivot


@inner
def solve_factorized(L, b, n):
    """Solve in place with the factor of `factorize`."""
    for r in range(n):
        s = b[r]
        for k in range(r):
            s -= L[r, k] * b[k]
        b[r] = s / L[r, r]
    for r in range(n - 1, -1, -1):
        s = b[r]
        for k in range(r + 1, n):
            s -= L[k, r] * b[k]
        b[r] = s / L[r, r]


@inner(forceinline=True)
def place_touched(world, work):
    """Number the unknowns of the touched bodies that move; returns how many there are."""
    place, n = work.patches.place, 0
    for i in range(len(place)):
        place[i] = -1
        if work.touched[i] and world.bodies.moving[i]:
            place[i] = n
            n += 6
    return n


@inner(forceinline=True)
def write_masses(laws, work, A, n):
    """Masses and inertias, in world axes, of the touched bodies on the diagonal of ``A`` (n, n), cleared."""
    for r in range(n):
        for c in range(n):
            A[r, c] = 0.0
    place = work.patches.place
    for i in range(len(place)):
        a = place[i]
        if a < 0:
            continue
        R, inertia = work.R[i], laws.inertia[i]
        for k in range(3):
            A[a + k, a + k] = laws.mass[i]
            x, y, z = rotate(inertia, R[k, 0], R[k, 1], R[k, 2])
            A[a + 3, a + 3 + k], A[a + 4, a + 3 + k], A[a + 5, a + 3 + k] = rotate(R, x, y, z)


@inner
def kick_patches(x, memory, world, laws, dt, work):
    """Change the velocities of all touched bodies over one step, by solving for all patches at once."""
    p = work.patches
    count = p.count[0]
    n = place_touched(world, work)
    fixed, A, step, impulse = p.system[0], p.system[1], p.step, p.impulse
    velocities, xi, work6, G = p.velocities, p.motion, p.moved, p.moved[2]
    write_masses(laws, work, fixed, n)
    _write_velocities(x, p, step, 0.0, velocities)
    for i in range(len(x)):
        if p.place[i] >= 0:
            for k in range(6):
                impulse[p.place[i] + k] = dt * work.wrench[i, k]
    needed = expected = False
    if laws.robust:
        gravity = math.sqrt(world.gravity[0] ** 2 + world.gravity[1] ** 2 + world.gravity[2] ** 2)
        for index in range(count):
            stiff = p.matrix[index, STIFF]
            rate = math.sqrt(_rate_squared(p, index, world, work, work6))
            p.load[index, 2] = rate
            if rate == 0.0:
                continue
            share = max(0.0, 1.0 - 1.0 / (dt * rate) ** 2)
            relative_motion(p, index, velocities, xi)
            slow = p.load[index, 1] * (_SLOW * gravity / rate) ** 2
            damper = 0.0
            if mean_square(stiff, xi) < slow:
                if not expected:
                    _expect(x, world, dt, work)
                    expected = True
                relative_motion(p, index, p.before, xi)
                if mean_square(stiff, xi) < slow:  # else it is only turning round
                    damper = 2.0 * _DAMPING_RATIO / rate
                relative_motion(p, index, velocities, xi)
            if share == 0.0 and damper == 0.0:
                continue
            needed = True
            for r in range(6):
                for c in range(6):
                    G[r, c] = dt * (share * dt + damper) * stiff[r, c]
            add_to_system(p, index, G, fixed, work6)
            if damper > 0.0:
                add_drag_impulse(p, index, stiff, xi, dt * damper, impulse)
            if share > 0.0:  # the force responds to the whole change of velocity, that by gravity included
                _fall_apart(p, index, world, dt, xi)
                add_drag_impulse(p, index, stiff, xi, dt * share * dt, impulse)
    for index in range(count):
        p.drag[index, 0, 0] = p.drag[index, 1, 0] = 0.0
    _begin_system(p, n)
    if needed:
        factorize(A, n)
        solve_factorized(A, step, n)
    else:
        _divide_by_masses(world, work, step)
    if laws.friction > 0.0 or laws.dissipation > 0.0:
        for turn in range(_ROUNDS):
            _choose_drag(x, laws, p, step, (p.before, velocities), xi, turn)
            _begin_system(p, n)
            _write_velocities(x, p, step, 0.0, velocities)
            for index in range(count):
                relative_motion(p, index, velocities, xi)
                for r in range(6):
                    for c in range(6):
                        G[r, c] = dt * (
                            p.drag[index, 0, 0] * p.matrix[index, TANGENTIAL, r, c]
                            + p.drag[index, 1, 0] * p.matrix[index, ACROSS, r, c]
                        )
                add_to_system(p, index, G, A, work6)
                add_drag_impulse(p, index, G, xi, 1.0, step)
            factorize(A, n)
            solve_factorized(A, step, n)
    for i in range(len(x)):
        a = p.place[i]
        if a >= 0:
            for k in range(3):
                x[i, V + k] += step[a + k]
                x[i, W + k] += step[a + 3 + k]
    if laws.robust:
        _remember_rates(x, memory, p, step, world, dt)


@inner
def _expect(x, world, dt, work):
    """Velocities that contacts and gravity would give without resistance, into ``before``."""
    p = work.patches
    for r in range(len(p.step)):
        p.step[r] = p.impulse[r]
    _divide_by_masses(world, work, p.step)
    _write_velocities(x, p, p.step, 1.0, p.before)
    for i in range(len(x)):
        if p.place[i] >= 0:
            for k in range(3):
                p.before[i, k] += dt * world.gravity[k]


@inner
def _fall_apart(p, index, world, dt, out):
    """What gravity adds to a patch's motion in a time, into ``out`` (6,): nothing where both bodies fall."""
    i, j = p.bodies[index, 0], p.bodies[index, 1]
    falls = np.float64(j >= 0 and world.bodies.moving[j]) - np.float64(world.bodies.moving[i])
    for k in range(3):
        out[k], out[3 + k] = falls * dt * world.gravity[k], 0.0


@inner
def _divide_by_masses(world, work, step):
    """Turn impulses into changes of velocity, where no patch resists them."""
    place = work.patches.place
    for i in range(len(place)):
        a = place[i]
        if a >= 0:
            R = work.R[i]
            for k in range(3):
                step[a + k] *= world.bodies.inverse_mass[i]
            x, y, z = rotate_back(R, step[a + 3], step[a + 4], step[a + 5])
            x, y, z = rotate(world.bodies.inverse_inertia[i], x, y, z)
            step[a + 3], step[a + 4], step[a + 5] = rotate(R, x, y, z)


@inner
def _begin_system(p, n):
    """Set out from the system without drag."""
    fixed, A = p.system[0], p.system[1]
    for r in range(n):
        p.step[r] = p.impulse[r]
        for c in range(n):
            A[r, c] = fixed[r, c]


@inner(forceinline=True)
def _remember_rates(x, memory, p, step, world, dt):
    """Keep the frequency of each touching pair whose force is about to change: the next step has to resolve it.

    What counts is how bodies drift before and after the piece's kick, in which contact and gravity may cancel.
    """
    xi, fall = p.motion, p.moved[2, 0]
    for index in range(p.count[0]):
        i, j = p.bodies[index, 0], p.bodies[index, 1]
        _write_velocities(x, p, step, -1.0, p.velocities)
        relative_motion(p, index, p.velocities, xi)
        _fall_apart(p, index, world, dt, fall)
        for k in range(3):
            xi[k] -= fall[k]
        moves = mean_square(p.matrix[index, STIFF], xi)
        _write_velocities(x, p, step, 0.0, p.velocities)
        relative_motion(p, index, p.velocities, xi)
        moves = math.sqrt(max(moves, mean_square(p.matrix[index, STIFF], xi)) / max(p.load[index, 1], 1e-300))
        quiet = moves * world.dt * p.load[index, 1] <= _QUIET * p.load[index, 0]
        memory[i, j if j >= 0 else len(x) - 1 - j, RATE] = QUIET if quiet else max(p.load[index, 2], 1.0)


@inner(forceinline=True)
def _write_velocities(x, p, step, share, velocities):
    """All bodies' velocities after ``share`` of the kick ``step`` into ``velocities`` (B, 6)."""
    for i in range(len(x)):
        for k in range(3):
            velocities[i, k], velocities[i, 3 + k] = x[i, V + k], x[i, W + k]
        if share != 0.0 and p.place[i] >= 0:
            for k in range(6):
                velocities[i, k] += share * step[p.place[i] + k]


@inner(forceinline=True)
def _choose_drag(x, laws, p, step, velocities, xi, turn):
    """Coefficients with which drag becomes Coulomb's force, from the velocities after the last solution.

    With a drag coefficient c the slip is ``v = u / (1 + c w)``, u being the slip without drag: two solutions tell the
    mobility w, and ``v = u - mu w`` is what Coulomb's law leaves of the slip, unless it sticks. A contact that stops
    closing in this kick opens for only a part of it: with ``e^2`` of the speed that the whole force gives.
    """
    before, now = velocities
    if turn == 0 and laws.dissipation > 0.0:
        _write_velocities(x, p, step, 0.0, before)
    _write_velocities(x, p, step, 1.0, now)
    for index in range(p.count[0]):
        relative_motion(p, index, now, xi)
        force = p.load[index, 0]
        for k in range(2):
            mu = laws.friction if k == 0 else laws.dissipation / (1.0 - laws.dissipation)
            creep = CREEP if k == 0 else SETTLING
            if mu == 0.0 or force == 0.0:
                continue
            slip = math.sqrt(mean_square(p.matrix[index, k], xi) / force)
            if turn == 0:
                p.drag[index, k, 1] = slip
                if k == 1:
                    other = p.moved[2, 0]
                    relative_motion(p, index, before, other)
                    if product(p.matrix[index, k], other, xi) < 0.0:
                        p.drag[index, k, 1] = -slip
            free, c = abs(p.drag[index, k, 1]), p.drag[index, k, 0]
            if c == 0.0 or slip == 0.0 or slip >= free:
                p.drag[index, k, 0] = mu / max(slip, creep)
                continue
            mobility = (free / slip - 1.0) / c
            if p.drag[index, k, 1] >= 0.0:
                p.drag[index, k, 0] = mu / max(free - mu * mobility, creep)
            else:
                wanted = min((1.0 - 2.0 * laws.dissipation) * (free + mu * mobility), free)
                least = free / (1.0 + mu / creep * mobility)
                p.drag[index, k, 0] = (free / max(wanted, least) - 1.0) / mobility


@inner(forceinline=True)
def _rate_squared(p, index, world, work, work6):
    """Trace of inverse masses times a patch's stiffness: not below the square of its frequency [1/s^2]."""
    i, j = p.bodies[index, 0], p.bodies[index, 1]
    G, bodies = p.matrix[index, STIFF], world.bodies
    total = 0.0
    if bodies.moving[i]:
        total += bodies.inverse_mass[i] * p.load[index, 1] + _turning(bodies.inverse_inertia[i], work.R[i], G)
    if j >= 0 and bodies.moving[j]:
        _moved_to_j(G, p.arm[index], work6[0])
        _moved_to_j_twice(work6[0], p.arm[index], work6[1])
        total += bodies.inverse_mass[j] * p.load[index, 1] + _turning(bodies.inverse_inertia[j], work.R[j], work6[1])
    return max(total, 0.0)


@inner
def _turning(inverse_inertia, R, G):
    """Trace of a body's inverse inertia times the rotational block of ``G``."""
    total = 0.0
    for k in range(3):
        # row k of R^T, the block's image of it, back in the body's axes
        x, y, z = R[0, k], R[1, k], R[2, k]
        gx = G[3, 3] * x + G[3, 4] * y + G[3, 5] * z
        gy = G[4, 3] * x + G[4, 4] * y + G[4, 5] * z
        gz = G[5, 3] * x + G[5, 4] * y + G[5, 5] * z
        for m in range(3):
            total += inverse_inertia[k, m] * (R[0, m] * gx + R[1, m] * gy + R[2, m] * gz)
    return total


@inner
def hold_columns(rows, place, x, world, laws, dt, joint, work):
    """Let the drag of the last kick act on errors of the velocities: rows of the touched bodies' error states.

    The derivative of Coulomb's force: it resists every error of the slip where the contact sticks, and those across
    the slip where it slides. ``place`` (B,) counts a body's blocks of 12 rows, -1 for a fixed one. Where
    bodies are not ``joint``, errors of one leave the others alone.
    """
    p = work.patches
    n = 0
    for i in range(len(p.place)):
        n += 6 * (p.place[i] >= 0)
    A, xi, G = p.system[1], p.motion, p.moved[2]
    write_masses(laws, work, A, n)
    _write_velocities(x, p, p.step, 0.0, p.velocities)
    for index in range(p.count[0]):
        relative_motion(p, index, p.velocities, xi)
        for r in range(6):
            for c in range(6):
                G[r, c] = 0.0
        for k in range(2):
            drag = dt * p.drag[index, k, 0]
            if drag == 0.0:
                continue
            weighted = p.matrix[index, k]
            square = mean_square(weighted, xi)
            creep = CREEP if k == 0 else SETTLING
            slides = square > 4.0 * creep**2 * p.load[index, 0]
            for r in range(6):
                left = 0.0
                for m in range(6):
                    left += weighted[r, m] * xi[m]
                for c in range(6):
                    right = 0.0
                    for m in range(6):
                        right += weighted[c, m] * xi[m]
                    G[r, c] += drag * (weighted[r, c] - (left * right / square if slides else 0.0))
        add_to_system(p, index, G, A, p.moved)
    if not joint:
        for r in range(n):
            for c in range(n):
                if r // 6 != c // 6:
                    A[r, c] = 0.0
    factorize(A, n)
    for column in range(rows.shape[1]):
        for i in range(len(p.place)):
            a, b = p.place[i], ERROR * place[i]
            if a < 0:
                continue
            wx, wy, wz = rotate_back(work.R[i], rows[b + EW, column], rows[b + EW + 1, column], rows[b + EW + 2, column])
            wx, wy, wz = rotate(laws.inertia[i], wx, wy, wz)
            p.step[a + 3], p.step[a + 4], p.step[a + 5] = rotate(work.R[i], wx, wy, wz)
            for k in range(3):
                p.step[a + k] = laws.mass[i] * rows[b + EV + k, column]
        solve_factorized(A, p.step, n)
        for i in range(len(p.place)):
            a, b = p.place[i], ERROR * place[i]
            if a >= 0:
                for k in range(3):
                    rows[b + EV + k, column] = p.step[a + k]
                    rows[b + EW + k, column] = p.step[a + 3 + k]
