"""States and covariances at a model's origin and at the centre of mass (COM), about fixed axes.

Messages use the pose of a model's own origin ``o`` and rotations about fixed axes. The error state refers to
the COM, with body-frame rotations. With ``r = R_world_body o`` (from the COM to the origin, world axes) and
``dphi = R_world_body dtheta``, the errors at the origin are::

    dp_o = dp - [r]x dphi                              p_o = p + r
    dv_o = dv - [r]x domega - [omega]x [r]x dphi       v_o = v + omega x r

This is linear in the error state: ``e_o = A e`` (`error_map`), so ``P_o = A P A^T``.
"""

from __future__ import annotations

import math

from ..compiler import inner, kernel
from ..compiler.arrays import empty, zeros
from .layout import EP, ER, ERROR, EV, EW, P, Q, V, W
from .rotation import rotate, write_matrix

_POSE, _TWIST = (EP, ER), (EV, EW)  # order in messages


@kernel
def _rotation(state):
    R = empty((1, 3, 3))
    write_matrix((state[Q], state[Q + 1], state[Q + 2], state[Q + 3]), R, 0)
    return R[0]


@kernel
def _skew(v):
    x, y, z = v
    K = zeros((3, 3))
    K[0, 1], K[0, 2], K[1, 2] = -z, y, -x
    K[1, 0], K[2, 0], K[2, 1] = z, -y, x
    return K


@kernel
def _product(A, B):
    """Return ``A @ B``; numba's own product would need SciPy."""
    C = zeros((len(A), B.shape[1]))
    for i in range(len(A)):
        for k in range(len(B)):
            if A[i, k] != 0.0:
                for j in range(B.shape[1]):
                    C[i, j] += A[i, k] * B[k, j]
    return C


@kernel
def _identity():
    A = zeros((ERROR, ERROR))
    for k in range(ERROR):
        A[k, k] = 1.0
    return A


@inner
def _copy_block(source, i, j, target, k, l, factor):
    """Assign ``target[k : k + 3, l : l + 3] = factor * source[i : i + 3, j : j + 3]``; compiles fast."""
    for r in range(3):
        for c in range(3):
            target[k + r, l + c] = factor * source[i + r, j + c]


@kernel
def congruent(A, C):
    """Return ``A C A^T``, exactly symmetric and without negative variances from round-off."""
    n = len(A)
    left, mapped, result = _product(A, C), zeros((n, n)), empty((n, n))
    for i in range(n):
        for k in range(n):
            if left[i, k] != 0.0:
                for j in range(n):
                    mapped[i, j] += left[i, k] * A[j, k]
    for i in range(n):
        for j in range(n):
            result[i, j] = 0.5 * (mapped[i, j] + mapped[j, i])
    for k in range(n):
        if result[k, k] < 0.0:
            for j in range(n):
                result[k, j] = result[j, k] = 0.0
    return result


@kernel
def error_map(state, origin):
    """Return the map A (12, 12) from the error state to the error about fixed axes at the model's origin.

    The error state is in the body frame at the COM.

    Parameters
    ----------
    state : (13,) array
        Mean state of the body.
    origin : (3,) array
        Origin of the model, body frame [m].

    Notes
    -----
    It is of first order in the rotation error, as is every pose covariance.
    """
    R = _rotation(state)
    lever = _skew(rotate(R, origin[0], origin[1], origin[2]))
    spin = _skew((state[W], state[W + 1], state[W + 2]))
    A = _identity()
    _copy_block(R, 0, 0, A, ER, ER, 1.0)
    _copy_block(_product(lever, R), 0, 0, A, EP, ER, -1.0)
    _copy_block(_product(_product(spin, lever), R), 0, 0, A, EV, ER, -1.0)
    _copy_block(lever, 0, 0, A, EV, EW, -1.0)
    return A


@kernel
def inverse_error_map(state, origin):
    """Return the inverse of `error_map`."""
    R = _rotation(state)
    lever = _skew(rotate(R, origin[0], origin[1], origin[2]))
    spin = _skew((state[W], state[W + 1], state[W + 2]))
    A = _identity()
    for r in range(3):
        for c in range(3):
            A[ER + r, ER + c] = R[c, r]
    _copy_block(lever, 0, 0, A, EP, ER, 1.0)
    _copy_block(_product(spin, lever), 0, 0, A, EV, ER, 1.0)
    _copy_block(lever, 0, 0, A, EV, EW, 1.0)
    return A


@kernel
def moved(state, origin, sign):
    """Return the state (13,) of the point at ``sign * origin`` from the body's point, body frame."""
    R = _rotation(state)
    x, y, z = rotate(R, sign * origin[0], sign * origin[1], sign * origin[2])
    wx, wy, wz = state[W], state[W + 1], state[W + 2]
    result = empty(len(state))
    for k in range(len(state)):
        result[k] = state[k]
    result[P] += x
    result[P + 1] += y
    result[P + 2] += z
    result[V] += wy * z - wz * y
    result[V + 1] += wz * x - wx * z
    result[V + 2] += wx * y - wy * x
    return result


@kernel
def at_com(C, state, origin):
    """Return the covariance (12, 12) at the COM from one at the model's origin, about fixed axes.

    Parameters
    ----------
    C : (12, 12) array
    state : (13,) array
        State at the COM.
    origin : (3,) array
        Body frame [m].
    """
    return congruent(inverse_error_map(state, origin), C)


@kernel
def split(C):
    """Return pose and twist covariances (36,) in the order of messages.

    ``C`` (12, 12) is the covariance at the origin.
    """
    pose, twist = empty((6, 6)), empty((6, 6))
    for a in range(2):
        for b in range(2):
            _copy_block(C, _POSE[a], _POSE[b], pose, 3 * a, 3 * b, 1.0)
            _copy_block(C, _TWIST[a], _TWIST[b], twist, 3 * a, 3 * b, 1.0)
    return pose.reshape(36), twist.reshape(36)


@kernel
def at_origin(state, P, origin):
    """Return a body's state (13,) and covariance (12, 12) at the COM in the form of messages.

    Returns
    -------
    state : (13,) array
        State at the model's origin.
    C : (12, 12) array
        Covariance at the model's origin, about fixed axes.
    pose, twist : (36,) array
        Pose and twist blocks of ``C``.
    finite : bool
        Whether all numbers are finite.
    """
    C = congruent(error_map(state, origin), P)
    result = moved(state, origin, 1.0)
    pose, twist = split(C)
    total = 0.0
    for k in range(len(result)):
        total += result[k]
    for i in range(ERROR):
        for j in range(ERROR):
            total += C[i, j]
    return result, C, pose, twist, math.isfinite(total)
