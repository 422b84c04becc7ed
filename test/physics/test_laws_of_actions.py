"""What robots do: prescribed paths, moving surfaces, wrenches, attachment, pushes; and drag."""

import math
from dataclasses import replace

import numpy as np
import pytest
from everyday_worlds import (
    MM,
    about,
    course,
    run,
    slab,
    solid_ball,
    solid_box,
    solid_cylinder,
    turn_between,
    world,
)
from law_table import Laws
from plain_scenes import BALL, G, at_steps, momenta, state
from scipy.spatial.transform import Rotation

from unc_physics import Belief, PosePath, RigidBody, Scene, Wrench, load_model, make_propagator, predict
from unc_physics.scene.kinematic_states import path_states

law = Laws()
BLOCK = solid_box("box", (0.14, 0.1, 0.04), 1.5)
FINGER = solid_ball("finger", 0.01, 1).model


def straight(velocity, time=4.0, position=(0, 0, 0), begin=0.0):
    """Return the path of a body that moves steadily for a time."""
    ends = [np.asarray(position, float), position + time * np.asarray(velocity, float)]
    return PosePath(times=[begin, begin + time], positions=ends, linear_velocities=[velocity] * 2)


def along(name, size, path, **surface):
    """Return a box that follows a path."""
    return RigidBody(name, solid_box(name, size, 1).model, 1, trajectory=path, **surface)


# -- prescribed bodies -------------------------------------------------------------------------------


@law
def a_path_is_followed_whatever_it_meets(dt):
    """Hermite's polynomials, through a block of 50 kg; way points' rotations; rest after the last one."""
    q = Rotation.from_rotvec([[0, 0, 0.2], [0.5, 0, 1.0], [0.5, -1.0, 0.3]])
    times, places = np.array([0.1, 0.6, 1.0]), np.array([[-0.3, 0, 0.03], [0.1, 0.02, 0.05], [0.5, 0, 0.03]])
    v = np.array([[0.1, 0, 0], [1.0, 0.3, -0.2], [0, 0, 0.4]])
    path = PosePath(times=times, positions=places, orientations=q.as_quat(), linear_velocities=v)
    bodies = RigidBody("box", BLOCK.model, 50.0), along("bar", (0.14, 0.1, 0.04), path)
    at = np.arange(1, 13) * 0.1
    found = course(world(*bodies, dt=dt), [state((0.05, 0, 0.02)), state()], at)
    yield "the block moves", 1, np.linalg.norm(found[-1, 0, :2] - [0.05, 0]) > 0.05, 0
    worst = turned = 0.0
    for t, x in zip(np.round(at / dt) * dt, found[:, 1], strict=True):
        k = min(max(int(np.searchsorted(times, t) - 1), 0), 1)
        h = times[k + 1] - times[k]
        u = min(max((t - times[k]) / h, 0.0), 1.0)
        a, b, c, d = 2 * u**3 - 3 * u**2 + 1, u**3 - 2 * u**2 + u, 3 * u**2 - 2 * u**3, u**3 - u**2
        p = a * places[k] + b * h * v[k] + c * places[k + 1] + d * h * v[k + 1]
        worst = max(worst, np.abs(x[:3] - p).max())
        if u == 1.0:
            turned = max(turned, (Rotation.from_quat(x[6:10]) * q[k + 1].inv()).magnitude())
    yield "position [m]", 0, worst, 1e-9
    yield "rotation [rad]", 0, turned, 1e-9
    yield "speed after it [m/s]", 0, np.abs(found[-1, 1, 3:6]).max(), 0


@law
def a_wall_on_a_path_throws_a_ball(dt):
    """Newton: twice the wall's speed; Coulomb's friction by the wall's motion along itself."""
    wall = along("wall", (0.1, 1, 1), straight((2, 0.6, 0), 0.5, (-0.4, 0, 0)), restitution=1.0)
    ball = solid_ball("ball", 0.05, 0.3, restitution=1.0)
    scene = world(ball, wall, dt=dt, gravity=None, environment=(), friction=0.1)
    x = run(scene, [state(), state()], 0.4)[0]
    yield "normal [m/s]", 4.0, x[3], 0.01
    yield "along [m/s]", min(0.1 * 4.0, 2 / 7 * 0.6), x[4], 0.002


