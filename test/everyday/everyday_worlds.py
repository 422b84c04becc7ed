"""Bodies of exact shape, their worlds, and single rollouts of the everyday step by the public interface."""

import math
import os

import numpy as np
from scipy.spatial.transform import Rotation

from unc_physics import Belief, Plane, RigidBody, Scene, SpherePacking, make_propagator, predict
from unc_physics.shapes import pieces as shapes

INTEGRATOR = os.environ.get("INTEGRATOR", "contact")
STEPS = (1 / 120, 1 / 240, 1 / 1000)  # s
FLOOR = Plane(name="floor")
_ONE = make_propagator("monte_carlo", samples=1)


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


def world(*bodies, environment=(FLOOR,), **physics):
    """Return a scene of the everyday step on a floor: friction .5, restitution 0, no model errors."""
    laws = {"integrator": INTEGRATOR, "restitution": 0.0, "overlap": "keep"} | physics
    return Scene.everyday(bodies, exact=True, environment=environment, **laws)


def course(scene, start, times):
    """Return the states (T, B, 13) of one rollout at ascending times [s], each rounded to whole steps."""
    start = np.array(start, float).reshape(-1, 13)
    steps = np.round(np.asarray(times) / scene.dt).astype(int)
    marks = [int(n) for n in dict.fromkeys(steps) if n > 0]
    found = predict(scene, Belief.exact(start, scene.moving), _ONE, times=[n * scene.dt for n in marks])
    states = {n: snapshot.samples[0] for n, snapshot in zip(marks, found.snapshots, strict=True)}
    return np.array([states[n] if n else start for n in steps])


def run(scene, start, time):
    """Return the states (B, 13) of one rollout at a time [s]."""
    return course(scene, start, [time])[0]


def about(axis, angle):
    """Return the quaternion of a rotation about an axis [rad]."""
    axis = np.asarray(axis, float)
    return Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_quat()


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
