"""Laws of rigid bodies with known answers, one table for every step.

``python test/everyday/everyday_laws.py HZ [NAME ...]`` prints the rows that are short. A law yields rows
(quantity, right, found, tolerance) for a time step. Its name is the law, its first line the formula.
"""

import math
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

from everyday_worlds import (
    FLOOR,
    about,
    course,
    model,
    product,
    run,
    solid_ball,
    solid_box,
    solid_cylinder,
    tilt,
    turn_between,
    world,
)
from plain_scenes import G, energy, state, tumbling_orientation
from planar_shelf import spin_off_shelf
from scipy.spatial.transform import Rotation

from unc_physics import Box, Plane, PosePath, RigidBody, Wrench, load_model
from unc_physics.shapes import pieces as shapes

SIDEWAYS = about((1, 0, 0), math.pi / 2)
CAN = 0.038, 0.11  # m, radius and length of a can
UM, MM, MRAD = 1e6, 1e3, 1e3


class Row(NamedTuple):
    """A quantity: its right value, the value found, and how far these may be apart."""

    name: str
    right: float
    found: float
    tolerance: float

    @property
    def short(self) -> bool:
        """Whether the value found is not right."""
        return not abs(self.found - self.right) <= self.tolerance


LAWS: list[Callable[[float], Iterator[tuple]]] = []


def law(function):
    """Add a law to the table."""
    LAWS.append(function)
    return function


def rows(function, dt) -> list[Row]:
    """Return the rows of a law at a time step [s]."""
    return [Row(*row) for row in function(dt)]


def slope_of(angle):
    """Return the plane through the origin that descends along x at an angle [rad], and its normal."""
    normal = np.array([math.sin(angle), 0.0, math.cos(angle)])
    return Plane(normal, name="slope"), normal


def slab(size, position, **surface):
    """Return a fixed box."""
    return Box(size, position, **surface)


def can(name="can"):
    """Return a can as a solid cylinder."""
    return solid_cylinder(name, *CAN, 0.455)


def rolling(body, speed, radius, position=None):
    """Return the state of a round body with its axis along y that rolls along x."""
    position = (0, 0, radius) if position is None else position
    return state(
        position, (speed, 0, 0), (0, speed / radius, 0), SIDEWAYS if body != "ball" else (0, 0, 0, 1)
    )


# -- impacts -----------------------------------------------------------------------------------------


@law
def a_ball_rebounds_with_e_times_its_speed(dt):
    """Newton: height after the bounce is e^2 h, whatever the height."""
    for e in (0.1, 0.3, 0.5, 0.9):
        scene = world(solid_ball("b", 0.03, 0.2), dt=dt, restitution=e, friction=0.0)
        worst = 0.0
        for h in (0.05, 0.11, 0.2, 0.33):
            fall = math.sqrt(2 * h / G)
            x = run(scene, state((0, 0, 0.03 + h)), fall + 0.6 * e * fall)[0]
            height = max(x[2] - 0.03 + x[5] ** 2 / (2 * G), 0.0)
            worst = max(worst, math.sqrt(height / h) / e - 1, key=abs)
        yield f"e {e}: worst error of the ratio", 0, worst, 0.02


@law
def an_elastic_ball_loses_nothing(dt):
    """Energy: constant for e = 1."""
    scene = world(solid_ball("b", 0.03, 0.2), dt=dt, restitution=1.0, friction=0.0)
    x = run(scene, state((0, 0, 0.53)), 3.0)[0]
    yield "share of energy after 3 s", 1, (G * (x[2] - 0.03) + x[5] ** 2 / 2) / (G * 0.5), 0.002


@law
def a_box_that_lands_flat_rebounds_without_spin(dt):
    """Newton over the whole face: e at the centre, and no moment."""
    scene = world(solid_box("b", (0.1, 0.08, 0.06), 0.5), dt=dt, restitution=0.3)
    x = run(scene, state((0, 0, 0.23), orientation=about((0, 0, 1), 0.3)), 1.2 * math.sqrt(0.4 / G))[0]
    yield "e", 0.3, math.sqrt(max(x[2] - 0.03 + x[5] ** 2 / (2 * G), 0) / 0.2), 0.006
    yield "spin [rad/s]", 0, np.abs(x[10:]).max(), 0.02


@law
def flat_landings_on_any_support_rebound_alike(dt):
    """Heights e^2 h and e^4 h without spin, on a plane, a wide box, and a pedestal narrower than the body."""
    fall = math.sqrt(0.4 / G)
    landers = (
        ("cube", solid_box("b", (0.1, 0.1, 0.1), 1.0), 0.05),
        ("carton", solid_box("b", (0.078, 0.046, 0.122), 0.52), 0.061),
        ("cylinder", solid_cylinder("b", 0.06, 0.12, 1.36), 0.06),
    )
    for what, body, half in landers:
        narrow = 0.03 if what == "carton" else 0.075
        supports = (FLOOR, slab((1, 1, 0.2), (0, 0, -0.1)), slab((narrow, narrow, 0.2), (0, 0, -0.1)))
        for where, support in zip(("plane", "box", "pedestal"), supports, strict=True):
            for e in (0.3, 0.69, 0.9, 1.0):
                scene = world(body, dt=dt, restitution=e, environment=[support])
                # in the middle of the first and the second flight after the impact
                times = np.array([fall * (1 + e), fall * (1 + 2 * e + e * e)])
                path = course(scene, state((0, 0, half + 0.2)), times)[:, 0]
                heights = path[:, 2] - half + path[:, 5] ** 2 / (2 * G)
                for k, height in enumerate(heights, start=1):
                    yield f"{what} on a {where}, e {e}: height {k} over h", e ** (2 * k), height / 0.2, 0.02
                yield f"{what} on a {where}, e {e}: spin [rad/s]", 0, np.abs(path[:, 10:]).max(), 0.02


@law
def friction_of_an_impact_is_coulombs(dt):
    """Change of speed mu (1 + e) v_n while it slips, without gravity."""
    mu, e = 0.2, 0.4
    scene = world(solid_ball("b", 0.03, 0.2), dt=dt, restitution=e, friction=mu, gravity=None)
    x = run(scene, state((0, 0, 0.0511), (3.0, 0, -2.0)), 0.03)[0]
    lost = mu * (1 + e) * 2
    yield "lost along [m/s]", lost, 3 - x[3], 0.02 * lost
    yield "normal [m/s]", e * 2, x[5], 0.02 * e * 2
    yield "spin [rad/s]", 2.5 * lost / 0.03, x[11], 0.02 * 2.5 * lost / 0.03


