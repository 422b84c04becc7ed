"""Spheres that give a packing its mesh's extent, flat faces and rims: the first of a packing.

A body rests, tips and rolls on its convex hull. Places on the hull are chosen, with a sphere for each:

- the corners of each face of the hull on which the body can rest, both ends of a narrow one, as on a body
  that rolls, and the middle of a small one;
- corners of the hull, until none sticks out of the hull of the spheres.

A face on which the body can rest is touched exactly. A sphere ends close to its place, is as large as
possible, and stays on its own side of the planes half-way to the other places, so that spheres are disjoint.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from .distance import even_directions
from .revolution import outside_polygon
from .solid_mesh import unique_rows
from .triangle_tree import nearest_on_mesh, winding_number

# Shares of the hull's size:
RECESS = 0.003  # how far other spheres stay below the narrow faces on which a body rolls
REACH = 0.004  # how far a sphere ends from its place, at most
OUTSIDE = 0.003  # how far a corner of a face may be outside of the hull of the places on it
STICKING_OUT = 0.007  # how far a corner of the hull may be outside of the hull of the spheres
NEAR = 3.0 * REACH  # how far a place is from a face that its sphere touches, at most
NARROW = 0.06  # a face's width
OFF_CENTRE = 0.05  # how far the centre of mass may be beside a narrow face on which the body can rest
LARGEST = 0.2  # radius of a sphere
SMALLEST = 1e-3  # radius of a sphere
# Turn between the first narrow faces around the body that get places of their own, and how often it is
# halved: as long as narrow faces get no more than a share of the places.
FIRST_TURN, HALVINGS = math.radians(120.0), 6
ROLLING = 0.7
_STRIP = math.radians(30.0)  # turn to the next face of a strip around the body, at most
_KEPT = 0.3  # of its radius: a sphere that recedes to less vanishes
_INSCRIBED = 1e-3  # of the radius
_COPLANAR = 1e-7
_ROUNDS = 30
# Against the radius: of a gap to a face, low enough for faces that spheres inside the mesh cannot touch, and
# of more than `REACH` to the place.
_GAP_PENALTY, _PLACE_PENALTY = 5.0, 50.0
_TOUCHING = 1e-5  # share of the size: smaller gaps are closed at the end
_GAIN = 1e-6  # share of the size: a smaller gain does not repay another linear programme
_NEIGHBOURS = 30  # nearest faces of the hull and nearest places that first constrain a sphere
_CORNERS = 4000  # of the hull, at most: each takes time in the search for places
_DIRECTIONS = even_directions(32)


class Face(NamedTuple):
    """A face of the convex hull: outward normal, height over the centre of mass, and its corners (k, 3).

    ``frame`` (2, 3) are unit vectors across it, the first along it; ``extent`` (2,) is its size that way, and
    ``polygon`` (k, 2) are its corners there, in order.
    """

    normal: np.ndarray
    height: float
    corners: np.ndarray
    frame: np.ndarray
    extent: np.ndarray
    polygon: np.ndarray


def hull_faces(points) -> tuple[list[Face], float]:
    """Return the faces of the convex hull of points (n, 3), with coplanar triangles united, and its size.

    A flat hull has none. The size is the edge of a cube of its volume.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import ConvexHull, QhullError

    try:
        found = ConvexHull(points)
    except QhullError:
        return [], 0.0
    count, equations = len(found.simplices), found.equations
    one, other = np.repeat(np.arange(count), 3), found.neighbors.reshape(-1)
    same = np.abs(equations[one, :3] - equations[other, :3]).max(axis=1) < _COPLANAR
    same &= np.abs(equations[one, 3] - equations[other, 3]) < _COPLANAR * np.abs(points).max()
    graph = coo_array((np.ones(same.sum(), np.int8), (one[same], other[same])), shape=(count, count))
    labels = connected_components(graph, directed=False)[1]
    faces = []
    ends = np.cumsum(np.bincount(labels))[:-1]
    for members in np.split(np.argsort(labels, kind="stable"), ends):
        faces.append(_face(equations[members[0], :3], points[np.unique(found.simplices[members])]))
    return faces, float(np.cbrt(found.volume))


