"""Friction in sliding, about the normal, and in rolling."""

import math

import numpy as np
from everyday_worlds import (
    CAN,
    MRAD,
    UM,
    about,
    base_radius,
    can,
    course,
    product,
    rolling,
    run,
    slab,
    slope_of,
    solid_ball,
    solid_box,
    solid_cylinder,
    tilt,
    turn_between,
    world,
)
from law_table import Laws
from plain_scenes import STEPS, G, packing, state
from scipy.integrate import solve_ivp

from unc_physics import Plane, RigidBody, load_model

law = Laws()
BLOCK = solid_box("b", (0.1, 0.08, 0.02), 0.5)


# -- sliding -----------------------------------------------------------------------------------------


@law
def a_block_slides_as_far_as_friction_lets_it(dt):
    """v^2 / (2 mu g), also where friction of impacts falls with their speed."""
    for mu, speed, half in ((0.3, 0.3, None), (0.3, 1.0, None), (0.1, 0.4, None), (0.2, 2.0, 0.5)):
        scene = world(BLOCK, dt=dt, friction=mu, impact_friction_speed=half)
        x = run(scene, state((0, 0, 0.01), (speed, 0, 0)), speed / (mu * G) + 0.2)[0]
        yield f"mu {mu}, {speed} m/s: distance over right", 1, x[0] / (speed**2 / (2 * mu * G)), 0.01
        yield f"mu {mu}, {speed} m/s: speed in the end [um/s]", 0, UM * np.linalg.norm(x[3:6]), 1


@law
def a_box_slides_on_a_fixed_body(dt):
    """v^2 / (2 mu g), on a fixed brick instead of the environment."""
    brick = RigidBody("brick", solid_box("brick", (0.24, 0.115, 0.071), 1).model, 1, fixed=True)
    for mu in (0.1, 0.3, 0.5):
        scene = world(solid_box("t", (0.078, 0.122, 0.046), 0.52), brick, dt=dt, friction=mu, environment=())
        x = run(scene, [state((-0.06, 0, 0.0355 + 0.023), (0.3, 0, 0)), state()], 0.7)[0]
        yield f"mu {mu}: distance over right", 1, (x[0] + 0.06) / (0.09 / (2 * mu * G)), 0.02


@law
def friction_of_a_pair_is_the_geometric_mean_or_its_own(dt):
    """Distances v^2 / (2 g mu), mu = sqrt(.8 .2); .1 where the pair has a value of its own."""
    bodies = [solid_box(name, (0.1, 0.08, 0.02), 0.5, friction=0.8) for name in "ab"]
    floor, own = Plane(name="floor", friction=0.2), [{"between": ["floor", "b"], "friction": 0.1}]
    scene = world(*bodies, dt=dt, environment=[floor], pairs=own)
    x = run(scene, [state((0, k, 0.01), (1.0, 0, 0)) for k in (0, 1)], 0.2)
    for body, mu in zip(x, (0.4, 0.1), strict=True):
        yield f"mu {mu}: speed [m/s]", 1.0 - 0.2 * mu * G, body[3], 1e-5


@law
def an_incline_holds_to_the_angle_of_friction(dt):
    """atan(mu); above it g (sin a - mu cos a)."""
    for mu in (0.2, 0.5, 1.0):
        for past in (-0.003, 0.003):  # rad
            a = math.atan(mu) + past
            plane, normal = slope_of(a)
            scene = world(BLOCK, dt=dt, friction=mu, environment=[plane])
            x = run(scene, state(0.01 * normal, orientation=about((0, 1, 0), a)), 2.0)[0]
            speed = np.linalg.norm(x[3:6])
            if past < 0:
                yield f"mu {mu}, below: speed [um/s]", 0, UM * speed, 1
            else:
                right = 2 * G * (math.sin(a) - mu * math.cos(a))
                yield f"mu {mu}, above: speed over right", 1, speed / right, 0.01