@law
def an_impact_with_much_friction_ends_slip(dt):
    """A ball that sticks keeps 5/7 of its tangential speed."""
    scene = world(solid_ball("b", 0.03, 0.2), dt=dt, restitution=0.4, friction=0.8, gravity=None)
    x = run(scene, state((0, 0, 0.0511), (1.0, 0, -2.0)), 0.03)[0]
    yield "speed along [m/s]", 5 / 7, x[3], 0.005


@law
def friction_of_impacts_falls_with_their_speed(dt):
    """mu / (1 + v_n / v0), as `impact_friction_speed` says."""
    mu, e, v0 = 0.2, 0.4, 2.0
    for closing in (0.5, 2.0):
        scene = world(
            solid_ball("b", 0.03, 0.2),
            dt=dt,
            restitution=e,
            friction=mu,
            gravity=None,
            impact_friction_speed=v0,
        )
        x = run(scene, state((0, 0, 0.04), (4.0, 0, -closing)), 0.04)[0]
        right = mu / (1 + closing / v0) * (1 + e) * closing
        yield f"closing at {closing} m/s: lost along [m/s]", right, 4 - x[3], 0.02 * right


@law
def an_edge_that_lands_turns_the_box(dt):
    """Plane impact without friction: impulse (1 + e) v / (1 / m + r^2 / I) at the edge."""
    size, mass, e, angle = (0.1, 0.2, 0.04), 0.5, 0.5, 0.35
    body = solid_box("b", size, mass)
    scene = world(body, dt=dt, restitution=e, friction=0.0, gravity=None)
    lever = 0.05 * math.cos(angle) - 0.02 * math.sin(angle)  # of the lower edge, horizontal
    down = 0.05 * math.sin(angle) + 0.02 * math.cos(angle)
    moment = mass * body.model.inertia[1, 1]
    impulse = (1 + e) * 1.5 / (1 / mass + lever**2 / moment)
    start = state((0, 0, down + 0.0101), (0, 0, -1.5), orientation=about((0, 1, 0), angle))
    x = run(scene, start, 0.0101 / 1.5 + 0.0025)[0]
    yield "speed of the centre [m/s]", impulse / mass - 1.5, x[5], 0.02
    yield "spin [rad/s]", -impulse * lever / moment, x[11], 0.02 * impulse * lever / moment


@law
def two_bodies_share_one_restitution(dt):
    """Textbook collision with the geometric mean of both restitutions."""
    bodies = [solid_ball("a", 0.05, 0.3, restitution=0.9), solid_ball("b", 0.05, 1.2, restitution=0.4)]
    scene = world(*bodies, dt=dt, gravity=None, environment=())
    x = run(scene, [state((0, 0, 0), (2, 0, 0)), state((0.13, 0, 0), (-0.5, 0, 0))], 0.1)
    before, e = (0.3 * 2.0 - 1.2 * 0.5) / 1.5, math.sqrt(0.36)
    yield "lighter [m/s]", before - 1.2 / 1.5 * e * 2.5, x[0, 3], 0.002
    yield "heavier [m/s]", before + 0.3 / 1.5 * e * 2.5, x[1, 3], 0.002


@law
def balls_that_meet_off_centre_part_along_their_centres(dt):
    """Newton along the line of centres at the moment of contact, from a quadratic equation; no friction."""
    (ra, ma), (rb, mb), e = (0.05, 0.3), (0.03, 0.2), 0.7
    a, b, va, vb = (
        np.array(part, float) for part in ((-0.15, 0, 0), (0.05, 0.03, 0), (1, 0, 0), (-0.5, 0.1, 0))
    )
    d, v = b - a, vb - va
    root = math.sqrt((d @ v) ** 2 - v @ v * (d @ d - (ra + rb) ** 2))
    normal = d + v * ((-(d @ v) - root) / (v @ v))
    normal /= np.linalg.norm(normal)
    impulse = (1 + e) * (va - vb) @ normal / (1 / ma + 1 / mb) * normal
    balls = solid_ball("a", ra, ma), solid_ball("b", rb, mb)
    scene = world(*balls, dt=dt, gravity=None, friction=0.0, restitution=e, environment=())
    x = run(scene, [state(a, va), state(b, vb)], 0.2)
    yield "first: error of velocity [m/s]", 0, np.abs(x[0, 3:6] - va + impulse / ma).max(), 0.01
    yield "second: error of velocity [m/s]", 0, np.abs(x[1, 3:6] - vb - impulse / mb).max(), 0.01


@law
def a_cradle_passes_the_impact_on(dt):
    """Newton's cradle: 0 0 0 0 1, with any gap."""
    r = 0.02
    for gap in (0.0, 1e-4, 1e-3):
        balls = [solid_ball(f"b{k}", r, 0.1) for k in range(5)]
        scene = world(*balls, dt=dt, gravity=None, friction=0.0, restitution=1.0, environment=())
        start = [state((k * (2 * r + gap) - 0.1 * (k == 0), 0, 0), (float(k == 0), 0, 0)) for k in range(5)]
        v = run(scene, start, 0.5)[:, 3]
        yield f"gaps {gap * MM} mm: largest error [m/s]", 0, np.abs(v - [0, 0, 0, 0, 1]).max(), 0.02


@law
def a_fast_ball_stops_at_a_thin_wall(dt):
    """20 m/s at 10 mm: rebound e v, and no passage."""
    for e in (0.0, 0.5):
        scene = world(
            solid_ball("b", 0.05, 0.3),
            dt=dt,
            gravity=None,
            restitution=e,
            environment=[slab((0.01, 1, 1), (1, 0, 0))],
        )
        x = run(scene, state((0.3, 0, 0), (20, 0, 0)), 0.1)[0]
        yield f"e {e}: speed [m/s]", -20 * e, x[3], 0.01
        yield f"e {e}: beyond the wall [mm]", 0, MM * max(0.0, x[0] - 1.0 + 0.005 + 0.05), 0.1


