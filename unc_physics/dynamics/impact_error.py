"""Random errors of impact impulses, drawn anew at each impact of two partners.

They model rough surfaces, worn corners, and contacts that are not points. All contacts of two partners in one
impact share one error. It rotates their directions by a small rotation, shifts their points along the
surface, and scales friction. Errors are computed from keys of the sample, the partners, and the impact. So
they do not depend on other bodies, threads, or the division of steps into calls.
"""

import math

from ..collision.contact_row import (
    AXIS,
    COMPLIANCE,
    DIRECTION,
    FRICTION,
    INVERSE_MASS_I,
    INVERSE_MASS_J,
    MOMENT_I,
    MOMENT_J,
    SLIP_COMPLIANCE,
    TURN_I,
    TURN_J,
)
from ..collision.implicit_workspace import CONTACTS
from ..compiler import inner
from ..spatial.random import combine, two_normals
from ..spatial.rotation import rotate


@inner(forceinline=True)
def is_drawn(error):
    """Return whether impacts have random errors."""
    return error.direction > 0.0 or error.point > 0.0 or error.friction > 0.0


@inner
def disturb(step, impact, bodies, key, error, work):
    """Draw and apply the errors of the current contacts.

    Parameters
    ----------
    step, impact : int
        Number of the step, and of the group's impact in the step.
    bodies : int
        Number of bodies.
    key : uint64
        Key of the sample.
    error : ImpactError
    work : ImplicitWorkspace
    """
    for c in range(work.counts[CONTACTS]):
        i, j = work.ids[c, 0], work.ids[c, 1]
        other = j if j >= 0 else bodies - 1 - j
        own = combine(combine(combine(key, step), impact), min(i, other))
        own = combine(own, max(i, other))
        row = work.rows[c]
        x, y = two_normals(own, 0)
        z, u = two_normals(own, 1)
        v, w = two_normals(own, 2)
        f, _ = two_normals(own, 3)
        d = error.direction
        _turn(row, d * x, d * y, d * z)
        _shift(row, error.point * u, error.point * v, error.point * w, i, j, work.inverse_inertia)
        row[FRICTION] *= math.exp(error.friction * f)


@inner
def _turn(row, x, y, z):
    """Rotate a contact's three directions by a small rotation vector (world axes), and update moments.

    Each new direction is a linear combination of the old ones, and so are its moments about the centres of
    mass.
    """
    angle = math.sqrt(x * x + y * y + z * z)
    if angle == 0.0:
        return
    # components of the rotation axis along the old directions
    a = (row[DIRECTION] * x + row[DIRECTION + 1] * y + row[DIRECTION + 2] * z) / angle
    b = (row[AXIS] * x + row[AXIS + 1] * y + row[AXIS + 2] * z) / angle
    c = (row[2 * AXIS] * x + row[2 * AXIS + 1] * y + row[2 * AXIS + 2] * z) / angle
    s, t = math.sin(angle), 1.0 - math.cos(angle)
    q00, q11, q22 = 1.0 - t * (b * b + c * c), 1.0 - t * (a * a + c * c), 1.0 - t * (a * a + b * b)
    q01, q10 = t * a * b - s * c, t * a * b + s * c
    q02, q20 = t * a * c + s * b, t * a * c - s * b
    q12, q21 = t * b * c - s * a, t * b * c + s * a
    for k in range(AXIS):  # directions, moments, and the velocity changes of unit impulses
        n, f, g = row[k], row[AXIS + k], row[2 * AXIS + k]
        row[k] = q00 * n + q10 * f + q20 * g
        row[AXIS + k] = q01 * n + q11 * f + q21 * g
        row[2 * AXIS + k] = q02 * n + q12 * f + q22 * g


@inner
def _shift(row, x, y, z, i, j, inverse_inertia):
    """Shift a contact point along the surface, and update its compliances."""
    along = row[DIRECTION] * x + row[DIRECTION + 1] * y + row[DIRECTION + 2] * z
    x, y, z = x - along * row[DIRECTION], y - along * row[DIRECTION + 1], z - along * row[DIRECTION + 2]
    for d in range(3):
        k = AXIS * d
        ax, ay, az = row[DIRECTION + k], row[DIRECTION + k + 1], row[DIRECTION + k + 2]
        more = (y * az - z * ay, z * ax - x * az, x * ay - y * ax)
        own = row[INVERSE_MASS_I] + _add_moment(row, MOMENT_I + k, TURN_I + k, more, inverse_inertia[i])
        if j >= 0:
            own += row[INVERSE_MASS_J] + _add_moment(row, MOMENT_J + k, TURN_J + k, more, inverse_inertia[j])
        if d == 0:
            row[COMPLIANCE] = own
        elif d == 1:
            row[SLIP_COMPLIANCE] = own
        else:
            row[SLIP_COMPLIANCE] = max(row[SLIP_COMPLIANCE], own)


@inner
def _add_moment(row, moment, turn, more, inverse_inertia):
    """Add to a moment and its angular velocity change; return the compliance of both."""
    tx, ty, tz = rotate(inverse_inertia, more[0], more[1], more[2])
    row[moment] += more[0]
    row[moment + 1] += more[1]
    row[moment + 2] += more[2]
    row[turn] += tx
    row[turn + 1] += ty
    row[turn + 2] += tz
    return row[moment] * row[turn] + row[moment + 1] * row[turn + 1] + row[moment + 2] * row[turn + 2]
