"""Seams, steps, edges and holes: what a body leaves, passes or tips over."""

import math
from dataclasses import replace

import numpy as np
from everyday_worlds import (
    FLOOR,
    MM,
    MRAD,
    about,
    base_radius,
    can,
    course,
    model,
    run,
    slab,
    solid_ball,
    solid_box,
    solid_cylinder,
    world,
)
from law_table import Laws
from plain_scenes import G, energy, state
from planar_shelf import spin_off_shelf
from scipy.integrate import solve_ivp

from unc_physics import Plane, RigidBody, load_model, rounded_box
from unc_physics.shapes import pieces as shapes
from unc_physics.shapes.recipes import RECIPES

law = Laws()
TABLE = slab((0.4, 0.6, 0.02), (-0.2, 0.0, -0.01))  # its edge is at x = 0


# -- from one body to the next -----------------------------------------------------------------------


@law
def a_flat_body_slides_over_a_seam(dt):
    """v t - mu g t^2 / 2 over level boxes; a gap may be less than half the body's length."""
    box, long = solid_box("b", (0.1, 0.08, 0.06), 0.5), solid_box("b", (0.3, 0.08, 0.03), 0.5)
    for gap in (0.0, 0.001, 0.01, 0.04):
        halves = [slab((1, 1, 0.1), (side * (0.5 + gap / 2), 0, -0.05)) for side in (-1, 1)]
        for what, body, half in (("box", box, 0.03), ("long box", long, 0.015), ("can", can(), 0.055)):
            if gap > 0.01 and what == "can":
                continue
            scene = world(body, dt=dt, friction=0.2, environment=halves)
            for speed in (0.6, 1.0, 2.0):
                for yaw in (0.0, 0.3):
                    along = np.array([math.cos(yaw), math.sin(yaw), 0])
                    start = np.array([0, 0, half]) - 0.08 * along
                    x = run(scene, state(start, speed * along, orientation=about((0, 0, 1), yaw)), 0.25)[0]
                    right = speed * 0.25 - 0.5 * 0.2 * G * 0.25**2
                    name = f"{what}, gap {gap * MM:g} mm, {speed} m/s, yaw {yaw}"
                    yield f"{name}: distance over right", 1, (x[:3] - start) @ along / right, 0.005
                    yield f"{name}: height [mm]", 0, MM * (x[2] - half), 0.1


@law
def a_box_stops_at_a_step_and_slides_off_one(dt):
    """Up a millimetre: no passage. Down 2 mm the edge pushes the tilted box on, to .320 m/s in MuJoCo."""
    box = solid_box("b", (0.12, 0.08, 0.03), 0.5)
    for step, mu, speed, time in ((1e-3, 0.3, 1.0, 0.5), (2e-3, 0.0, 0.3, 1.0)):
        tables = [slab((2, 0.6, 0.04), (-1, 0, -0.02)), slab((2, 0.6, 0.04), (1, 0, step - 0.02))]
        scene = world(box, dt=dt, friction=mu, environment=tables)
        x = run(scene, state((-0.1, 0, 0.015), (speed, 0, 0)), time)[0]
        yield f"up {step * MM:g} mm: beyond the step [mm]", 0, MM * max(0.0, x[0] + 0.06), 0.1
    carton = RigidBody("b", load_model("salt_box"))
    tables = [slab((2, 2, 0.1), (-1, 0, -0.05)), slab((6, 2, 0.1), (3, 0, -2e-3 - 0.05))]
    scene = world(carton, dt=dt, friction=0.0, restitution=0.05, environment=tables)
    x = run(scene, state((-0.15, 0, 0.061), (0.3, 0, 0)), 1.0)[0]
    yield "down 2 mm: speed [m/s]", 0.32, x[3], 0.02