@law
def gravity_may_have_any_direction(dt):
    """The same incline, with gravity turned instead of the plane."""
    mu = 0.5
    for past in (-0.003, 0.003):
        a = math.atan(mu) + past
        gravity = (0.6 * G * math.sin(a), 0.8 * G * math.sin(a), -G * math.cos(a))
        scene = world(BLOCK, dt=dt, friction=mu, gravity=gravity)
        x = run(scene, state((0, 0, 0.01)), 2.0)[0]
        speed = np.linalg.norm(x[3:6])
        if past < 0:
            yield "below: speed [um/s]", 0, UM * speed, 1
        else:
            yield "above: speed over right", 1, speed / (2 * G * (math.sin(a) - mu * math.cos(a))), 0.01
            yield "above: direction [mrad]", 0, MRAD * (math.atan2(x[4], x[3]) - math.atan2(0.8, 0.6)), 2


@law
def a_cube_slides_down_a_turned_body_without_friction(dt):
    """g sin a."""
    a = math.radians(20)
    q, (_, normal) = about((0, 1, 0), a), slope_of(a)
    down = np.array([math.cos(a), 0, -math.sin(a)])
    slope = RigidBody("slope", solid_box("s", (1.2, 0.3, 0.1), 1.0).model, 1.0, fixed=True)
    scene = world(solid_box("b", (0.1, 0.1, 0.1), 1.0), slope, dt=dt, friction=0.0, environment=())
    start = [state(0.1 * normal - 0.4 * down + (0, 0.01, 0), orientation=q), state(orientation=q)]
    speed = run(scene, start, 0.5)[0, 3:6] @ down
    yield "acceleration over right", 1, speed / (0.5 * G * math.sin(a)), 1e-4


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


@law.at(*STEPS, 1 / 4000)
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
    x = run(world(solid_ball("b", 0.03, 0.2), dt=dt), state((0, 0, 0.03), (1, 0, 0)), 1.0)[0]
    yield "speed [m/s]", 5 / 7, x[3], 0.002 * 5 / 7
    yield "slip [m/s]", 0, x[3] - 0.03 * x[11], 1e-4


# -- about the normal --------------------------------------------------------------------------------


@law
def spin_on_a_floor_ends_as_at_the_rim_of_the_face(dt):
    """mu g r / i with r of the rim, or of the corners, and i the moment of inertia per mass."""
    library = load_model("can")
    for what, body, half, r in (
        ("box", solid_box("b", (0.078, 0.046, 0.122), 0.52), 0.061, math.hypot(0.039, 0.023)),
        ("disc", solid_cylinder("b", 0.05, 0.02, 0.5), 0.01, 0.05),
        ("can of the library", RigidBody("b", library), 0.055, base_radius(library)),
    ):
        x = run(world(body, dt=dt), state((0, 0, half), spin=(0, 0, 20)), 0.05)[0]
        yield (
            f"{what}: rate over right",
            1,
            (20 - x[12]) / (0.05 * 0.5 * G * r / body.model.inertia[2, 2]),
            5e-3,
        )


@law
def torsional_friction_stops_a_spin(dt):
    """Length times g over the moment of inertia per mass; the geometric mean of both lengths."""
    r, floor = 0.03, Plane(torsional_friction=0.002)
    for own, length in ((None, 0.002), (0.008, 0.004)):
        scene = world(solid_ball("b", r, 0.2, torsional_friction=own), dt=dt, environment=[floor])
        slowing = length * G / (0.4 * r * r)
        path = course(scene, state((0, 0, r), spin=(0, 0, 20)), [0.1, 21 / slowing])[:, 0, 12]
        yield f"{length} m: spin after .1 s [rad/s]", 20 - 0.1 * slowing, path[0], 2e-3
        yield f"{length} m: spin in the end [rad/s]", 0, path[1], 1e-6