# -- friction ----------------------------------------------------------------------------------------


@law
def a_block_slides_as_far_as_friction_lets_it(dt):
    """v^2 / (2 mu g)."""
    for mu, speed in ((0.3, 0.3), (0.3, 1.0), (0.1, 0.4)):
        scene = world(solid_box("b", (0.1, 0.08, 0.02), 0.5), dt=dt, friction=mu)
        x = run(scene, state((0, 0, 0.01), (speed, 0, 0)), speed / (mu * G) + 0.2)[0]
        yield f"mu {mu}, {speed} m/s: distance over right", 1, x[0] / (speed**2 / (2 * mu * G)), 0.01


@law
def a_box_slides_on_a_fixed_body(dt):
    """v^2 / (2 mu g), on a fixed brick instead of the environment."""
    for mu in (0.1, 0.3):
        bodies = [solid_box("t", (0.078, 0.122, 0.046), 0.52), solid_box("b", (0.24, 0.115, 0.071), 1)]
        bodies[1] = RigidBody("b", bodies[1].model, 1, fixed=True)
        scene = world(*bodies, dt=dt, friction=mu, environment=())
        x = run(scene, [state((-0.06, 0, 0.0355 + 0.023), (0.3, 0, 0)), state()], 0.7)[0]
        yield f"mu {mu}: distance over right", 1, (x[0] + 0.06) / (0.09 / (2 * mu * G)), 0.02


@law
def friction_of_a_pair_is_the_geometric_mean(dt):
    """Distance v^2 / (2 g sqrt(.8 .2))."""
    scene = world(
        solid_box("b", (0.1, 0.08, 0.02), 0.5, friction=0.8), dt=dt, environment=[Plane(friction=0.2)]
    )
    x = run(scene, state((0, 0, 0.01), (1.0, 0, 0)), 0.6)[0]
    yield "distance over right", 1, x[0] / (1 / (2 * 0.4 * G)), 0.01


@law
def an_incline_holds_to_the_angle_of_friction(dt):
    """atan(mu); above it g (sin a - mu cos a)."""
    mu = 0.5
    for past in (-0.003, 0.003):  # rad
        a = math.atan(mu) + past
        plane, normal = slope_of(a)
        scene = world(solid_box("b", (0.1, 0.08, 0.02), 0.5), dt=dt, friction=mu, environment=[plane])
        x = run(scene, state(0.01 * normal, orientation=about((0, 1, 0), a)), 2.0)[0]
        speed = np.linalg.norm(x[3:6])
        if past < 0:
            yield "below: speed [um/s]", 0, UM * speed, 1
        else:
            yield "above: speed over right", 1, speed / (2 * G * (math.sin(a) - mu * math.cos(a))), 0.01


@law
def gravity_may_have_any_direction(dt):
    """The same incline, with gravity turned instead of the plane."""
    mu = 0.5
    for past in (-0.003, 0.003):
        a = math.atan(mu) + past
        gravity = (0.6 * G * math.sin(a), 0.8 * G * math.sin(a), -G * math.cos(a))
        scene = world(solid_box("b", (0.1, 0.08, 0.02), 0.5), dt=dt, friction=mu, gravity=gravity)
        x = run(scene, state((0, 0, 0.01)), 2.0)[0]
        speed = np.linalg.norm(x[3:6])
        if past < 0:
            yield "below: speed [um/s]", 0, UM * speed, 1
        else:
            yield "above: speed over right", 1, speed / (2 * G * (math.sin(a) - mu * math.cos(a))), 0.01
            yield "above: direction [mrad]", 0, MRAD * (math.atan2(x[4], x[3]) - math.atan2(0.8, 0.6)), 2


@law
def a_can_topples_at_the_angle_of_its_base(dt):
    """atan(r / h), 34.6 degrees for mu 2, at every yaw."""
    a = math.atan(CAN[0] / (CAN[1] / 2))
    for past in (-0.006, 0.006):
        plane, normal = slope_of(a + past)
        scene = world(can(), dt=dt, friction=2.0, environment=[plane])
        leans = []
        for yaw in np.arange(8) * 2 * math.pi / 8 / 8 * 5:
            q = product(about((0, 1, 0), a + past), about((0, 0, 1), yaw))
            x = state(0.055 * normal, orientation=q)
            leans.append(turn_between(x, run(scene, x, 1.0)[0]))
        fallen = sum(lean > 0.1 for lean in leans)
        yield f"{past:+} rad: number of 8 yaws that topple", 8 * (past > 0), fallen, 0
        if past < 0:
            yield f"{past:+} rad: largest turn [mrad]", 0, MRAD * max(leans), 0.2


@law
def an_upright_can_slides_and_spins_without_tilting(dt):
    """mu h < r: it does not tip, however it spins, at any yaw."""
    for what, body, half, mu in (
        ("can", can(), 0.055, 0.24),
        ("can of the library", RigidBody("b", load_model("can")), 0.055, 0.24),
        ("tall cylinder", solid_cylinder("b", 0.05, 0.19, 3.73), 0.095, 0.24),
        ("disc", solid_cylinder("b", 0.085, 0.04, 0.9), 0.02, 0.24),
    ):
        scene = world(body, dt=dt, friction=mu)
        for speed, spin in ((0.6, 0.0), (0.0, 15.0), (0.6, 15.0), (0.6, 40.0)):
            most = 0.0
            for yaw in np.arange(2) * math.pi / 8:
                x = state((0, 0, half), (speed, 0, 0), (0, 0, spin), about((0, 0, 1), yaw))
                most = max(most, *(tilt(y[0]) for y in course(scene, x, np.arange(1, 17) * 0.05)))
            yield f"{what}, {speed} m/s, {spin} rad/s: largest tilt [degrees]", 0, math.degrees(most), 0.1


@law
def a_sliding_ball_begins_to_roll(dt):
    """5/7 of its speed."""
    scene = world(solid_ball("b", 0.03, 0.2), dt=dt)
    x = run(scene, state((0, 0, 0.03), (1, 0, 0)), 1.0)[0]
    yield "speed [m/s]", 5 / 7, x[3], 0.002 * 5 / 7


# -- rolling -----------------------------------------------------------------------------------------


