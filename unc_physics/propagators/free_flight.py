"""Free flight of single bodies over many steps at once: the same motion as step by step, to round-off."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..compiler import kernel
from ..spatial.layout import (
    ANGULAR_VELOCITY,
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    ERROR,
    POSITION,
    QUATERNION,
    VELOCITY,
    P,
    Q,
    V,
    W,
)
from ..spatial.rotation import exp, multiply, normalized, rotation_matrix


class Course(NamedTuple):
    """Factors of the state after some steps of free flight."""

    decay: float  # factor on the initial velocities at the end
    fall: float  # factor on gravity in the final velocity [s]
    #: reach, sink: factors on the initial velocity [s] and on gravity [s^2] in the displacement
    reach: float
    sink: float
    turn: float  # factor on the initial angular velocity in the rotation [s]
    #: weights, before: (n,): of each drift: its time, times the decay until then, and the sum of these
    #: over the drifts before it [s]
    weights: np.ndarray
    before: np.ndarray


@lru_cache(maxsize=64)
def course(dt: float, decay: float, steps: float, implicit: bool = False) -> Course:
    """Return the course of ``steps`` time steps of either integrator; the last one may be a part of a step.

    Both compute ``v' = decay v + dt g``. The explicit integrator travels at v, the implicit one at the mean
    of v and v', a parabola. Both turn at the angular velocity at the beginning of a step.
    """
    if steps == 0:
        nothing = np.zeros(0)
        return Course(1.0, 0.0, 0.0, 0.0, 0.0, nothing, nothing)
    if steps != int(steps):
        return _with_part_of_a_step(course(dt, decay, int(steps), implicit), dt, decay, steps % 1.0, implicit)
    powers = decay ** np.arange(steps + 1)
    falls = dt * np.concatenate([[0.0], np.cumsum(powers[:-1])])
    weights = dt * powers[:-1]
    ends = np.cumsum(weights)
    turn = float(ends[-1])
    if implicit:
        reach = 0.5 * dt * float((powers[:-1] + powers[1:]).sum())
        sink = 0.5 * dt * float((falls[:-1] + falls[1:]).sum())
    else:
        reach, sink = turn, dt * float(falls[:-1].sum())
    return Course(float(powers[-1]), float(falls[-1]), reach, sink, turn, weights, ends - weights)


def _with_part_of_a_step(whole, dt, decay, part, implicit):
    """Return a course followed by a ``part`` of a step of ``dt``."""
    h = part * dt
    slower = decay**part
    end, fall = slower * whole.decay, slower * whole.fall + h
    v, g = (0.5 * (whole.decay + end), 0.5 * (whole.fall + fall)) if implicit else (whole.decay, whole.fall)
    return Course(
        end,
        fall,
        whole.reach + h * v,
        whole.sink + h * g,
        whole.turn + h * whole.decay,
        np.append(whole.weights, h * whole.decay),
        np.append(whole.before, whole.turn),
    )


def course_of(world, steps: float) -> Course:
    """Return the course of ``steps`` time steps in a `dynamics.world.World`; the last one may be shorter."""
    return course(world.dt, world.decay, steps, world.implicit is not None)


class Flight(NamedTuple):
    """Free flight of a single body.

    Attributes: gravity (3,) [m/s^2], course, and the number of time steps, which may end with a part of a
    step.
    """

    gravity: np.ndarray
    course: Course
    steps: float


def after_flight(states: np.ndarray, flight: Flight) -> np.ndarray:
    """Return states (..., 13) after a free flight."""
    gravity, along = flight.gravity, flight.course
    ended = states.copy()
    v, w, q = states[..., VELOCITY], states[..., ANGULAR_VELOCITY], states[..., QUATERNION]
    ended[..., POSITION] += along.reach * v + along.sink * gravity
    ended[..., VELOCITY] = along.decay * v + along.fall * gravity
    ended[..., ANGULAR_VELOCITY] = along.decay * w
    half = 0.5 * along.turn * np.linalg.norm(w, axis=-1, keepdims=True)
    axis, scalar = 0.5 * along.turn * np.sinc(half / np.pi) * w, np.cos(half)
    turned = np.concatenate(
        [
            scalar * q[..., :3] + q[..., 3:] * axis + np.cross(axis, q[..., :3]),
            scalar * q[..., 3:] - np.sum(axis * q[..., :3], axis=-1, keepdims=True),
        ],
        axis=-1,
    )
    ended[..., QUATERNION] = turned / np.linalg.norm(turned, axis=-1, keepdims=True)
    return ended


def propagate_flight(states: np.ndarray, flight: Flight) -> None:
    """Move many states (S, B, 13) in place by a free flight; as `after_flight`, to round-off."""
    along = flight.course
    _fly(states, flight.gravity, along.decay, along.fall, along.reach, along.sink, along.turn)


@kernel
def _fly(states, gravity, decay, fall, reach, sink, turn):
    for n in range(len(states)):
        for i in range(states.shape[1]):
            x = states[n, i]
            turned = exp(turn * x[W], turn * x[W + 1], turn * x[W + 2])
            q = normalized(multiply(turned, (x[Q], x[Q + 1], x[Q + 2], x[Q + 3])))
            x[Q], x[Q + 1], x[Q + 2], x[Q + 3] = q
            for k in range(3):
                x[P + k] += reach * x[V + k] + sink * gravity[k]
                x[V + k] = decay * x[V + k] + fall * gravity[k]
                x[W + k] *= decay


def transition(state: np.ndarray, along: Course, exact: bool) -> np.ndarray:
    """Return the transition (12, 12) of errors of a state (13,) along a course.

    It is the product of the transitions of its steps, with the exact derivative of the drift or with Eq. 14.
    """
    R_transposed = rotation_matrix(state[QUATERNION]).T
    omega = state[ANGULAR_VELOCITY]
    speed = float(np.linalg.norm(omega))
    u = omega / speed if speed > 0.0 else omega
    cross = np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
    if exact:  # the mean of all rotations on the way, turned back: the left Jacobian transposed
        angle = along.turn * speed
        cosine = along.turn * np.sinc(angle / np.pi)
        sine = along.turn * 0.5 * angle * np.sinc(0.5 * angle / np.pi) ** 2
    else:
        cosine = np.sum(along.weights * np.cos(along.before * speed))
        sine = np.sum(along.weights * np.sin(along.before * speed))
    A = np.eye(ERROR)
    A[ERR_POSITION, ERR_VELOCITY] = along.reach * np.eye(3)
    A[ERR_ROTATION, ERR_ANGULAR_VELOCITY] = R_transposed @ (
        cosine * np.eye(3) + (along.turn - cosine) * np.outer(u, u) - sine * cross
    )
    A[ERR_VELOCITY, ERR_VELOCITY] = A[ERR_ANGULAR_VELOCITY, ERR_ANGULAR_VELOCITY] = along.decay * np.eye(3)
    return A