def _face(normal, corners):
    spread = corners - corners.mean(axis=0)
    along = np.linalg.svd(spread - np.outer(spread @ normal, normal))[2][0]
    frame = np.stack([along, np.cross(normal, along)])
    polygon = corners @ frame.T
    from_middle = polygon - polygon.mean(axis=0)
    polygon = polygon[np.argsort(np.arctan2(from_middle[:, 1], from_middle[:, 0]))]
    return Face(normal, float((corners @ normal).max()), corners, frame, np.ptp(polygon, axis=0), polygon)


def _is_near(face, point, gap):
    """Return whether a point is at most ``gap`` from a face."""
    up = face.normal @ point - face.height
    return (
        abs(up) <= gap and math.hypot(up, outside_polygon((face.frame @ point)[None], face.polygon)[0]) <= gap
    )


def resting_faces(faces, size) -> list[Face]:
    """Return the faces on which a body can rest: the centre of mass, the origin, is above them."""
    found = []
    for face in faces:
        # a narrow face rolls on to the next
        beside = OFF_CENTRE if face.extent[0] > NARROW * size >= face.extent[1] else _COPLANAR
        if outside_polygon(np.zeros((1, 2)), face.polygon)[0] <= beside * size:
            found.append(face)
    return found


class Places:
    """Places that get a sphere, and of each the faces that it touches."""

    def __init__(self, resting, size, most):
        self.resting, self.size, self.most = resting, size, most
        self.is_narrow = np.array([face.extent[1] <= NARROW * size for face in resting], bool)
        self.points = np.empty((0, 3))
        self.touched = []
        self.rolling = []

    def add(self, point, narrow=None):
        """Add a place unless it is close to another, and return whether it was added.

        ``narrow`` is the number of the narrow face on which it is, if any.
        """
        gaps = np.linalg.norm(self.points - point, axis=1)
        if len(self.points) >= self.most or gaps.min(initial=np.inf) <= REACH * self.size:
            return False
        self.points = np.vstack([self.points, point])
        wide = [
            k for k in np.flatnonzero(~self.is_narrow) if _is_near(self.resting[k], point, NEAR * self.size)
        ]
        self.touched.append(wide if narrow is None else [narrow, *wide])
        return True

    def add_resting(self):
        """Add places on the faces on which the body can rest, the narrow ones first."""
        self.levels = []
        for level in self._narrow_faces():
            for k in level:
                face = self.resting[k]
                if face.extent[0] <= NARROW * self.size:
                    self.add(face.corners.mean(axis=0), k)
                    continue
                along = face.corners @ face.frame[0]
                for end in (along, -along):
                    self.add(face.corners[end >= end.max() - 0.5 * face.extent[1]].mean(axis=0), k)
            self.levels.append(len(self.points))
        for k in np.flatnonzero(~self.is_narrow):
            face = self.resting[k]
            while True:
                own = self.points[[k in touched for touched in self.touched]] @ face.frame.T
                gaps = _outside_all(face.corners @ face.frame.T, own)
                farthest = int(gaps.argmax())
                if gaps[farthest] <= OUTSIDE * self.size or not self.add(face.corners[farthest]):
                    break

    def _narrow_faces(self):
        """Return the numbers of narrow faces that get places, evenly around the body: a list for each level.

        Each level halves the turn between those before. The body rolls on ``rolling``.
        """
        faces = np.flatnonzero(self.is_narrow)
        ends = np.array([1 + (self.resting[k].extent[0] > NARROW * self.size) for k in faces], np.int64)
        strips = _strips(np.array([self.resting[k].normal for k in faces]).reshape(-1, 3))
        self.rolling = [self.resting[faces[k]] for strip, _ in strips if len(strip) > 2 for k in strip]
        levels, chosen = [], np.empty(0, np.int64)
        for level in range(HALVINGS + 1):
            found = [strip[_evenly(turns, level)] for strip, turns in strips]
            new = np.setdiff1d(np.concatenate([chosen, *found]), chosen)
            chosen = np.concatenate([chosen, new])
            if levels and ends[chosen].sum() > ROLLING * self.most:
                break
            levels.append(faces[new])
        return levels

    def add_extremes(self, points, within):
        """Add corners of the hull of points until none is outside of the hull of places and ``within``."""
        from scipy.spatial import ConvexHull, QhullError

        corners = points[ConvexHull(points).vertices]
        if len(within) == 0:
            for direction in np.concatenate([np.eye(3), -np.eye(3)]):
                self.add(corners[(corners @ direction).argmax()])
            within = self.points
        try:
            inner = ConvexHull(within, incremental=True)
        except QhullError:
            return
        left = np.ones(len(corners), bool)
        while left.any() and len(self.points) < self.most:
            outside = (corners @ inner.equations[:, :3].T + inner.equations[:, 3]).max(axis=1)
            gaps = np.where(left, outside, -np.inf)
            farthest = int(gaps.argmax())
            if gaps[farthest] <= STICKING_OUT * self.size:
                return
            left[farthest] = False
            if self.add(corners[farthest]):
                inner.add_points(corners[farthest][None])