@law
def a_ball_rolls_without_loss(dt):
    """Rolling without slip does no work."""
    scene = world(solid_ball("b", 0.03, 0.2), dt=dt)
    x = run(scene, rolling("ball", 1.0, 0.03), 5.0)[0]
    yield "speed after 5 s [m/s]", 1, x[3], 0.001


@law
def a_can_rolls_without_loss(dt):
    """Rolling without slip does no work: on a plane, and on a box."""
    for what, body in (("can", can()), ("can of the library", RigidBody("can", load_model("can")))):
        radius = max(piece.profile[:, 0].max() for piece in body.model.pieces) if what != "can" else 0.038
        scene = world(body, dt=dt, restitution=0.1)
        for speed in (0.4, 0.8):
            x = run(scene, rolling("can", speed, radius), 8.0)[0]
            yield f"{what}, {speed} m/s: share after 8 s", 1, x[3] / speed, 0.005
    scene = world(can(), dt=dt, restitution=0.1, environment=[slab((3, 3, 0.1), (0, 0, -0.05))])
    x = run(scene, rolling("can", 0.5, 0.038, (-0.6, 0, 0.038)), 2.0)[0]
    yield "on a box: share after 2 s", 1, x[3] / 0.5, 0.005


@law
def a_bottle_rolls_without_loss(dt):
    """Rolling without slip does no work; the library's bottle touches along its cylinder."""
    scene = world(RigidBody("b", load_model("bottle")), dt=dt)
    for speed in (0.4, 0.8):
        x = run(scene, rolling("bottle", speed, 0.0305), 8.0)[0]
        yield f"{speed} m/s: share after 8 s", 1, math.hypot(x[3], x[4]) / speed, 0.01


@law
def round_bodies_roll_down_a_slope(dt):
    """g sin a / (1 + I / (m r^2)) t."""
    for degrees in (5.0, 10.0):
        a = math.radians(degrees)
        plane, normal = slope_of(a)
        scene = world(can(), dt=dt, restitution=0.1, environment=[plane])
        x = run(scene, state(0.038 * normal, orientation=product(about((0, 1, 0), a), SIDEWAYS)), 0.4)[0]
        right = G * math.sin(a) / 1.5 * 0.4
        yield f"can, {degrees} degrees: speed over right", 1, math.hypot(x[3], x[5]) / right, 0.01
    a = 0.1111
    plane, normal = slope_of(a)
    tiny = RigidBody("b", solid_ball("b", 0.1, 1).model, 1.0, inertia=7e-7)
    x = run(world(tiny, dt=dt, environment=[plane]), state(0.1 * normal), 2.0)[0]
    right = G * math.sin(a) / (1 + 7e-7 / 0.01) * 2
    yield "ball with its mass in the middle: speed over right", 1, math.hypot(x[3], x[5]) / right, 0.005


@law
def what_begins_too_deep_on_a_slope_comes_out_and_moves_on(dt):
    """g sin a / (1 + I / (m r^2)) t; taking out the depth costs its energy at most, m g depth."""
    for angle in (0.02, 0.2):
        plane, normal = slope_of(angle)
        for what, body, radius, share, q in (
            ("ball", solid_ball("b", 0.03, 0.2), 0.03, 1.4, (0, 0, 0, 1)),
            ("can", can(), 0.038, 1.5, SIDEWAYS),
        ):
            scene = world(body, dt=dt, environment=[plane])
            for depth in (5e-5, 3e-4):
                start = state((radius - depth) * normal, orientation=product(about((0, 1, 0), angle), q))
                x = run(scene, start, 1.0)[0]
                found = np.linalg.norm(x[3:6]) / (G * math.sin(angle) / share)
                name = f"{what}, {angle} rad, {depth * UM:g} um"
                yield f"{name}: speed over right", 1, found, 0.03
                yield f"{name}: depth after 1 s [um]", 20, UM * (radius - x[:3] @ normal), 1


@law
def a_wheel_rolls_over_a_seam(dt):
    """Two level boxes are one plane: no vertical speed, no loss."""
    halves = [slab((1, 1, 0.1), (side * 0.5, 0, -0.05)) for side in (-1, 1)]
    scene = world(solid_cylinder("w", 0.05, 0.1, 0.8), dt=dt, environment=halves)
    for what, yaw in (("across", 0.0), ("along", math.pi / 2), ("askew", 0.3)):
        along = np.array([math.cos(yaw), math.sin(yaw), 0])
        turn = about((0, 0, 1), yaw)
        spin = 0.5 / 0.05 * np.array([-math.sin(yaw), math.cos(yaw), 0])
        x = state(np.array([0, 0, 0.05]) - 0.1 * along, 0.5 * along, spin, product(turn, SIDEWAYS))
        path = course(scene, x, np.arange(1, 49) / 120)[:, 0]
        yield f"{what}: vertical speed [mm/s]", 0, MM * np.abs(path[:, 5]).max(), 1.0
        yield f"{what}: share of speed", 1, path[-1, 3:6] @ along / 0.5, 0.002


@law
def a_round_body_rolls_along_an_edge(dt):
    """Its centre is above the support: neither loss nor fall."""
    across = about((0, 1, 0), math.pi / 2)
    for what, radius, half in (
        ("battery", 0.00725, 0.02525),
        ("cylinder", 0.021, 0.0665),
        ("can", 0.038, 0.055),
    ):
        body = solid_cylinder("c", radius, 2 * half, 0.1)
        for share in (0.8, 0.25):
            scene = world(
                body, dt=dt, friction=0.4, environment=[slab((1, 4, 0.04), (share * half - 0.5, 0, -0.02))]
            )
            for speed in (0.05, 0.3):
                x = run(scene, state((0, 0, radius), (0, speed, 0), (-speed / radius, 0, 0), across), 1.0)[0]
                name = f"{what}, edge at {share} of its half, {speed} m/s"
                yield f"{name}: share of speed", 1, x[4] / speed, 0.005
                yield f"{name}: height [mm]", 0, MM * (x[2] - radius), 0.1


