"""Climb to the local maxima of the free distance: the largest sphere that fits around there.

The free distance at a point, ``f(x) = min(distance to the mesh, distance to the nearest placed sphere)``, is
the radius of the largest ball about it that touches nothing. It is climbed by a bundle method: each
evaluation yields the feature that is nearest there (a sphere, or a plane through the mesh's nearest point),
and each step goes to the maximum of the smallest of the features known so far, within a trust region. A step
is shorter than f, so that a path that starts inside the mesh cannot leave it. Four features determine a
point, and there the steps are Newton's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiler import kernel
from .sphere_grid import SphereGrid, insert_sphere, nearest_sphere
from .triangle_tree import TriangleTree, nearest_on_mesh

MAX_FEATURES = 10
MAX_STEPS = 40
STEP_LIMIT = 0.9  # of f
TOLERANCE = 1e-5  # of f: the increase that is not worth another step
NARROW = 0.02  # of a sphere's radius: the gap beside it that is not worth a start
UNCHANGED = 0.999  # of f: a candidate that lost less is placed as it is


class Space(NamedTuple):
    """All that bounds the free distance."""

    tree: TriangleTree
    grid: SphereGrid
    spheres: np.ndarray  # (capacity, 4): centre, radius


class Bundle(NamedTuple):
    """Work space of an ascent: features, and their linearization at the current point."""

    features: np.ndarray  # (n, 7): sphere centre or plane point, radius (-1: a plane), plane normal
    values: np.ndarray  # (n,)
    gradients: np.ndarray  # (n, 3)
    subsets: np.ndarray  # (2, 4) working set of the linear programme, and the candidate that replaces it


@kernel
def new_bundle():
    return Bundle(
        np.empty((MAX_FEATURES + 1, 7)),
        np.empty(MAX_FEATURES + 1),
        np.empty((MAX_FEATURES + 1, 3)),
        np.empty((2, 4), np.int64),
    )


@kernel
def copy(source, target, count):
    """Copy the first entries of a row (numba compiles a loop far faster than an assignment to a slice)."""
    for i in range(count):
        target[i] = source[i]


@kernel
def free_distance(space, x, y, z, feature):
    """Return f at a point, at most the grid's reach, and write the nearest feature, if there is one."""
    f, index = nearest_sphere(space.grid, space.spheres, x, y, z, -1)
    if f <= 0.0:
        return f
    d, qx, qy, qz = nearest_on_mesh(space.tree, x, y, z, f)
    if d < f:
        if d == 0.0:
            return 0.0
        feature[0], feature[1], feature[2], feature[3] = qx, qy, qz, -1.0
        feature[4], feature[5], feature[6] = (x - qx) / d, (y - qy) / d, (z - qz) / d
        return d
    if index >= 0:
        copy(space.spheres[index], feature, 4)
    return f


@kernel
def linearize(bundle, i, x, y, z):
    """Write value and gradient of feature i at a point to the bundle."""
    feature = bundle.features[i]
    dx, dy, dz = x - feature[0], y - feature[1], z - feature[2]
    if feature[3] < 0.0:
        gx, gy, gz = feature[4], feature[5], feature[6]
        bundle.values[i] = gx * dx + gy * dy + gz * dz
    else:
        d = np.sqrt(dx * dx + dy * dy + dz * dz)  # not 0: the point is outside the sphere
        gx, gy, gz = dx / d, dy / d, dz / d
        bundle.values[i] = d - feature[3]
    bundle.gradients[i, 0], bundle.gradients[i, 1], bundle.gradients[i, 2] = gx, gy, gz