def _strips(normals):
    """Group normals (n, 3) into strips around a body: their numbers in order, and the turn to each next one.

    The last turn leads back to the first, and is infinite where the strip is open.
    """
    left, strips = list(range(len(normals))), []
    while left:
        strip = [left.pop(0)]
        turns = []
        while True:
            angles = np.arccos(np.clip(normals[left] @ normals[strip[-1]], -1.0, 1.0))
            nearest = int(angles.argmin()) if left else 0
            if not left or angles[nearest] > _STRIP:
                break
            turns.append(angles[nearest])
            strip.append(left.pop(nearest))
        back = float(np.arccos(np.clip(normals[strip[-1]] @ normals[strip[0]], -1.0, 1.0)))
        closed = len(strip) > 2 and back <= _STRIP
        strips.append((np.array(strip), np.array([*turns, back if closed else np.inf])))
    return strips


def _evenly(turns, level):
    """Return which faces of a strip to take on a level: evenly, with those of the levels before."""
    at = np.concatenate([[0.0], np.cumsum(turns[:-1])])
    closed = math.isfinite(turns[-1])
    whole = at[-1] + (turns[-1] if closed else 0.0)
    count = max(1, int(whole / FIRST_TURN + 1e-6)) << level
    wanted = np.arange(count + (not closed)) / count * whole
    return np.unique(np.abs(at - wanted[:, None]).argmin(axis=1))


def _outside_all(points, polygon):
    """Return the distances of points (n, 2) outside of the convex hull of others."""
    from scipy.spatial import ConvexHull, QhullError

    if len(polygon) == 0:
        return np.linalg.norm(points - points.mean(axis=0), axis=1)
    try:
        equations = ConvexHull(polygon).equations
    except (QhullError, ValueError):
        return np.linalg.norm(points[:, None] - polygon, axis=2).min(axis=1)
    return (points @ equations[:, :2].T + equations[:, 2]).max(axis=1)


class SupportSpheres(NamedTuple):
    """The first spheres of a packing (s, 4), in an order in which any first part spreads evenly.

    ``normals`` (f, 3) and ``heights`` (f,) are planes below which all other spheres stay. A body then
    rolls on the spheres that line its rims alone.
    """

    spheres: np.ndarray
    normals: np.ndarray
    heights: np.ndarray

    def scaled(self, scale) -> SupportSpheres:
        """Return them with all lengths multiplied by ``scale``."""
        return SupportSpheres(self.spheres * scale, self.normals, self.heights * scale)

    def receded(self, spheres):
        """Return spheres (n, 4), made smaller to stay below the planes, without those that vanish."""
        over = (spheres[:, :3] @ self.normals.T - self.heights).max(axis=1, initial=-np.inf) + spheres[:, 3]
        radii = spheres[:, 3] - np.maximum(over, 0.0)
        kept = radii > _KEPT * spheres[:, 3]
        return np.column_stack([spheres[:, :3], radii])[kept]


def capsule_supports(radius, length) -> SupportSpheres:
    """Return the supports of a capsule along z, ``length`` between the centres of its ends: balls.

    They overlap in a short one, and are by ``_INSCRIBED`` smaller than it, to lie inside its mesh.
    """
    balls = max(2, int(length / (2.0 * radius)) + 1)
    spheres = np.zeros((balls, 4))
    spheres[:, 2] = np.linspace(-0.5 * length, 0.5 * length, balls)
    spheres[:, 3] = (1.0 - _INSCRIBED) * radius
    angle = np.arange(0.0, 2.0 * math.pi, 0.5 * FIRST_TURN / (1 << HALVINGS))
    normals = np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    size = float(np.cbrt(math.pi * radius**2 * (length + 4.0 / 3.0 * radius)))
    return SupportSpheres(
        spheres[[0, -1, *range(1, balls - 1)]], normals, np.full(len(angle), radius - RECESS * size)
    )


