"""Bodies of exact shape for tests of the everyday step, and where they are."""

import math

import numpy as np
from plain_scenes import FLOOR, course, run, state, world  # noqa: F401  (for tests of laws)
from scipy.spatial.transform import Rotation

from unc_physics import Belief, BodyBelief, Box, Plane, RigidBody, SpherePacking
from unc_physics.shapes import pieces as shapes

UM, MM, MRAD = 1e6, 1e3, 1e3
CAN = 0.038, 0.11  # m, radius and length of a can


def model(pieces, inertia, mass=None):
    """Return a model of pieces with its inertia per unit mass, (3,) or (3, 3); small spheres stand for it."""
    points = np.concatenate([piece.outline() for piece in pieces])
    radii = np.full(len(points), max(1e-3, *(piece.rounding for piece in pieces)))
    return SpherePacking(
        name="model",
        centers=points,
        radii=radii,
        inertia=np.diag(inertia) if np.ndim(inertia) == 1 else inertia,
        volume=1e-3,
        origin=np.zeros(3),
        bounding_radius=float((np.linalg.norm(points, axis=1) + radii).max()) * 1.001,
        mass=mass,
        pieces=pieces,
    )


def solid_ball(name, radius, mass, **surface):
    """Return a solid ball."""
    return RigidBody(name, model([shapes.ball(radius)], [0.4 * radius**2] * 3), mass, **surface)


def solid_box(name, size, mass, **surface):
    """Return a solid box."""
    a, b, c = np.square(size)
    return RigidBody(name, model([shapes.box(size)], np.array([b + c, a + c, a + b]) / 12), mass, **surface)


def solid_cylinder(name, radius, length, mass, **surface):
    """Return a solid cylinder along z."""
    across = radius**2 / 4 + length**2 / 12
    inertia = [across, across, radius**2 / 2]
    return RigidBody(name, model([shapes.cylinder(radius, length)], inertia), mass, **surface)


def belief_of(scene, **states):
    """Return the belief of bodies with these fields of `BodyBelief`."""
    return Belief.of(scene, {name: BodyBelief(**fields) for name, fields in states.items()})


def about(axis, angle):
    """Return the quaternion of a rotation about an axis [rad]."""
    axis = np.asarray(axis, float)
    return Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_quat()


SIDEWAYS = about((1, 0, 0), math.pi / 2)  # a body's z axis along -y


def product(*quaternions):
    """Return the product of quaternions; the last one rotates first."""
    q = Rotation.identity()
    for other in quaternions:
        q = q * Rotation.from_quat(other)
    return q.as_quat()


def tilt(x):
    """Return the angle of a body's z axis to the vertical [rad]."""
    return math.acos(min(1.0, max(-1.0, Rotation.from_quat(x[6:10]).as_matrix()[2, 2])))


def turn_between(x, y):
    """Return the angle of the rotation between two states (13,) [rad]."""
    return (Rotation.from_quat(x[6:10]).inv() * Rotation.from_quat(y[6:10])).magnitude()


def can(name="can"):
    """Return a can as a solid cylinder."""
    return solid_cylinder(name, *CAN, 0.455)


def slab(size, position, **surface):
    """Return a fixed box."""
    return Box(size, position, **surface)


def slope_of(angle):
    """Return the plane through the origin that descends along x at an angle [rad], and its normal."""
    normal = np.array([math.sin(angle), 0.0, math.cos(angle)])
    return Plane(normal, name="slope"), normal


def rolling(speed, radius, position=None, orientation=SIDEWAYS):
    """Return the state of a round body with its axis along y that rolls along x."""
    position = (0, 0, radius) if position is None else position
    return state(position, (speed, 0, 0), (0, speed / radius, 0), orientation)


def base_radius(packing):
    """Return the largest radius at which a model of lathes touches the floor it stands on [m]."""
    corners = np.concatenate([piece.profile + [0, piece.origin[2]] for piece in packing.pieces])
    return float(corners[corners[:, 1] < corners[:, 1].min() + 1e-6, 0].max())
