"""Rotations in kernels: quaternions ``(x, y, z, w)`` are tuples of floats, matrices are 3 x 3 arrays."""

import math

import numpy as np

from ..compiler import kernel

_SMALL_ANGLE_SQUARED = 1e-8  # below it, two terms of the series are exact to round-off
_STEP_ANGLE_SQUARED = (
    0.01  # below it, as in most time steps, five terms are exact, and cheaper than sine and cosine
)


@kernel(arrays=False)
def multiply(a, b):
    """Return the Hamilton product of two quaternions: the rotation ``b`` followed by ``a``."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


@kernel(arrays=False)
def conjugate(q):
    """Return the inverse of a unit quaternion."""
    return -q[0], -q[1], -q[2], q[3]


@kernel(arrays=False)
def normalized(q):
    """Return a quaternion scaled to unit length."""
    s = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] * s, q[1] * s, q[2] * s, q[3] * s


@kernel(arrays=False)
def renormalized(q):
    """Normalize a quaternion of nearly unit length by one step of Newton's method."""
    s = 1.5 - 0.5 * (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] * s, q[1] * s, q[2] * s, q[3] * s


@kernel(arrays=False)
def exp(x, y, z):
    """Return the quaternion of the rotation vector ``(x, y, z)`` [rad]."""
    angle2 = x * x + y * y + z * z
    if angle2 < _STEP_ANGLE_SQUARED:
        s = 0.5 - angle2 * (
            1.0 / 48.0 - angle2 * (1.0 / 3840.0 - angle2 * (1.0 / 645120.0 - angle2 / 185794560.0))
        )
        c = 1.0 - angle2 * (
            1.0 / 8.0 - angle2 * (1.0 / 384.0 - angle2 * (1.0 / 46080.0 - angle2 / 10321920.0))
        )
    else:
        angle = math.sqrt(angle2)
        s, c = math.sin(0.5 * angle) / angle, math.cos(0.5 * angle)
    return x * s, y * s, z * s, c


@kernel(arrays=False)
def log(q):
    """Return the rotation vector of a unit quaternion [rad]; its length is at most pi."""
    x, y, z, w = q
    if w < 0.0:  # q and -q are equal rotations; this sign has the angle below pi
        x, y, z, w = -x, -y, -z, -w
    n2 = x * x + y * y + z * z
    if n2 < _SMALL_ANGLE_SQUARED:
        s = 2.0 + n2 / 3.0  # 2 asin(n) / n
    else:
        n = math.sqrt(n2)
        s = 2.0 * math.atan2(n, w) / n
    return x * s, y * s, z * s


@kernel(arrays=False)
def write_matrix(q, out, k):
    """Write the rotation matrix of a unit quaternion into ``out[k]`` of an array (n, 3, 3)."""
    x, y, z, w = q
    out[k, 0, 0] = 1.0 - 2.0 * (y * y + z * z)
    out[k, 0, 1] = 2.0 * (x * y - z * w)
    out[k, 0, 2] = 2.0 * (x * z + y * w)
    out[k, 1, 0] = 2.0 * (x * y + z * w)
    out[k, 1, 1] = 1.0 - 2.0 * (x * x + z * z)
    out[k, 1, 2] = 2.0 * (y * z - x * w)
    out[k, 2, 0] = 2.0 * (x * z - y * w)
    out[k, 2, 1] = 2.0 * (y * z + x * w)
    out[k, 2, 2] = 1.0 - 2.0 * (x * x + y * y)


@kernel(arrays=False)
def rotate(R, x, y, z):
    """Return ``R @ (x, y, z)`` as a tuple."""
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@kernel(arrays=False)
def rotate_back(R, x, y, z):
    """Return ``R.T @ (x, y, z)`` as a tuple."""
    return (
        R[0, 0] * x + R[1, 0] * y + R[2, 0] * z,
        R[0, 1] * x + R[1, 1] * y + R[2, 1] * z,
        R[0, 2] * x + R[1, 2] * y + R[2, 2] * z,
    )


@kernel(arrays=False)
def cross(a, b):
    """Return the cross product of two vectors as a tuple."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel(arrays=False)
def rotate_by_quaternion(q, v):
    """Return a vector rotated by a unit quaternion as a tuple."""
    axis = (q[0], q[1], q[2])
    once = cross(axis, v)
    twice = cross(axis, (once[0] + q[3] * v[0], once[1] + q[3] * v[1], once[2] + q[3] * v[2]))
    return v[0] + 2.0 * twice[0], v[1] + 2.0 * twice[1], v[2] + 2.0 * twice[2]


def rotation_matrix(q):
    """Return the rotation matrix (3, 3) of a unit quaternion; callable from Python."""
    R = np.empty((1, 3, 3))
    write_matrix(tuple(map(float, q)), R, 0)
    return R[0]


@kernel(arrays=False, error_model="numpy")
def tangents(n):
    """Return two unit vectors that complete ``n`` to a right-handed basis (Duff et al. 2017)."""
    s = 1.0 if n[2] >= 0.0 else -1.0
    a = -1.0 / (s + n[2])
    b = n[0] * n[1] * a
    return (1.0 + s * n[0] * n[0] * a, s * b, -s * n[0]), (b, s + n[1] * n[1] * a, -n[1])


def rotation_matrices(q):
    """Return the rotation matrices (..., 3, 3) of unit quaternions (..., 4); not for kernels."""
    x, y, z, w = np.moveaxis(np.asarray(q), -1, 0)
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def rotate_vectors(q, vectors):
    """Return vectors (..., 3) rotated by unit quaternions (..., 4); not for kernels."""
    once = 2.0 * np.cross(q[..., :3], vectors)
    return vectors + q[..., 3:] * once + np.cross(q[..., :3], once)


def from_roll_pitch_yaw(angles):
    """Quaternion (4,) of turns about the world's x, then y, then z axis [rad], as in URDF."""
    cr, cp, cy = np.cos(0.5 * angles)
    sr, sp, sy = np.sin(0.5 * angles)
    return np.array(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )


def exp_vectors(turns):
    """Return the unit quaternions (..., 4) of rotation vectors (..., 3) [rad]; not for kernels."""
    half = 0.5 * np.linalg.norm(turns, axis=-1, keepdims=True)
    return np.concatenate([0.5 * np.sinc(half / np.pi) * turns, np.cos(half)], axis=-1)


def cross_matrices(v):
    """Return the matrices (..., 3, 3) of the cross products with vectors (..., 3); not for kernels."""
    K = np.zeros((*v.shape, 3))
    K[..., 0, 1], K[..., 0, 2], K[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return K - np.swapaxes(K, -1, -2)


def left_jacobian(v):
    """Return the left Jacobian (3, 3) of SO(3) at a rotation vector (3,) [rad]; not for kernels.

    To first order, ``Exp(v + d) = Exp(J d) Exp(v)``.
    """
    K, angle = cross_matrices(np.asarray(v)), float(np.linalg.norm(v))
    if angle < 1e-4:  # where the quotients below lose digits
        return np.eye(3) + 0.5 * K
    once, twice = (1.0 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return np.eye(3) + once * K + twice * K @ K