@law
def a_tray_takes_a_part_along_or_slips(dt):
    """Slip v^2 / (2 mu g) of a steady tray; (a - mu g) t^2 / 2, if any, of one that accelerates."""
    part, size, up = RigidBody("part", load_model("salt_box")), (4, 0.4, 0.02), (0, 0, 0.061)
    for speed in (0.3, 1.0):
        tray = along("tray", size, straight((speed, 0, 0), position=(0, 0, -0.01)))
        scene = world(part, tray, dt=dt, friction=0.3, environment=())
        x = run(scene, [state((-0.5, 0, 0.061)), state()], 1.0)[0]
        slip = speed**2 / (2 * 0.3 * G)
        yield f"{speed} m/s: slip [mm]", MM * slip, MM * (speed - (x[0] + 0.5)), 0.005 * MM * slip
        yield f"{speed} m/s: speed over right", 1, x[3] / speed, 0.001
    for acceleration, mu, every, given in (
        (2.0, 0.3, 0.1, True),
        (2.0, 0.3, 0.01, False),
        (3.0, 0.5, 0.1, False),
        (4.0, 0.3, 0.1, True),
        (20.0, 0.3, 0.1, True),
    ):
        t = np.arange(0.0, 0.8001, every)
        places = np.stack([0.5 * acceleration * t * t, 0 * t, 0 * t - 0.01], axis=1)
        speeds = np.stack([acceleration * t, 0 * t, 0 * t], axis=1) if given else None
        tray = along("tray", size, PosePath(times=t, positions=places, linear_velocities=speeds))
        scene = world(part, tray, dt=dt, friction=mu, environment=())
        x, carrier = run(scene, [state(up), state((0, 0, -0.01))], 0.4)
        slip = 0.5 * max(acceleration - mu * G, 0.0) * 0.16
        yield f"{acceleration} m/s^2: slip [mm]", MM * slip, MM * (carrier[0] - x[0]), 1e-3 + 2e-3 * MM * slip
        yield f"{acceleration} m/s^2: height [mm]", 61, MM * x[2], 0.1


@law
def a_lift_raises_a_box(dt):
    """It keeps to the lift."""
    up = (0, 0, 0.5)
    lift = along("lift", (0.2, 0.2, 0.02), straight(up))
    scene = world(solid_box("b", (0.05,) * 3, 0.1), lift, dt=dt, environment=())
    x = run(scene, [state((0, 0, 0.035), up), state(velocity=up)], 1.0)[0]
    yield "height [mm]", 535, MM * x[2], 0.1


@law
def what_came_to_rest_is_taken_along_by_a_surface(dt):
    """A body that settled at the start, with the surface at rest, on a belt and about a turntable's axis."""
    one = make_propagator("monte_carlo", samples=1, seed=0)
    box = replace(solid_box("b", (0.05,) * 3, 0.1), at_rest=True)
    for what, surface, right in (
        ("belt", {"surface_velocity": (0.3, 0, 0)}, (0.3 - 0.3**2 / (2 * 0.3 * G), 0.0)),
        ("turntable", {"surface_angular_velocity": (0, 0, 2), "surface_center": (0, 0, 0)}, (0.0, 2.0)),
    ):
        scene = world(box, dt=dt, friction=0.3, environment=[slab((4, 4, 0.02), (0, 0, -0.01), **surface)])
        x = predict(scene, Belief.exact(state((0, 0, 0.025))[None]), one, 1.0).samples()[0, 0]
        yield f"{what}: way [mm]", MM * right[0], MM * x[0], 0.2
        yield f"{what}: spin [mrad/s]", MM * right[1], MM * x[12], 2


@law
def a_turntable_takes_a_box_along(dt):
    """w^2 r < mu g: it turns with a body or a surface."""
    times = np.linspace(0, 2, 41)
    path = PosePath(
        times=times,
        positions=np.zeros((41, 3)),
        orientations=[about((0, 0, 1), 2 * t) if t else np.array([0, 0, 0, 1.0]) for t in times],
        angular_velocities=np.tile([0, 0, 2.0], (41, 1)),
    )
    disc = RigidBody("disc", solid_cylinder("disc", 0.3, 0.02, 1).model, 1, trajectory=path)
    own = {"surface_angular_velocity": (0, 0, 2), "surface_center": (0.1, 0, 0)}
    surface, spin = slab((2, 2, 0.1), (0.3, 0, -0.04), **own), (0, 0, 2.0)
    for what, bodies, around, middle, tolerance in (
        ("disc", [disc], (), 0.0, 0.02),
        ("surface", [], [surface], 0.1, 0.4),
    ):
        scene = world(solid_box("b", (0.03,) * 3, 0.1), *bodies, dt=dt, environment=around)
        start = [state((middle + 0.2, 0, 0.025), (0, 0.4, 0), spin), state(spin=spin)][: 1 + len(bodies)]
        x = run(scene, start, 1.9)[0]
        angle = math.remainder(math.atan2(x[1], x[0] - middle) - 3.8, 2 * math.pi)
        turned = turn_between(x, state(orientation=about((0, 0, 1), 3.8)))
        yield f"{what}: radius [mm]", 200, MM * math.hypot(x[0] - middle, x[1]), tolerance
        yield f"{what}: angle [mrad]", 0, MM * angle, 1
        yield f"{what}: its own turn [mrad]", 0, MM * turned, 3