@kernel
def equalized_step(bundle, subset, size, delta, step):
    """Write the step of length up to delta that keeps a subset's linearizations equal and raises them most.

    Returns their value after the step; -inf if no such step exists.
    """
    values, g = bundle.values, bundle.gradients
    a = subset[0]
    ax, ay, az = g[a, 0], g[a, 1], g[a, 2]
    if size == 1:
        step[0], step[1], step[2] = delta * ax, delta * ay, delta * az
        return values[a] + delta
    b = subset[1]
    ux, uy, uz = g[b, 0] - ax, g[b, 1] - ay, g[b, 2] - az
    p = values[a] - values[b]
    if size == 2:
        uu = ux * ux + uy * uy + uz * uz
        if uu < 1e-20:
            return -np.inf
        s = p / uu
        slack = delta * delta - s * p
        along = (ax * ux + ay * uy + az * uz) / uu
        nx, ny, nz = ax - along * ux, ay - along * uy, az - along * uz
        norm = nx * nx + ny * ny + nz * nz
        if slack < 0.0:
            return -np.inf
        h = np.sqrt(slack / norm) if norm > 1e-20 else 0.0
        step[0], step[1], step[2] = s * ux + h * nx, s * uy + h * ny, s * uz + h * nz
        return values[a] + ax * step[0] + ay * step[1] + az * step[2]
    c = subset[2]
    vx, vy, vz = g[c, 0] - ax, g[c, 1] - ay, g[c, 2] - az
    q = values[a] - values[c]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    if size == 3:
        norm = nx * nx + ny * ny + nz * nz
        if norm < 1e-20:
            return -np.inf
        sx = (p * (vy * nz - vz * ny) + q * (ny * uz - nz * uy)) / norm
        sy = (p * (vz * nx - vx * nz) + q * (nz * ux - nx * uz)) / norm
        sz = (p * (vx * ny - vy * nx) + q * (nx * uy - ny * ux)) / norm
        slack = delta * delta - sx * sx - sy * sy - sz * sz
        if slack < 0.0:
            return -np.inf
        rise = ax * nx + ay * ny + az * nz
        h = np.sqrt(slack / norm)
        if rise * rise < 1e-20 * norm:  # neither way rises: stay as near as possible
            h = 0.0
        elif rise < 0.0:
            h = -h
        step[0], step[1], step[2] = sx + h * nx, sy + h * ny, sz + h * nz
        return values[a] + ax * step[0] + ay * step[1] + az * step[2]
    d = subset[3]
    wx, wy, wz = g[d, 0] - ax, g[d, 1] - ay, g[d, 2] - az
    r = values[a] - values[d]
    det = nx * wx + ny * wy + nz * wz
    if abs(det) < 1e-12:
        return -np.inf
    step[0] = (p * (vy * wz - vz * wy) + q * (wy * uz - wz * uy) + r * nx) / det
    step[1] = (p * (vz * wx - vx * wz) + q * (wz * ux - wx * uz) + r * ny) / det
    step[2] = (p * (vx * wy - vy * wx) + q * (wx * uy - wy * ux) + r * nz) / det
    if step[0] * step[0] + step[1] * step[1] + step[2] * step[2] > delta * delta:
        return -np.inf
    return values[a] + ax * step[0] + ay * step[1] + az * step[2]


@kernel
def extreme(values, count, sign):
    """Return the index of the largest (sign 1) or smallest (sign -1) of the first ``count`` values."""
    best = 0
    for i in range(1, count):
        if sign * values[i] > sign * values[best]:
            best = i
    return best


@kernel
def value_after(bundle, i, step):
    """Return the linearization of feature i after a step."""
    g = bundle.gradients
    return bundle.values[i] + g[i, 0] * step[0] + g[i, 1] * step[1] + g[i, 2] * step[2]