@law
def a_turning_surface_takes_a_ball_along(dt):
    """Torsional friction: moment times normal force over the moment of inertia, up to the surface's spin."""
    r, length, spin = 0.03, 1e-3, 3.0
    own = {"surface_angular_velocity": (0, 0, spin), "torsional_friction": length}
    table = slab((1, 1, 0.02), (0, 0, -0.01), **own)
    scene = world(solid_ball("b", r, 0.2, torsional_friction=length), dt=dt, environment=[table])
    path = course(scene, state((0, 0, r)), [0.05, 0.3])[:, 0]
    yield "spin after .05 s [rad/s]", 0.05 * length * G / (0.4 * r * r), path[0, 12], 0.01
    yield "spin in the end [rad/s]", spin, path[1, 12], 0.001


# -- in rolling --------------------------------------------------------------------------------------


@law
def rolling_friction_slows_a_ball(dt):
    """5/7 g l / r; a body's and the scene's length have a geometric mean, a pair's own comes first."""
    r, pair = 0.03, [{"between": ["b", "floor"], "rolling_friction": 3e-4}]
    for what, own, given, length in (
        ("of the scene", None, {"rolling_friction": 1e-3}, 1e-3),
        ("of both", 4e-4, {"rolling_friction": 1e-4}, 2e-4),
        ("of the pair", None, {"rolling_friction": 1e-4, "pairs": pair}, 3e-4),
        ("of one alone", 4e-4, {}, 0.0),
    ):
        scene = world(solid_ball("b", r, 0.1, rolling_friction=own), dt=dt, **given)
        x = run(scene, rolling(0.5, r, orientation=(0, 0, 0, 1)), 0.5)[0]
        yield f"{what}: speed [m/s]", 0.5 - 0.5 * 5 / 7 * G * length / r, x[3], 1e-8
        yield f"{what}: slip [m/s]", 0, x[3] - r * x[11], 1e-8


@law
def rolling_friction_holds_a_ball_on_a_slope(dt):
    """Up to atan(l / r); beyond it 5/14 g (sin a - cos a l / r) t^2."""
    r, length = 0.03, 1e-3
    for share in (0.9, 1.1):
        a = math.atan(share * length / r)
        gravity = (G * math.sin(a), 0.0, -G * math.cos(a))
        scene = world(solid_ball("b", r, 0.1), dt=dt, rolling_friction=length, gravity=gravity)
        way = 0.5 * 5 / 7 * G * (math.sin(a) - math.cos(a) * length / r) if share > 1 else 0.0
        yield (
            f"{share} of it: way [um]",
            UM * way,
            UM * run(scene, state((0, 0, r)), 1.0)[0, 0],
            1e-3 * UM * way + 1,
        )


@law.at(1 / 240)
def a_loaded_ball_swings_out_as_friction_says(dt):
    """SciPy: its centre of mass is below its middle; each swing ends nearer, until friction holds it."""
    r, radius, d, start = 1e-3, 0.03, 0.01, 0.9
    inertia = 0.3 * radius * radius
    body = RigidBody("b", packing("loaded", [[0, 0, d]], [radius], inertia * np.eye(3)), 0.1)

    def rates(_, y):  # while it rolls to smaller angles
        s, c, w = math.sin(y[0]), math.cos(y[0]), y[1]
        mass = inertia + radius * radius + d * d - 2 * radius * d * c - r * d * s
        return w, (-radius * d * s * w * w - G * d * s + r * (G + d * c * w * w)) / mass

    def turns(t, y):
        return y[1] if t > 0.0 else -1.0

    turns.terminal = True
    end = solve_ivp(rates, (0.0, 2.0), [start, 0.0], events=turns, rtol=1e-10, atol=1e-10)
    place = (-d * math.sin(start), 0.0, radius - d * math.cos(start))
    scene = world(body, dt=dt, rolling_friction=r, friction=2.0)
    path = course(scene, state(place, orientation=about((0, 1, 0), start)), [end.t[-1], 5.0, 6.0])[:, 0]
    half, rest, later = 2 * np.arctan2(path[:, 7], path[:, 9])
    yield "angle where it turns [rad]", end.y[0, -1], half, 0.01
    yield "angle in the end, of what is held [rad]", 0, rest, r / d * 1.02
    yield "drift [rad]", 0, later - rest, 1e-5


test_law = law.test()