def few_corners(points):
    """Return points (n, 3), or if their convex hull has more than `_CORNERS` corners, evenly chosen ones.

    Round bodies have so many. Their hull shrinks by 3e-4 of their size.
    """
    from scipy.spatial import ConvexHull

    if len(points) <= _CORNERS:
        return points
    corners = points[ConvexHull(points).vertices]
    return points if len(corners) <= _CORNERS else corners[:: -(-len(corners) // _CORNERS)]


def support_spheres(corners, tree, most) -> SupportSpheres:
    """Return at most ``most`` spheres that give a packing its extent, flat faces and rims.

    ``corners`` (m, 3, 3) are those of the mesh's triangles about the centre of mass, which ``tree`` has, too.
    """
    points = few_corners(unique_rows(corners.reshape(-1, 3))[0])
    faces, size = hull_faces(points)
    if not faces or most < 4:
        return SupportSpheres(np.empty((0, 4)), np.empty((0, 3)), np.empty(0))
    resting = resting_faces(faces, size)
    places = Places(resting, size, most)
    places.add_resting()
    fit = _SphereFit(corners, tree, faces, resting, size)
    fit.add(places)
    ends = np.concatenate(
        [fit.spheres[:, None, :3] + fit.spheres[:, None, 3:] * _DIRECTIONS, *fit.contacts], axis=None
    ).reshape(-1, 3)
    places.add_extremes(points, ends)
    fit.add(places)
    level = np.searchsorted(places.levels, fit.place_of, side="right")
    rolling = level < len(places.levels)
    normals = np.array([face.normal for face in places.rolling]).reshape(-1, 3)
    heights = np.array([face.height for face in places.rolling]) - RECESS * size
    found = SupportSpheres(np.empty((0, 4)), normals, heights)
    lining = np.array([bool(places.touched[k]) for k in fit.place_of], bool)
    first = np.concatenate([fit.spheres[lining & ~rolling], found.receded(fit.spheres[~lining])])
    lines = [_spread(fit.spheres[level == k]) for k in range(len(places.levels))]
    return found._replace(spheres=np.concatenate([_spread(first), *lines]))


def _spread(spheres):
    """Return spheres in an order in which each is as far as possible from those before."""
    if len(spheres) == 0:
        return spheres
    order = [int(np.linalg.norm(spheres[:, :3], axis=1).argmax())]
    gaps = np.full(len(spheres), np.inf)
    for _ in range(len(spheres) - 1):
        gaps = np.minimum(gaps, np.linalg.norm(spheres[:, :3] - spheres[order[-1], :3], axis=1))
        gaps[order] = -np.inf
        order.append(int(gaps.argmax()))
    return spheres[order]


class _SphereFit:
    """Fits a sphere to each place, by linear programmes in its centre and radius."""

    def __init__(self, corners, tree, faces, resting, size):
        from scipy.spatial import KDTree

        self.corners, self.tree, self.size = corners, tree, size
        self.nearest = KDTree(corners.reshape(-1, 3))
        self.far = 4.0 * float(np.abs(corners).max())
        self.normals = np.array([face.normal for face in faces])
        self.heights = np.array([face.height for face in faces])
        self.resting = resting
        self.spheres, self.contacts = np.empty((0, 4)), []
        self.below = np.zeros(len(resting))  # how far below the faces spheres end
        self.place_of, self.done = np.empty(0, np.int64), 0

    def add(self, places):
        """Fit spheres to the places that have none yet.

        No sphere inside the mesh can touch a face of the hull that holds only sharp edges of the mesh. All
        spheres of such a face end as far below it as the farthest does, so that it stays flat.
        """
        first, self.done = self.done, len(places.points)
        new = range(first, self.done)
        others = [np.delete(places.points[first:], k - first, axis=0) for k in new]
        found = [
            self.sphere(places.points[k], o, places.touched[k]) for k, o in zip(new, others, strict=True)
        ]
        if first == 0:
            for k, sphere in zip(new, found, strict=True):
                if sphere is None:
                    continue
                for f in places.touched[k]:
                    gap = self.resting[f].height - self.resting[f].normal @ sphere[:3] - sphere[3]
                    self.below[f] = max(self.below[f], gap)
            self.below[self.below < _TOUCHING * self.size] = 0.0
            for k in new:
                if self.below[places.touched[k]].any():
                    found[k] = self.sphere(places.points[k], others[k], places.touched[k])
        fitted = [(k, sphere) for k, sphere in zip(new, found, strict=True) if sphere is not None]
        for k, sphere in fitted:
            normals = [self.resting[f].normal for f in places.touched[k]]
            self.contacts += [sphere[:3] + sphere[3] * normal for normal in normals]
        self.place_of = np.append(self.place_of, [k for k, _ in fitted]).astype(np.int64)
        self.spheres = np.concatenate(
            [self.spheres, np.array([sphere for _, sphere in fitted]).reshape(-1, 4)]
        )

    def sphere(self, place, others, touches):
        """Return the largest free sphere (4,) at a place, in its cell, that touches faces; None if none."""
        center = self.start(place)
        if center is None:
            return None
        rows, limits = self.fixed_rows(place, others)
        touched = [self.resting[f] for f in touches]
        equal = np.array([[*face.normal, 1.0] for face in touched]).reshape(-1, 4)
        equal_to = np.array([face.height for face in touched]) - self.below[np.array(touches, np.int64)]
        rows, limits = np.concatenate([rows, equal]), np.concatenate([limits, equal_to])
        features: list[tuple[np.ndarray, np.ndarray | None, float]] = []
        radius = self.free(center, features)
        trust = radius
        best = self.merit(center, radius, place, equal, equal_to)
        for _ in range(_ROUNDS):
            trust = min(trust, 0.5 * self.free(center, features))
            found = self.solve(center, place, rows, limits, equal, equal_to, features, trust)
            if found is None or found[2] <= best + _GAIN * self.size:
                break
            new, wanted, _ = found
            free = self.free(new, features)
            radius_there = min(wanted, free)
            merit = self.merit(new, radius_there, place, equal, equal_to)
            if merit > best:
                center, radius, best = new, radius_there, merit
                trust *= 2.0 if free >= 0.9 * wanted else 1.0
            else:
                trust *= 0.3
        return self.polished(center, radius, rows, limits, equal, equal_to)

    def start(self, place):
        """Return a free point inside the mesh close to a place of its surface; None if none was found."""
        _, *q = nearest_on_mesh(self.tree, *place, self.far)
        near = self.nearest.query_ball_point(place, self.nearest.query(place)[0] + 1e-9 * self.size)
        incident = self.corners[np.unique(np.array(near) // 3)]
        cross = np.cross(incident[:, 1] - incident[:, 0], incident[:, 2] - incident[:, 0])
        ways = [-cross / np.linalg.norm(cross, axis=1, keepdims=True).clip(1e-30), -place[None]]
        ways = [way.sum(axis=0) for way in ways]
        for depth in (0.5, 0.1, 2.0):
            for way in ways:
                norm = np.linalg.norm(way)
                if norm > 0.0:
                    point = np.array(q) + depth * REACH * self.size * way / norm
                    if winding_number(self.tree, *point) > 0 and self.distance(point) > 0.0:
                        return point
        return None

    def distance(self, point):
        """Return the distance of a point from the mesh and the spheres."""
        gaps = np.linalg.norm(self.spheres[:, :3] - point, axis=1) - self.spheres[:, 3]
        return min(nearest_on_mesh(self.tree, *point, self.far)[0], gaps.min(initial=np.inf))

    def free(self, point, features):
        """Return the distance of a point from mesh and spheres, and add the nearest feature to ``features``.

        A feature is a point, the normal of a plane through it or None, and a radius about it.
        """
        distance, *foot = nearest_on_mesh(self.tree, *point, self.far)
        nearest, radius = np.array(foot), 0.0
        normal = (point - nearest) / max(distance, 1e-300)
        gaps = np.linalg.norm(self.spheres[:, :3] - point, axis=1) - self.spheres[:, 3]
        if gaps.min(initial=np.inf) < distance:
            distance = float(gaps.min())
            nearest, radius, normal = *np.split(self.spheres[gaps.argmin()], [3]), None
            radius = float(radius[0])
        # a plane that cuts off a known point that is free stands for a bend of the mesh
        for i, (place, way, _) in enumerate(features):
            if way is not None and way @ (point - place) < distance * (1.0 - 1e-9):
                features[i] = (place, None, 0.0)
        if not any(np.abs(place - nearest).max() < 1e-9 * self.size for place, _, _ in features):
            features.append((nearest, normal, radius))
        return distance

    def fixed_rows(self, place, others):
        """Return rows (r, 4) and limits (r,) of the constraints of hull and cell, which hold everywhere."""
        below = self.heights - self.normals @ place
        near = np.argsort(below)[:_NEIGHBOURS]
        near = near[below[near] < NEAR * self.size]
        rows = [np.column_stack([self.normals[near], np.ones(len(near))])]
        away = others - place
        gaps = np.linalg.norm(away, axis=1)
        close = np.argsort(gaps)[:_NEIGHBOURS]
        away = away[close] / gaps[close, None]
        rows.append(np.column_stack([away, np.ones(len(away))]))
        return np.concatenate(rows), np.concatenate(
            [self.heights[near], (away * (0.5 * (others[close] + place))).sum(axis=1)]
        )

    def merit(self, center, radius, place, equal, equal_to):
        """Return the radius less penalties for gaps to the faces to touch, and to the place."""
        gaps = equal_to - equal @ [*center, radius]
        far = max(0.0, np.linalg.norm(place - center) - radius - REACH * self.size)
        return radius - _GAP_PENALTY * np.abs(gaps).sum() - _PLACE_PENALTY * far

    def solve(self, center, place, rows, limits, equal, equal_to, features, trust):
        """Return centre, radius and merit of the best sphere by the linear programme at a point, or None."""
        from scipy import optimize

        scipy: Any = optimize  # whose types know no arrays
        planes, values = [], []
        for foot, normal, within in features:
            if normal is None:
                normal = (center - foot) / max(np.linalg.norm(center - foot), 1e-300)
            planes.append([*-normal, 1.0])
            values.append(-normal @ foot - within)
        to_place = place - center
        out = to_place / max(np.linalg.norm(to_place), 1e-300)
        soft = len(equal_to) + 1
        free_rows = np.concatenate([rows, np.array(planes).reshape(-1, 4)])
        a = np.zeros((len(free_rows) + soft, 4 + soft))
        b = np.concatenate([limits, values, -equal_to, [REACH * self.size - out @ place]])
        a[: len(free_rows), :4] = free_rows
        # no farther below a face than its slack; the planes of the hull keep it from going above
        a[len(free_rows) : -1, :4] = -equal
        a[-1, :4] = [*-out, -1.0]
        a[len(free_rows) :, 4:] = -np.eye(soft)
        cost = np.array([0.0, 0.0, 0.0, -1.0, *[_GAP_PENALTY] * (soft - 1), _PLACE_PENALTY])
        low = np.array([*(center - trust), *[0.0] * (1 + soft)])
        high = np.array([*(center + trust), LARGEST * self.size, *[np.inf] * soft])
        # a linear programme has no integers; the function for it spends more time on checks
        limits = scipy.LinearConstraint(a, -np.inf, b)
        found = scipy.milp(cost, constraints=limits, bounds=scipy.Bounds(low, high))
        return None if found.x is None else (found.x[:3], found.x[3], -found.fun)

    def polished(self, center, radius, rows, limits, equal, equal_to):
        """Return the sphere (4,) moved onto its faces to round-off, within bounds; None if too small."""
        gaps = equal_to - equal @ [*center, radius]
        close = np.abs(gaps) < _TOUCHING * self.size
        if close.any():
            step = np.linalg.lstsq(equal[close], gaps[close], rcond=1e-9)[0]
            center, radius = center + step[:3], radius + step[3]
        radius = min(radius, self.distance(center), float((limits - rows[:, :3] @ center).min()))
        return np.array([*center, radius]) if radius > SMALLEST * self.size else None