@law
def a_battery_lies_across_an_edge(dt):
    """Statics: its centre is above the table, so that it lies still."""
    across = about((0, 1, 0), math.pi / 2)
    for edge in (0.012, 0.008, 0.003):
        for drop in (0.0, 0.005):
            scene = world(
                solid_cylinder("b", 0.00725, 0.0505, 0.023),
                dt=dt,
                restitution=0.2,
                environment=[slab((1, 1, 0.04), (edge - 0.5, 0, -0.02))],
            )
            x = run(scene, state((0, 0, 0.00725 + drop), orientation=across), 5.0)[0]
            axis = Rotation.from_quat(x[6:10]).apply((0, 0, 1))
            name = f"edge at {edge * MM:g} mm, from {drop * MM:g} mm"
            yield f"{name}: rolled [mm]", 0, MM * math.hypot(x[0], x[1]), 1.0
            yield f"{name}: heights of its ends apart [mm]", 0, MM * abs(axis[2]) * 0.0505, 0.1


# -- seams and edges ---------------------------------------------------------------------------------


@law
def a_flat_body_slides_over_a_seam(dt):
    """v t - mu g t^2 / 2 over level boxes, with or without a gap between them."""
    for gap in (0.0, 0.001, 0.01):
        halves = [slab((1, 1, 0.1), (side * (0.5 + gap / 2), 0, -0.05)) for side in (-1, 1)]
        for what, body, half in (
            ("box", solid_box("b", (0.1, 0.08, 0.06), 0.5), 0.03),
            ("can", can(), 0.055),
        ):
            scene = world(body, dt=dt, friction=0.2, environment=halves)
            for speed in (0.6, 1.0):
                for yaw in (0.0, 0.3):
                    along = np.array([math.cos(yaw), math.sin(yaw), 0])
                    start = np.array([0, 0, half]) - 0.08 * along
                    x = run(scene, state(start, speed * along, orientation=about((0, 0, 1), yaw)), 0.25)[0]
                    right = speed * 0.25 - 0.5 * 0.2 * G * 0.25**2
                    name = f"{what}, gap {gap * MM:g} mm, {speed} m/s, yaw {yaw}"
                    yield f"{name}: distance over right", 1, (x[:3] - start) @ along / right, 0.005
                    yield f"{name}: height [mm]", 0, MM * (x[2] - half), 0.1


@law
def a_body_leaves_a_shelf_with_the_right_spin(dt):
    """The planar solution of `planar_shelf`; within 3 % up to 1/240 s."""
    tolerance, across = (0.03, 0.1) if dt < 0.005 else (0.15, 0.6)
    shelf = [slab((0.6, 1, 0.4), (-0.3, 0, 0.2)), Plane(offset=-2.0)]
    library = RigidBody("can", load_model("can"))
    carton = RigidBody("carton", load_model("salt_box"))
    cases = [("can", can(), 0.055, 0.038, 0.5, v) for v in (0.78, 0.85, 0.9, 1.0, 1.2)]
    cases += [("can of the library", library, 0.055, base_radius(library.model), 0.5, v) for v in (0.8, 1.0)]
    cases += [("carton", carton, 0.061, 0.039, 0.5, v) for v in (0.78, 0.8, 0.85, 0.9, 1.0, 1.2)]
    cases += [("slick can", can(), 0.055, 0.038, 0.001, v) for v in (0.1, 0.2, 0.3, 0.5)]
    for what, body, height, half_base, mu, speed in cases:
        right = spin_off_shelf(height, half_base, body.model.inertia[1, 1], mu, speed, 0.06)
        scene = world(body, dt=dt, friction=mu, restitution=0.1, environment=shelf)
        path = course(scene, state((-0.06, 0, 0.4 + height), (speed, 0, 0)), np.arange(1, 121) / 120)[:, 0]
        fallen = path[np.argmax(path[:, 2] < 0.3)]
        yield f"{what}, mu {mu}, {speed} m/s: spin over right", 1, fallen[11] / right, tolerance
        yield f"{what}, mu {mu}, {speed} m/s: spin across [rad/s]", 0, np.abs(fallen[[10, 12]]).max(), across


def base_radius(packing):
    """Return the largest radius at which a model of lathes touches the floor it stands on [m]."""
    corners = np.concatenate([piece.profile + [0, piece.origin[2]] for piece in packing.pieces])
    return float(corners[corners[:, 1] < corners[:, 1].min() + 1e-6, 0].max())


@law
def a_ball_falls_through_a_hole(dt):
    """Free fall, although four walls are near it."""
    r = 0.02
    for gap in (0.05e-3, 0.25e-3, 1e-3):
        w = r + gap
        walls = [slab((0.1, 0.3, 0.01), (side * (w + 0.05), 0, 0)) for side in (-1, 1)]
        walls += [slab((0.3, 0.1, 0.01), (0, side * (w + 0.05), 0)) for side in (-1, 1)]
        scene = world(solid_ball("b", r, 0.1), dt=dt, environment=walls)
        x = run(scene, state((0, 0, 0.06)), 0.2)[0]
        yield f"{gap * MM:g} mm free: speed [m/s]", -G * 0.2, x[5], 0.002


@law
def a_carton_falls_past_an_edge(dt):
    """Free fall beside a shelf at .2 mm: no push."""
    scene = world(
        RigidBody("b", load_model("salt_box")), dt=dt, environment=[slab((0.2, 0.4, 0.02), (0.1, 0, -0.01))]
    )
    x = run(scene, state((-0.0392, 0, 0.081)), 0.3)[0]
    yield "shift [mm]", 0, MM * (x[0] + 0.0392), 0.05
    yield "speed [m/s]", -G * 0.3, x[5], 0.002


