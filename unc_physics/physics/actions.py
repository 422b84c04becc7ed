"""Actions as arrays for the kernels: paths, attachments, moving surfaces, wrenches, and drag of the air."""

from typing import NamedTuple

import numpy as np

from ..compiler import inner, kernel
from ..compiler.arrays import empty
from ..spatial.layout import P, Q, V, W
from ..spatial.rotation import (
    conjugate,
    cross,
    exp,
    log,
    multiply,
    normalized,
    rotate,
    rotate_back,
    rotate_by_quaternion,
)

#: Relative round-off within which a time counts as the beginning or end of a step.
ROUND_OFF = 1e-9


class Actions(NamedTuple):
    """Actions on the B bodies; all arrays are empty if there are none.

    Attributes
    ----------
    kinematic : (D,) int64
        Bodies that follow a path, then attached bodies.
    path : (B, 2) int64
        First and last (exclusive) index of each body's poses; equal if it follows no path.
    time : (K,) float64
        Times of the K poses [s].
    pose : (K, 13) float64
        States of the centre of mass at these times, world frame.
    turn : (K, 6) float64
        Rotation vector from each pose to the next, world frame [rad], and its rate at the end [rad/s].
    pace : (K, 4) float64
        Bounds until the next pose: speed [m/s], angular speed [rad/s], acceleration [m/s^2], angular
        acceleration [rad/s^2].
    carrier : (B,) int64
        Body to which each body is attached; -1 for none.
    held : (B, 2) float64
        Times of attachment and of release [s].
    wrench_body : (U,) int64
    wrench : (U, 6) float64
        Force [N], and torque about the centre of mass [N m].
    wrench_time : (U, 2) float64
        Times at which each wrench begins and ends [s].
    wrench_local : (U,) bool
        Whether force and torque are in the body frame, not the world frame.
    wrench_drag : (U,) float64
        Drag c of a wrench that is the force ``-c |v| v`` on the centre of mass [kg/m]; 0 of all others.
    surface : (E, 6) float64
        Velocity of each element's surface at the world's origin [m/s] and its angular velocity [rad/s]. Empty
        if no surface moves.
    """

    kinematic: np.ndarray
    path: np.ndarray
    time: np.ndarray
    pose: np.ndarray
    turn: np.ndarray
    pace: np.ndarray
    carrier: np.ndarray
    held: np.ndarray
    wrench_body: np.ndarray
    wrench: np.ndarray
    wrench_time: np.ndarray
    wrench_local: np.ndarray
    wrench_drag: np.ndarray
    surface: np.ndarray


def no_actions(bodies: int) -> Actions:
    """Return empty actions for a number of bodies."""
    return Actions(
        kinematic=np.empty(0, np.int64),
        path=np.zeros((bodies, 2), np.int64),
        time=np.empty(0),
        pose=np.empty((0, 13)),
        turn=np.empty((0, 6)),
        pace=np.empty((0, 4)),
        carrier=np.full(bodies, -1),
        held=np.full((bodies, 2), np.inf),
        wrench_body=np.empty(0, np.int64),
        wrench=np.empty((0, 6)),
        wrench_time=np.empty((0, 2)),
        wrench_local=np.empty(0, np.bool_),
        wrench_drag=np.empty(0),
        surface=np.empty((0, 6)),
    )


@inner
def follows(j, actions):
    """Return whether body j follows a path."""
    return actions.path[j, 1] > actions.path[j, 0]


@inner
def segment_at(j, t, actions):
    """Return the index of body j's last pose at time ``t``, or of its first one."""
    low, high = actions.path[j, 0], actions.path[j, 1] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if actions.time[middle] <= t:
            low = middle
        else:
            high = middle
    return low