@kernel
def best_step(bundle, count, delta, step):
    """Write the step of length up to delta that maximizes the smallest linearization; return that value.

    A working set of at most four features is exchanged, one violated feature at a time, until none is
    violated.
    """
    working, trial = bundle.subsets[0], bundle.subsets[1]
    trial_step = np.empty(3)
    epsilon = 1e-13 * delta
    size = 1
    working[0] = extreme(bundle.values, count, -1.0)
    t = equalized_step(bundle, working, 1, delta, step)
    for _ in range(3 * MAX_FEATURES):
        violated, lowest = -1, t - epsilon
        for i in range(count):
            value = value_after(bundle, i, step)
            if value < lowest:
                violated, lowest = i, value
        if violated < 0:
            return t
        best, best_mask = -np.inf, 0
        for mask in range(1 << size):
            trial[0] = violated
            trial_size = 1
            for k in range(size):
                if mask >> k & 1:
                    if trial_size < 4:
                        trial[trial_size] = working[k]
                    trial_size += 1
            if trial_size > 4:
                continue
            value = equalized_step(bundle, trial, trial_size, delta, trial_step)
            if value <= best:
                continue
            feasible = True
            for k in range(size):
                if not mask >> k & 1 and value_after(bundle, working[k], trial_step) < value - epsilon:
                    feasible = False
                    break
            if feasible:
                best, best_mask = value, mask
                copy(trial_step, step, 3)
        if best == -np.inf:
            break
        t = best
        trial_size = 0
        for k in range(size):
            if best_mask >> k & 1:
                working[trial_size] = working[k]
                trial_size += 1
        working[trial_size] = violated
        size = trial_size + 1
    t = np.inf  # no end to the exchange, for round-off: the step is as good as it is
    for i in range(count):
        t = min(t, value_after(bundle, i, step))
    return t


@kernel
def updated_bundle(bundle, count, feature, f, x, y, z):
    """Move the bundle to a new point: drop features that no longer bound f, and add one.

    Where the mesh bends towards the point, a plane may be closer than f. Its foot on the mesh, a sphere of
    radius 0, never is. A plane that is closer than f is therefore added as its foot. Returns the number of
    features.
    """
    least = f * (1.0 - 1e-9)
    kept = 0
    for i in range(count):
        if kept != i:
            copy(bundle.features[i], bundle.features[kept], 7)
        linearize(bundle, kept, x, y, z)
        if bundle.values[kept] >= least:
            kept += 1
    if kept == MAX_FEATURES:
        slackest = extreme(bundle.values, kept, 1.0)
        kept -= 1
        copy(bundle.features[kept], bundle.features[slackest], 7)
        linearize(bundle, slackest, x, y, z)
    copy(feature, bundle.features[kept], 7)
    linearize(bundle, kept, x, y, z)
    if bundle.values[kept] < least and feature[3] < 0.0:
        bundle.features[kept, 3] = 0.0
        linearize(bundle, kept, x, y, z)
    for i in range(kept):  # a known feature is not added again
        if (
            abs(bundle.values[i] - bundle.values[kept]) < 1e-9 * f
            and abs(bundle.gradients[i, 0] - bundle.gradients[kept, 0]) < 1e-6
            and abs(bundle.gradients[i, 1] - bundle.gradients[kept, 1]) < 1e-6
            and abs(bundle.gradients[i, 2] - bundle.gradients[kept, 2]) < 1e-6
        ):
            return kept
    return kept + 1


@kernel(noinline=True)
def climb(space, point, bundle):
    """Move a point to the local maximum of f around it, and return f there.

    Returns 0, and leaves the point where it is, if f is not positive at the start.
    """
    trial = np.empty(7)
    step = np.empty(3)
    x, y, z = point[0], point[1], point[2]
    f = free_distance(space, x, y, z, trial)
    if f <= 0.0 or f >= space.grid.reach:
        return max(f, 0.0)
    delta = STEP_LIMIT * f
    copy(trial, bundle.features[0], 7)
    linearize(bundle, 0, x, y, z)
    count = 1
    for _ in range(MAX_STEPS):
        target = best_step(bundle, count, delta, step)
        if target - f < TOLERANCE * f:
            break
        xt, yt, zt = x + step[0], y + step[1], z + step[2]
        ft = free_distance(space, xt, yt, zt, trial)
        if ft >= space.grid.reach:
            x, y, z, f = xt, yt, zt, ft
            break
        if ft > f:
            delta = STEP_LIMIT * ft if ft - f > 0.5 * (target - f) else min(delta, STEP_LIMIT * ft)
            x, y, z, f = xt, yt, zt, ft
        else:
            delta = 0.5 * min(delta, np.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2))
        count = updated_bundle(bundle, count, trial, f, x, y, z)
        if count == 0:
            break
    point[0], point[1], point[2] = x, y, z
    return f