@law
def nothing_passes_through_a_thin_top(dt):
    """Balls and small bodies stay above tops of 20 mm and of .1 mm, wherever and from wherever they fall."""
    rng = np.random.default_rng(1)
    tops = (("tray", (0.4, 0.3, 0.02)), ("sheet", (1, 1, 0.0001)))
    for what, size in tops:
        top = slab(size, (0, 0, -size[2] / 2))
        deepest, through = 0.0, 0
        for radius in (0.003, 0.006, 0.02):
            scene = world(
                solid_ball("b", radius, 4000 * radius**3), dt=dt, restitution=0.1, environment=[top]
            )
            for h in (0.003, 0.02, 0.1, 0.35):
                for x, y in ((0.004, 0.003), (0.05, -0.04)):
                    fall = math.sqrt(2 * h / G)
                    path = course(scene, state((x, y, radius + h)), [fall + 0.02, fall + 0.06, fall + 0.2])[
                        :, 0
                    ]
                    deepest = max(deepest, radius - path[:, 2].min())
        yield f"{what}: deepest ball [mm]", 0, MM * deepest, 0.3
        for body in (
            solid_box("b", (0.03, 0.02, 0.01), 0.02),
            solid_cylinder("b", 0.013, 0.02, 0.02),
            RigidBody("b", model([shapes.capsule(0.009, 0.182)], [2.5e-3, 2.5e-3, 5e-5]), 0.02),
        ):
            scene = world(body, dt=dt, restitution=0.3, environment=[top])
            for h in (0.01, 0.1, 0.8):
                q = rng.standard_normal(4)
                start = state((0.004, 0.003, 0.1 + h), orientation=q / np.linalg.norm(q))
                through += run(scene, start, math.sqrt(2 * (0.1 + h) / G) + 0.15)[0, 2] < 0
        yield f"{what}: small bodies that pass", 0, through, 0


# -- rest --------------------------------------------------------------------------------------------


@law
def bodies_rest(dt):
    """Statics: no drift in 10 s, and no depth."""
    for what, body, height, q in (
        ("box", solid_box("b", (0.078, 0.046, 0.122), 0.52), 0.061, (0, 0, 0, 1)),
        ("can", can(), 0.055, (0, 0, 0, 1)),
        ("can on its side", can(), 0.038, SIDEWAYS),
    ):
        scene = world(body, dt=dt, restitution=0.1)
        start = state((0, 0, height), orientation=product(about((0, 0, 1), 0.3), q))
        settled, later = course(scene, start, [0.5, 10.5])[:, 0]
        yield f"{what}: drift [um]", 0, UM * np.linalg.norm(later[:3] - settled[:3]), 2
        yield f"{what}: depth [um]", 0, UM * (height - later[2]), 100
        yield f"{what}: turn [mrad]", 0, MRAD * turn_between(settled, later), 0.1


@law
def models_of_the_library_rest(dt):
    """Statics: no drift after they have settled."""
    for name in ("salt_box", "can", "brick", "mug", "bowl", "plate", "bottle"):
        body = RigidBody("b", load_model(name))
        base = -float(body.model.origin[2])  # their meshes stand on their origins
        settled, later = course(world(body, dt=dt), state((0, 0, base + 0.0002)), [1.0, 4.0])[:, 0]
        yield f"{name}: drift [um]", 0, UM * np.linalg.norm(later[:3] - settled[:3]), 2
        yield f"{name}: depth [um]", 0, UM * (base - later[2]), 100
        yield f"{name}: turn [mrad]", 0, MRAD * turn_between(settled, later), 0.1


BRICK = 0.24, 0.115, 0.071  # m


@law
def stacks_stand(dt):
    """Statics, with equal masses and with ratios of 100."""
    for what, masses in (
        ("equal", [3.5] * 5),
        ("alternating by 100", [3.5, 0.035, 3.5, 0.035, 3.5]),
        ("heavy on top by 100", [0.035] * 4 + [3.5]),
    ):
        bodies = [solid_box(f"b{k}", BRICK, mass) for k, mass in enumerate(masses)]
        start = [state((0.004 * (-1) ** k, 0, 0.0355 + 0.071 * k)) for k in range(5)]
        x = run(world(*bodies, dt=dt, restitution=0.1), start, 3.0)
        yield f"{what}: shift [mm]", 0, MM * np.abs(x[:, :3] - np.array(start)[:, :3]).max(), 2


@law
def a_light_brick_carries_a_heavy_one(dt):
    """Statics: 50 kg on 10 g."""
    bodies = [solid_box("light", BRICK, 0.01), solid_box("heavy", BRICK, 50.0)]
    start = [state((0, 0, 0.0355)), state((0, 0, 0.1065))]
    x = run(world(*bodies, dt=dt, restitution=0.1), start, 3.0)
    yield "shift [mm]", 0, MM * np.abs(x[:, :3] - np.array(start)[:, :3]).max(), 2


@law
def a_peg_lies_across_a_cube(dt):
    """Statics: as long as its centre is above the cube."""
    for off in (0.0, 0.02):
        cube = slab((0.05, 0.05, 0.05), (0, 0, 0.025))
        scene = world(solid_box("p", (0.096, 0.02, 0.02), 0.038), dt=dt, environment=[cube, FLOOR])
        x = run(scene, state((off, 0, 0.06)), 5.0)[0]
        yield f"{off * MM:g} mm off: shift [mm]", 0, MM * np.linalg.norm(x[:3] - [off, 0, 0.06]), 0.1
        yield f"{off * MM:g} mm off: tilt [mrad]", 0, MRAD * tilt(x), 1


@law
def a_corner_holds_a_box(dt):
    """Statics: gravity leans into a corner of a floor and two walls."""
    walls = [FLOOR, slab((0.02, 1, 1), (-0.21, 0, 0.4)), slab((1, 0.02, 1), (0, -0.21, 0.4))]
    body = solid_box("b", (0.078, 0.046, 0.122), 0.52)
    scene = world(body, dt=dt, gravity=(-5, -6, -7), friction=0.3, environment=walls)
    start = state((-0.05, -0.04, 0.07), orientation=about((0, 0, 1), 0.2))
    settled, later = course(scene, start, [2.0, 4.0])[:, 0]
    yield "drift [um]", 0, UM * np.linalg.norm(later[:3] - settled[:3]), 2
    yield "turn [mrad]", 0, MRAD * turn_between(settled, later), 0.1


