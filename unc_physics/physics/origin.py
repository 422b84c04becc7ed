"""States and covariances at a model's origin and at the centre of mass (COM), about fixed axes.

Messages give the pose of a model's own origin ``o`` and rotations about fixed axes; the error state is
that of the COM, with rotations on the body side. With ``r = R_world_body o`` (from the COM to the
origin, world axes) and ``dphi = R_world_body dtheta``, the errors at the origin are::

    dp_o = dp - [r]x dphi                              p_o = p + r
    dv_o = dv - [r]x domega - [omega]x [r]x dphi       v_o = v + omega x r

which is linear in the error state: ``e_o = A e`` (`error_map`), so ``P_o = A P A^T``.
"""

from __future__ import annotations

import numpy as np

from .compiled import kernel
from .layout import EP, ER, ERROR, EV, EW, P, Q, V, W
from .rotation import rotate, write_matrix


@kernel
def _rotation(q):
    R = np.empty((1, 3, 3))
    write_matrix((q[0], q[1], q[2], q[3]), R, 0)
    return R[0]


@kernel
def _skew(x, y, z):
    K = np.zeros((3, 3))
    K[0, 1], K[0, 2], K[1, 2] = -z, y, -x
    K[1, 0], K[2, 0], K[2, 1] = z, -y, x
    return K


@kernel
def _product(A, B):
    """``A @ B``; numba's own would need SciPy."""
    C = np.zeros((len(A), B.shape[1]))
    for i in range(len(A)):
        for k in range(len(B)):
            if A[i, k] != 0.0:
                for j in range(B.shape[1]):
                    C[i, j] += A[i, k] * B[k, j]
    return C


@kernel
def congruent(A, C):
    """``A C A^T``, symmetric to the last bit; round-off leaves no variance below zero."""
    mapped = _product(_product(A, C), A.T)
    result = 0.5 * (mapped + mapped.T)
    for k in range(len(result)):
        if result[k, k] < 0.0:
            result[k, :] = 0.0
            result[:, k] = 0.0
    return result


@kernel
def error_map(state, origin):
    """A (12, 12): from the error state (body side, at the COM) to the error about fixed axes at the model's
    origin.

    Parameters
    ----------
    state : (13,) array
        Mean state of the body.
    origin : (3,) array
        The model's origin, body frame [m].

    Notes
    -----
    To first order in the rotation error, as every covariance of a pose.
    """
    R = _rotation(state[Q : Q + 4])
    lever, spin = (
        _skew(*rotate(R, origin[0], origin[1], origin[2])),
        _skew(state[W], state[W + 1], state[W + 2]),
    )
    A = np.eye(ERROR)
    A[ER : ER + 3, ER : ER + 3] = R
    A[EP : EP + 3, ER : ER + 3] = -_product(lever, R)
    A[EV : EV + 3, ER : ER + 3] = -_product(_product(spin, lever), R)
    A[EV : EV + 3, EW : EW + 3] = -lever
    return A


@kernel
def inverse_error_map(state, origin):
    """Inverse of `error_map`."""
    R = _rotation(state[Q : Q + 4])
    lever, spin = (
        _skew(*rotate(R, origin[0], origin[1], origin[2])),
        _skew(state[W], state[W + 1], state[W + 2]),
    )
    A = np.eye(ERROR)
    A[ER : ER + 3, ER : ER + 3] = R.T
    A[EP : EP + 3, ER : ER + 3] = lever
    A[EV : EV + 3, ER : ER + 3] = _product(spin, lever)
    A[EV : EV + 3, EW : EW + 3] = lever
    return A


@kernel
def moved(state, origin, sign):
    """The state (13,) with position and velocity of the point that is ``sign * origin`` away, body frame."""
    R = _rotation(state[Q : Q + 4])
    x, y, z = rotate(R, sign * origin[0], sign * origin[1], sign * origin[2])
    wx, wy, wz = state[W], state[W + 1], state[W + 2]
    result = state.copy()
    result[P] += x
    result[P + 1] += y
    result[P + 2] += z
    result[V] += wy * z - wz * y
    result[V + 1] += wz * x - wx * z
    result[V + 2] += wx * y - wy * x
    return result


@kernel
def at_com(C, state, origin):
    """Covariance (12, 12) of the error state at the COM from that at the model's origin, about fixed axes.

    Parameters
    ----------
    C : (12, 12) array
    state : (13,) array
        At the COM.
    origin : (3,) array
        Body frame [m].
    """
    return congruent(inverse_error_map(state, origin), C)


@kernel
def covariance_at_com(pose, twist, state, origin):
    """Covariance (12, 12) of the error state at the COM from those of a message.

    Parameters
    ----------
    pose, twist : (6, 6) array
        Covariances at the model's origin, as messages order them; independent of each other.
    state : (13,) array
        At the COM.
    origin : (3,) array
        Body frame [m].
    """
    C = np.zeros((ERROR, ERROR))
    for a, first in enumerate((EP, ER)):
        for b, second in enumerate((EP, ER)):
            C[first : first + 3, second : second + 3] = pose[3 * a : 3 * a + 3, 3 * b : 3 * b + 3]
    for a, first in enumerate((EV, EW)):
        for b, second in enumerate((EV, EW)):
            C[first : first + 3, second : second + 3] = twist[3 * a : 3 * a + 3, 3 * b : 3 * b + 3]
    return at_com(C, state, origin)


@kernel
def split(C):
    """Covariances (36,) of pose and of twist, as messages order them, from the covariance (12, 12) at the
    origin.
    """
    pose, twist = np.empty((6, 6)), np.empty((6, 6))
    for a, first in enumerate((EP, ER)):
        for b, second in enumerate((EP, ER)):
            pose[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] = C[first : first + 3, second : second + 3]
    for a, first in enumerate((EV, EW)):
        for b, second in enumerate((EV, EW)):
            twist[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] = C[first : first + 3, second : second + 3]
    return pose.ravel(), twist.ravel()


@kernel
def at_origin(state, P, origin):
    """A body's state (13,) and covariance (12, 12) at the COM as messages want them.

    Returns
    -------
    state : (13,) array
        At the model's origin.
    C : (12, 12) array
        Covariance there, about fixed axes.
    pose, twist : (36,) array
        Its parts.
    finite : bool
        Whether all numbers are.
    """
    C = congruent(error_map(state, origin), P)
    result = moved(state, origin, 1.0)
    pose, twist = split(C)
    return result, C, pose, twist, np.isfinite(result.sum() + C.sum())
