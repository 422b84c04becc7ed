"""Motions with known answers: closed forms, and ODEs integrated to round-off by SciPy.

None of them uses the simulator. Angles are in radians, all other units are SI.
"""

from __future__ import annotations

import math
from itertools import count

import numpy as np
from scipy.integrate import solve_ivp

GRAVITY = 9.81  # m/s^2
_ODE = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14}
#: Moment of inertia of a solid ball, per mass and squared radius.
BALL_INERTIA = 0.4


def tumbling_orientation(inertia: np.ndarray, angular_velocity: np.ndarray, time: float) -> np.ndarray:
    """Return the quaternion of a body that turns freely from the identity.

    Parameters
    ----------
    inertia : (3,) array
        Principal moments along the body axes, in any common unit.
    angular_velocity : (3,) array
        At time 0 [rad/s].
    time : float
        [s]

    Returns
    -------
    (4,) array
        ``(x, y, z, w)``, from the body frame to the world frame.
    """

    def rate(_, y):
        q, w, turn = y[:3], y[3], y[4:]  # vector part, scalar part, angular velocity in body axes
        return np.concatenate(
            [
                0.5 * (w * turn + np.cross(q, turn)),
                [-0.5 * q @ turn],
                np.cross(inertia * turn, turn) / inertia,
            ]
        )

    start = np.concatenate([[0.0, 0.0, 0.0, 1.0], angular_velocity])
    end = solve_ivp(rate, (0.0, time), start, **_ODE).y[:4, -1]
    return end / np.linalg.norm(end)


def incline_distance(slope: float, inertia: float, time: float) -> float:
    """Return the distance that a round body rolls from rest down a slope without slip [m].

    Parameters
    ----------
    slope : float
        Angle of the slope [rad].
    inertia : float
        Moment of inertia about the axis, per mass and squared radius.
    time : float
        [s]
    """
    return 0.5 * GRAVITY * math.sin(slope) / (1.0 + inertia) * time**2


def dome_angle(radius: float, angle: float, time: float) -> float:
    """Return the angle from the vertical of a ball that rolls from rest down a dome [rad].

    Parameters
    ----------
    radius : float
        Distance of the ball's centre from the dome's centre [m].
    angle : float
        At time 0 [rad]; the ball rolls without slip and stays in contact.
    time : float
        [s]
    """
    gain = GRAVITY / (radius * (1.0 + BALL_INERTIA))
    end = solve_ivp(lambda _, y: (y[1], gain * math.sin(y[0])), (0.0, time), (angle, 0.0), **_ODE)
    return float(end.y[0, -1])


def skid_distance(speed: float, friction: float, time: float) -> float:
    """Return the distance of a ball that begins to slide without spin, and rolls in the end [m]."""
    deceleration = friction * GRAVITY
    sliding = min(time, speed / (deceleration * (1.0 + 1.0 / BALL_INERTIA)))
    rolling_speed = speed / (1.0 + BALL_INERTIA)
    return speed * sliding - 0.5 * deceleration * sliding**2 + rolling_speed * (time - sliding)


def sliding_distance(speed: float, friction: float, time: float) -> float:
    """Return the distance of a block that friction stops [m]."""
    deceleration = friction * GRAVITY
    sliding = min(time, speed / deceleration)
    return speed * sliding - 0.5 * deceleration * sliding**2


def bouncing_height(height: float, restitution: float, time: float) -> float:
    """Return the height above its rest of a point mass that falls from rest and bounces [m]."""
    begin, speed = -math.sqrt(2.0 * height / GRAVITY), math.sqrt(2.0 * GRAVITY * height)
    for _ in count():  # each flight begins with ``speed`` upwards at the time ``begin``
        flight = 2.0 * speed / GRAVITY
        if begin + flight >= time:
            passed = time - begin
            return speed * passed - 0.5 * GRAVITY * passed**2
        begin, speed = begin + flight, restitution * speed
    raise AssertionError


def rocking_tilt(width: float, height: float, tilt: float, time: float) -> float:
    """Return the tilt of Housner's rocking block [rad].

    Parameters
    ----------
    width, height : float
        Of the uniform block [m].
    tilt : float
        At time 0, where the block is at rest on its lower right edge [rad].
    time : float
        [s]

    Notes
    -----
    The block turns about one edge at a time. At an impact the angular momentum about the new edge is kept, so
    nothing bounces (Housner 1963).
    """
    across, up = 0.5 * width, 0.5 * height
    gyration = (width**2 + height**2) / 12.0
    reach, lean = math.hypot(across, up), math.atan2(across, up)
    standing = gyration + 0.25 * height**2
    kept = (standing - across**2) / (standing + across**2)

    def rate(_, y):
        return y[1], -reach * math.sin(lean - y[0]) * GRAVITY / (gyration + reach**2)

    def lands(_, y):
        return y[0]

    lands.terminal, lands.direction = True, -1.0
    begin, state, side = 0.0, (tilt, 0.0), 1.0
    while True:
        found = solve_ivp(rate, (begin, time), state, events=lands, **_ODE)
        if not len(found.t_events[0]):
            return side * float(found.y[0, -1])
        begin, side = float(found.t_events[0][0]), -side
        state = (0.0, -kept * float(found.y_events[0][0][1]))
