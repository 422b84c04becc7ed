"""Derivative of the kick of two bodies' dominant contact, applied to a root of the covariance."""

import math

from ..compiler import inner
from ..physics.paper.contact_model import lens_lever
from ..spatial.layout import EP, ER, ERROR, EV, EW, P
from ..spatial.rotation import cross, rotate, rotate_back


@inner
def contact_geometry(x, R, tree, dominant, k):
    """Return the geometry of the sphere pair of dominant contact ``k``, world frame.

    Returns
    -------
    arm_i, arm_j : tuples of 3 floats
        Sphere centres from their bodies' centres of mass [m].
    D : tuple of 3 floats
        From sphere i's centre to sphere j's [m].
    r_i, r_j : float
        Radii of the spheres [m].
    """
    i, j = dominant.bodies[k]
    a, b = dominant.spheres[k]
    arm_i = rotate(R[i], tree.centers[a, 0], tree.centers[a, 1], tree.centers[a, 2])
    arm_j = rotate(R[j], tree.centers[b, 0], tree.centers[b, 1], tree.centers[b, 2])
    D = (
        x[j, P] + arm_j[0] - x[i, P] - arm_i[0],
        x[j, P + 1] + arm_j[1] - x[i, P + 1] - arm_i[1],
        x[j, P + 2] + arm_j[2] - x[i, P + 2] - arm_i[2],
    )
    return arm_i, arm_j, D, tree.radii[a], tree.radii[b]


@inner(error_model="numpy")
def contact_root(x, root, error_block, world, R, dominant, k):
    """Add to the root what the kick of dominant contact ``k`` adds, to first order in each column's error.

    With s = r_i + r_j and the volume V held, the force on body j is f = kappa V D / (d + s) (Eq. 10), at the
    point c = c_i + lever(d) D / d.
    """
    i, j = dominant.bodies[k]
    row_i, row_j = ERROR * error_block[i], ERROR * error_block[j]
    arm_i, arm_j, D, ri, rj = contact_geometry(x, R, world.tree, dominant, k)
    d = math.sqrt(D[0] * D[0] + D[1] * D[1] + D[2] * D[2])
    n = (D[0] / d, D[1] / d, D[2] / d)
    scale = world.stiffness * dominant.volume[k] / (d + ri + rj)
    f = (scale * D[0], scale * D[1], scale * D[2])
    lever, slope = lens_lever(d, ri, rj)
    point = (lever * n[0], lever * n[1], lever * n[2])
    lever_i = (arm_i[0] + point[0], arm_i[1] + point[1], arm_i[2] + point[2])
    lever_j = (arm_j[0] + point[0] - D[0], arm_j[1] + point[1] - D[1], arm_j[2] + point[2] - D[2])
    torque_i, torque_j = cross(f, lever_i), cross(lever_j, f)
    for c in range(root.shape[1]):
        dp_i, turn_i, d_arm_i = moved_by_column(root, row_i, c, R[i], arm_i)
        dp_j, turn_j, d_arm_j = moved_by_column(root, row_j, c, R[j], arm_j)
        dD = (
            dp_j[0] + d_arm_j[0] - dp_i[0] - d_arm_i[0],
            dp_j[1] + d_arm_j[1] - dp_i[1] - d_arm_i[1],
            dp_j[2] + d_arm_j[2] - dp_i[2] - d_arm_i[2],
        )
        stretch = n[0] * dD[0] + n[1] * dD[1] + n[2] * dD[2]
        shrink = stretch / (d + ri + rj)
        df = (
            scale * (dD[0] - shrink * D[0]),
            scale * (dD[1] - shrink * D[1]),
            scale * (dD[2] - shrink * D[2]),
        )
        along = slope * stretch - lever * stretch / d
        d_point = (
            lever / d * dD[0] + along * n[0],
            lever / d * dD[1] + along * n[1],
            lever / d * dD[2] + along * n[2],
        )
        if row_i >= 0:
            d_lever = (d_arm_i[0] + d_point[0], d_arm_i[1] + d_point[1], d_arm_i[2] + d_point[2])
            a, b = cross(df, lever_i), cross(f, d_lever)
            dtau = (a[0] + b[0], a[1] + b[1], a[2] + b[2])
            kick_column(root, row_i, c, (-df[0], -df[1], -df[2]), (torque_i, dtau, turn_i), world, R, i)
        if row_j >= 0:
            d_lever = (
                d_arm_j[0] + d_point[0] - dD[0],
                d_arm_j[1] + d_point[1] - dD[1],
                d_arm_j[2] + d_point[2] - dD[2],
            )
            a, b = cross(d_lever, f), cross(lever_j, df)
            dtau = (a[0] + b[0], a[1] + b[1], a[2] + b[2])
            kick_column(root, row_j, c, df, (torque_j, dtau, turn_j), world, R, j)


@inner
def moved_by_column(root, row, c, R, arm):
    """Return displacement, rotation and change of ``arm`` by column ``c`` of a body's errors, world axes."""
    if row < 0:
        zero = (0.0, 0.0, 0.0)
        return zero, zero, zero
    dp = (root[row + EP, c], root[row + EP + 1, c], root[row + EP + 2, c])
    turn = rotate(R, root[row + ER, c], root[row + ER + 1, c], root[row + ER + 2, c])
    return dp, turn, cross(turn, arm)


@inner
def kick_column(root, row, c, df, torques, world, R, body):
    """Add the change of one body's velocities by a changed force and torque, and by a turned inertia.

    ``torques`` holds the nominal torque, its change, and the body's rotation, all in world axes: with
    ``w = I_world^-1 tau`` and a rotation ``t``, ``dw = t x w + I_world^-1 (dtau - t x tau)``.
    """
    tau, dtau, turn = torques
    dt = world.dt
    a = dt * world.bodies.inverse_mass[body]
    for k in range(3):
        root[row + EV + k, c] += a * df[k]
    w = _inverse_inertia(world, R[body], body, tau)
    twist = cross(turn, tau)
    dw = _inverse_inertia(world, R[body], body, (dtau[0] - twist[0], dtau[1] - twist[1], dtau[2] - twist[2]))
    turned = cross(turn, w)
    for k in range(3):
        root[row + EW + k, c] += dt * (turned[k] + dw[k])


@inner
def _inverse_inertia(world, R, body, tau):
    """Return ``I_world^-1 tau``, the angular acceleration by a torque in world axes."""
    x, y, z = rotate_back(R, tau[0], tau[1], tau[2])
    x, y, z = rotate(world.bodies.inverse_inertia[body], x, y, z)
    return rotate(R, x, y, z)
