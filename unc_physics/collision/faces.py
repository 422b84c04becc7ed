"""Flat faces of packings: planes that touch several spheres from outside.

The spheres of two sliding faces would interlock. Where a sphere touches a face, the contact is therefore with
the face's plane.
"""

import math
from typing import NamedTuple

import numpy as np

from ..compiler import inner
from ..spatial.rotation import tangents
from ..spatial.vectors import minus
from .hull import hull_volume

#: Number of directions in which the extent of a face is stored; the second half are opposites of the first.
SIDES = 16
_HALF = SIDES // 2
_ANGLES = math.pi / _HALF * np.arange(_HALF)
_COSINES, _SINES = np.cos(_ANGLES), np.sin(_ANGLES)
#: Largest number of faces that a sphere touches: three in the corner of a box.
FACES_OF_A_SPHERE = 3
#: Relative to the packing's radius: largest gap between plane and spheres, least width of a face.
_TOLERANCE, _WIDTH = 1e-5, 0.05
#: Least number of spheres of a face; any three define a plane.
_FEWEST = 4
#: Number of start directions and of rounds of the search. Height of the layer of spheres in the first and in
#: the last round, relative to the packing's radius.
_STARTS, _ROUNDS, _FAR, _NEAR = 150, 16, 0.1, 2e-4
_SAME = 1.0 - 1e-6  # cosine of the angle between equal normals
#: Least and largest volume of a convex solid, relative to the hull of its spheres.
_FILLED = 0.97, 1.05
_STRAIGHT = 1e-4  # angle by which an outline turns at a corner, at least [rad]


class Faces(NamedTuple):
    """Flat faces of a scene's models, concatenated.

    Attributes
    ----------
    normal : (F, 3) float64
        Outward normal, body frame.
    across : (F, 2, 3) float64
        Two unit vectors in the plane of the face.
    sphere : (F,) int64
        A sphere that touches the face.
    reach : (F, SIDES) float64
        Extent of the face's contact points from that sphere's centre, in `SIDES` directions in the plane [m].
    of_sphere : (S, 3) int32
        Faces that each sphere touches; -1 for no face.
    outline : (F, SIDES) int64
        Spheres at the corners of the face's outline, counter-clockwise as seen from outside.
    corners : (F,) int64
        Their number; 0 for faces of bodies that are not convex, which may be hollow.
    """

    normal: np.ndarray
    across: np.ndarray
    sphere: np.ndarray
    reach: np.ndarray
    of_sphere: np.ndarray
    outline: np.ndarray
    corners: np.ndarray


def flat_faces(centers, radii, hull, volume):
    """Find the flat faces (`Faces`) of a packing.

    Parameters
    ----------
    centers : (n, 3) array
        Body frame [m].
    radii : (n,) array
        [m]
    hull : (h,) int array
        Spheres that can touch a plane (`hull.hull_spheres`).
    volume : float
        Of the solid [m^3]. A solid that fills the hull of its spheres is convex, and its faces are solid.

    Notes
    -----
    Starting from many directions, a plane is fitted to the spheres near the packing's top by weighted least
    squares. Each round includes fewer spheres.
    """
    size = float((np.linalg.norm(centers, axis=1) + radii).max())
    normals, found = _settled(centers[hull], radii[hull], size), []
    touching = np.zeros((len(radii), len(normals)), bool)
    for k, u in enumerate(normals):
        for tolerance in (10.0 * _TOLERANCE, _TOLERANCE):
            tops = centers @ u + radii
            touching[:, k] = tops >= tops.max() - tolerance * size
            if touching[:, k].sum() < _FEWEST:
                break
            u = _fitted(centers[touching[:, k]], radii[touching[:, k]], u)
        normals[k] = u
    of_sphere = np.full((len(radii), FACES_OF_A_SPHERE), -1, np.int32)
    room = np.zeros(len(radii), np.int64)
    faces = []
    for u, touches in zip(normals, touching.T, strict=True):
        if touches.sum() < _FEWEST or any(u @ v > _SAME for v in found):
            continue
        points = centers[touches] + radii[touches, None] * u
        width = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] / math.sqrt(len(points))
        if width < _WIDTH * size:
            continue
        found.append(u)
        sphere = int(np.flatnonzero(touches)[0])
        across = np.array(tangents(tuple(u)))
        along = (centers[touches] - centers[sphere]) @ across.T @ np.array([_COSINES, _SINES])
        for s in np.flatnonzero(touches & (room < FACES_OF_A_SPHERE)):
            of_sphere[s, room[s]] = len(faces)
            room[s] += 1
        faces.append((u, across, sphere, np.concatenate([along.max(axis=0), -along.min(axis=0)]), touches))
    return Faces(
        np.array([face[0] for face in faces]).reshape(-1, 3),
        np.array([face[1] for face in faces]).reshape(-1, 2, 3),
        np.array([face[2] for face in faces], np.int64),
        np.array([face[3] for face in faces]).reshape(-1, SIDES),
        of_sphere,
        *_outlines(faces, centers, radii, hull, volume),
    )


