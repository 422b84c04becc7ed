"""Rolling, rocking and wobbling: what touches at points that travel."""

import math

import numpy as np
from everyday_worlds import (
    CAN,
    MM,
    SIDEWAYS,
    UM,
    about,
    can,
    course,
    model,
    product,
    rolling,
    run,
    slab,
    slope_of,
    solid_ball,
    solid_box,
    solid_cylinder,
    tilt,
    world,
)
from law_table import Laws
from plain_scenes import G, energy, state
from scipy.spatial.transform import Rotation

from unc_physics import RigidBody, load_model
from unc_physics.shapes import pieces as shapes
from unc_physics.shapes.revolution import lathe_pieces

law = Laws()


# -- rolling -----------------------------------------------------------------------------------------


@law
def round_bodies_roll_without_loss(dt):
    """Rolling without slip does no work, on planes, boxes and fixed bodies, on a side of several pieces."""
    library = load_model("can")
    outer = max(piece.profile[:, 0].max() for piece in library.pieces)
    capsule = RigidBody("b", model([shapes.capsule(0.03, 0.1)], [8e-4, 8e-4, 4e-4]), 0.4)
    for what, body, radius, speeds, tolerance in (
        ("ball", solid_ball("b", 0.03, 0.2), 0.03, (1.0,), 0.001),
        ("can", can(), 0.038, (0.4, 0.8), 0.005),
        ("disc", solid_cylinder("b", 0.04, 0.02, 0.4), 0.04, (0.4,), 0.005),
        ("drum", solid_cylinder("b", 0.1, 0.3, 0.4), 0.1, (0.4,), 0.005),
        ("capsule", capsule, 0.03, (0.4,), 0.005),
        ("can of the library", RigidBody("b", library), outer, (0.4, 0.8), 0.005),
        ("bottle of the library", RigidBody("b", load_model("bottle")), 0.0305, (0.4, 0.8), 0.01),
    ):
        scene = world(body, dt=dt, restitution=0.1)
        for speed in speeds:
            x = run(scene, rolling(speed, radius), 8.0)[0]
            yield f"{what}, {speed} m/s: share after 8 s", 1, math.hypot(x[3], x[4]) / speed, tolerance
    top = RigidBody("top", solid_box("top", (3, 3, 0.1), 1).model, 1, fixed=True)
    for what, bodies, around in (
        ("a box", [can()], [slab((3, 3, 0.1), (0, 0, -0.05))]),
        ("a fixed body", [can(), top], []),
    ):
        scene = world(*bodies, dt=dt, restitution=0.1, environment=around)
        start = [rolling(0.5, 0.038, (-0.6, 0, 0.038)), state((0, 0, -0.05))][: len(bodies)]
        yield f"can on {what}: share after 2 s", 1, run(scene, start, 2.0)[0, 3] / 0.5, 0.005


@law
def balls_roll_in_a_bowl(dt):
    """A ball returns to its height; small swings take 2 pi sqrt(1.4 (R - r) / g); a circle stays level.

    A bowl of 160 mm with a wall of 6 mm has 32 pieces, whose sides are chords that are 4 mm deep.
    """
    turn = np.linspace(0.0, 0.5 * math.pi, 25)
    circle = np.column_stack([np.sin(turn), -np.cos(turn)])
    pieces = lathe_pieces(np.concatenate([0.08 * circle, 0.074 * circle[::-1]]), 4.4e-3)
    assert len(pieces) <= 32
    bowl = RigidBody("bowl", model(pieces, [1, 1, 1]), 1.0, fixed=True)
    for radius in (0.003, 0.01, 0.03):
        arm = 0.074 - radius
        for mu in (0.0, 0.5):
            scene = world(
                solid_ball("b", radius, 0.03), bowl, dt=dt, friction=mu, restitution=0.1, environment=()
            )
            start = state((arm * math.sin(0.7), 0, -arm * math.cos(0.7)))
            heights = arm + course(scene, [start, state()], np.arange(20, 161) * 0.01)[:, 0, 2]
            name = f"ball of {MM * radius:g} mm, mu {mu:g}"
            yield f"{name}: share of its height", 1, heights.max() / (arm + start[2]), 0.03
        start = state((arm * math.sin(0.02), 0, -arm * math.cos(0.02)))
        times = np.arange(1, 801) * 0.001
        x = course(scene, [start, state()], times)[:, 0, 0]
        half = times[np.flatnonzero(x < 0)[0]]
        yield f"{name}: quarter of a swing [s]", 0.5 * math.pi * math.sqrt(1.4 * arm / G), half, 0.006
    arm, speed = 0.064, math.sqrt(G * 0.064 * math.sin(0.7) * math.tan(0.7))
    scene = world(solid_ball("b", 0.01, 0.03), bowl, dt=dt, friction=0.0, environment=())
    start = state((arm * math.sin(0.7), 0, -arm * math.cos(0.7)), (0, speed, 0))
    heights = course(scene, [start, state()], np.arange(1, 101) * 0.02)[:, 0, 2]
    yield "circle: highest rise [mm]", 0, MM * (heights - start[2]).max(), 0.3
    yield "circle: deepest fall [mm]", 0, MM * (heights - start[2]).min(), 0.3


