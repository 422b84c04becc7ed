"""Rest: what statics hold still, asleep or awake."""

import math
from dataclasses import replace

import numpy as np
from everyday_worlds import (
    FLOOR,
    MM,
    MRAD,
    SIDEWAYS,
    UM,
    about,
    can,
    course,
    model,
    product,
    run,
    slab,
    solid_ball,
    solid_box,
    tilt,
    turn_between,
    world,
)
from law_table import Laws
from plain_scenes import G, state
from scipy.spatial.transform import Rotation

from unc_physics import Plane, RigidBody, Wrench, load_model
from unc_physics.scene.contact_world import depths_of_pairs
from unc_physics.shapes import pieces as shapes

law = Laws()
BRICK = 0.24, 0.115, 0.071  # m
CARTON = solid_box("b", (0.078, 0.046, 0.122), 0.52)


@law
def bodies_rest(dt):
    """Statics: no drift in 10 s, and no depth."""
    for what, body, height, q in (
        ("box", CARTON, 0.061, (0, 0, 0, 1)),
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
    """Statics: no drift after they have settled, whatever they weigh."""
    for name in ("salt_box", "can", "brick", "mug", "bowl", "plate", "bottle"):
        body = RigidBody("b", load_model(name), {"bowl": 5.0, "can": 0.1}.get(name))
        base = -float(body.model.origin[2])  # their meshes stand on their origins
        settled, later = course(world(body, dt=dt), state((0, 0, base + 0.0002)), [1.0, 4.0])[:, 0]
        yield f"{name}: drift [um]", 0, UM * np.linalg.norm(later[:3] - settled[:3]), 2
        yield f"{name}: depth [um]", 0, UM * (base - later[2]), 100
        yield f"{name}: turn [mrad]", 0, MRAD * turn_between(settled, later), 0.1


@law
def a_dropped_mug_lands_flat(dt):
    """From .1 m on its base, without rebound: it stands there upright at once."""
    mug = load_model("mug")
    x = run(world(RigidBody("b", mug), dt=dt), state((0, 0, 0.1 - mug.origin[2])), 0.2)[0]
    yield "height [mm]", -MM * mug.origin[2], MM * x[2], 0.2
    yield "tilt [mrad]", 0, MRAD * tilt(x), 2


@law
def stacks_stand(dt):
    """Statics, with equal masses and with ratios of 100 and more."""
    for what, masses in (
        ("equal", [3.5] * 5),
        ("alternating by 100", [3.5, 0.035, 3.5, 0.035, 3.5]),
        ("heavy on top by 100", [0.035] * 4 + [3.5]),
        ("lighter and lighter", [100, 10, 1, 0.5, 0.2]),
        ("50 kg on 10 g", [0.01, 50.0]),
    ):
        bodies = [solid_box(f"b{k}", BRICK, mass) for k, mass in enumerate(masses)]
        start = [state((0.004 * (-1) ** k, 0, 0.0355 + 0.071 * k)) for k in range(len(masses))]
        x = run(world(*bodies, dt=dt, restitution=0.1), start, 3.0)
        yield f"{what}: shift [mm]", 0, MM * np.abs(x[:, :3] - np.array(start)[:, :3]).max(), 2
        yield f"{what}: tilt [mrad]", 0, MRAD * max(map(tilt, x)), 10


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
    scene = world(CARTON, dt=dt, gravity=(-5, -6, -7), friction=0.3, environment=walls)
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


# -- falling to rest ---------------------------------------------------------------------------------


@law.at(1 / 60, 1 / 240)
def boxes_that_fall_come_to_lie_on_the_floor(dt):
    """No corner of any of 100 at random orientations ends below it, and all are still."""
    box, corners = RigidBody("b", load_model("salt_box")), np.array([0.039, 0.023, 0.061])
    corners = corners * np.stack(np.meshgrid(*[(-1, 1)] * 3), axis=-1).reshape(-1, 3)
    low, fastest = math.inf, 0.0
    for q in Rotation.random(100, np.random.default_rng(0)).as_quat():
        lift = -Rotation.from_quat(q).apply(corners)[:, 2].min()
        x = run(world(box, dt=dt), state((0, 0, 0.05 + lift), orientation=q), 3.0)[0]
        low = min(low, x[2] + Rotation.from_quat(x[6:10]).apply(corners)[:, 2].min())
        fastest = max(fastest, np.linalg.norm(x[3:6]))
    yield "lowest corner [mm]", 0, MM * low, 0.1
    yield "fastest [m/s]", 0, fastest, 1e-3


@law.at(1 / 240)
def cubes_in_a_bin_come_to_rest(dt):
    """48 cubes of 5 cm from a lattice: most are still after 1.5 s, and none sinks in."""
    half = 0.19  # m, of the bin
    walls = [slab((0.05, 1, 1), (s * (half + 0.025), 0, 0.5)) for s in (-1, 1)]
    walls += [slab((1, 0.05, 1), (0, s * (half + 0.025), 0.5)) for s in (-1, 1)]
    place = np.arange(48)
    start = 0.09 * np.column_stack([place % 4 - 1.5, place // 4 % 4 - 1.5, place // 16 + 0.9])
    turns = Rotation.random(48, np.random.default_rng(0)).as_quat()
    x = np.array([state(p, (0, 0, 0), (0.5, 1, 0), q) for p, q in zip(start, turns, strict=True)])
    bodies = [solid_box(f"cube {k}", (0.05,) * 3, 0.2) for k in place]
    scene = world(*bodies, dt=dt, environment=[FLOOR, *walls])
    end = run(scene, x, 1.5)
    yield "median speed [m/s]", 0, np.median(np.linalg.norm(end[:, 3:6], axis=1)), 0.01
    yield "most depth [mm]", 0, MM * depths_of_pairs(scene, end[None]).max(), 0.5
    yield "cubes that left the bin", 0, (np.abs(end[:, :2]) > half).any(axis=1).sum(), 0


# -- sleep -------------------------------------------------------------------------------------------


@law
def sleep_changes_no_outcome(dt):
    """The same course as awake; then all stand still, to the last bit, also what need not sleep."""
    bodies = [RigidBody(name, load_model("brick"), 0.5) for name in "ab"]
    start = [state((-0.06, 0, 0.2)), state((0.06, 0.02, 0.3), (-0.3, 0, 0))]
    scene = world(*bodies, dt=dt, restitution=0.05)
    awake, asleep = (run(replace(scene, sleep=sleep), start, 4.0) for sleep in (False, True))
    for what, states in (("asleep", asleep), ("awake", awake)):
        yield f"speeds {what} [m/s]", 0, np.abs(states[:, [3, 4, 5, 10, 11, 12]]).max(), 0
    yield "apart [mm]", 0, MM * np.abs(asleep[:, :3] - awake[:, :3]).max(), 0.1
    yield "turned [mrad]", 0, MRAD * max(map(turn_between, asleep, awake)), 1


@law
def what_moves_slowly_does_not_fall_asleep(dt):
    """On an incline 1 mrad above the angle of friction; on a belt of 1 mm/s; pushed with 1.2 mu m g."""
    angle = math.atan(0.5) + 1e-3
    slope = {"gravity": (G * math.sin(angle), 0, -G * math.cos(angle))}
    belt = {"environment": [Plane(surface_velocity=(1e-3, 0, 0))]}
    for what, laws, force, right, tolerance in (
        ("on an incline", slope, 0.0, 0.5 * G * (math.sin(angle) - 0.5 * math.cos(angle)) * 4.0, 2e-3),
        ("on a belt", belt, 0.0, 2e-3, 5e-6),
        ("pushed", {}, 1.2, 0.5 * 0.2 * 0.5 * G, 1e-3),
        ("pushed too little", {}, 0.9, 0.0, 1e-6),
    ):
        wrench = Wrench(force=(force * 0.5 * 0.52 * G, 0, 0), start=1.0, duration=1.0)
        body = replace(CARTON, wrenches=[wrench] if force else [])
        for sleep in (False, True):
            x = run(world(body, dt=dt, sleep=sleep, **laws), state((0, 0, 0.061)), 2.0)[0]
            yield f"{what}, sleep {sleep}: way [m]", right, x[0], tolerance


@law
def what_sleeps_wakes_when_it_is_hit(dt):
    """A ball rolls at a block that has rested for a second, with nothing else near that keeps it awake."""
    bodies = solid_box("block", (0.14, 0.1, 0.04), 0.1), solid_ball("ball", 0.05, 0.5)
    start = [state((0, 0, 0.02)), state((-1.57, 0, 0.05), (1.5, 0, 0), (0, 1.5 / 0.05, 0))]
    times = np.arange(0.5, 2.6, 0.1)
    scene = world(*bodies, dt=dt, sleep=True)
    asleep, awake = course(scene, start, times), course(replace(scene, sleep=False), start, times)
    yield "speed before [m/s]", 0, np.abs([asleep[0, 0, 3:6], awake[0, 0, 3:6]]).max(), 0
    yield "has moved by the end", 1, asleep[-1, 0, 0] > 0.1, 0
    yield "apart [mm]", 0, MM * np.abs(asleep[:, :, :3] - awake[:, :, :3]).max(), 1


test_law = law.test()
