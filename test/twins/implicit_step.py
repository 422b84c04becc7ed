"""Twin of the implicit step's stages: brute force over all spheres, dense matrices, general solvers.

A state is (B, 13); velocities of all bodies are one vector (6 B,), a linear and an angular one for each body.
Fixed bodies have no inverse mass.
"""

from functools import cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, least_squares
from scipy.spatial.transform import Rotation
from unc_physics.collision.hull import hull_spheres

from unc_physics import Box
from unc_physics.scene.body import shape_of

from .states import P, Q, V, W

#: Gaps up to which contacts take part in a step, take part in an impact, and touch, and the gap at which an
#: impact is aimed [m].
ACTIVE, IMPACT, TOUCHING, AIM = 5e-4, 2e-4, 2e-5, 1e-5
#: Cosine of the angle between normals of one patch; the tilt that finds its supports, at least and at most
#: [rad].
SAME_PATCH, TILT, MOST_TILT = 0.9, 0.02, 0.5
#: A contact that carried load counts as deeper by this [m], and by this share of the body's radius at most,
#: unless the body's points turn farther than the last one in a step [m].
BONUS, BONUS_SHARE, TURNING, ROLLED = 2e-5, 0.01, 2e-3, 1e-4
#: Of a packing's radius: distance from a face up to which spheres touch it, and the least width of a face.
FACE_TOLERANCE, FACE_WIDTH = 1e-5, 0.05
#: Least cosine of the angle between the normals of two spheres and of a face that stands for one of them.
OVER_FACE = 0.5
#: How much nearer a face may be than the spheres themselves [m], so that no contact begins deeper.
HOLLOW = 1.5e-4
#: The same of a solid face that slides on another.
SLIDING = 5e-4
#: SMOOTHING: height over which the least height of a rolling body's spheres is smoothed. CUT: how many such
#: heights count. AXIAL: by how much spheres that are one radius away along the axis count as higher. WIDTH:
#: how far others may be from the lowest one across the axis. All are relative to the body's radius. TURNED:
#: least turn in a step at which contacts push in its middle [rad]. FARTHEST: longest way from the support to
#: the push, in units of that of the body's surface.
SMOOTHING, CUT, AXIAL, WIDTH, TURNED, FARTHEST = 4e-3, 5.0, 0.05, 0.2, 1e-3, 5.0
#: Overlap that contacts always push out [m], and the speed at which they push out unexplained overlap [m/s].
SLACK, RECOVERY = 2e-5, 0.05
#: FACING: least cosine of the angle between faces that carry each other. DEEPEST: their largest depth,
#: relative to the smaller radius. NEAR_EDGE: distance outside an outline that counts as inside [m].
FACING, DEEPEST, NEAR_EDGE = 0.95, 0.1, 1e-6
#: Depth of a resting face at an edge that it passes [m].
LEVEL = 1e-4
#: Added to the sphere of the partner for each kind of contact of outlines.
KINDS = 10**6
#: ROLL_DEPTH: least depth at which a cylinder's contact is as wide as the part of a patch that rolls together
#: [m]. ROLL_SHARE: limit of that depth. BESIDE: distance along the axis within which contacts share their
#: places. Both are relative to the radius. LEAST_COMPLIANCE: least compliance of a moved contact, relative to
#: the inverse mass.
ROLL_DEPTH, ROLL_SHARE, LEAST_COMPLIANCE, BESIDE = 2e-4, 0.01, 0.7, 0.1
#: Restitution from which on impacts act in sequence, and their slowest closing speed [m/s].
LIVELY, LIVELY_SPEED = 0.7, 1e-3
#: Way that an edge which lands closes in a step, above which it has an impact [m].
LANDING = 8e-5


class Contact(NamedTuple):
    """Spheres ``a`` of body ``i`` and ``b`` of body ``j``, or element ``-1 - j``; world frame.

    ``point`` is on the first sphere's surface, ``normal`` points towards its body, ``predicted`` is the gap
    after the horizon. ``center_i`` and ``center_j`` are centres of spheres that touch at this contact: the
    spheres themselves or, at a flat face, one inside the face. ``on_face`` marks contacts with a face.
    """

    i: int
    j: int
    a: int
    b: int
    normal: np.ndarray
    point: np.ndarray
    gap: float
    predicted: float
    center_i: np.ndarray
    center_j: np.ndarray
    radius: float
    on_face: bool = False

    def is_within(self, limit):
        """Whether it is nearer than a limit [m], now or after the horizon."""
        return min(self.gap, self.predicted) < limit


class Face(NamedTuple):
    """A flat face: its outward normal in the body frame, the numbers of the spheres that touch it, and of
    those at the corners of its outline, if it is solid.
    """

    normal: np.ndarray
    touching: np.ndarray
    outline: np.ndarray = np.zeros(0, int)


@cache
def faces_in_use(model):
    """Return the flat faces that the package found, which `flat_faces` checks."""
    found = shape_of(model).faces
    return [
        Face(n, np.flatnonzero((found.of_sphere == k).any(axis=1)), found.outline[k, : found.corners[k]])
        for k, n in enumerate(found.normal)
    ]


