"""Impacts: Newton's restitution and Coulomb's friction, whatever meets."""

import math

import numpy as np
from everyday_worlds import FLOOR, MM, about, course, run, slab, solid_ball, solid_box, solid_cylinder, world
from law_table import Laws
from plain_scenes import G, ball, state
from scipy.spatial.transform import Rotation

from unc_physics import Box, Capsule, Cylinder, Plane, RigidBody, Sphere, load_model

law = Laws()


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
def a_ball_rebounds_alike_whenever_it_lands_in_a_step(dt):
    """Energy after the bounce: e^2 of that before, also where the impact is just after the end of a step."""
    scene, e = world(solid_ball("b", 0.03, 0.2), dt=dt, restitution=0.8, friction=0.0), 0.8
    steps = round(0.25 / dt)
    for part in (-0.01, -1e-4, 0.0, 1e-4, 1e-3, 3e-3, 8e-3, 0.03, 0.5):
        h = 0.5 * G * ((steps + part) * dt) ** 2
        x = run(scene, state((0, 0, 0.03 + h)), (steps + 8) * dt)[0]
        found = (x[2] - 0.03 + x[5] ** 2 / (2 * G)) / h
        yield f"landing {part} steps after one ends", e * e, found, 1e-6


@law
def a_ball_rebounds_alike_from_rows_of_cubes(dt):
    """Cubes that touch at their sides bear no part of an impact on one of them: the height of one cube."""
    side, r, h, e = 0.05, 0.02, 0.3, 0.7
    alone = None
    for count in (1, 9, 20):
        bodies = [*(solid_box(f"c{k}", (side,) * 3, 0.5) for k in range(count)), solid_ball("b", r, 0.05)]
        scene = world(*bodies, dt=dt, restitution=e, friction=0.0)
        start = [state((side * k, 0, 0.5 * side)) for k in range(count)]
        start.append(state((side * (count // 2), 0, side + r + h)))
        x = run(scene, start, math.sqrt(2 * h / G) + 0.1)[-1]
        height = (x[2] - side - r + x[5] ** 2 / (2 * G)) / h
        alone = height if alone is None else alone
        yield f"{count} cubes: height over h", alone, height, 0.01
    yield "1 cube: it rebounds", 0.29, alone, 0.02


@law
def an_elastic_ball_loses_nothing(dt):
    """Energy: constant for e = 1."""
    scene = world(solid_ball("b", 0.03, 0.2), dt=dt, restitution=1.0, friction=0.0)
    x = run(scene, state((0, 0, 0.53)), 3.0)[0]
    yield "share of energy after 3 s", 1, (G * (x[2] - 0.03) + x[5] ** 2 / 2) / (G * 0.5), 0.002


@law
def flat_landings_on_any_support_rebound_alike(dt):
    """Heights e^2 h and e^4 h without spin, on a plane, a wide box, and a pedestal narrower than the body."""
    fall, cube = math.sqrt(0.4 / G), solid_box("b", (0.1, 0.1, 0.1), 1.0)
    landers = (
        ("cube", cube, 0.05, 0.075, 0.0),
        ("turned cube", cube, 0.05, 0.075, math.pi / 4),
        ("carton", RigidBody("b", load_model("salt_box")), 0.061, 0.03, 0.3),
        ("cylinder", solid_cylinder("b", 0.06, 0.12, 1.36), 0.06, 0.075, 0.0),
    )
    for what, body, half, narrow, yaw in landers:
        supports = (FLOOR, slab((1, 1, 0.2), (0, 0, -0.1)), slab((narrow, narrow, 0.2), (0, 0, -0.1)))
        start = state((0, 0, half + 0.2), orientation=about((0, 0, 1), yaw))
        for where, support in zip(("plane", "box", "pedestal"), supports, strict=True):
            for e in (0.3, 0.5, 0.69, 0.9, 1.0):
                scene = world(body, dt=dt, restitution=e, environment=[support])
                # in the middle of the first and the second flight after the impact
                times = np.array([fall * (1 + e), fall * (1 + 2 * e + e * e)])
                path = course(scene, start, times)[:, 0]
                heights = path[:, 2] - half + path[:, 5] ** 2 / (2 * G)
                for k, height in enumerate(heights, start=1):
                    yield f"{what} on a {where}, e {e}: height {k} over h", e ** (2 * k), height / 0.2, 0.02
                yield f"{what} on a {where}, e {e}: spin [rad/s]", 0, np.abs(path[:, 10:]).max(), 0.02


@law
def an_impact_has_newtons_restitution_and_coulombs_friction(dt):
    """Change of speed mu (1 + e) v_n while it slips; a ball that sticks keeps 5/7; no gravity."""
    for e in (0.0, 0.05, 0.4, 1.0):
        for mu in (0.05, 0.2, 0.8):
            for normal, along in ((1.0, 1.0), (0.3, 2.0), (3.0, 0.5)):
                scene = world(solid_ball("b", 0.03, 0.2), dt=dt, restitution=e, friction=mu, gravity=None)
                x = run(scene, state((0, 0, 0.04), (along, 0, -normal)), 0.06)[0]
                lost, name = min(mu * (1 + e) * normal, 2 / 7 * along), f"e {e}, mu {mu}, {normal} m/s"
                yield f"{name}: normal [m/s]", e * normal, x[5], 0.02 * normal
                yield f"{name}: lost along [m/s]", lost, along - x[3], 0.02 * lost
                yield f"{name}: spin [rad/s]", 2.5 * lost / 0.03, x[11], 0.02 * 2.5 * lost / 0.03
                yield f"{name}: across", 0, np.abs(x[[4, 10, 12]]).max(), 1e-9


@law
def friction_of_impacts_falls_with_their_speed(dt):
    """mu / (1 + v_n / v0), as `impact_friction_speed` says; it still ends slip."""
    laws = {"dt": dt, "gravity": None}
    for e in (0.0, 0.5, 0.8):
        for closing in (0.3, 1.0, 3.0):
            own = {"restitution": e, "friction": 0.2, "impact_friction_speed": 2.0}
            scene = world(solid_ball("b", 0.03, 0.2), **laws | own)
            x = run(scene, state((0, 0, 0.04), (4.0, 0, -closing)), 0.06)[0]
            ratio = (4 - x[3]) / (x[5] + closing)
            yield f"e {e}, closing at {closing} m/s: ratio", 0.2 / (1 + closing / 2), ratio, 0.002
    scene = world(solid_ball("b", 0.03, 0.2), **laws, friction=0.6, impact_friction_speed=1.0)
    x = run(scene, state((0, 0, 0.04), (0.5, 0, -1.0)), 0.06)[0]
    yield "sticks: speed along [m/s]", 5 / 7 * 0.5, x[3], 0.005


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
    for gap in (0.0, 1e-5, 5e-5, 1e-4, 1e-3):
        balls = [solid_ball(f"b{k}", r, 0.1) for k in range(5)]
        scene = world(*balls, dt=dt, gravity=None, friction=0.0, restitution=1.0, environment=())
        start = [state((k * (2 * r + gap) - 0.1 * (k == 0), 0, 0), (float(k == 0), 0, 0)) for k in range(5)]
        v = run(scene, start, 0.5)[:, 3]
        yield f"gaps {gap * MM} mm: largest error [m/s]", 0, np.abs(v - [0, 0, 0, 0, 1]).max(), 0.02


@law
def a_body_that_is_struck_meets_what_is_behind_it_in_the_same_step(dt):
    """Before a ball at rest it passes its speed on, before a thin wall it does not go through."""
    for speed, way in ((6.0, 0.05), (15.0, 0.05 + 0.3 * 15 * dt)):
        for gap in (3e-4, 3e-3):
            balls = [solid_ball(name, 0.02, 0.1) for name in "abc"]
            start = np.array([state((-0.04 - way, 0, 0), (speed, 0, 0)), state(), state((0.04 + gap, 0, 0))])
            space, name = {"dt": dt, "gravity": None, "friction": 0.0}, f"{speed} m/s, {gap * MM} mm"
            v = run(world(*balls, environment=(), restitution=1.0, **space), start, 0.2)[:, 3]
            yield f"{name}: largest error [m/s]", 0, np.abs(v - [0, 0, speed]).max(), 0.02 * speed
            wall = slab((0.002, 1, 1), (0.02 + gap + 0.001, 0, 0))
            end = run(world(*balls[:2], environment=[wall], **space), start[:2], 0.2)
            yield f"{name}: into the wall [mm]", 0, MM * max(0.0, end[1, 0] - gap), 0.2


@law
def a_fast_ball_stops_at_a_thin_wall(dt):
    """20 m/s at 10 mm: rebound e v, and no passage."""
    for e in (0.0, 0.5):
        wall = [slab((0.01, 1, 1), (1, 0, 0))]
        scene = world(solid_ball("b", 0.05, 0.3), dt=dt, gravity=None, restitution=e, environment=wall)
        x = run(scene, state((0.3, 0, 0), (20, 0, 0)), 0.1)[0]
        yield f"e {e}: speed [m/s]", -20 * e, x[3], 0.01
        yield f"e {e}: beyond the wall [mm]", 0, MM * max(0.0, x[0] - 1.0 + 0.005 + 0.05), 0.1


# -- what stands in the environment ------------------------------------------------------------------


def _axes(x, z):
    """Return the quaternion of the frame with these two axes."""
    return Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z])).as_quat()


#: Elements of the environment whose surface has a point with a normal, and a tangent in it.
ELEMENTS = {
    "plane": lambda p, n, t: Plane(n, n @ p),
    "box": lambda p, n, t: Box((0.3, 0.2, 0.1), p - 0.05 * n, _axes(t, n)),
    "sphere": lambda p, n, t: Sphere(0.07, p - 0.07 * n),
    "cylinder": lambda p, n, t: Cylinder(0.06, 0.3, p - 0.06 * n, _axes(n, t)),
    "end of a cylinder": lambda p, n, t: Cylinder(0.06, 0.3, p - 0.15 * n, _axes(t, n)),
    "capsule": lambda p, n, t: Capsule(0.06, 0.3, p - 0.06 * n, _axes(n, t)),
}


@law
def each_element_stops_a_ball(dt):
    """Newton along its normal, at 5 m/s."""
    p, n, t = np.array([0.2, 0.1, -0.3]), np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.0])
    for what, make in ELEMENTS.items():
        for e in (0.0, 0.7):
            element = [make(p, n, t)]
            scene = world(solid_ball("b", 0.05, 0.3), dt=dt, gravity=None, restitution=e, environment=element)
            x = run(scene, state(p + 0.08 * n, -5.0 * n), 0.05)[0]
            yield f"{what}, e {e}: error of velocity [m/s]", 0, np.abs(x[3:6] - 5.0 * e * n).max(), 0.01