@law
def a_grip_does_not_creep(dt):
    """Coulomb: a rod between a wall and a pad that presses it, 2 mu N above its weight."""
    rod = RigidBody("rod", model([shapes.capsule(0.004, 0.052)], [3e-4, 3e-4, 8e-6]), 0.045)
    for force in (12.0, 60.0):
        pad = solid_box("pad", (0.04, 0.04, 0.04), 1.0, wrenches=[Wrench(force=(-force, 0, 0))])
        fixed = [slab((0.04, 0.04, 0.04), (-0.02, 0, 0.02)), Plane(friction=0.0, name="floor")]
        scene = world(rod, pad, dt=dt, friction=0.7, environment=fixed)
        start = [state((0.004, 0, 0.02), orientation=SIDEWAYS), state((0.028, 0, 0.02))]
        settled, later = course(scene, start, [0.1, 10.1])[:, 0]
        yield f"{force:g} N: creep in 10 s [um]", 0, UM * np.linalg.norm(later[1:3] - settled[1:3]), 5
        yield f"{force:g} N: turn in 10 s [mrad]", 0, MRAD * turn_between(settled, later), 1


# -- rocking and wobbling ----------------------------------------------------------------------------


def rocking(dt, width, depth, height, lift):
    """Return the greatest tilt of a block after its first landing, and Housner's [rad]."""
    alpha = math.atan(width / height)
    axes = Rotation.from_quat(about((0, 1, 0), -lift))
    start = state(axes.apply((width / 2, 0, height / 2)), orientation=axes.as_quat())
    scene = world(solid_box("b", (width, depth, height), 1.0), dt=dt, friction=0.9)
    # without loss a half period would last as long again
    kept = 1 - 1.5 * math.sin(alpha) ** 2
    right = alpha - math.acos(math.cos(alpha) + kept**2 * (math.cos(alpha - lift) - math.cos(alpha)))
    times = np.arange(1, round(1.6 / max(dt, 0.004)) + 1) * max(dt, 0.004)
    tilts = [2 * math.atan2(x[0, 7], x[0, 9]) for x in course(scene, start, times)]
    landed = next((k for k, t in enumerate(tilts) if t > 0.0), len(tilts) - 1)
    back = next((k for k in range(landed + 2, len(tilts)) if tilts[k] < 0.0), len(tilts))
    return max(tilts[landed:back]), right


@law
def a_block_rocks(dt):
    """Housner 1963: each landing keeps 1 - 1.5 sin^2 a of the spin, for which the landing edge sticks."""
    found, right = rocking(dt, 0.04, 0.08, 0.2, 0.1)
    yield "4 x 8 x 20 cm: tilt after the first landing [mrad]", MRAD * right, MRAD * found, 2
    found, right = rocking(dt, 0.06, 0.06, 0.42, 0.5 * math.atan(1 / 7))
    yield "7 to 1: tilt over right", 1, found / right, 0.03


@law
def a_disc_rolls_on_its_rim(dt):
    """Euler's disc: steady precession W^2 = 4 g / (R sin a), whose tilt stays."""
    radius, lean = 0.0375, math.radians(20)
    spin = math.sqrt(4 * G / (radius * math.sin(lean)))
    inertia = radius**2 / 4, radius**2 / 4, radius**2 / 2
    disc = RigidBody("d", model([shapes.cylinder(radius, 0.004)], inertia), 0.1)
    height = radius * math.sin(lean) + 0.002 * math.cos(lean)
    w = spin * math.sin(lean) * np.array([0, math.cos(lean), math.sin(lean)])
    x = run(world(disc, dt=dt), state((0, 0, height), (0, 0, 0), w, about((1, 0, 0), lean)), 1.0)[0]
    yield "tilt after 1 s [degrees]", 20, math.degrees(min(tilt(x), math.pi - tilt(x))), 1


def wobbling(degrees, factor=1.0, more=(0, 0, 0)):
    """Return the state of a can that rolls on its rim around its centre, which stands still."""
    (r, length), lean = CAN, math.radians(degrees)
    h, s, c = length / 2, math.sin(lean), math.cos(lean)
    across, along = r**2 / 4 + length**2 / 12, r**2 / 2
    reach = r * c - h * s
    rate = factor * math.sqrt(reach * G / (s * (across * c - along * h / r * s)))
    spin = -rate * reach / r
    w = np.array([spin * s, 0, rate + spin * c]) + more
    velocity = -np.cross(w, [reach, 0, -h * c - r * s])
    return state((0, 0, h * c + r * s), velocity, w, about((0, 1, 0), lean))


@law
def a_wobbling_can_keeps_its_energy(dt):
    """Rolling does no work: closed form of the steady motion, and a perturbed one; no gain above .1 %."""
    scene = world(can(), dt=dt)
    rest = 0.455 * G * 0.055
    for what, factor, more in (("steady", 1.0, (0, 0, 0)), ("perturbed", 1.1, (0.5, 1.0, -2.0))):
        for degrees in (5, 10, 15):
            start = wobbling(degrees, factor, more)
            path = course(scene, start, np.arange(1, 101) * 0.02)
            E = np.array([energy(scene, x) - rest for x in (start[None], *path)])
            rise = (E - np.minimum.accumulate(E)).max() / E[0]
            yield f"{what}, {degrees} degrees: largest gain [%]", 0, 100 * rise, 0.1
            if degrees > 5:
                lost = max(0.0, 1 - E[-1] / E[0])
                yield f"{what}, {degrees} degrees: lost in 2 s", 0, lost, 0.05


@law
def a_dropped_can_stands_or_lies(dt):
    """Rigid limit, agreed by three independent programs, for mu .5, e .1."""
    scene = world(can(), dt=dt, restitution=0.1)
    for h, degrees, upright in (
        (0.1, 3, True),
        (0.1, 15, True),
        (0.1, 30, True),
        (0.3, 3, False),
        (0.3, 7, False),
        (0.3, 25, True),
        (1.0, 3, False),
        (1.0, 30, True),
    ):
        lean = math.radians(degrees)
        low = 0.055 * math.cos(lean) + 0.038 * math.sin(lean)
        x = run(scene, state((0, 0, low + h), orientation=about((0, 1, 0), lean)), 4.0)[0]
        yield f"from {h} m, {degrees} degrees: upright", upright, tilt(x) < 0.1, 0


# -- free motion -------------------------------------------------------------------------------------


@law
def a_body_tumbles_freely(dt):
    """Euler's equations by SciPy's DOP853: the middle axis of inertia is unstable."""
    inertia = np.array([6e-4, 1.1e-3, 1.5e-3])
    body = RigidBody("b", model([shapes.box((0.06, 0.04, 0.02))], inertia), 1.0)
    scene = world(body, dt=dt, gravity=None, environment=())
    spin = np.array([0.01, 5, 0.01])
    x = run(scene, state(spin=spin), 10.0)[0]
    right = state(orientation=tumbling_orientation(inertia, spin, 10.0))
    yield "error of orientation after 10 s [degrees]", 0, math.degrees(turn_between(x, right)), 0.1


