"""Quasi-static pushing by an ellipsoidal limit surface: what a push does to a thing that slides on a table.

Friction's force and moment about the centre of mass lie on an ellipsoid, and the motion is along its normal
(Howe and Cutkosky 1996): ``(v, omega) ~ (f, m / c^2)``, where c is the load's mean distance from the centre.
Each tip pushes a point of the edge with Coulomb friction: it sticks, or slides, or parts from it (Lynch,
Maekawa and Tanie 1992). Nothing is fitted, and speeds do not matter.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .recorded_pushes import PATCH, TIPS, face_points, planar_before, recorded_pushes

STEP = 1e-4  # m, at most, that a tip goes in a step
_SWEEPS = 30  # over the tips of a step
_DONE = 1e-10  # m: what a sweep may still change


class Contact(NamedTuple):
    """Where a tip is by the edge of what it pushes, world axes.

    Attributes
    ----------
    gap : float
        From the edge, below zero inside [m].
    normal : (2,) array
        Of the edge, inwards.
    arm : (2,) array
        From the centre of mass to the tip [m].
    """

    gap: float
    normal: np.ndarray
    arm: np.ndarray


def motion_of(force: np.ndarray, arm: np.ndarray, reach: float) -> np.ndarray:
    """(3,): motion in x, y and yaw that a force at ``arm`` from the centre of mass brings, up to a factor."""
    moment = arm[0] * force[1] - arm[1] * force[0]
    return np.array([force[0], force[1], moment / reach**2])


def point_motion(motion: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """(2,): how a point at ``arm`` from the centre of mass moves."""
    return np.array([motion[0] - motion[2] * arm[1], motion[1] + motion[2] * arm[0]])


def step(contacts: list[Contact], ways: np.ndarray, reach: float, friction: float) -> np.ndarray:
    """(3,): motion in x, y [m] and yaw [rad] while each tip goes its way.

    Parameters
    ----------
    contacts : list of Contact
    ways : (tips, 2) array
        World axes [m].
    reach : float
        The load's mean distance from the centre of mass [m].
    friction : float
        Of the tips.
    """
    forces, motion = np.zeros((len(contacts), 2)), np.zeros(3)
    for _ in range(_SWEEPS if len(contacts) > 1 else 1):
        before = motion
        for k, (contact, way) in enumerate(zip(contacts, ways, strict=True)):
            others = motion - motion_of(forces[k], contact.arm, reach)
            missing = way - contact.gap * contact.normal - point_motion(others, contact.arm)
            forces[k] = _force(contact, missing, reach, friction)
            motion = others + motion_of(forces[k], contact.arm, reach)
        if np.abs(motion - before)[:2].max() < _DONE:
            break
    return motion


def _force(contact, missing, reach, friction):
    """Force (2,) of one tip that is to move its point by ``missing``; it may slide, and does not pull."""
    x, y = contact.arm
    c2 = reach**2
    give = np.array([[1.0 + y * y / c2, -x * y / c2], [-x * y / c2, 1.0 + x * x / c2]])
    normal = contact.normal
    along = np.array([-normal[1], normal[0]])
    force = np.linalg.solve(give, missing)
    pressed, dragged = float(force @ normal), float(force @ along)
    if abs(dragged) <= friction * pressed:
        return force
    if missing @ normal <= 0.0:
        return np.zeros(2)
    slides = normal + math.copysign(friction, dragged) * along
    return slides * (missing @ normal) / max(float(normal @ give @ slides), 1e-9)


def pushed(k: int, friction: float | None = None) -> np.ndarray:
    """(3,): where recorded push ``k`` takes the block: place of its centre of mass [m] and yaw [rad].

    What overlaps at first, by errors of frames, may keep to overlap as much.
    """
    pushes = recorded_pushes()
    friction = pushes.pusher_friction if friction is None else friction
    reach, tips = load_reach(int(pushes.support[k])), TIPS[min(int(pushes.kind[k]), 1)][:, :2]
    place, path = planar_before(k), _fine(pushes.paths[k])
    allowed = None
    last = _tip_places(path[0], tips)
    for pose in path[1:]:
        contacts = [_contact(place, tip, pushes) for tip in last]
        if allowed is None:
            allowed = [min(contact.gap, 0.0) for contact in contacts]
        contacts = [
            contact._replace(gap=contact.gap - own) for contact, own in zip(contacts, allowed, strict=True)
        ]
        now = _tip_places(pose, tips)
        place = place + step(contacts, now - last, reach, friction)
        last = now
    return place


def load_reach(support: int) -> float:
    """Mean distance of the block's load from its centre of mass [m]; its feet carry what statics says."""
    pushes = recorded_pushes()
    if support == PATCH:
        return float(np.linalg.norm(face_points() - pushes.com, axis=1).mean())
    arms = pushes.supports[support] - pushes.com
    shares = np.linalg.solve(np.vstack([arms.T, np.ones(3)]), [0.0, 0.0, 1.0])
    return float(shares @ np.linalg.norm(arms, axis=1))


def _fine(path):
    """A path's poses (n, 3), so near to each other that no tip goes further than a step's way."""
    far = np.linalg.norm(np.diff(path[:, 1:3], axis=0), axis=1) + 0.025 * np.abs(np.diff(path[:, 3]))
    way = np.concatenate([[0.0], np.cumsum(far)])
    marks = np.linspace(0.0, way[-1], math.ceil(way[-1] / STEP) + 1)
    times = np.interp(marks, way, path[:, 0])
    return np.column_stack([np.interp(times, path[:, 0], path[:, c]) for c in (1, 2, 3)])


def _turned(angle, vectors):
    c, s = math.cos(angle), math.sin(angle)
    return vectors @ np.array([[c, s], [-s, c]])


def _tip_places(pose, tips):
    return pose[:2] + _turned(pose[2], tips)


def _contact(place, tip, pushes):
    """Contact of a tip with the nearest edge of the block, whose centre of mass is at a place (3,)."""
    own = _turned(-place[2], tip - place[:2])
    corners = pushes.polygon - pushes.com
    along = np.roll(corners, -1, axis=0) - corners
    inward = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    gaps = np.einsum("ij,ij->i", corners - own, inward)
    edge = int(np.argmax(gaps))
    return Contact(float(gaps[edge]), _turned(place[2], inward[edge]), tip - place[:2])
