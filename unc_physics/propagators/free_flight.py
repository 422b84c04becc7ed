"""Free flight of single bodies over many steps at once: the same motion as step by step, to round-off."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..compiler import kernel
from ..scene.scene import Scene
from ..spatial.layout import P, Q, V, W
from ..spatial.rotation import exp, multiply, normalized


class Course(NamedTuple):
    """Factors of the state after some steps of free flight."""

    decay: float  # factor on the initial velocities at the end
    fall: float  # factor on gravity in the final velocity [s]
    #: reach, sink: factors on the initial velocity [s] and on gravity [s^2] in the displacement
    reach: float
    sink: float
    turn: float  # factor on the initial angular velocity in the rotation [s]


@lru_cache(maxsize=64)
def course(dt: float, decay: float, steps: float, integrator: str) -> Course:
    """Return the course of ``steps`` time steps of an integrator; the last one may be a part of a step.

    Both compute ``v' = decay v + h g``. The explicit one has h = dt, travels at v, and turns at the angular
    velocity of the beginning. The implicit one has the exact mean of gravity's decay, travels at the mean of
    v and v', a parabola, and turns at the mean of both angular velocities.
    """
    if steps == 0:
        return Course(1.0, 0.0, 0.0, 0.0, 0.0)
    if steps != int(steps):
        whole = course(dt, decay, int(steps), integrator)
        return _with_part_of_a_step(whole, dt, decay, steps % 1.0, integrator)
    powers = decay ** np.arange(steps + 1)
    falls = _fall(dt, decay, integrator) * np.concatenate([[0.0], np.cumsum(powers[:-1])])
    turn = float(np.cumsum(dt * powers[:-1])[-1])
    if integrator != "explicit":
        reach = 0.5 * dt * float((powers[:-1] + powers[1:]).sum())
        sink = 0.5 * dt * float((falls[:-1] + falls[1:]).sum())
        turn = reach
    else:
        reach, sink = turn, dt * float(falls[:-1].sum())
    return Course(float(powers[-1]), float(falls[-1]), reach, sink, turn)


def _fall(dt, decay, integrator):
    """Return the factor on gravity in the change of velocity within a step [s]."""
    exact = integrator == "implicit" and decay < 1.0
    return dt * (1.0 - decay) / -math.log(decay) if exact else dt


def _with_part_of_a_step(whole, dt, decay, part, integrator):
    """Return a course followed by a ``part`` of a step of ``dt``."""
    h = part * dt
    slower = decay**part
    end, fall = slower * whole.decay, slower * whole.fall + _fall(h, slower, integrator)
    v, g, w = whole.decay, whole.fall, whole.decay
    if integrator != "explicit":
        v, g = 0.5 * (whole.decay + end), 0.5 * (whole.fall + fall)
        w = v
    return Course(end, fall, whole.reach + h * v, whole.sink + h * g, whole.turn + h * w)


def course_of(scene: Scene, steps: float) -> Course:
    """Return the course of ``steps`` time steps in a scene; the last one may be shorter."""
    return course(scene.dt, scene.decay, steps, scene.integrator)


def propagate_flight(states: np.ndarray, gravity: np.ndarray, along: Course) -> None:
    """Move many states (S, B, 13) in place by a free flight of single bodies."""
    _fly(states, gravity, along.decay, along.fall, along.reach, along.sink, along.turn)


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
