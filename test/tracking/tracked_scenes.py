"""Scenes and measurements for tests of the tracker."""

from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from unc_physics import (
    Belief,
    BodyBelief,
    ContactNoise,
    Plane,
    PoseMeasurement,
    RigidBody,
    Scene,
    make_propagator,
    rounded_box,
)
from unc_physics.tracking.ensemble import Gates
from unc_physics.tracking.hypotheses import Filter, new_track
from unc_physics.tracking.members import first_members
from unc_physics.tracking.state import State, TrackedScene
from unc_physics.tracking.symmetry import NONE

#: Standard deviations of a measured pose [m], [rad].
NOISE = np.r_[np.full(3, 2e-3), np.full(3, 0.02)]
SIDE = 0.08


@cache
def box():
    """The model of a cube of 8 cm."""
    return rounded_box((SIDE, SIDE, SIDE), 0.004)


def bodies(count):
    return [RigidBody(f"box{k}", box(), 0.3) for k in range(count)]


def table_scene(count=1, **changes):
    """Boxes above a table."""
    return Scene.everyday(bodies(count), exact=True, environment=[Plane(offset=0.0, name="table")], **changes)


def free_scene(count=1, **changes):
    """Boxes that fly freely, without gravity."""
    return Scene(bodies(count), integrator="implicit", gravity=(0.0, 0.0, 0.0), dt=1.0 / 240.0, **changes)


def belief_of(scene, **known):
    """A belief by names; 3 mm, 0.02 rad, 0.05 m/s and 0.3 rad/s where nothing else is said."""
    usual = {
        "position_std": 0.003,
        "orientation_std": 0.02,
        "linear_velocity_std": 0.05,
        "angular_velocity_std": 0.3,
    }
    return Belief.of(scene, {name: BodyBelief(**(usual | given)) for name, given in known.items()})


def pose(position, quaternion=(0.0, 0.0, 0.0, 1.0)):
    return np.r_[position, quaternion]


def measured(state, rng, noise=NOISE):
    """A measurement of a state (13,), or of a pose (7,), with noise."""
    x = np.asarray(state, float)
    q = x[6:10] if len(x) == 13 else x[3:]
    e = noise * rng.standard_normal(6)
    turned = Rotation.from_quat(q) * Rotation.from_rotvec(e[3:])
    return PoseMeasurement(pose(x[:3] + e[:3], turned.as_quat()), noise)


def angle(a, b):
    """Angle between two quaternions [rad]."""
    return (Rotation.from_quat(a).inv() * Rotation.from_quat(b)).magnitude()


def begun(scene, samples=64, seed=0, **known):
    """A tracked scene and its state at time 0."""
    belief = belief_of(scene, **known)
    propagator = make_propagator("monte_carlo", samples=samples, seed=seed)
    tracked = TrackedScene(scene, {}, propagator, ContactNoise(), Gates(), 0.0)
    tracks = tuple(
        new_track(Filter(np.array(belief.mean[body]), np.array(P), 0.0), NONE)
        for body, P in zip(belief.moving, belief.blocks, strict=True)
    )
    carry = first_members(tracked, belief, tracks)
    return tracked, State(carry, np.zeros(len(scene.bodies)), tracks, np.eye(len(tracks), dtype=bool))