def _outlines(faces, centers, radii, hull, volume):
    """Return the spheres at the corners of faces' outlines, and their numbers (`Faces`)."""
    outline, corners = np.zeros((len(faces), SIDES), np.int64), np.zeros(len(faces), np.int64)
    normals = np.array([face[0] for face in faces]).reshape(-1, 3)
    low, high = _FILLED
    if len(faces) == 0 or not low < volume / hull_volume(centers[hull], radii[hull], normals) < high:
        return outline, corners
    for k, (_, across, *_, touches) in enumerate(faces):
        spheres = np.flatnonzero(touches)
        flat = centers[spheres] @ across.T
        along = flat @ np.array([_COSINES, _SINES])
        around = spheres[np.concatenate([along.argmax(axis=0), along.argmin(axis=0)])]
        around = around[around != np.roll(around, 1)]
        places = centers[around] @ across.T
        before, after = places - np.roll(places, 1, axis=0), np.roll(places, -1, axis=0) - places
        turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
        kept = turn > _STRAIGHT * np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
        corners[k] = kept.sum()
        outline[k, : corners[k]] = around[kept]
    return outline, corners


def _fitted(centers, radii, u):
    """Fit the normal of a plane that touches spheres by least squares, starting from ``u``."""
    across = np.array(tangents(tuple(u)))
    a = np.column_stack([centers @ across.T, np.ones(len(radii))])
    turn = np.linalg.lstsq(a, -(centers @ u + radii), rcond=1e-9)[0]
    u = u + turn[:2] @ across
    return u / np.linalg.norm(u)


def _settled(centers, radii, size):
    """Find normals (k, 3) of planes on top of a packing, starting from directions all around."""
    k = np.arange(_STARTS) + 0.5
    z, angle = 1.0 - 2.0 * k / _STARTS, math.pi * (1.0 + math.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z * z)
    u = np.column_stack([across * np.cos(angle), across * np.sin(angle), z])
    u = np.concatenate([u, np.eye(3), -np.eye(3)])
    for scale in np.geomspace(_FAR * size, _NEAR * size, _ROUNDS):
        tops = u @ centers.T + radii
        weights = np.exp((tops - tops.max(axis=1, keepdims=True)) / scale)
        weights /= weights.sum(axis=1, keepdims=True)
        mean, mean_radius = weights @ centers, weights @ radii
        spread = np.einsum("dn,na,nb->dab", weights, centers, centers, optimize=True)
        spread -= mean[:, :, None] * mean[:, None, :]
        slope = np.einsum("dab,db->da", spread, u) + (weights * radii) @ centers - mean * mean_radius[:, None]
        # keep the normal's component along itself
        project = np.eye(3) - u[:, :, None] * u[:, None, :]
        spread = project @ spread @ project + 1e-9 * size**2 * np.eye(3)
        step = -np.linalg.solve(spread, np.einsum("dab,db->da", project, slope)[:, :, None])[:, :, 0]
        step *= np.minimum(1.0, 0.2 / np.maximum(np.linalg.norm(step, axis=1), 1e-12))[:, None]
        u = u + step
        u /= np.linalg.norm(u, axis=1, keepdims=True)
    return u


def of_scene(models, first_sphere):
    """Concatenate the faces of several models, whose spheres begin at ``first_sphere``."""
    found, first = [], 0
    for faces, begin in zip(models, first_sphere, strict=True):
        of_sphere = np.where(faces.of_sphere >= 0, faces.of_sphere + first, -1).astype(np.int32)
        found.append(
            faces._replace(sphere=faces.sphere + begin, of_sphere=of_sphere, outline=faces.outline + begin)
        )
        first += len(faces.sphere)
    return Faces(*map(np.concatenate, zip(*found, strict=True)))


@inner(forceinline=True)
def over_face(f, point, centers, faces):
    """Return whether a point, in the body frame of face f, is over the face."""
    s = faces.sphere[f]
    q, across = minus(point, (centers[s, 0], centers[s, 1], centers[s, 2])), faces.across[f]
    a = across[0, 0] * q[0] + across[0, 1] * q[1] + across[0, 2] * q[2]
    b = across[1, 0] * q[0] + across[1, 1] * q[1] + across[1, 2] * q[2]
    reach = faces.reach[f]
    for k in range(_HALF):
        along = _COSINES[k] * a + _SINES[k] * b
        if along > reach[k] or -along > reach[_HALF + k]:
            return False
    return True