@law
def a_belt_takes_a_box_along(dt):
    """Slip v^2 / (2 mu g) on a surface that moves in itself; what is along its normal does not count."""
    for speed, normal, sleep in ((0.3, 0.0, False), (1.0, 0.0, False), (0.5, 7.0, True)):
        belt = slab((4, 0.4, 0.02), (0, 0, -0.01), surface_velocity=(speed, 0, normal))
        scene = world(solid_box("b", (0.05,) * 3, 0.1), dt=dt, friction=0.3, environment=[belt], sleep=sleep)
        x = run(scene, state((-0.5, 0, 0.025)), 1.0)[0]
        right = speed**2 / (2 * 0.3 * G)
        yield f"{speed} m/s: slip [mm]", MM * right, MM * (speed - (x[0] + 0.5)), 0.005 * MM * right
        yield f"{speed} m/s: speed over right", 1, x[3] / speed, 1e-4
        yield f"{speed} m/s: height [mm]", 25, MM * x[2], 0.1


# -- pushes ------------------------------------------------------------------------------------------


@law
def a_slow_push_moves_a_box_along(dt):
    """As far as the finger goes, at 2.5 mm/s and a tenth of that, asleep before it or not."""
    for sleep in (False, True):
        for speed in (2.5e-3, 2.5e-4):
            time = 2.0
            path = straight((speed, 0, 0), time, (-0.08, 0, 0.03), begin=0.5)
            scene = world(
                BLOCK, RigidBody("finger", FINGER, trajectory=path), dt=dt, sleep=sleep, friction=0.3
            )
            start, half, end = course(
                scene, [state((0, 0, 0.02)), state()], (0.5, 0.5 + 0.5 * time, 0.7 + time)
            )[:, 0]
            name = f"{MM * speed} mm/s, sleep {sleep}"
            yield f"{name}: way [mm]", MM * speed * time, MM * (end[0] - start[0]), 0.02
            yield f"{name}: second half [mm]", MM * speed * time / 2, MM * (end[0] - half[0]), 0.02
            yield f"{name}: speed over right", 1, half[3] / speed, 0.01
            yield f"{name}: aside [mm]", 0, MM * end[1], 0.005
            yield f"{name}: speed in the end [mm/s]", 0, MM * np.linalg.norm(end[3:6]), 0.01


@law
def a_push_off_the_centre_turns_a_box(dt):
    """Limit surface of a frictionless push: turn F a / c^2 of its way, c^2 from a third to all of r^2."""
    for offset in (-0.04, -0.02, 0.0, 0.02, 0.04):
        path = straight((0.01, 0, 0), 1.0, (-0.08, offset, 0.03), begin=0.5)
        finger = RigidBody("finger", FINGER, friction=0.0, trajectory=path)
        start, end = course(world(BLOCK, finger, dt=dt), [state((0, 0, 0.02)), state()], (0.5, 1.5))[:, 0]
        turn, a, c2 = Rotation.from_quat(end[6:10]).as_rotvec()[2], abs(offset), 0.07**2 + 0.05**2
        if offset == 0.0:
            yield "through the centre: turn [mrad]", 0, MM * turn, 0.1
            yield "through the centre: way [mm]", 10, MM * (end[0] - start[0]), 0.1
        else:
            low, high = 0.01 * a / (c2 + a * a) * 0.9, 0.01 * a / (c2 / 3 + a * a) * 1.1
            # a force along x at (-0.07, offset) has the moment -offset F
            yield f"{offset} m: turn [rad]", (low + high) / 2, -turn * np.sign(offset), (high - low) / 2


# -- wrenches ----------------------------------------------------------------------------------------