@law
def round_bodies_roll_down_a_slope(dt):
    """g sin a / (1 + I / (m r^2)) t, whatever the inertia."""
    for degrees in (5.0, 10.0):
        a = math.radians(degrees)
        plane, normal = slope_of(a)
        scene = world(can(), dt=dt, restitution=0.1, environment=[plane])
        x = run(scene, state(0.038 * normal, orientation=product(about((0, 1, 0), a), SIDEWAYS)), 0.4)[0]
        right = G * math.sin(a) / 1.5 * 0.4
        yield f"can, {degrees} degrees: speed over right", 1, math.hypot(x[3], x[5]) / right, 0.01
    a = 0.1111
    plane, normal = slope_of(a)
    for inertia, r in ((7e-7, 0.1), (7e-7, 0.05), (1e-3, 0.1), (4e-3, 0.1)):
        ball = RigidBody("b", solid_ball("b", r, 1).model, 1.0, inertia=inertia)
        x = run(world(ball, dt=dt, environment=[plane]), state(r * normal), 2.0)[0]
        right = G * math.sin(a) / (1 + inertia / r**2) * 2
        yield f"ball, {inertia} kg m^2: speed over right", 1, math.hypot(x[3], x[5]) / right, 0.001


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
    """Statics: its centre is above the table, so that it lies still; AA, AAA and D cells."""
    for radius, length, mass, edges in (
        (0.00725, 0.0505, 0.023, (0.012, 0.008, 0.003)),
        (0.00525, 0.0445, 0.012, (0.003,)),
        (0.0171, 0.0615, 0.14, (0.003,)),
    ):
        for edge in edges:
            table = [slab((1, 1, 0.04), (edge - 0.5, 0, -0.02))]
            scene = world(
                solid_cylinder("b", radius, length, mass), dt=dt, restitution=0.2, environment=table
            )
            for drop, yaw in ((0.0, 0.0), (0.005, 0.0), (0.005, 0.4)):
                across = product(about((0, 0, 1), yaw), about((0, 1, 0), math.pi / 2))
                x = run(scene, state((0, 0, radius + drop), orientation=across), 5.0)[0]
                name = f"{length * MM:g} mm, edge at {edge * MM:g}, from {drop * MM:g} mm, yaw {yaw}"
                yield f"{name}: rolled [mm]", 0, MM * math.hypot(x[0], x[1]), 1.0
                yield f"{name}: heights of its ends apart [mm]", 0, MM * abs(math.cos(tilt(x))) * length, 0.1


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
    for size, lift in (
        ((0.04, 0.08, 0.2), 0.1),
        ((0.03, 0.08, 0.2), 0.06),
        ((0.06, 0.08, 0.2), 0.12),
        ((0.09, 0.08, 0.2), 0.18),
        ((0.06, 0.06, 0.42), 0.5 * math.atan(1 / 7)),
    ):
        found, right = rocking(dt, *size, lift)
        yield f"{size[0]} by {size[2]} m: tilt after the first landing over right", 1, found / right, 0.03


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


# -- in a row ----------------------------------------------------------------------------------------

DOMINO = np.array([0.008, 0.024, 0.048])  # m
#: Speed of the wave [m/s] over the gap between dominoes [m], by MuJoCo 4.0.0: box geoms of 10 g with friction
#: 0.5, condim 3 and an elliptic cone, on a plane; solref "0.005 1", solimp "0.99 0.999 0.0001", at most 200
#: iterations, time step 1/4000 s. With 1/1000 s, and solref from "0.01 1" to "0.002 1", it differs by 0.4 %.
WAVE_SPEED = {0.016: 0.6057, 0.024: 0.6326}


@law.at(1 / 240, 1 / 1000)
def dominoes_fall_one_after_another(dt):
    """MuJoCo: the wave's speed over six dominoes from the fourth on, as they pass a tilt of .05 rad."""
    half, first = 0.5 * DOMINO, Rotation.from_rotvec((0, 0.2, 0))
    bodies = [solid_box(f"d{k}", DOMINO, 0.01) for k in range(10)]
    for gap, right in WAVE_SPEED.items():
        start = np.array([state((k * (DOMINO[0] + gap), 0, half[2])) for k in range(10)])
        start[0, :3] = (half[0], 0, 0) + first.apply((-half[0], 0, half[2]))
        start[0, 6:10] = first.as_quat()
        times = np.arange(1, 217) / 240
        path = course(world(*bodies, dt=dt), start, times)
        up = Rotation.from_quat(path[:, :, 6:10].reshape(-1, 4)).apply((0, 0, 1)).reshape(-1, 10, 3)
        tilts = np.arctan2(up[..., 0], up[..., 2])
        passed = [np.interp(0.05, np.maximum.accumulate(tilts[:, k]), times) for k in (3, 9)]
        yield f"gap {gap} m: number that fall", 10, (tilts[-1] > 0.05).sum(), 0
        yield (
            f"gap {gap} m: speed over right",
            1,
            6 * (DOMINO[0] + gap) / (passed[1] - passed[0]) / right,
            0.05,
        )


# at 120 steps a second the contact travels 0.46 rad of the disc's rim in a step
test_law = law.test({("a_disc_rolls_on_its_rim", 120): ("tilt", 4.0)})