@law
def a_body_leaves_a_shelf_with_the_right_spin(dt):
    """The planar solution of `planar_shelf`; within 3 % up to 1/240 s."""
    tolerance, across = (0.03, 0.1) if dt < 0.005 else (0.15, 0.6)
    shelf = [slab((0.6, 1, 0.4), (-0.3, 0, 0.2)), Plane(offset=-2.0)]
    library = RigidBody("can", load_model("can"))
    carton, brick = (RigidBody("b", load_model(name)) for name in ("salt_box", "brick"))
    cases = [("can", can(), 0.055, 0.038, 0.5, v) for v in (0.78, 0.85, 0.9, 1.0, 1.2)]
    cases += [("can of the library", library, 0.055, base_radius(library.model), 0.5, v) for v in (0.8, 1.0)]
    # its upper pieces come within the way of a step of the shelf, and must not take the place of its foot
    cases += [("can of the library", library, 0.055, base_radius(library.model), 0.2, v) for v in (0.7, 1.2)]
    cases += [("carton", carton, 0.061, 0.039, 0.5, v) for v in (0.78, 0.8, 0.85, 0.9, 1.0, 1.2)]
    cases += [("brick", brick, 0.0355, 0.12, 0.3, v) for v in (1.3, 2.0)]
    cases += [("slick can", can(), 0.055, 0.038, 0.001, v) for v in (0.1, 0.2, 0.3, 0.5)]
    for what, body, height, half_base, mu, speed in cases:
        right = spin_off_shelf(height, half_base, body.model.inertia[1, 1], mu, speed, 0.06)
        scene = world(body, dt=dt, friction=mu, restitution=0.1, environment=shelf)
        path = course(scene, state((-0.06, 0, 0.4 + height), (speed, 0, 0)), np.arange(1, 121) / 120)[:, 0]
        fallen = path[np.argmax(path[:, 2] < 0.3)]
        yield f"{what}, mu {mu}, {speed} m/s: spin over right", 1, fallen[11] / right, tolerance
        yield f"{what}, mu {mu}, {speed} m/s: spin across [rad/s]", 0, np.abs(fallen[[10, 12]]).max(), across


# -- over an edge ------------------------------------------------------------------------------------


@law
def a_body_stands_where_its_centre_is_over_its_support(dt):
    """Statics, to 1 mm, on tables and bodies; a rounded body's face ends a radius before its side."""
    carton, turned = RigidBody("b", load_model("salt_box")), about((0, 0, 1), 0.6)
    lower = RigidBody("lower", solid_box("l", (0.2, 0.1, 0.05), 2.0).model, 2.0)
    upper, straight = solid_box("b", (0.1, 0.08, 0.06), 0.3), (0, 0, 0, 1)
    for inset in (-1e-3, 1e-3):  # of the centre from the edge [m]
        cases = [
            ("carton on a table", [carton], [TABLE], -inset, 0.061, straight),
            ("turned carton on a table", [carton], [TABLE], -inset, 0.061, turned),
            ("box on a body", [upper, lower], [FLOOR], 0.1 - inset, 0.08, turned),
        ]
        for r in (5e-4, 2e-3, 5e-3):
            cubes = [RigidBody(name, rounded_box(0.1, r), 1.0) for name in ("b", "lower")]
            cases.append((f"cube rounded by {r} m", cubes, [FLOOR], 0.05 - r - inset, 0.15, straight))
        bottle = RigidBody("b", load_model("bottle"))
        high = 0.05 - bottle.model.origin[2]
        cases.append(("bottle on a body", [bottle, lower], [FLOOR], 0.1 - inset, high, straight))
        for name in ("bottle", "bowl", "plate", "mug"):  # feet that are rings, of sectors
            ring = RigidBody("b", load_model(name))
            height = -ring.model.origin[2]
            for yaw in np.radians((0, 11, 22, 33, 44, 55, 66, 77)):
                case = f"{name} at {yaw:.2f} rad", [ring], [TABLE], -inset, height, about((0, 0, 1), yaw)
                cases.append(case)
        bowl = load_model("bowl")
        packed = replace(
            bowl, pieces=[piece.moved(bowl.origin, np.eye(3)) for piece in RECIPES["bowl"].pieces()]
        )
        assert any(len(piece.arcs) for piece in packed.pieces)
        case = "bowl with arcs", [RigidBody("b", packed)], [TABLE], -inset, -packed.origin[2]
        cases += [(*case, about((0, 0, 1), yaw)) for yaw in (0.0, 0.19)]
        for what, bodies, around, x, z, q in cases:
            low = 0.025 if bodies[-1] is lower else 0.05
            start = [state((x, 0.01, z), orientation=q), state((0, 0, low))][: len(bodies)]
            fell = z - run(world(*bodies, dt=dt, environment=around), start, 0.8)[0, 2]
            if inset < 0:
                yield f"{what}, beyond the edge: falls 1 cm", 1, fell > 0.01, 0
            else:
                yield f"{what}, before the edge: falls [mm]", 0, MM * fell, 0.1