@law
def each_element_holds_a_ball(dt):
    """Statics: three of them make a hollow, in whose middle it stays."""
    middle = np.array([0.1, -0.2, 0.3])
    for what, make in ELEMENTS.items():
        elements = []
        for angle in 2.0 * np.pi / 3.0 * np.arange(3):
            out, across = np.array(
                [[math.cos(angle), math.sin(angle), 0], [-math.sin(angle), math.cos(angle), 0]]
            )
            normal = 0.8 * np.array([0, 0, 1]) - 0.6 * out
            elements.append(make(middle - 0.05 * normal, normal, across))
        scene = world(solid_ball("b", 0.05, 0.3), dt=dt, environment=elements)
        settled, later = course(scene, state(middle + (0.002, 0.001, 0.03)), [2.0, 4.0])[:, 0]
        yield f"{what}: from the middle [mm]", 0, MM * np.abs(later[:3] - middle).max(), 0.2
        yield f"{what}: drift [mm]", 0, MM * np.linalg.norm(later[:3] - settled[:3]), 1e-3


@law
def a_ball_of_spheres_bounces_on_a_turned_box(dt):
    """Height e^2 h along gravity, which is the box's axis; without pieces a model has one for each sphere."""
    r, angle, e = 0.02, 0.3, 0.8
    up = np.array([math.sin(angle), 0.0, math.cos(angle)])
    box = Box((1.0, 1.0, 0.1), -0.05 * up, about((0, 1, 0), angle))
    scene = world(RigidBody("b", ball(r), 0.1), dt=dt, environment=[box], gravity=-G * up, restitution=e)
    x = run(scene, state((r + 0.1) * up), 1.8 * math.sqrt(0.2 / G))[0]
    height = x[:3] @ up - r + (x[3:6] @ up) ** 2 / (2 * G)
    yield "height over h", e * e, height / 0.1, 1e-3
    yield "aside [um]", 0, 1e6 * np.linalg.norm(x[:3] - x[:3] @ up * up), 1e-3


test_law = law.test()
