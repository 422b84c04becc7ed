"""Cases for the order of accuracy: one rollout each, with an error against a known answer.

Bodies are a ball, a box and a cylinder, which all engines have. `order_references` has the answers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from unc_physics import Belief, Plane, RigidBody, Scene, Sphere, SpherePacking, make_propagator, predict
from unc_physics.physics.everyday.columns import SLOP
from unc_physics.shapes import pieces as shapes
from unc_physics.spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY

from .engines import PEERS
from .methods import OURS
from .order_references import (
    BALL_INERTIA,
    GRAVITY,
    bouncing_height,
    dome_angle,
    incline_distance,
    rocking_tilt,
    skid_distance,
    sliding_distance,
    tumbling_orientation,
)

DEPTH = SLOP  # m, which contacts at rest keep
ROUND_OFF = 1e-9  # m or rad, of some thousand steps


class Case(NamedTuple):
    """A rollout with a known final state.

    Attributes
    ----------
    title : str
    unit : str
        Unit of the error.
    order : int or None
        Required order; None if the motion is not smooth.
    horizon : float
        [s]; a multiple of 0.05 s, so that all time steps fit in.
    scene : Scene
        Its time step is the caller's.
    start : (B, 13) array
    measure : callable
        Function of the final states (B, 13) that is compared.
    answer : float or array
        The exact value of ``measure``.
    floor : float
        Smaller errors do not depend on the time step.
    reason : str
        Cause of the floor.
    reference : str
        Source of the answer.
    geometry : str
        Geometry of the bodies in other engines.
    """

    title: str
    unit: str
    order: int | None
    horizon: float
    scene: Scene
    start: np.ndarray
    measure: Callable[[np.ndarray], float | np.ndarray]
    answer: float | np.ndarray
    floor: float
    reason: str
    reference: str
    geometry: str = "primitive"

    def error(self, end: np.ndarray) -> float:
        """Return the error of the states (B, 13) at the end.

        Of several bodies with a point each, (B, 3), the farthest counts.
        """
        return float(np.linalg.norm(np.atleast_1d(self.measure(end) - self.answer), axis=-1).max())


def end_states(case: Case, engine: str) -> np.ndarray:
    """Return the states (B, 13) at the end of one rollout in an engine."""
    if engine == OURS:
        propagator = make_propagator("monte_carlo", samples=1)
        return predict(case.scene, Belief.exact(case.start), propagator, case.horizon).belief.mean
    peer = PEERS[engine](case.scene, case.geometry)
    try:
        if case.scene.restitution and hasattr(peer, "set_restitution"):
            peer.set_restitution(case.scene.restitution)
        return peer.run(case.start, round(case.horizon / case.scene.dt))
    finally:
        peer.close()


def flight_path(dt: float) -> Case:
    """Return the position of a body that flies freely."""
    case = _flight(dt)
    end = case.start[0, POSITION] + case.start[0, VELOCITY] * case.horizon
    return case._replace(
        title="flight: position",
        unit="m",
        measure=lambda x: x[0, POSITION],
        answer=end - np.array([0.0, 0.0, 0.5 * GRAVITY * case.horizon**2]),
        reference="parabola",
    )


def flight_tumbling(dt: float) -> Case:
    """Return the orientation of a body that flies freely, about its middle axis of inertia."""
    case = _flight(dt)
    body = case.scene.bodies[0].model
    exact = Rotation.from_quat(
        tumbling_orientation(np.diag(body.inertia), case.start[0, ANGULAR_VELOCITY], case.horizon)
    )
    return case._replace(
        title="flight: orientation",
        unit="rad",
        measure=lambda x: (exact.inv() * Rotation.from_quat(x[0, QUATERNION])).as_rotvec(),
        answer=np.zeros(3),
        reference="Euler's equations by DOP853",
    )


def rolling_ball(dt: float) -> Case:
    """Return a ball that rolls from rest down a spherical dome."""
    ball, dome, angle, horizon = 0.1, 0.4, 0.1, 0.5
    distance = dome + ball
    exact = dome_angle(distance, angle, horizon)
    sunk = dome_angle(distance * (1.0 + _arm_loss(ball, BALL_INERTIA) + DEPTH / distance), angle, horizon)
    return Case(
        "rolling: ball on a dome",
        "m",
        2,
        horizon,
        _scene([_ball(ball)], dt, environment=[Sphere(dome)], friction=1.0, restitution=0.0),
        _start((distance * math.sin(angle), 0.0, distance * math.cos(angle))),
        lambda x: distance * math.atan2(x[0, 0], x[0, 2]),
        distance * exact,
        distance * abs(sunk - exact),
        "depth of contact, which shortens the arm",
        "rolling without slip, by DOP853",
        geometry="spheres",
    )


def rolling_can(dt: float) -> Case:
    """Return a can that rolls from rest down a slope."""
    radius, length, inertia = 0.038, 0.11, 0.5
    slope, horizon = math.radians(10.0), 0.5
    across = (3.0 * radius**2 + length**2) / 12.0
    can = _model(
        "can",
        shapes.cylinder(radius, length),
        (across, across, inertia * radius**2),
        np.array([radius, radius, 0.5 * length]),
    )
    exact = incline_distance(slope, inertia, horizon)
    return Case(
        "rolling: can on a slope",
        "m",
        2,
        horizon,
        _scene(
            [RigidBody("can", can, 0.45)],
            dt,
            environment=[Plane()],
            friction=0.5,
            restitution=0.0,
            gravity=(GRAVITY * math.sin(slope), 0.0, -GRAVITY * math.cos(slope)),
        ),
        _start((0.0, 0.0, radius), rotation=(0.5 * math.pi, 0.0, 0.0)),
        lambda x: x[0, 0],
        exact,
        exact * _arm_loss(radius, inertia),
        "depth of contact, which shortens the arm",
        "g sin a / (1 + I / m R^2)",
    )


def skidding_ball(dt: float) -> Case:
    """Return a ball that slides at first, and rolls in the end."""
    radius, speed, friction, horizon = 0.1, 3.0, 0.3, 0.5
    exact = skid_distance(speed, friction, horizon)
    return Case(
        "sliding: ball until it rolls",
        "m",
        1,
        horizon,
        _scene([_ball(radius)], dt, environment=[Plane()], friction=friction, restitution=0.0),
        _start((0.0, 0.0, radius), velocity=(speed, 0.0, 0.0)),
        lambda x: x[0, 0],
        exact,
        friction * DEPTH + exact * _arm_loss(radius, BALL_INERTIA),
        "depth of contact, which shortens the arm",
        "5/7 of the speed is left",
        geometry="spheres",
    )


def sliding_block(dt: float) -> Case:
    """Return a block that friction stops."""
    size, speed, friction, horizon = (0.1, 0.1, 0.05), 1.0, 0.3, 0.5
    return Case(
        "sliding: block until it stops",
        "m",
        1,
        horizon,
        _scene([_block("block", size)], dt, environment=[Plane()], friction=friction, restitution=0.0),
        _start((0.0, 0.0, 0.5 * size[2]), velocity=(speed, 0.0, 0.0)),
        lambda x: x[0, 0],
        sliding_distance(speed, friction, horizon),
        friction * DEPTH,
        "friction times depth of contact",
        "v^2 / (2 mu g)",
    )


def bouncing_ball(dt: float) -> Case:
    """Return a ball between its second and its third bounce."""
    radius, height, restitution, horizon = 0.02, 0.2, 0.5, 0.45
    return Case(
        "bouncing: ball, e = 0.5",
        "m",
        None,
        horizon,
        _scene([_ball(radius)], dt, environment=[Plane()], friction=0.5, restitution=restitution),
        _start((0.0, 0.0, radius + height)),
        lambda x: x[0, 2] - radius,
        bouncing_height(height, restitution, horizon),
        DEPTH,
        "depth of contact",
        "parabolas",
        geometry="spheres",
    )


def rocking_block(dt: float) -> Case:
    """Return a block that rocks, after its first impact."""
    size = (0.04, 0.08, 0.2)
    width, height = size[0], size[2]
    tilt, horizon = 0.1, 0.3
    across, up = 0.5 * width, 0.5 * height
    place = (
        up * math.sin(tilt) - across * math.cos(tilt),
        0.0,
        up * math.cos(tilt) + across * math.sin(tilt),
    )
    return Case(
        "rocking: block from 0.1 rad",
        "rad",
        None,
        horizon,
        _scene([_block("block", size)], dt, environment=[Plane()], friction=1.0, restitution=0.0),
        _start(place, rotation=(0.0, tilt, 0.0)),
        lambda x: Rotation.from_quat(x[0, QUATERNION]).as_rotvec()[1],
        rocking_tilt(width, height, tilt, horizon),
        DEPTH / width,
        "depth of contact over the width",
        "Housner's impact, ODE by DOP853",
    )


def standing_stack(dt: float) -> Case:
    """Return five cubes on each other, which should stay there."""
    side, number = 0.05, 5
    bodies = [_block(f"block {k}", (side, side, side)) for k in range(number)]
    start = np.concatenate([_start((0.0, 0.0, (k + 0.5) * side)) for k in range(number)])
    return Case(
        "stacking: five cubes",
        "m",
        None,
        1.0,
        _scene(bodies, dt, environment=[Plane()], friction=0.5, restitution=0.0),
        start,
        lambda x: x[:, POSITION],
        start[:, POSITION].copy(),
        number * DEPTH,
        "depth of all contacts",
        "nothing moves",
    )


CASES = {
    "flight_path": flight_path,
    "flight_tumbling": flight_tumbling,
    "rolling_ball": rolling_ball,
    "rolling_can": rolling_can,
    "skidding_ball": skidding_ball,
    "sliding_block": sliding_block,
    "bouncing_ball": bouncing_ball,
    "rocking_block": rocking_block,
    "standing_stack": standing_stack,
}


def _flight(dt):
    start = _start((0.0, 0.0, 0.0), velocity=(0.5, 0.0, 2.0), angular_velocity=(1.0, 5.0, 1.0))
    return Case(
        title="",
        unit="",
        order=2,
        horizon=1.0,
        scene=_scene([_block("block", (0.03, 0.06, 0.1))], dt),
        start=start,
        measure=np.asarray,
        answer=0.0,
        floor=ROUND_OFF,
        reason="round-off",
        reference="",
    )


def _arm_loss(radius, inertia):
    """Relative change of a rolling body's acceleration or speed where its arm is shorter by `DEPTH`."""
    return 2.0 * inertia / (1.0 + inertia) * DEPTH / radius