@law
def a_box_tips_about_an_edge(dt):
    """A pendulum about the edge, by SciPy: its tilt, with its energy and the place of the edge kept."""
    body, times = solid_box("b", (0.1, 0.08, 0.06), 1.0), np.array([0.1, 0.125, 0.15])
    moment = body.model.inertia[1, 1] + 0.01**2 + 0.03**2  # per mass

    def swing(_, y):
        return y[1], G * (0.01 * math.cos(y[0]) + 0.03 * math.sin(y[0])) / moment

    times = np.round(times / dt) * dt
    right = solve_ivp(swing, (0, 0.16), [0, 0], t_eval=times, rtol=1e-10, atol=1e-12).y[0]
    scene = world(body, dt=dt, friction=3.0, environment=[TABLE])
    for a, end in zip(right, course(scene, state((0.01, 0, 0.03)), times)[:, 0], strict=True):
        name, found = f"{math.degrees(a):.1f} degrees", 2.0 * math.atan2(end[7], end[9])
        kinetic = energy(scene, end[None]) - G * end[2]
        up, along = (math.sin(found), math.cos(found)), (math.cos(found), -math.sin(found))
        yield f"{name}: tilt [mrad]", MRAD * a, MRAD * found, 4
        yield f"{name}: energy over right", 1, kinetic / (G * (0.03 - end[2])), 0.01
        yield f"{name}: edge up [mm]", 30, MM * (up @ end[[0, 2]]), 0.1
        yield f"{name}: edge along [mm]", 10, MM * (along @ end[[0, 2]]), 0.1


# -- past it -----------------------------------------------------------------------------------------


@law
def a_ball_falls_through_a_hole(dt):
    """Free fall, although four walls are near it."""
    r = 0.02
    for gap in (0.05e-3, 0.25e-3, 0.5e-3, 1e-3):
        w = r + gap
        walls = [slab((0.1, 0.3, 0.01), (side * (w + 0.05), 0, 0)) for side in (-1, 1)]
        walls += [slab((0.3, 0.1, 0.01), (0, side * (w + 0.05), 0)) for side in (-1, 1)]
        scene = world(solid_ball("b", r, 0.1), dt=dt, environment=walls)
        for aside in (0.0, 0.5 * gap):
            x, name = (
                run(scene, state((aside, 0, 0.06)), 0.2)[0],
                f"{gap * MM:g} mm free, {aside * MM:g} aside",
            )
            yield f"{name}: speed [m/s]", -G * round(0.2 / dt) * dt, x[5], 1e-9
            yield (
                f"{gap * MM:g} mm free, {aside * MM:g} aside: shift [m]",
                0,
                np.abs(x[:2] - [aside, 0]).max(),
                1e-9,
            )


@law
def a_carton_falls_past_an_edge(dt):
    """Free fall beside a shelf: no push."""
    shelf = [slab((0.2, 0.4, 0.02), (0.1, 0, -0.01))]
    scene = world(RigidBody("b", load_model("salt_box")), dt=dt, environment=shelf)
    for free in (5e-5, 2e-4, 4e-4):
        x, time = run(scene, state((-0.039 - free, 0, 0.081)), 0.3)[0], round(0.3 / dt) * dt
        yield f"{free} m free: shift and spin", 0, np.abs([x[0] + 0.039 + free, *x[10:]]).max(), 1e-9
        yield f"{free} m free: speed [m/s]", -G * time, x[5], 1e-9


@law
def a_box_falls_into_a_bin(dt):
    """Free fall through its opening, then rest on its ground."""
    bin = RigidBody("bin", load_model("bin"), 1.0, fixed=True)
    scene = world(RigidBody("b", rounded_box(0.03, 1e-3), 0.1), bin, dt=dt, environment=())
    top, time = bin.model.bounds[1][2] + 0.016, round(0.15 / dt) * dt
    path = course(scene, [state((0, 0, top)), state()], [time, 0.8])[:, 0]
    yield "speed [m/s]", -G * time, path[0, 5], 1e-9
    yield (
        "rests above the ground [m]",
        1,
        bin.model.bounds[0][2] < path[1, 2] < bin.model.bounds[0][2] + 0.03,
        0,
    )
    yield "speed in the end [m/s]", 0, np.abs(path[1, 3:6]).max(), 1e-4


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


test_law = law.test()