@kernel
def climb_all(space, points):
    """Climb from each point, in place; return f (n,) at each, 0 for a point that is not free."""
    bundle = new_bundle()
    out = np.empty(len(points))
    for i in range(len(points)):
        out[i] = climb(space, points[i], bundle)
    return out


@kernel
def touching_ball(space, point, inward, radius, feature):
    """Return the radius of the largest free ball that touches the mesh from inside at a point of its surface.

    It is at most ``radius``. The ball shrinks until it only touches the feature that is nearest to its
    centre; the result is 0 if it vanishes.
    """
    for _ in range(MAX_STEPS):
        x = point[0] + radius * inward[0]
        y = point[1] + radius * inward[1]
        z = point[2] + radius * inward[2]
        feature[3] = 0.0
        f = free_distance(space, x, y, z, feature)
        if f >= radius * (1.0 - 1e-6):
            return radius
        if f <= 0.0:  # inside a sphere, which may be unnamed, or on the mesh
            radius *= 0.5
            continue
        size = max(feature[3], 0.0)
        dx, dy, dz = point[0] - feature[0], point[1] - feature[1], point[2] - feature[2]
        gap = dx * dx + dy * dy + dz * dz - size * size
        height = size - dx * inward[0] - dy * inward[1] - dz * inward[2]
        if gap <= 0.0 or height <= 0.0:
            return 0.0
        radius = min(0.999 * radius, 0.5 * gap / height)
    return 0.0


@kernel
def starts_at_surface(space, points, inward, radius):
    """Return the centres (m, 3) of touching balls at points of the mesh's surface, without vanished ones."""
    feature = np.empty(7)
    centers = np.empty_like(points)
    count = 0
    for i in range(len(points)):
        r = touching_ball(space, points[i], inward[i], radius, feature)
        if r > 0.0:
            for k in range(3):
                centers[count, k] = points[i, k] + r * inward[i, k]
            count += 1
    return centers[:count]


@kernel
def starts_around(space, placed, directions):
    """Return points (m, 3) around spheres, each half-way across the gap to the next sphere or to the mesh.

    ``placed`` are indices of the spheres.
    """
    centers = np.empty((len(placed) * len(directions), 3))
    count = 0
    for index in placed:
        cx, cy, cz = space.spheres[index, 0], space.spheres[index, 1], space.spheres[index, 2]
        r = space.spheres[index, 3]
        for k in range(len(directions)):
            ux, uy, uz = directions[k, 0], directions[k, 1], directions[k, 2]
            x, y, z = cx + r * ux, cy + r * uy, cz + r * uz
            gap, _ = nearest_sphere(space.grid, space.spheres, x, y, z, index)
            if gap > NARROW * r:
                gap = nearest_on_mesh(space.tree, x, y, z, gap)[0]
            if gap > NARROW * r:
                h = 0.5 * gap
                centers[count, 0], centers[count, 1], centers[count, 2] = x + h * ux, y + h * uy, z + h * uz
                count += 1
    return centers[:count]


@kernel
def place(space, points, values, count):
    """Place spheres at candidates, in the order given, where f is still what it was; the grid is updated.

    ``values`` become f now, 0 where a sphere was placed.

    Returns
    -------
    count : int
        Number of spheres then.
    done : int
        Number of candidates dealt with; fewer than all when there was no room for another sphere.
    """
    feature = np.empty(7)
    for i in range(len(points)):
        if count == len(space.spheres):
            return count, i
        f = free_distance(space, points[i, 0], points[i, 1], points[i, 2], feature)
        if f >= UNCHANGED * values[i]:
            copy(points[i], space.spheres[count], 3)
            space.spheres[count, 3] = f
            if not insert_sphere(space.grid, space.spheres, count):
                return count, i
            count += 1
            values[i] = 0.0
        else:
            values[i] = max(f, 0.0)
    return count, len(points)