@law
def forces_and_torques_give_their_impulses(dt):
    """m v = F t, I w = T t, at times that are no step's; in body axes they turn with the body."""
    space = {"dt": dt, "gravity": None, "environment": ()}
    wrench = Wrench(force=(0.3, 0, 0), torque=(0, 0, 2e-5), start=0.1013, duration=0.2)
    x = run(world(RigidBody("ball", BALL, 0.5, wrenches=[wrench]), **space), state(), 1.0)[0]
    yield "speed [m/s]", 0.3 * 0.2 / 0.5, x[3], 1e-10
    yield "way [m]", 0.12 * (1.0 - 0.1013 - 0.1), x[0], 2e-5
    yield "spin [rad/s]", 2e-5 * 0.2 / (0.5 * 0.001), x[12], 1e-10
    wrench = Wrench(torque=(1e-3, 0, 2e-3), duration=0.3)
    scene = world(replace(BLOCK, wrenches=[wrench]), **space)
    x = run(scene, state(orientation=about((1, 2, 3), 0.8)), 0.5)
    error = momenta(scene, x)[1] - 0.3 * np.array([1e-3, 0, 2e-3])
    yield "turned box: angular momentum [kg m^2/s]", 0, np.abs(error).max(), 1e-9
    wrench = Wrench(force=(1.0, 0, 0), body_axes=True)
    ball, t = RigidBody("ball", BALL, 1.0, wrenches=[wrench]), round(math.pi / 2 / dt) * dt
    x = run(world(ball, **space), state(spin=(0, 0, 2)), t)
    for axis, right in enumerate((0.5 * math.sin(2 * t), 0.5 - 0.5 * math.cos(2 * t), 0.0)):
        yield f"in body axes, half a turn: speed {axis} [m/s]", right, x[0, 3 + axis], 1.1 * dt


# -- drag --------------------------------------------------------------------------------------------