@law
def a_body_flies_along_a_parabola(dt):
    """x + v t + g t^2 / 2, exact at any step; damping exp(-c t)."""
    body = solid_box("b", (0.1, 0.08, 0.06), 0.5)
    x = run(world(body, dt=dt), state((0, 0, 100), (1, 2, 3), (2, 3, 1)), 2.0)[0]
    yield "height [um]", UM * (106 - 2 * G), UM * x[2], 0.01
    yield "along [um]", UM * 2, UM * x[0], 0.01
    scene = world(body, dt=dt, gravity=None, damping=0.7, environment=())
    x = run(scene, state((0, 0, 0), (1, 2, 3)), 1.5)[0]
    yield "damped speed over right", 1, x[5] / (3 * math.exp(-0.7 * 1.5)), 1e-9


# -- surfaces that move ------------------------------------------------------------------------------


def straight(position, velocity, time=4.0):
    """Return the path of a body that moves steadily."""
    ends = [np.asarray(position), np.asarray(position) + time * np.asarray(velocity)]
    return PosePath(times=[0.0, time], positions=ends, linear_velocities=[velocity, velocity])


@law
def a_moving_tray_takes_a_box_along(dt):
    """Slip v^2 / (2 mu g) on a prescribed body."""
    for speed in (0.3, 1.0):
        board = solid_box("tray", (4, 0.4, 0.02), 1).model
        tray = RigidBody("tray", board, 1, trajectory=straight((0, 0, 0), (speed, 0, 0)))
        scene = world(solid_box("b", (0.05,) * 3, 0.1), tray, dt=dt, friction=0.3, environment=())
        x = run(scene, [state((-0.5, 0, 0.035)), state(velocity=(speed, 0, 0))], 1.0)[0]
        right = speed**2 / (2 * 0.3 * G)
        yield f"{speed} m/s: slip [mm]", MM * right, MM * (speed - (x[0] + 0.5)), 0.005 * MM * right
        yield f"{speed} m/s: speed over right", 1, x[3] / speed, 0.001


@law
def a_belt_takes_a_box_along(dt):
    """Slip v^2 / (2 mu g) on a surface that moves in itself."""
    for speed in (0.3, 1.0):
        belt = slab((4, 0.4, 0.02), (0, 0, -0.01), surface_velocity=(speed, 0, 0))
        scene = world(solid_box("b", (0.05,) * 3, 0.1), dt=dt, friction=0.3, environment=[belt])
        x = run(scene, state((-0.5, 0, 0.025)), 1.0)[0]
        right = speed**2 / (2 * 0.3 * G)
        yield f"{speed} m/s: slip [mm]", MM * right, MM * (speed - (x[0] + 0.5)), 0.005 * MM * right


@law
def a_turning_surface_takes_a_ball_along(dt):
    """Torsional friction: moment times normal force over the moment of inertia, up to the surface's spin."""
    r, length, spin = 0.03, 1e-3, 3.0
    table = slab(
        (1, 1, 0.02), (0, 0, -0.01), surface_angular_velocity=(0, 0, spin), torsional_friction=length
    )
    scene = world(solid_ball("b", r, 0.2, torsional_friction=length), dt=dt, environment=[table])
    path = course(scene, state((0, 0, r)), [0.05, 0.3])[:, 0]
    yield "spin after .05 s [rad/s]", 0.05 * length * G / (0.4 * r * r), path[0, 12], 0.01
    yield "spin in the end [rad/s]", spin, path[1, 12], 0.001


@law
def a_lift_raises_a_box(dt):
    """It keeps to the lift."""
    board = solid_box("lift", (0.2, 0.2, 0.02), 1).model
    lift = RigidBody("lift", board, 1, trajectory=straight((0, 0, 0), (0, 0, 0.5)))
    scene = world(solid_box("b", (0.05,) * 3, 0.1), lift, dt=dt, environment=())
    up = (0, 0, 0.5)
    x = run(scene, [state((0, 0, 0.035), up), state(velocity=up)], 1.0)[0]
    yield "height [mm]", 535, MM * x[2], 0.1


@law
def a_turntable_takes_a_box_along(dt):
    """w^2 r < mu g: it turns with the table; straight steps would widen the circle by 3 mm at 1/240."""
    times = np.linspace(0, 2, 41)
    turns = [about((0, 0, 1), 2 * t) if t else np.array([0, 0, 0, 1.0]) for t in times]
    path = PosePath(
        times=times,
        positions=np.zeros((41, 3)),
        orientations=turns,
        angular_velocities=np.tile([0, 0, 2.0], (41, 1)),
    )
    disc = RigidBody("disc", solid_cylinder("disc", 0.3, 0.02, 1).model, 1, trajectory=path)
    scene = world(solid_box("b", (0.03,) * 3, 0.1), disc, dt=dt, environment=())
    spin = (0, 0, 2.0)
    x = run(scene, [state((0.2, 0, 0.025), (0, 0.4, 0), spin), state(spin=spin)], 1.9)[0]
    yield "radius [mm]", 200, MM * math.hypot(x[0], x[1]), 0.02
    yield "angle [mrad]", 0, MRAD * math.remainder(math.atan2(x[1], x[0]) - 3.8, 2 * math.pi), 1


def main(hz, *names):
    """Print the rows of all laws, or of those whose names contain one of ``names``."""
    short = total = 0
    for function in LAWS:
        if names and not any(name in function.__name__ for name in names):
            continue
        found = rows(function, 1 / float(hz))
        bad = [row for row in found if row.short]
        total, short = total + 1, short + bool(bad)
        print(f"{function.__name__}: {len(found)} rows, {len(bad)} short")
        for row in bad:
            print(
                f"    1/{hz} {row.name}: right {row.right:.6g} +- {row.tolerance:.3g}, found {row.found:.6g}"
            )
    print(f"{short} of {total} laws short at 1/{hz}")


if __name__ == "__main__":
    main(*sys.argv[1:])
