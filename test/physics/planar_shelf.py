"""A body that slides upright off a shelf's edge, in the plane: an independent solution by SciPy.

The shelf's edge touches the flat base. Let s be the distance of the edge ahead of the centre along the base,
h the height of the centre above it, a the forward tilt, and u = -ds/dt the speed at which the base slides
over the edge. With the normal force N and friction f along the base, Newton and Euler give

    m (s a'' - 2 u a' - h a'^2) = N - m g cos a
    m (u' + h a'' + s a'^2) = -f + m g sin a
    I a'' = -N s + f h

The base slides with f = mu N against u, or sticks with u = 0 as long as |f| <= mu N. The body leaves where
N = 0, or where the end of its base passes the edge.
"""

import math

import numpy as np
from plain_scenes import G
from scipy.integrate import solve_ivp

MOST = 3.0  # s, within which every case leaves


def spin_off_shelf(height, half_base, moment, friction, speed, distance):
    """Return the spin in free flight of a body that slides off a shelf [rad/s].

    Parameters
    ----------
    height, half_base : float
        Of the centre of mass above the base, and half the length of the base [m].
    moment : float
        Moment of inertia per unit mass about the axis of tipping [m^2].
    friction, speed : float
        Coefficient, and speed [m/s] at the start.
    distance : float
        From the centre to the edge at the start [m].

    Returns
    -------
    float
        NaN if the body stays on the shelf.
    """
    body = height, moment, friction
    # it tips when the support's middle, friction times height ahead of the centre, passes the edge
    left = speed**2 - 2 * friction * G * (distance - friction * height)
    if left <= 0.0:
        return math.nan
    y, slip, start = np.array([friction * height, math.sqrt(left), 0.0, 0.0]), 1, 0.0
    while start < MOST:
        events = (
            _falling(lambda t, y, slip=slip: _motion(y, slip, *body)[1]),
            _falling(lambda t, y: y[0] + half_base),
            _falling(lambda t, y, slip=slip: slip * y[1] if slip else _grip(y, *body)),
        )
        path = solve_ivp(
            lambda t, y, slip=slip: _motion(y, slip, *body)[0],
            (start, MOST),
            y,
            method="DOP853",
            rtol=1e-9,
            atol=1e-11,
            events=events,
        )
        start, y = path.t[-1], path.y[:, -1]
        if len(path.t_events[0]) or len(path.t_events[1]):
            return float(y[3])
        y[1] = 0.0
        friction = _motion(y, 0, *body)[2]
        slips = slip == 0 or _grip(y, *body) < 0.0
        slip = int(math.copysign(1, friction)) if slips else 0
    return math.nan


def _falling(function):
    """Return an event that ends the integration where a function falls below zero."""
    function.terminal, function.direction = True, -1
    return function


def _motion(y, slip, h, moment, mu):
    """Return the rates of (s, u, a, a'), N and f per mass, while the base slides (1, -1) or sticks (0)."""
    s, u, a, w = y
    if slip:
        friction = slip * mu
        normal = (G * math.cos(a) - 2 * u * w - h * w * w) / (1 + s * (s - friction * h) / moment)
        turn = normal * (friction * h - s) / moment
        along = G * math.sin(a) - friction * normal - h * turn - s * w * w
        return np.array([-u, along, w, turn]), normal, friction * normal
    turn = G * (h * math.sin(a) - s * math.cos(a)) / (moment + s * s + h * h)
    normal = G * math.cos(a) + s * turn - h * w * w
    return np.array([0.0, 0.0, w, turn]), normal, G * math.sin(a) - h * turn - s * w * w


def _grip(y, *body):
    """Return how much more friction there is than what sticking needs, per mass."""
    _, normal, friction = _motion(y, 0, *body)
    return body[2] * normal - abs(friction)