@at_steps
@pytest.mark.parametrize("integrator", ["implicit", "explicit"])
def test_drag_alone_slows_down_hyperbolically(integrator, dt):
    """``v0 / (1 + k v0 t)`` with ``k = rho C_d A / (2 m)``, to round-off at any step; spin stays."""
    ball = RigidBody("ball", BALL, 0.05, drag=0.04)
    x = run(drag_scene(ball, integrator, dt, None), state(velocity=(3.0, -4.0, 0), spin=(0, 0, 2)), 1.5)[0]
    speed = 5.0 / (1.0 + 0.5 * 1.2 * 0.04 / 0.05 * 5.0 * 1.5)
    np.testing.assert_allclose(x[3:6], [0.6 * speed, -0.8 * speed, 0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(x[10:], [0, 0, 2], rtol=1e-9, atol=1e-12)


def drag_scene(body, integrator, dt, gravity):
    """Return a scene of one body in the air by either integrator."""
    if integrator == "explicit":
        return Scene([body], gravity=gravity, integrator=integrator, dt=dt, stiffness=1e5)
    return world(body, gravity=gravity, dt=dt, environment=())


def test_a_body_that_falls_with_drag_approaches_its_terminal_velocity():
    """``v = v_t tanh(g t / v_t)``, ``v_t = sqrt(2 m g / (rho C_d A))``; second order, explicit first."""
    terminal = math.sqrt(2.0 * 0.02 * G / (1.2 * 0.05))
    for integrator, most, share in (("implicit", 3e-4, 0.3), ("explicit", 0.04, 0.6)):
        for time in (0.25, 2.0):
            depth = terminal**2 / G * math.log(math.cosh(G * time / terminal))
            speed, errors = terminal * math.tanh(G * time / terminal), []
            for dt in (1 / 120, 1 / 240):
                ball = RigidBody("ball", BALL, 0.02, drag=0.05)
                x = run(drag_scene(ball, integrator, dt, (0, 0, -G)), state(), time)[0]
                errors.append(np.abs([-x[2] / depth - 1, -x[5] / speed - 1]))
            assert errors[0].max() < most
            assert np.all((errors[1] < share * errors[0]) | (errors[1] < 1e-9))


@law
def drag_acts_on_a_thrown_body_until_it_rests(dt):
    """A light block lands nearer than without drag; asleep it stays to the last bit."""
    ends = []
    for area in (0.0, 0.03):
        body = RigidBody("box", BLOCK.model, 0.02, drag=area)
        scene = world(body, dt=dt, friction=2.0, sleep=True)
        there = course(scene, state((0, 0, 0.3), (2.0, 0, 1.0)), [1.0, 3.0, 4.0])[:, 0]
        yield f"{area} m^2: moved asleep", 0, np.abs(there[2] - there[1]).max(), 0
        ends.append(there[1, 0])
    yield "less than .8 of the way", 1, ends[1] < 0.8 * ends[0], 0


# -- attachment --------------------------------------------------------------------------------------


@law
def a_released_body_flies_as_thrown(dt):
    """A parabola from a hand that moves and turns, or stands, released at a time that is no step's."""
    for v, w in ((np.array([0.5, 0.0, 1.0]), np.array([0.0, 0.0, 2.0])), (np.zeros(3), np.zeros(3))):
        path = PosePath(
            times=[0, 0.5],
            positions=[[0, 0, 0], 0.5 * v],
            orientations=Rotation.from_rotvec([[0, 0, 0], 0.5 * w]).as_quat(),
            linear_velocities=[v] * 2,
            angular_velocities=[w] * 2,
        )
        ball = RigidBody("ball", BALL, 0.3, attached_to="hand", released_at=0.3041)
        scene = world(ball, RigidBody("hand", FINGER, trajectory=path), dt=dt, environment=())
        arm = np.array([0.1, 0.0, 0.0])
        before, after = (round(t / dt) * dt for t in (0.25, 0.75))
        held, flown = course(scene, [state(arm), state()], (before, after))[:, 0]
        turned = Rotation.from_rotvec(0.3041 * w).apply(arm)
        thrown, left = v + np.cross(w, turned), after - 0.3041
        right = 0.3041 * v + turned + thrown * left - [0, 0, 0.5 * G * left**2]
        error = held[:3] - before * v - Rotation.from_rotvec(before * w).apply(arm)
        yield f"hand at {v[0]} m/s: held, position [m]", 0, np.abs(error).max(), 1e-9
        yield f"hand at {v[0]} m/s: position [m]", 0, np.abs(flown[:3] - right).max(), 1e-9
        yield (
            f"hand at {v[0]} m/s: speed [m/s]",
            0,
            np.abs(flown[3:6] - thrown + [0, 0, G * left]).max(),
            1e-9,
        )
        yield f"hand at {v[0]} m/s: spin [rad/s]", 0, np.abs(flown[10:] - w).max(), 1e-9
        yield (
            f"hand at {v[0]} m/s: turn [rad]",
            after * w[2],
            Rotation.from_quat(flown[6:10]).as_rotvec()[2],
            1e-9,
        )


@law
def what_is_held_is_one_body_with_the_hand(dt):
    """It lifts a box from the floor where it closes, what stands on that too, and lets go."""
    up = PosePath(times=[1.0, 2.0], positions=[[0, 0, 0.2], [0, 0, 0.5]])
    box = RigidBody("box", BLOCK.model, 0.4, attached_to="hand", attached_at=0.6, released_at=2.5)
    bodies = box, RigidBody("hand", FINGER, trajectory=up), solid_ball("rider", 0.05, 50.0)
    start = [state((0, 0, 0.02)), state(), state((0, 0, 0.09))]
    before, held, end = course(world(*bodies, dt=dt, sleep=True), start, (0.5, 2.4, 3.5))
    yield "box is lifted [mm]", 300, MM * (held[0, 2] - before[0, 2]), 1e-4
    yield "rider on the box [mm]", 70, MM * (held[2, 2] - held[0, 2]), 0.1
    yield "box falls in the end", 1, end[0, 2] < 0.1, 0
    yield "hand stays [mm]", 500, MM * end[1, 2], 1e-6


def test_the_velocities_of_a_path_are_those_of_its_motion():
    rng = np.random.default_rng(5)
    q = Rotation.from_rotvec(rng.normal(0, 0.6, (4, 3)))
    path = PosePath(
        times=[0, 0.3, 0.5, 1.1],
        positions=rng.normal(0, 0.3, (4, 3)),
        orientations=q.as_quat(),
        angular_velocities=[[np.nan] * 3, [1, -2, 0.5], [np.nan] * 3, [0, 0, 0]],
    )
    scene = Scene([RigidBody("hand", BALL, trajectory=path)])
    t, e = np.linspace(0.013, 1.09, 40), 1e-6
    low, here, high = (path_states(scene, 0, t + s) for s in (-e, 0.0, e))
    np.testing.assert_allclose(here[:, 3:6], (high - low)[:, :3] / (2 * e), atol=1e-7)
    turn = (Rotation.from_quat(high[:, 6:10]) * Rotation.from_quat(low[:, 6:10]).inv()).as_rotvec()
    np.testing.assert_allclose(here[:, 10:], turn / (2 * e), atol=1e-7)
    np.testing.assert_allclose(path_states(scene, 0, [0.3])[0, 10:], [1, -2, 0.5], atol=1e-12)
    bound = path.paces
    assert np.linalg.norm(here[:, 3:6], axis=1).max() <= bound[:, 0].max()
    assert np.linalg.norm(here[:, 10:], axis=1).max() <= bound[:, 1].max()


test_law = law.test()