@inner(error_model="numpy")
def write_on_path(out, row, j, t, actions):
    """Write the state of body j on its path at time ``t`` into a row of ``out`` (n, 13).

    Between two poses the position is the cubic Hermite polynomial of their positions and velocities. The
    rotation is ``Exp(phi) R``, where phi is the Hermite polynomial of rotation vectors. Before the first and
    after the last pose the body stands still.
    """
    first, last = actions.path[j, 0], actions.path[j, 1] - 1
    pose, time = actions.pose, actions.time
    if t < time[first] or t > time[last] or first == last:
        k = first if t < time[first] else last
        for c in range(3):
            out[row, P + c], out[row, V + c], out[row, W + c] = pose[k, P + c], 0.0, 0.0
        for c in range(4):
            out[row, Q + c] = pose[k, Q + c]
        return
    k = segment_at(j, t, actions)
    h = time[k + 1] - time[k]
    u = (t - time[k]) / h
    there, start, stop = u * u * (3.0 - 2.0 * u), h * u * (1.0 - u) ** 2, -h * u * u * (1.0 - u)
    slope, starting, stopping = 6.0 * u * (1.0 - u) / h, (1.0 - u) * (1.0 - 3.0 * u), u * (3.0 * u - 2.0)
    for c in range(3):
        way = pose[k + 1, P + c] - pose[k, P + c]
        v, w = pose[k, V + c], pose[k + 1, V + c]
        out[row, P + c] = pose[k, P + c] + there * way + start * v + stop * w
        out[row, V + c] = slope * way + starting * v + stopping * w
    turn = actions.turn[k]
    wx, wy, wz = pose[k, W], pose[k, W + 1], pose[k, W + 2]
    phi = (
        there * turn[0] + start * wx + stop * turn[3],
        there * turn[1] + start * wy + stop * turn[4],
        there * turn[2] + start * wz + stop * turn[5],
    )
    rate = (
        slope * turn[0] + starting * wx + stopping * turn[3],
        slope * turn[1] + starting * wy + stopping * turn[4],
        slope * turn[2] + starting * wz + stopping * turn[5],
    )
    q = multiply(exp(phi[0], phi[1], phi[2]), (pose[k, Q], pose[k, Q + 1], pose[k, Q + 2], pose[k, Q + 3]))
    out[row, Q], out[row, Q + 1], out[row, Q + 2], out[row, Q + 3] = normalized(q)
    out[row, W], out[row, W + 1], out[row, W + 2] = _left_jacobian(phi, rate)


@inner(error_model="numpy")
def _left_jacobian(phi, v):
    """Return the angular velocity of ``Exp(phi)``, world frame, if phi changes at the rate ``v``."""
    square = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    if square < 1e-6:
        a, b = 0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0
    else:
        angle = np.sqrt(square)
        a, b = (1.0 - np.cos(angle)) / square, (angle - np.sin(angle)) / (square * angle)
    once = cross(phi, v)
    twice = cross(phi, once)
    return (
        v[0] + a * once[0] + b * twice[0],
        v[1] + a * once[1] + b * twice[1],
        v[2] + a * once[2] + b * twice[2],
    )


@inner
def bound_pace(j, begin, end, radius, actions):
    """Bound the speed of a point of body j on its path [m/s], and the change of its velocity, in an interval.

    The point is within ``radius`` of the centre of mass.
    """
    first, last = actions.path[j, 0], actions.path[j, 1] - 1
    if end < actions.time[first] or begin > actions.time[last] or first == last:
        return 0.0, 0.0
    pace = change = 0.0
    k = segment_at(j, begin, actions)
    while k < last and actions.time[k] <= end:
        most = actions.pace[k]
        pace = max(pace, most[0] + radius * most[1])
        change = max(change, (end - begin) * (most[2] + radius * (most[3] + most[1] * most[1])))
        k += 1
    # the velocity may jump at the ends of the path
    if begin <= actions.time[first] or end >= actions.time[last]:
        change = 2.0 * pace
    return pace, min(change, 2.0 * pace)