def _scene(bodies, dt, **given):
    return Scene.everyday(bodies, exact=True, dt=dt, **given)


def _start(position, rotation=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0), angular_velocity=(0.0, 0.0, 0.0)):
    """State (1, 13) of one body; ``rotation`` is a rotation vector."""
    state = np.zeros((1, 13))
    state[0, POSITION], state[0, VELOCITY], state[0, ANGULAR_VELOCITY] = position, velocity, angular_velocity
    state[0, QUATERNION] = Rotation.from_rotvec(rotation).as_quat()
    return state


def _ball(radius):
    """A uniform ball of 500 kg/m^3."""
    inertia = [BALL_INERTIA * radius**2] * 3
    model = _model("ball", shapes.ball(radius), inertia, np.full(3, radius))
    return RigidBody("ball", model, 500.0 * 4.0 / 3.0 * math.pi * radius**3)


def _block(name, size):
    """A uniform block of 500 kg/m^3."""
    squares = np.array(size) ** 2
    model = _model("block", shapes.box(size), (squares.sum() - squares) / 12.0, 0.5 * np.array(size))
    return RigidBody(name, model, 500.0 * float(np.prod(size)))


def _model(name, piece, inertia, half):
    """A piece with moments (3,) per mass, in a box of half sides (3,), and the largest sphere in it."""
    return SpherePacking(
        name=name,
        centers=np.zeros((1, 3)),
        radii=np.array([np.min(half)]),
        inertia=np.diag(np.array(inertia, float)),
        volume=float(8.0 * np.prod(half)),
        origin=np.zeros(3),
        bounding_radius=float(np.linalg.norm(half)),
        bounds=np.array([-half, half]),
        pieces=[piece],
    )