def flat_faces(model):
    """Return the flat faces of a packing: the planes that touch three spheres of its hull from outside, and
    at least a fourth.
    """
    centers, radii = np.array(model.centers), np.array(model.radii)
    size = (np.linalg.norm(centers, axis=1) + radii).max()
    directions = np.random.default_rng(0).normal(size=(20000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    corners = np.unique((directions @ centers.T + radii).argmax(axis=1))
    if len(corners) < 3:
        return []
    triples = corners[np.array(list(combinations(range(len(corners)), 3)))]
    first, second = (centers[triples[:, k]] - centers[triples[:, 0]] for k in (1, 2))
    across = np.cross(first, second)
    area = np.linalg.norm(across, axis=1)
    kept = area > 1e-3 * size**2
    first, second, across, triples = first[kept], second[kept], across[kept], triples[kept]
    across /= area[kept, None]
    rises = radii[triples[:, :1]] - radii[triples[:, 1:]]  # normal . first and normal . second
    gram = np.array([[np.sum(u * v, axis=1) for u in (first, second)] for v in (first, second)])
    shares = np.linalg.solve(gram.transpose(2, 0, 1), rises[:, :, None])[:, :, 0]
    inside = shares[:, :1] * first + shares[:, 1:] * second
    square = 1.0 - np.sum(inside**2, axis=1)
    planes = []
    for sign in (1.0, -1.0):
        normals = inside + sign * np.sqrt(np.maximum(square, 0.0))[:, None] * across
        top = np.sum(normals * centers[triples[:, 0]], axis=1) + radii[triples[:, 0]]
        beyond = (normals @ centers[corners].T + radii[corners]).max(axis=1) - top
        planes.append(normals[(square > 0.0) & (beyond < FACE_TOLERANCE * size)])
    normals, faces = np.concatenate(planes), []
    touch = [_touching(n, centers, radii, size) for n in normals]
    for k in sorted(range(len(normals)), key=lambda k: -len(touch[k])):
        touching = touch[k]
        if len(touching) < 4 or any(normals[k] @ face.normal > 1.0 - 1e-6 for face in faces):
            continue
        points = centers[touching] - centers[touching].mean(axis=0)
        if np.linalg.svd(points, compute_uv=False)[1] < FACE_WIDTH * size * np.sqrt(len(points)):
            continue
        faces.append(Face(_fitted(normals[k], centers[touching], radii[touching]), touching))
    return faces


def _touching(normal, centers, radii, size):
    tops = centers @ normal + radii
    return np.flatnonzero(tops >= tops.max() - FACE_TOLERANCE * size)


def _fitted(normal, centers, radii):
    """Return the normal of the plane that is nearest to touching all spheres, by least squares."""

    def misses(y):
        return centers @ (y[:3] / np.linalg.norm(y[:3])) + radii - y[3]

    start = np.append(normal, (centers @ normal + radii).mean())
    found = least_squares(misses, start, xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale=0.01).x[:3]
    return found / np.linalg.norm(found)


def is_over(face, points, centers):
    """Return whether points (n, 3) are over a face, in the body frame: inside the 16 sides around the places
    where spheres touch it.
    """
    first, second = frame(face.normal)
    angles = 2.0 * np.pi / 16.0 * np.arange(16)[:, None]
    sides = np.cos(angles) * first + np.sin(angles) * second
    return (points @ sides.T <= (centers[face.touching] @ sides.T).max(axis=0)).all(axis=1)


def centers(body, s):
    return s[P] + body.model.centers @ Rotation.from_quat(s[Q]).as_matrix().T


def _speed_at(s, points, gravity, horizon, fixed=False):
    """Mean velocity over the horizon of a body's points in free fall."""
    return s[V] + (0.0 if fixed else 0.5 * horizon) * np.asarray(gravity) + np.cross(s[W], points - s[P])


def candidates(scene, x, i, j, horizon, limit=None):
    """Return all contacts of body i with body j, or element ``-1 - j``, whose spheres are nearer than a limit
    [m], now or within ``horizon`` seconds. The limit is an impact's without a horizon, or a step's.
    """
    if limit is None:
        limit = ACTIVE if horizon > 0.0 else IMPACT
    ci, ri = centers(scene.bodies[i], x[i]), scene.bodies[i].model.radii
    vi = _speed_at(x[i], ci, scene.gravity, horizon)
    found = []
    if j < 0:
        distances, normals = scene.environment[-1 - j].surface(ci)
        for a, (distance, n) in enumerate(zip(distances, normals, strict=True)):
            gap = distance - ri[a]
            predicted = gap + horizon * n @ vi[a]
            if min(gap, predicted) < limit and not passes_edge(scene, x[i], i, a, j, n, horizon * vi[a]):
                found.append(Contact(i, j, a, 0, n, ci[a] - ri[a] * n, gap, predicted, ci[a], None, ri[a]))
        return found + outline_contacts(scene, x, i, j, horizon, limit)
    cj, rj = centers(scene.bodies[j], x[j]), scene.bodies[j].model.radii
    vj = _speed_at(x[j], cj, scene.gravity, horizon, scene.bodies[j].fixed)
    away = ci[:, None] - cj[None]
    distance = np.linalg.norm(away, axis=2)
    normal = away / distance[..., None]
    gaps = distance - ri[:, None] - rj
    predictions = gaps + horizon * np.sum(normal * (vi[:, None] - vj), axis=2)
    pairs = np.argwhere(np.minimum(gaps, predictions) < limit)
    own = [Own(normal[a, b], ci[a], gaps[a, b]) for a, b in pairs]
    for (a, b), contact in zip(pairs, best_contacts(scene, x, (i, j), pairs, (ci, cj), own), strict=True):
        n, center, gap, on_face = contact
        point = center - ri[a] * n
        inner = point - (gap + rj[b]) * n
        speeds = [
            _speed_at(x[k], at, scene.gravity, horizon, scene.bodies[k].fixed)
            for k, at in ((i, center), (j, inner))
        ]
        found.append(
            Contact(
                *(i, j, int(a), int(b), n, point, gap, gap + horizon * n @ (speeds[0] - speeds[1])),
                *(center, inner, ri[a] * rj[b] / (ri[a] + rj[b]), on_face),
            )
        )
    found += outline_contacts(scene, x, i, j, horizon, limit)
    return found + [
        c
        for c in contacts_on_faces(scene, x, i, j, horizon, limit)
        if not any(_is_same(c, other) for other in found)
    ]


def _is_same(contact, other):
    """Whether another contact is of the same sphere, with the same face."""
    sphere = contact.a == other.a if contact.b < 2 * KINDS else contact.b % KINDS == other.b
    same_gap = abs(contact.gap - other.gap) < 1e-9
    return sphere and same_gap and contact.normal @ other.normal > 1.0 - 1e-9


class Outline(NamedTuple):
    """Corners (n, 3) of a solid face or of a box's side, counter-clockwise as seen from outside, the numbers
    of their spheres, and the outward normal; world frame.
    """

    normal: np.ndarray
    corners: np.ndarray
    spheres: np.ndarray


def outlines_of(scene, x, k):
    """Return the outlines of body k, or of element ``-1 - k``."""
    if k >= 0:
        model, R = scene.bodies[k].model, Rotation.from_quat(x[k, Q]).as_matrix()
        return [
            Outline(
                R @ face.normal,
                x[k, P] + (model.centers[face.outline] + model.radii[face.outline, None] * face.normal) @ R.T,
                face.outline,
            )
            for face in faces_in_use(model)
            if len(face.outline)
        ]
    element, out = scene.environment[-1 - k], []
    for axis in range(3) if isinstance(element, Box) else ():
        for sign in (1.0, -1.0):
            signs = np.zeros((4, 3))
            signs[:, axis] = sign
            signs[:, (axis + 1) % 3] = 1.0, -1.0, -1.0, 1.0
            signs[:, (axis + 2) % 3] = sign, sign, -sign, -sign
            corners = element.position + 0.5 * np.array(element.size) * signs @ element.rotation.T
            out.append(Outline(sign * element.rotation[:, axis], corners, np.arange(4)))
    return out


def passes_edge(scene, state, i, a, j, n, way):
    """Return whether sphere a of body i touches an edge of box ``-1 - j`` that its solid face passes.

    The face is not below the box's side, now or after a way [m], but for the depth at rest and the free fall
    of a step.
    """
    element, faces = scene.environment[-1 - j], shape_of(scene.bodies[i].model).faces
    if not isinstance(element, Box):
        return False
    axes = element.rotation
    turn = Rotation.from_quat(state[Q]).as_matrix()
    if np.abs(n @ axes).max() > 1.0 - 1e-12:
        return False
    center, r = centers(scene.bodies[i], state)[a], scene.bodies[i].model.radii[a]
    level = LEVEL + scene.dt**2 * np.linalg.norm(scene.gravity)
    for f in faces.of_sphere[a]:
        if f < 0 or faces.corners[f] == 0:
            continue
        normal = turn @ faces.normal[f]
        for axis, half in zip(axes.T, 0.5 * np.asarray(element.size), strict=True):
            side = np.sign(n @ axis) * axis
            if normal @ side < -FACING:
                height = side @ (center + r * normal - element.position) - half
                if min(height, height + side @ way) > -level:
                    return True
    return False


def outline_contacts(scene, x, i, j, horizon, limit):
    """Return contacts where outlines of body i and of body j, or element ``-1 - j``, overlap.

    These are the corners of one over the other, and the crossings of their edges. Corners of body i on an
    element are left out, as they are spheres. Only the faces that separate best count.
    """
    best, deepest = [], _deepest(scene, i, j)
    for own in outlines_of(scene, x, i):
        for other in outlines_of(scene, x, j):
            if own.normal @ other.normal > -FACING:
                continue
            places = _overlap_places(scene, x, i, j, own, other)
            lowest = min((gap for _, _, gap, *_ in places), default=-np.inf)
            if lowest >= deepest:
                best, deepest = places, lowest
    return [
        contact for place in best if (contact := _contact_at(scene, x, i, j, place, horizon)).is_within(limit)
    ]


def contacts_on_faces(scene, x, i, j, horizon, limit):
    """Return contacts of spheres of one body over solid faces of the other.

    Faces below its centre count that none of the other body's solid faces are opposite to.
    """
    out = []
    for of, on in ((i, j), (j, i)):
        body, facing = scene.bodies[of], outlines_of(scene, x, of)
        c, radii = centers(body, x[of]), body.model.radii
        for face in outlines_of(scene, x, on):
            height = face.normal @ (x[of, P] - face.corners[0])
            if height <= 0.0 or any(own.normal @ face.normal < -FACING for own in facing):
                continue
            across = np.column_stack(frame(face.normal))
            for s in hull_spheres(body.model.centers, radii):
                gap = face.normal @ (c[s] - face.corners[0]) - radii[s]
                if gap < _deepest(scene, i, j) or not _is_in(c[s] @ across, face.corners @ across):
                    continue
                at = c[s] - radii[s] * face.normal
                if of == i:
                    place = face.normal, at, gap, s, KINDS + face.spheres[0]
                else:
                    place = -face.normal, at - gap * face.normal, gap, face.spheres[0], 2 * KINDS + s
                if (contact := _contact_at(scene, x, i, j, place, horizon)).is_within(limit):
                    out.append(contact)
    return out


def _deepest(scene, i, j):
    return -DEEPEST * min(scene.bodies[k].model.bounding_radius for k in (i, j) if k >= 0)


def _contact_at(scene, x, i, j, place, horizon):
    """Return the contact at (normal, place on body i, gap, a, b)."""
    normal, at, gap, a, b = place
    speeds = [_speed_at(x[i], at, scene.gravity, horizon)]
    if j >= 0:
        speeds.append(_speed_at(x[j], at, scene.gravity, horizon, scene.bodies[j].fixed))
    predicted = gap + horizon * normal @ (speeds[0] - (speeds[1] if j >= 0 else 0.0))
    r, inner = scene.bodies[i].model.radii[a], None
    center = at + r * normal
    if j >= 0:
        other = scene.bodies[j].model.radii[b % KINDS]
        inner, r = at - (gap + other) * normal, r * other / (r + other)
    return Contact(i, j, int(a), int(b), normal, at, gap, predicted, center, inner, r, True)


def _overlap_places(scene, x, i, j, own, other):
    """Return (normal, place on body i, gap, a, b) of the corners and crossings of two outlines."""
    first, second = frame(other.normal)
    flat = [outline.corners @ np.column_stack([first, second]) for outline in (own, other)]
    out = []
    for k, corner in enumerate(own.corners if j >= 0 else ()):
        if _is_in(flat[0][k], flat[1]):
            r, a = scene.bodies[i].model.radii[own.spheres[k]], own.spheres[k]
            at = corner - r * own.normal - r * other.normal
            out.append(
                (other.normal, at, other.normal @ (at - other.corners[0]), a, KINDS + other.spheres[0])
            )
    for k, corner in enumerate(other.corners):
        if _is_in(flat[1][k], flat[0]):
            gap = own.normal @ (corner - own.corners[0])
            b = 2 * KINDS + other.spheres[k] if j >= 0 else 1 + k
            out.append((-own.normal, corner - gap * own.normal, gap, own.spheres[0], b))
    for k, corner in enumerate(own.corners):
        along = np.roll(own.corners, -1, axis=0)[k] - corner
        for m, start in enumerate(other.corners):
            beside = np.roll(other.corners, -1, axis=0)[m] - start
            # where a line across the partner's face meets both edges
            s, t, _ = np.linalg.solve(np.column_stack([along, -beside, other.normal]), start - corner)
            if min(s, t) < 0.0 or max(s, t) > 1.0:
                continue
            n = np.cross(along, beside)
            n *= np.sign(n @ other.normal) / np.linalg.norm(n)
            if min(n @ other.normal, -n @ own.normal) < -own.normal @ other.normal - 1e-9:
                n = other.normal
            at = corner + s * along
            b = 3 * KINDS + other.spheres[m] if j >= 0 else 5 + m
            out.append((n, at, n @ (at - start - t * beside), own.spheres[k], b))
    return out


def _is_in(point, corners):
    """Return whether a point is in a convex polygon, or hardly outside."""
    if len(corners) < 3:
        return False
    sides = np.roll(corners, -1, axis=0) - corners
    sides /= np.linalg.norm(sides, axis=1)[:, None]
    away = sides[:, 0] * (point - corners)[:, 1] - sides[:, 1] * (point - corners)[:, 0]
    return (away >= -NEAR_EDGE).all() or (away <= NEAR_EDGE).all()


class Own(NamedTuple):
    """The contact of two spheres, of which the first has its centre at ``center``, by themselves or by a face
    that stands for one of them.
    """

    normal: np.ndarray
    center: np.ndarray
    gap: float
    on_face: bool = False


def best_contacts(scene, x, bodies, pairs, places, own):
    """Return the contacts of pairs of spheres, which have ``own`` ones.

    A face stands for a sphere that touches it if the other sphere is over it. If the body is not solid, that
    is no farther beside the first than twice the smaller radius. Of several faces, the one that separates the
    spheres best counts, unless it is much nearer than the spheres are, by more if both touch solid faces that
    face each other.
    """
    found = [[] for _ in pairs]
    for near, far, sign in ((1, 0, 1.0), (0, 1, -1.0)):  # the sphere that touches a face, and the other
        s, model = x[bodies[near]], scene.bodies[bodies[near]].model
        R, radii = Rotation.from_quat(s[Q]).as_matrix(), [scene.bodies[k].model.radii for k in bodies]
        other = scene.bodies[bodies[far]].model
        R_other = Rotation.from_quat(x[bodies[far], Q]).as_matrix()
        for face in faces_in_use(model) if len(pairs) else ():
            n, over = R @ face.normal, is_over(face, (places[far] - s[P]) @ R, model.centers)
            solid = len(face.outline) > 0
            opposite = {
                int(sphere)
                for g in faces_in_use(other)
                if solid and len(g.outline) > 0 and n @ R_other @ g.normal < -FACING
                for sphere in g.touching
            }
            for k, pair in enumerate(pairs):
                away = places[far][pair[far]] - places[near][pair[near]]
                beside = np.linalg.norm(away - (n @ away) * n)
                slides = int(pair[far]) in opposite
                aligned = sign * n @ own[k].normal > OVER_FACE
                aligned &= solid or beside < 2.0 * min(radii[0][pair[0]], radii[1][pair[1]])
                if pair[near] in face.touching and over[pair[far]] and aligned:
                    reach = radii[0][pair[0]] + radii[1][pair[1]]
                    height = n @ away - reach
                    opposite_center = places[1][pair[1]] - (reach + height) * n
                    center = opposite_center if far == 1 else places[0][pair[0]]
                    found[k].append((Own(sign * n, center, height, True), slides))
    best = [max(faces, key=lambda face: face[0].gap, default=None) for faces in found]
    return [
        contact if face is None or face[0].gap < contact.gap - (SLIDING if face[1] else HOLLOW) else face[0]
        for face, contact in zip(best, own, strict=True)
    ]


def patches(found, score):
    """Return lists of contacts with similar normals: each around its deepest contact, which is the first, by
    ``score``, gaps by spheres.
    """
    left, out = list(found), []
    while left:
        deepest = min(left, key=lambda c: score[c.a, c.b])
        near = [c.normal @ deepest.normal >= SAME_PATCH for c in left]
        out.append([deepest, *(c for c, same in zip(left, near, strict=True) if same and c is not deepest)])
        left = [c for c, same in zip(left, near, strict=True) if not same]
    return out


def patch_tilt(x, i, j, turned):
    """Return the tilt that finds a patch's supports [rad], of bodies that turned freely for some time [s]."""
    spin = np.linalg.norm(x[i, W] - (x[j, W] if j >= 0 else 0.0))
    return min(max(TILT, turned * spin), MOST_TILT)


def reduced(found, s, loaded=(), bonus=0.0, tilt=TILT):
    """Return those that stand for all: of each patch the deepest, and the deepest when it is tilted in eight
    directions.

    ``s`` is body i's state; ``loaded`` has pairs of spheres that carried load in the last step, which count
    as deeper by ``bonus`` [m].
    """
    R = Rotation.from_quat(s[Q]).as_matrix()
    score = {(c.a, c.b): c.predicted - (bonus if (c.a, c.b) in loaded else 0.0) for c in found}
    kept = set()
    for patch in patches(found, score):
        deepest = patch[0]
        kept.add((deepest.a, deepest.b))
        first, second = frame(R.T @ deepest.normal)
        ordered = sorted(patch, key=lambda c: (c.a, c.b))
        for angle in 0.25 * np.pi * np.arange(8):
            slope = tilt * (np.cos(angle) * first + np.sin(angle) * second)
            lowest = min(ordered, key=lambda c: score[c.a, c.b] + slope @ (R.T @ (c.point - s[P])))
            kept.add((lowest.a, lowest.b))
    return kept


def lasting_limit(scene, h):
    """Return the gap up to which contacts take part in an interval [m]: an impact's, or by how much holding a
    body against gravity changes its place.
    """
    return max(IMPACT, h * h * np.linalg.norm(scene.gravity))


def loaded_bonus(scene, x, i, j):
    """Return by how much contacts of body i with body j that carried load count as deeper [m]."""
    radius = scene.bodies[i].model.bounding_radius
    spin = np.linalg.norm(x[i, W] - (x[j, W] if j >= 0 else 0.0))
    return 0.0 if radius * spin > TURNING else min(BONUS, BONUS_SHARE * radius)


def frame(n):
    """Two unit vectors across ``n``, continuous but at one pole (Duff et al. 2017)."""
    sign = 1.0 if n[2] >= 0.0 else -1.0
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    return np.array([1.0 + sign * n[0] ** 2 * a, sign * b, -sign * n[0]]), np.array(
        [b, sign + n[1] ** 2 * a, -n[1]]
    )


def inverse_mass(scene, x):
    """(6 B, 6 B)"""
    out = np.zeros((6 * len(x), 6 * len(x)))
    for k in scene.moving:
        body, R = scene.bodies[k], Rotation.from_quat(x[k, Q]).as_matrix()
        out[6 * k : 6 * k + 3, 6 * k : 6 * k + 3] = np.eye(3) / body.mass
        out[6 * k + 3 : 6 * k + 6, 6 * k + 3 : 6 * k + 6] = (
            R @ np.linalg.inv(body.mass * body.model.inertia) @ R.T
        )
    return out


def velocities(x):
    """(6 B,)"""
    return np.concatenate([x[:, V], x[:, W]], axis=1).ravel()


def middle_of(c):
    """Return a contact's place [m]: the middle of its gap or, in an element, the sphere's surface."""
    gap = c.gap if c.j >= 0 else max(c.gap, 0.0)
    return c.point - 0.5 * gap * c.normal


def jacobian(contacts, x):
    """(3 m, 6 B): velocities along each contact's normal and two directions across, at its place."""
    J = np.zeros((3 * len(contacts), 6 * len(x)))
    for k, c in enumerate(contacts):
        middle = middle_of(c)
        for d, axis in enumerate((c.normal, *frame(c.normal))):
            for body, sign in ((c.i, 1.0), (c.j, -1.0)):
                if body >= 0:
                    J[3 * k + d, 6 * body : 6 * body + 3] = sign * axis
                    J[3 * k + d, 6 * body + 3 : 6 * body + 6] = sign * np.cross(middle - x[body, P], axis)
    return J


def fall(scene, c, x):
    """Return the second derivative of a gap in free fall [m/s^2]: that of spheres whose centres go round, and
    gravity where it does not pull at both.
    """
    total = c.normal @ np.cross(x[c.i, W], np.cross(x[c.i, W], c.center_i - x[c.i, P]))
    if c.j >= 0:
        total -= c.normal @ np.cross(x[c.j, W], np.cross(x[c.j, W], c.center_j - x[c.j, P]))
    both = c.j >= 0 and not scene.bodies[c.j].fixed
    return total + (0.0 if both else c.normal @ scene.gravity)


def mean_of(values, c, bodies):
    """Geometric mean of a material's value of a contact's partners; bodies come before elements."""
    return np.sqrt(values[c.i] * values[c.j if c.j >= 0 else bodies - 1 - c.j])


def leads(scene, contacts, x, J, limit):
    """Return for each contact the number of the contact whose normal speed damps it, and that of the deepest
    contact of its patch.

    The deepest contact's speed damps those at which a round body that rolls would touch as well: their speeds
    differ by no more than the body's spin times the half width of a shallow contact. Others have their own.
    ``x`` is the state at the end without contacts, ``limit`` the gap of contacts that take part [m].
    """
    speeds, out = (J @ velocities(x))[::3], np.arange(len(contacts))
    lowest, numbers = out.copy(), {c[:4]: k for k, c in enumerate(contacts)}
    for i, j in {(c.i, c.j) for c in contacts}:
        every = candidates(scene, x, i, j, 0.0, limit)
        for patch in patches(every, {(c.a, c.b): c.gap for c in every}):
            chosen = [numbers[c[:4]] for c in patch if c[:4] in numbers]
            if not chosen:
                continue
            deepest = min(chosen, key=lambda k: contacts[k].gap)
            spin = np.linalg.norm(x[i, W] - (x[j, W] if j >= 0 else 0.0))
            radius = min(scene.bodies[k].model.bounding_radius for k in (i, j) if k >= 0)
            near = spin * np.sqrt(2.0 * roll_depth(scene, radius) * radius)
            near = near if scene.dt * spin * radius > ROLLED else 0.0
            for k in chosen:
                lowest[k] = deepest
                if k == deepest or abs(speeds[k] - speeds[deepest]) < near:
                    out[k] = deepest
    return out, lowest


def roll_depth(scene, radius):
    """Return the depth at which spheres of a body may touch when it rolls [m]."""
    return max(ROLL_DEPTH, min(scene.dt**2 * np.linalg.norm(scene.gravity), ROLL_SHARE * radius))


def support(body, R, n, ahead, axis, sphere):
    """Return the least height of a body's hull against ``n`` near a sphere, its smooth minimum, and the
    coordinate along ``ahead`` of its place [m].
    """
    hull, size = shape_of(body.model).hull, body.model.bounding_radius
    places, radii = body.model.centers[hull] @ R.T, body.model.radii[hull]
    apart = (places - R @ body.model.centers[sphere]) @ axis
    heights = places @ n - radii + AXIAL / size * apart**2
    above, across = heights - heights.min(), (places - places[heights.argmin()]) @ ahead
    near = (above < CUT * SMOOTHING * size) & (abs(across) < WIDTH * size)
    weights = np.where(near, np.exp(-above / (SMOOTHING * size)), 0.0)
    smooth = heights.min() - SMOOTHING * size * np.log(weights.sum())
    return heights.min(), smooth, weights @ places @ ahead / weights.sum()


def rolling_contacts(scene, contacts, before, x, J, lead, lowest, h):
    """Return how impulses change momenta (3 m, 6 B), and which normal speeds (m,) come from rolling.

    Impulses of what rolls on an element act where they do the work of the support's change of height. The
    body is turned back from the end by its turn, at the mean angular velocity of the interval's second half.
    Other impulses act as ``J`` says. The speed from rolling is that of the sphere relative to the support; of
    other contacts it is that relative to their lead.
    """
    out, speeds = J.copy(), (J @ velocities(x))[::3]
    rolling = speeds - speeds[lead]
    anchors = {}  # spheres for which places were found, by the patch
    for k, c in enumerate(contacts):
        n, body, R = contacts[lowest[k]].normal, scene.bodies[c.i], Rotation.from_quat(x[c.i, Q])
        w = 0.25 * before[c.i, W] + 0.75 * x[c.i, W]
        across = w - (w @ n) * n
        size = h * np.linalg.norm(across)
        if c.j >= 0 or c.b > 0 or lead[k] != lowest[k] or scene.dt / h * size <= TURNED:
            continue
        ahead, axis = np.cross(across, n) / np.linalg.norm(across), w / np.linalg.norm(w)
        known, radius = anchors.setdefault(lowest[k], []), body.model.bounding_radius
        offsets = body.model.centers @ R.as_matrix().T @ axis
        anchor = next((s for s in known if abs(offsets[s] - offsets[c.a]) < BESIDE * radius), c.a)
        known.append(anchor)
        least, end, foot = support(body, R.as_matrix(), n, ahead, axis, anchor)
        earlier = Rotation.from_rotvec(-h * w) * R
        # the axis does not turn, so places along it stay
        start = support(body, earlier.as_matrix(), n, ahead, axis, anchor)[1]
        push, arm = (start - end) / size, middle_of(c) - x[c.i, P]
        farthest = min(FARTHEST * size, WIDTH) * radius
        if abs(least - arm @ n) >= roll_depth(scene, radius) or abs(push - foot) >= farthest:
            continue
        if abs(arm @ ahead - foot) >= WIDTH * radius:
            continue
        rolled = np.cross(-0.5 * h * (w @ n) * n, arm) + arm
        rolled = rolled + (push - rolled @ ahead) * ahead + 0.5 * (start - end) * n
        inverse = inverse_mass(scene, x)[6 * c.i : 6 * c.i + 6, 6 * c.i : 6 * c.i + 6]
        gives = np.cross(arm, n) @ inverse[3:, 3:] @ np.cross(rolled, n)
        if gives <= (LEAST_COMPLIANCE - 1.0) * inverse[0, 0]:
            continue
        rolling[k] = -(x[c.i, W] @ np.cross(n, ahead)) * (arm @ ahead - foot)
        for d, axis in enumerate((c.normal, *frame(c.normal))):
            out[3 * k + d, 6 * c.i + 3 : 6 * c.i + 6] = np.cross(rolled, axis)
    return out, rolling


def counted_gaps(gaps, mean_speeds, explained, h):
    """Return gaps at an interval's end of which overlap that nothing explains counts only in part.

    Overlap at the start beyond the depth that the last force explains, and a slack, is pushed out at a
    limited speed, so it gives back no energy.
    """
    start = gaps - h * mean_speeds
    return gaps + np.maximum(-explained - SLACK - RECOVERY * h - start, 0.0)


class Lasting(NamedTuple):
    """The law of lasting contacts: depths at an interval's end give normal impulses; impulses change ``free``
    (6 B,). Gaps and speeds are those of the interval's end without contacts, and ``push`` says where impulses
    act (`rolling_contacts`).
    """

    J: np.ndarray
    push: np.ndarray
    inverse_mass: np.ndarray
    free: np.ndarray
    gap: np.ndarray  # at the end without contacts (m,)
    rolling: np.ndarray  # normal speed beyond the one that is damped, without contacts (m,)
    stiffness: np.ndarray  # kappa pi R
    friction: np.ndarray
    h: float
    damping_time: np.ndarray

    def speeds(self, impulses):
        """(m, 3) at the interval's end."""
        return (self.J @ self.ends(impulses)).reshape(-1, 3)

    def ends(self, impulses):
        """Velocities (6 B,) at the interval's end."""
        return self.free + self.inverse_mass @ self.push.T @ impulses.ravel()

    def normal_impulses(self, speeds):
        change = speeds[:, 0] - (self.J @ self.free)[::3]
        gap = self.gap + 0.5 * self.h * change  # bodies travel by the mean of start and end
        depth = np.maximum(0.0, -gap - self.damping_time * (speeds[:, 0] - self.rolling))
        return self.h * self.stiffness * depth**2

    def residual(self, impulses):
        """(m, 3) [N s]: 0 where the law holds."""
        speeds = self.speeds(impulses)
        return np.column_stack(
            [impulses[:, 0] - self.normal_impulses(speeds), slip_residual(self, impulses, speeds)]
        )

    def own_residual(self, impulses):
        """(m, 3) [N s]: by how much each impulse would have to change for its law to hold, the
        others held.
        """
        wanted, speeds, own = impulses.copy(), self.speeds(impulses), compliance(self)
        for k in range(len(impulses)):

            def miss(impulse, k=k):
                v = speeds.copy()
                v[k, 0] += own[k, 0] * (impulse - impulses[k, 0])
                return impulse - self.normal_impulses(v)[k]

            wanted[k, 0] = brentq(miss, 0.0, impulses[:, 0].sum() + miss(0.0) * -2.0 + 1.0, xtol=1e-15)
        return np.column_stack([impulses[:, 0] - wanted[:, 0], slip_residual(self, impulses, speeds)])


class Impact(NamedTuple):
    """The law of an impact: normal speeds reach their targets, or there is no impulse."""

    J: np.ndarray
    inverse_mass: np.ndarray
    free: np.ndarray
    target: np.ndarray
    friction: np.ndarray

    speeds, ends = Lasting.speeds, Lasting.ends

    @property
    def push(self):
        return self.J

    def residual(self, impulses):
        speeds = self.speeds(impulses)
        normal = impulses[:, 0] - np.maximum(
            0.0, impulses[:, 0] - (speeds[:, 0] - self.target) / compliance(self)[:, 0]
        )
        return np.column_stack([normal, slip_residual(self, impulses, speeds)])


def impact_friction(friction, closing, half_speed):
    """Return the coefficients of an impact at these closing speeds [m/s]; half of them at ``half_speed``."""
    return (
        friction * half_speed / (half_speed + np.maximum(closing, 0.0)) if half_speed < np.inf else friction
    )


def compliance(law):
    """(m, 3): each direction's own."""
    return np.einsum("ij,jk,ik->i", law.J, law.inverse_mass, law.push).reshape(-1, 3)


def slip_residual(law, impulses, speeds):
    """Coulomb: an impulse that goes on against the slip and back into the cone stays where it is."""
    wanted = impulses[:, 1:] - speeds[:, 1:] / compliance(law)[:, 1:].max(axis=1)[:, None]
    limit = law.friction * np.maximum(impulses[:, 0], 0.0)
    size = np.linalg.norm(wanted, axis=1)
    share = np.where(size > limit, limit / np.maximum(size, 1e-300), 1.0)
    return impulses[:, 1:] - share[:, None] * wanted


def solution(law, scale):
    """Impulses (m, 3) that obey a law, by least squares of its residual; ``scale`` [N s] is a typical
    impulse.
    """

    def residual(y):
        return law.residual(scale * y.reshape(-1, 3)).ravel() / scale

    best = None
    for start in (0.0, 0.3, 1.0, 0.1, 3.0):  # from some it ends in a hollow
        y = np.zeros((len(law.friction), 3))
        y[:, 0] = start
        found = least_squares(
            residual, y.ravel(), method="trf", xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=2000
        )
        if best is None or found.cost < best.cost:
            best = found
        if best.cost < 1e-20:
            break
    return scale * best.x.reshape(-1, 3), np.sqrt(2.0 * best.cost)


def kinetic_energy(scene, x, v):
    """[J], of velocities (6 B,)."""
    total = 0.0
    for k in scene.moving:
        body, R = scene.bodies[k], Rotation.from_quat(x[k, Q]).as_matrix()
        u, w = v[6 * k : 6 * k + 3], R.T @ v[6 * k + 3 : 6 * k + 6]
        total += 0.5 * body.mass * (u @ u + w @ body.model.inertia @ w)
    return total


def blended(scene, x, before, elastic, plastic):
    """Velocities after an impact: as elastic as no energy is gained."""

    def gain(share):
        return kinetic_energy(scene, x, plastic + share * (elastic - plastic)) - kinetic_energy(
            scene, x, before
        )

    if gain(1.0) <= 0.0:
        return elastic
    return plastic + brentq(gain, 0.0, 1.0, xtol=1e-14) * (elastic - plastic)


def impact_speed(restitution, threshold):
    """Return the closing speed above which a contact has an impact [m/s]."""
    return min(LIVELY_SPEED, threshold) if restitution >= LIVELY else threshold


def time_to_impact(gaps, speeds, accelerations, left, thresholds):
    """When the first gap, a parabola, reaches the aim faster than its threshold; ``left`` [s] if none does
    before.
    """
    first = left
    for gap, speed, acceleration, threshold in zip(gaps, speeds, accelerations, thresholds, strict=True):
        if gap <= AIM:
            continue
        for time in np.roots([0.5 * acceleration, speed, gap - AIM]):
            if (
                abs(time.imag) == 0.0
                and 0.0 < time.real < first
                and speed + acceleration * time.real < -threshold
            ):
                first = time.real
    return first


def first_closing(gaps, speeds, accelerations, h, thresholds):
    """Return the time at which a gap may first have closed faster than its threshold on the way to these gaps
    and speeds; ``h`` without one, and 0 if one had closed at the start that is not open at the end. Almost as
    fast is enough on the way.
    """
    slow = 0.9 * np.asarray(thresholds)
    begin = speeds - h * accelerations
    start = gaps - 0.5 * h * (begin + speeds)
    closed = start <= 2.0 * TOUCHING
    if (begin < -np.asarray(thresholds))[closed & (gaps <= 0.0)].any():
        return 0.0
    left = ~closed
    return time_to_impact(start[left], begin[left], accelerations[left], h, slow[left])


def landing_speed(dt, threshold):
    """Return the closing speed above which an edge that lands has an impact [m/s]."""
    return min(threshold, LANDING / dt)


def speeds_across_edges(scene, x, contacts, speeds, falls, h, loaded, threshold):
    """Return the normal speeds (m,) that decide on impacts, ``h`` seconds before the state ``x``.

    Of a sphere of a face that slides over an edge of an element, that is at most the speed along the face's
    normal. ``loaded`` has pairs (a, b) of the last step's contacts of this body with the element, and
    ``speeds`` are the normal speeds at ``x``.
    """
    out = speeds - h * falls
    corners = {a for a, b in loaded if b > 0}
    for k, c in enumerate(contacts):
        if c.j >= 0 or c.b > 0 or out[k] >= -landing_speed(scene.dt, threshold):
            continue
        v = x[c.i, V] + np.cross(x[c.i, W], c.point - x[c.i, P])
        for face in faces_in_use(scene.bodies[c.i].model):
            p = Rotation.from_quat(x[c.i, Q]).apply(face.normal)
            if len(face.outline) and corners & set(face.touching.tolist()) and p @ c.normal < -FACING:
                out[k] = max(out[k], -p @ v - h * falls[k])
    return out


def in_impact(contacts, speeds, restitution, threshold, moving):
    """Return the numbers of the contacts that an impact reaches.

    Contacts of low restitution are rigid up to a distance; elastic ones act in sequence, so only those that
    touch and close take part. An impact reaches all bodies that these connect to a contact that closes fast.
    """
    slowest = np.array([impact_speed(e, threshold) for e in restitution])
    gaps = np.array([c.gap for c in contacts])
    rigid = np.where(restitution < LIVELY, gaps <= IMPACT, (gaps <= TOUCHING) & (speeds < -slowest))
    reached = {contacts[k].i for k in np.flatnonzero(rigid & (speeds < -slowest))}
    reached |= {contacts[k].j for k in np.flatnonzero(rigid & (speeds < -slowest)) if contacts[k].j in moving}
    while True:
        more = set()
        for k in np.flatnonzero(rigid):
            ends = {contacts[k].i, contacts[k].j} & set(moving)
            more |= ends if ends & reached else set()
        if more <= reached:
            return [k for k in np.flatnonzero(rigid) if contacts[k].i in reached]
        reached |= more


def travelled(s, end, h):
    """Pose (7,) of a body in contact, by the mean of its velocities at the interval's start and end (6,)."""
    mean = 0.5 * (np.concatenate([s[V], s[W]]) + end)
    turn = Rotation.from_rotvec(h * mean[3:]) * Rotation.from_quat(s[Q])
    return np.concatenate([s[P] + h * mean[:3], turn.as_quat()])
