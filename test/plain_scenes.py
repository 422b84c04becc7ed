"""Bodies of known shape, their worlds, states and beliefs, and rollouts of one state: for tests of laws,
whatever the integrator.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from unc_physics import Belief, Plane, Scene, make_propagator, predict
from unc_physics.shapes import pieces
from unc_physics.shapes.packing_file import SpherePacking

G = 9.81
FLOOR = Plane(name="floor")
STEPS = (1 / 120, 1 / 240, 1 / 1000)  # s
_ONE = make_propagator("monte_carlo", samples=1)
at_steps = pytest.mark.parametrize("dt", STEPS, ids=lambda dt: f"{round(1 / dt)}Hz")


def packing(name, centers, radii, inertia, **more):
    """A packing (body frame) with its inertia per unit mass; its balls are its shape, or ``pieces``."""
    centers, radii = np.asarray(centers, float), np.asarray(radii, float)
    reach = float(np.max(np.linalg.norm(centers, axis=1) + radii))
    return SpherePacking(
        name=name,
        centers=centers,
        radii=radii,
        inertia=inertia,
        volume=1e-3,
        origin=np.zeros(3),
        bounding_radius=reach,
        **more,
    )


def ball(radius):
    """A packing of a single sphere, with the inertia of a solid one."""
    return packing("ball", [[0, 0, 0]], [radius], 0.4 * radius**2 * np.eye(3))


def box(*size):
    """A model of a solid box, in which eight balls stand for the explicit step's spheres."""
    a, b, c = np.square(size)
    radius, piece = 0.5 * min(size), pieces.box(size)
    corners = np.sign(piece.outline()) * (0.5 * np.array(size) - radius)
    return packing("box", corners, [radius] * 8, np.diag([b + c, a + c, a + b]) / 12.0, pieces=(piece,))


BALL = ball(0.05)
_GRID = [(x, y, z) for x in np.arange(-3, 4) * 0.02 for y in np.arange(-2, 3) * 0.02 for z in (-0.01, 0.01)]
BLOCK = packing(
    "block", _GRID, [0.01] * len(_GRID), np.diag([0.1**2 + 0.04**2, 0.14**2 + 0.04**2, 0.14**2 + 0.1**2]) / 12
)
PLATE = packing(  # far from a sphere's inertia
    "plate",
    [(x, y, 0) for x in (-0.2, 0, 0.2) for y in (-0.1, 0, 0.1)],
    [0.02] * 9,
    np.diag([0.004, 0.013, 0.017]),
)


_LAWS = {"restitution": 0.0, "overlap": "keep"}


def world(*bodies, environment=(FLOOR,), **physics):
    """A robot's world on a floor: friction 0.5, no rebound, no model errors, states as they are given."""
    return Scene.everyday(bodies, exact=True, environment=environment, **_LAWS | physics)


def state(position=(0, 0, 0), velocity=(0, 0, 0), spin=(0, 0, 0), orientation=(0, 0, 0, 1)):
    """A state (13,)."""
    return np.concatenate([position, velocity, orientation, spin]).astype(float)


def independent(*states, position=0.0, velocity=0.0, rotation=0.0, spin=0.0):
    """A belief about bodies at states (13,), all with these standard deviations, of all axes or of three."""
    std = np.concatenate([np.broadcast_to(one, 3) for one in (position, velocity, rotation, spin)])
    return Belief(np.array(states), np.tile(np.diag(std.astype(float) ** 2), (len(states), 1, 1)))


def turned(*rotation_vector):
    """Quaternion of a rotation vector [rad]."""
    return Rotation.from_rotvec(rotation_vector).as_quat()


def run(scene, x, time):
    """The state (B, 13) some seconds after the state ``x``."""
    (end,) = course(scene, x, [time])
    return end


def course(scene, x, times):
    """States (T, B, 13) of one rollout that begins at ``x``, at ascending times [s], each in whole steps."""
    start = np.array(x, float).reshape(-1, 13)
    steps = np.round(np.asarray(times) / scene.dt).astype(int)
    marks = [int(n) for n in dict.fromkeys(steps) if n > 0]
    found = predict(scene, Belief.exact(start, scene.moving), _ONE, times=[n * scene.dt for n in marks])
    states = {n: snapshot.samples[0] for n, snapshot in zip(marks, found.snapshots, strict=True)}
    return np.array([states[n] if n else start for n in steps])


def energy(scene, x):
    """Kinetic and potential energy of all moving bodies at a state (B, 13) [J]."""
    total = 0.0
    for k in scene.moving:
        body, s = scene.bodies[k], x[k]
        spin = Rotation.from_quat(s[6:10]).inv().apply(s[10:])
        total += (
            0.5 * body.mass * (s[3:6] @ s[3:6] + spin @ body.model.inertia @ spin)
            - body.mass * scene.gravity @ s[:3]
        )
    return total


def tumbling_orientation(inertia, spin, time):
    """Quaternion (x, y, z, w) of a body that turns freely from the identity, by Euler's equations."""

    def rate(_, y):
        q, w, turn = y[:3], y[3], y[4:]
        turning = np.cross(inertia * turn, turn) / inertia
        return np.concatenate([0.5 * (w * turn + np.cross(q, turn)), [-0.5 * q @ turn], turning])

    start = np.concatenate([[0.0, 0.0, 0.0, 1.0], spin])
    return solve_ivp(rate, (0.0, time), start, method="DOP853", rtol=1e-12, atol=1e-13).y[:4, -1]


def momenta(scene, x):
    """Linear and angular momentum about the origin (2, 3) at a state (B, 13)."""
    linear, angular = np.zeros(3), np.zeros(3)
    for body, s in zip(scene.bodies, x, strict=True):
        R = Rotation.from_quat(s[6:10]).as_matrix()
        linear += body.mass * s[3:6]
        angular += body.mass * (np.cross(s[:3], s[3:6]) + R @ body.model.inertia @ R.T @ s[10:])
    return linear, angular


def lowest(model):
    """Height of the lowest point of a model's shape in its body frame [m], relative to its centre of mass."""
    return -float(pieces.farthest(model.pieces, np.array([[0.0, 0.0, -1.0]]))[0])