@inner
def write_carried(out, row, carrier, other, hold):
    """Write the state of an attached body into a row of ``out``.

    The holding body's state is row ``other`` of ``carrier``; ``hold`` (7,) is the position and quaternion in
    its frame.
    """
    q = (carrier[other, Q], carrier[other, Q + 1], carrier[other, Q + 2], carrier[other, Q + 3])
    arm = rotate_by_quaternion(q, (hold[0], hold[1], hold[2]))
    omega = (carrier[other, W], carrier[other, W + 1], carrier[other, W + 2])
    v = cross(omega, arm)
    turned = normalized(multiply(q, (hold[3], hold[4], hold[5], hold[6])))
    for k in range(3):
        out[row, P + k] = carrier[other, P + k] + arm[k]
        out[row, V + k] = carrier[other, V + k] + v[k]
        out[row, W + k] = omega[k]
    for k in range(4):
        out[row, Q + k] = turned[k]


@inner
def write_hold(x, i, carrier, other, hold):
    """Write the pose of body i in the frame of the body that holds it into ``hold`` (`write_carried`)."""
    q = conjugate((carrier[other, Q], carrier[other, Q + 1], carrier[other, Q + 2], carrier[other, Q + 3]))
    away = (
        x[i, P] - carrier[other, P],
        x[i, P + 1] - carrier[other, P + 1],
        x[i, P + 2] - carrier[other, P + 2],
    )
    arm, turn = rotate_by_quaternion(q, away), multiply(q, (x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]))
    for k in range(3):
        hold[k] = arm[k]
    for k in range(4):
        hold[3 + k] = turn[k]


@inner(forceinline=True)
def acting_for(u, begin, end, actions):
    """Return how long wrench ``u`` acts between two times [s]."""
    return min(end, actions.wrench_time[u, 1]) - max(begin, actions.wrench_time[u, 0])


@inner
def push(x, i, begin, end, share, bodies, R, actions):
    """Add a share of the impulses that wrenches give body i between two times to its velocities.

    Drag alone would leave ``v / (1 + c |v| t / m)`` of a velocity, which is exact for any time.
    """
    for u in range(len(actions.wrench_body)):
        if actions.wrench_body[u] != i:
            continue
        time = share * acting_for(u, begin, end, actions)
        if time <= 0.0:
            continue
        if actions.wrench_drag[u] > 0.0:
            pace = np.sqrt(x[i, V] * x[i, V] + x[i, V + 1] * x[i, V + 1] + x[i, V + 2] * x[i, V + 2])
            kept = 1.0 / (1.0 + time * bodies.inverse_mass[i] * actions.wrench_drag[u] * pace)
            for k in range(3):
                x[i, V + k] *= kept
            continue
        f, A = actions.wrench[u], R[i]
        fx, fy, fz = f[0], f[1], f[2]
        tx, ty, tz = f[3], f[4], f[5]
        if actions.wrench_local[u]:
            fx, fy, fz = rotate(A, fx, fy, fz)
        else:
            tx, ty, tz = rotate_back(A, tx, ty, tz)
        tx, ty, tz = rotate(bodies.inverse_inertia[i], tx, ty, tz)
        tx, ty, tz = rotate(A, tx, ty, tz)
        force, spin = (fx, fy, fz), (tx, ty, tz)
        for k in range(3):
            x[i, V + k] += time * bodies.inverse_mass[i] * force[k]
            x[i, W + k] += time * spin[k]


@kernel
def states_on_path(j, times, actions):
    """Return the states (T, 13) of body j on its path at given times [s]."""
    out = empty((len(times), 13))
    for k in range(len(times)):
        write_on_path(out, k, j, times[k], actions)
    return out


@kernel
def carry_along(states, i, before, after):
    """Move body i of states (N, B, 13) in place with a carrier that moves from ``before`` to ``after``.

    ``before`` (1, 13) and ``after`` (N, 13) are states of the carrier; the body is rigidly attached to it.
    """
    hold = empty(7)
    for n in range(len(states)):
        write_hold(states[n], i, before, 0, hold)
        write_carried(states[n], i, after, n, hold)
    return states


@kernel
def rotation_between(q, r):
    """Return the rotation vector from quaternion ``q`` to ``r`` (4,), world frame [rad]."""
    return np.array(log(multiply((r[0], r[1], r[2], r[3]), conjugate((q[0], q[1], q[2], q[3])))))
