"""Laws of what a robot does in the implicit step: prescribed paths, belts, wrenches, attachment, torsional
friction, slow pushes.
"""

import math

import numpy as np
import pytest
from plain_scenes import BALL, BLOCK, G, at_steps, course, packing, run, state, world
from scipy.spatial.transform import Rotation

from unc_physics import Box, Plane, PosePath, RigidBody, Scene, Wrench

FINGER = BALL.scaled(0.2)  # 1 cm
#: Flat for all that stands on it.
GROUND = packing("ground", [[0, 0, -1000.0]], [1000.0], np.eye(3))


def straight(first, velocity, time, begin=0.0, orientation=(0, 0, 0, 1)):
    """A path at one velocity from ``begin`` on, for a time."""
    first, velocity = np.asarray(first, float), np.asarray(velocity, float)
    return PosePath(
        times=[begin, begin + time],
        positions=[first, first + time * velocity],
        orientations=[orientation] * 2,
        linear_velocities=[velocity] * 2,
    )


# -- prescribed bodies -------------------------------------------------------------------------------


@at_steps
def test_a_path_is_followed_exactly_whatever_it_meets(dt):
    """Through a block of 50 kg that is in its way; position and rotation from Hermite's polynomials."""
    q = Rotation.from_rotvec([[0, 0, 0.2], [0.5, 0, 1.0], [0.5, -1.0, 0.3]])
    times, places = np.array([0.1, 0.6, 1.0]), np.array([[-0.3, 0, 0.03], [0.1, 0.02, 0.05], [0.5, 0, 0.03]])
    v = np.array([[0.1, 0, 0], [1.0, 0.3, -0.2], [0, 0, 0.4]])
    path = PosePath(times=times, positions=places, orientations=q.as_quat(), linear_velocities=v)
    scene = world(RigidBody("box", BLOCK, 50.0), RigidBody("bar", BLOCK, trajectory=path), dt=dt)
    at = np.arange(1, 13) * 0.1
    found = course(scene, [state((0.05, 0, 0.02)), state()], at)
    assert np.linalg.norm(found[-1, 0, :2] - [0.05, 0]) > 0.05, "they must meet"
    for t, x in zip(at, found[:, 1], strict=True):
        k = min(max(int(np.searchsorted(times, t) - 1), 0), 1)
        h = times[k + 1] - times[k]
        u = min(max((t - times[k]) / h, 0.0), 1.0)
        a, b, c, d = 2 * u**3 - 3 * u**2 + 1, u**3 - 2 * u**2 + u, 3 * u**2 - 2 * u**3, u**3 - u**2
        p = a * places[k] + b * h * v[k] + c * places[k + 1] + d * h * v[k + 1]
        np.testing.assert_allclose(x[:3], p, rtol=0, atol=1e-9)
        if u == 1.0:
            assert (Rotation.from_quat(x[6:10]) * q[k + 1].inv()).magnitude() < 1e-9
    np.testing.assert_array_equal(found[-1, 1, 3:6], 0.0)


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
    from unc_physics.scene.kinematic_states import path_states

    t, e = np.linspace(0.013, 1.09, 40), 1e-6
    low, here, high = (path_states(scene, 0, t + s) for s in (-e, 0.0, e))
    np.testing.assert_allclose(here[:, 3:6], (high - low)[:, :3] / (2 * e), atol=1e-7)
    turn = (Rotation.from_quat(high[:, 6:10]) * Rotation.from_quat(low[:, 6:10]).inv()).as_rotvec()
    np.testing.assert_allclose(here[:, 10:], turn / (2 * e), atol=1e-7)
    np.testing.assert_allclose(path_states(scene, 0, [0.3])[0, 10:], [1, -2, 0.5], atol=1e-12)
    bound = path.paces
    assert np.linalg.norm(here[:, 3:6], axis=1).max() <= bound[:, 0].max()
    assert np.linalg.norm(here[:, 10:], axis=1).max() <= bound[:, 1].max()


@at_steps
@pytest.mark.parametrize("sleep", [False, True])
def test_a_slow_push_moves_a_box_along(dt, sleep):
    """At 2.5 mm/s and a tenth of that: neither the solver's tolerances nor sleep show."""
    for speed in (2.5e-3, 2.5e-4):
        time = 0.02 / speed if speed > 1e-3 and dt > 0.002 else 2.0
        finger = straight((-0.08, 0, 0.03), (speed, 0, 0), time, begin=0.5)
        bodies = RigidBody("box", BLOCK, 1.5), RigidBody("finger", FINGER, trajectory=finger)
        scene = world(*bodies, dt=dt, sleep=sleep, friction=0.3)
        start, touching, end = course(
            scene, [state((0, 0, 0.02)), state()], (0.5, 0.5 + 0.5 * time, 0.7 + time)
        )[:, 0]
        moved = touching[0] - start[0], end[0] - start[0]
        assert moved[1] == pytest.approx(speed * time, abs=1e-4)  # contacts give way that far
        assert moved[1] - moved[0] == pytest.approx(0.5 * speed * time, abs=2e-5)
        assert touching[3] == pytest.approx(speed, rel=0.01)
        assert abs(end[1]) < 5e-6 and np.linalg.norm(end[3:6]) < 1e-5


@at_steps
def test_an_impact_feels_the_velocity_of_a_path(dt):
    """A wall that comes at 2 m/s throws a ball at twice that, and friction turns it."""
    wall = RigidBody(
        "wall",
        BLOCK.scaled(3.0),
        trajectory=straight((-0.5, -0.072, -0.03), (2, 0.6, 0), 0.5),
        restitution=1.0,
    )
    ball = RigidBody("ball", BALL, 0.3, restitution=1.0)
    scene = world(ball, wall, dt=dt, gravity=None, environment=(), friction=0.1)
    x = run(scene, [state(), state()], 0.4)[0]
    assert x[3] == pytest.approx(4.0, rel=0.01)
    assert x[4] == pytest.approx(min(0.1 * 4.0, 2 / 7 * 0.6), rel=0.03)


def test_a_tray_carries_what_stands_on_it():
    """With 2 m/s^2 below friction's 4.9; with 20 m/s^2 it is pulled away under it."""
    for acceleration, carried in ((2.0, True), (20.0, False)):
        path = PosePath(
            times=[0.2, 0.6],
            positions=[[0, 0, 0], [0.5 * acceleration * 0.16, 0, 0]],
            linear_velocities=[[0, 0, 0], [acceleration * 0.4, 0, 0]],
        )
        bodies = RigidBody("box", BLOCK, 0.5), RigidBody("tray", GROUND, trajectory=path)
        x = run(world(*bodies, environment=()), [state((0, 0, 0.02)), state()], 0.6)
        if carried:
            assert x[0, 0] == pytest.approx(x[1, 0], abs=2e-5) and x[0, 3] == pytest.approx(0.8, rel=1e-3)
        else:
            assert x[0, 3] == pytest.approx(0.5 * G * 0.4, rel=0.02)


# -- belts and turntables ----------------------------------------------------------------------------


@at_steps
def test_a_belt_brings_a_box_to_its_speed(dt):
    """After ``v / (mu g)``, and ``v^2 / (2 mu g)`` behind."""
    belt = Plane(surface_velocity=(0.5, 0.0, 7.0))
    scene = world(RigidBody("box", BLOCK, 0.4), dt=dt, environment=[belt], friction=0.2, sleep=True)
    time = 0.5 / (0.2 * G)
    half, there, later = course(scene, state((0, 0, 0.02)), (0.5 * time, time + 2 * dt, 2.0))[:, 0]
    assert half[3] == pytest.approx(0.25, abs=0.2 * G * dt)
    assert there[3] == pytest.approx(0.5, rel=2e-3) and later[3] == pytest.approx(0.5, rel=1e-4)
    assert 0.5 * 2.0 - later[0] == pytest.approx(0.25 / (2 * 0.2 * G), abs=0.5 * dt)


def test_a_slow_belt_does_not_fall_asleep():
    scene = world(
        RigidBody("box", BLOCK, 0.4), environment=[Plane(surface_velocity=(1e-3, 0, 0))], sleep=True
    )
    assert run(scene, state((0, 0, 0.02)), 2.0)[0, 0] == pytest.approx(2e-3, abs=5e-6)


def test_a_turntable_takes_a_box_round():
    """A block 10 cm from the point it turns about, at 1 rad/s; friction is enough."""
    table = Box((2, 2, 0.1), (0.3, 0, -0.05), surface_angular_velocity=(0, 0, 1), surface_center=(0.2, 0, 0))
    scene = world(RigidBody("box", BLOCK, 0.4), environment=[table])
    x = run(scene, state((0.3, 0, 0.02), (0, 0.1, 0), (0, 0, 1)), math.pi)[0]
    np.testing.assert_allclose(x[:2], [0.1, 0], atol=2e-3)
    assert x[12] == pytest.approx(1.0, rel=1e-3)
    assert abs(Rotation.from_quat(x[6:10]).as_rotvec()[2]) == pytest.approx(math.pi, abs=0.01)


# -- wrenches ----------------------------------------------------------------------------------------


@at_steps
def test_a_force_and_a_torque_give_their_impulses(dt):
    """Times need not be those of steps."""
    wrench = Wrench(force=(0.3, 0, 0), torque=(0, 0, 2e-5), start=0.1013, duration=0.2)
    scene = world(RigidBody("ball", BALL, 0.5, wrenches=[wrench]), dt=dt, gravity=None, environment=())
    x = run(scene, state(), 1.0)[0]
    assert x[3] == pytest.approx(0.3 * 0.2 / 0.5, rel=1e-9)
    assert x[0] == pytest.approx(0.12 * (1.0 - 0.1013 - 0.1), abs=2e-5)
    assert x[12] == pytest.approx(2e-5 * 0.2 / (0.5 * 0.001), rel=1e-9)


def test_a_force_in_body_axes_turns_with_the_body():
    """A ball that turns at 2 rad/s about z is pushed along its own x axis for half a turn."""
    wrench = Wrench(force=(1.0, 0, 0), body_axes=True)
    scene = world(RigidBody("ball", BALL, 1.0, wrenches=[wrench]), gravity=None, environment=(), dt=1e-3)
    x = run(scene, state(spin=(0, 0, 2)), math.pi / 2)[0]
    np.testing.assert_allclose(x[3:6], [0, 1.0, 0], atol=2e-3)


def test_a_force_against_friction():
    """1.2 times what friction holds accelerates, 0.9 times does not, asleep or not."""
    for share, speed in ((1.2, 0.2 * 0.5 * G), (0.9, 0.0)):
        wrench = Wrench(force=(share * 0.5 * 0.4 * G, 0, 0), start=1.0, duration=1.0)
        scene = world(RigidBody("box", BLOCK, 0.4, wrenches=[wrench]), sleep=True)
        assert run(scene, state((0, 0, 0.02)), 2.0)[0, 3] == pytest.approx(speed, rel=0.01, abs=1e-6)


# -- drag --------------------------------------------------------------------------------------------


@at_steps
@pytest.mark.parametrize("integrator", ["implicit", "explicit"])
def test_drag_alone_slows_down_hyperbolically(integrator, dt):
    """``v0 / (1 + k v0 t)`` with ``k = rho C_d A / (2 m)``, to round-off at any step; spin stays."""
    ball = RigidBody("ball", BALL, 0.05, drag=0.04)
    physics = {"gravity": None, "integrator": integrator, "dt": dt, "stiffness": 1e5}
    x = run(Scene([ball], **physics), state(velocity=(3.0, -4.0, 0), spin=(0, 0, 2)), 1.5)[0]
    speed = 5.0 / (1.0 + 0.5 * 1.2 * 0.04 / 0.05 * 5.0 * 1.5)
    np.testing.assert_allclose(x[3:6], [0.6 * speed, -0.8 * speed, 0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(x[10:], [0, 0, 2], rtol=1e-9, atol=1e-12)


def fallen(dt, time, integrator="implicit"):
    """Depth and speed of a ball with drag that falls from rest, over those of the analytic solution."""
    mass, area = 0.02, 0.05
    terminal = math.sqrt(2.0 * mass * G / (1.2 * area))
    scene = Scene(
        [RigidBody("ball", BALL, mass, drag=area)],
        gravity=(0, 0, -G),
        integrator=integrator,
        dt=dt,
        stiffness=1e5,
    )
    x = run(scene, state(), time)[0]
    depth = terminal**2 / G * math.log(math.cosh(G * time / terminal))
    return -x[2] / depth, -x[5] / (terminal * math.tanh(G * time / terminal))


def test_a_body_that_falls_with_drag_approaches_its_terminal_velocity():
    """``v = v_t tanh(g t / v_t)``, ``v_t = sqrt(2 m g / (rho C_d A))``; second order, explicit first."""
    for time in (0.25, 2.0):
        coarse, fine = (np.abs(np.subtract(fallen(dt, time), 1.0)) for dt in (1 / 120, 1 / 240))
        assert coarse.max() < 3e-4
        assert np.all((fine < 0.3 * coarse) | (fine < 1e-9))
        coarse, fine = (np.abs(np.subtract(fallen(dt, time, "explicit"), 1.0)) for dt in (1 / 120, 1 / 240))
        assert coarse.max() < 0.04
        assert np.all(fine < 0.6 * coarse)


def test_drag_acts_on_a_thrown_body_until_it_lands_and_not_at_rest():
    """A light block lands nearer than without drag; at rest it falls asleep."""
    ends = []
    for area in (0.0, 0.03):
        scene = world(RigidBody("box", BLOCK, 0.02, drag=area), friction=2.0, sleep=True)
        there = course(scene, [state((0, 0, 0.3), (2.0, 0, 1.0))], [1.0, 3.0, 4.0])[:, 0]
        np.testing.assert_array_equal(there[1], there[2])
        ends.append(there[1, 0])
    assert ends[1] < 0.8 * ends[0]


# -- attachment --------------------------------------------------------------------------------------


@at_steps
def test_a_released_body_flies_as_thrown(dt):
    """At a time that is no step's, from a hand that moves and turns."""
    v, w, released = np.array([0.5, 0.0, 1.0]), np.array([0.0, 0.0, 2.0]), 0.3041
    hand = PosePath(
        times=[0, 0.5],
        positions=[[0, 0, 0], 0.5 * v],
        orientations=Rotation.from_rotvec([[0, 0, 0], 0.5 * w]).as_quat(),
        linear_velocities=[v] * 2,
        angular_velocities=[w] * 2,
    )
    bodies = [
        RigidBody("ball", BALL, 0.3, attached_to="hand", released_at=released),
        RigidBody("hand", FINGER, trajectory=hand),
    ]
    scene = world(*bodies, dt=dt, environment=())
    arm, times = np.array([0.1, 0.0, 0.0]), (0.25, 0.75)
    held, flown = course(scene, [state(arm), state()], times)[:, 0]
    turned = Rotation.from_rotvec(0.25 * w).apply(arm)
    np.testing.assert_allclose(held[:3], 0.25 * v + turned, atol=1e-9)
    turned = Rotation.from_rotvec(released * w).apply(arm)
    thrown, left = v + np.cross(w, turned), 0.75 - released
    expected = released * v + turned + thrown * left - [0, 0, 0.5 * G * left**2]
    np.testing.assert_allclose(flown[:3], expected, atol=1e-9)
    np.testing.assert_allclose(flown[3:6], thrown - [0, 0, G * left], atol=1e-9)
    np.testing.assert_allclose(flown[10:], w, atol=1e-9)
    assert Rotation.from_quat(flown[6:10]).as_rotvec()[2] == pytest.approx(0.75 * 2.0, abs=1e-9)


def test_what_is_held_is_one_body_with_the_hand():
    """It lifts a box from the floor where it closes, pushes another one, and lets go."""
    up = PosePath(times=[1.0, 2.0], positions=[[0, 0, 0.2], [0, 0, 0.5]])
    bodies = [
        RigidBody("box", BLOCK, 0.4, attached_to="hand", attached_at=0.6, released_at=2.5),
        RigidBody("hand", FINGER, trajectory=up),
        RigidBody("rider", BALL, 50.0),
    ]
    scene = world(*bodies, sleep=True)
    x = [state((0, 0, 0.02)), state(), state((0, 0, 0.04 + 0.05))]
    before, held, end = course(scene, x, (0.5, 2.4, 3.5))
    rest = before[0, 2]
    assert held[0, 2] - rest == pytest.approx(0.3, abs=1e-7)
    assert held[2, 2] - held[0, 2] == pytest.approx(0.07, abs=2e-3), "what stands on it is lifted, too"
    assert end[0, 2] < 0.1 and end[1, 2] == pytest.approx(0.5, abs=1e-9)


# -- torsional friction ------------------------------------------------------------------------------


@at_steps
def test_a_spinning_disc_stops_as_torsional_friction_says(dt):
    """At ``reach m g / I``; a ball touches at a point, where nothing else slows it."""
    disc = packing("disc", [[0, 0, 0]], [0.05], np.diag([3e-4, 3e-4, 4e-4]))
    floor = Plane(torsional_friction=0.002)
    scene = world(RigidBody("disc", disc, 0.7), dt=dt, environment=[floor])
    rate = 0.002 * G / 4e-4
    half, end = course(scene, state((0, 0, 0.05), spin=(0, 0, 20)), (0.5 * 20 / rate, 1.05 * 20 / rate))[:, 0]
    assert half[12] == pytest.approx(10.0, abs=1.5 * rate * dt)
    assert abs(end[12]) < 1e-6
    both = world(RigidBody("disc", disc, 0.7, torsional_friction=0.008), dt=dt, environment=[floor])
    half = run(both, state((0, 0, 0.05), spin=(0, 0, 20)), 0.25 * 20 / rate)[0]
    assert half[12] == pytest.approx(10.0, abs=3 * rate * dt), "the geometric mean of both"


# -- slow pushes and the limit surface ---------------------------------------------------------------


@pytest.mark.parametrize("offset", [-0.04, -0.02, 0.0, 0.02, 0.04])
def test_a_slow_push_turns_a_box_to_the_side_of_the_centre_of_friction(offset):
    """Through the centre it does not turn it, off the centre as far as the ellipsoidal limit surface says.

    The finger has no friction, so that its force is normal to the box's face; with ``c`` the ratio of the
    most friction moment and the most friction force, the box turns by ``F a / c^2`` of its speed.
    """
    finger = straight((-0.08, offset, 0.03), (0.01, 0, 0), 1.0, begin=0.5)
    bodies = RigidBody("box", BLOCK, 1.5), RigidBody("finger", FINGER, friction=0.0, trajectory=finger)
    scene = world(*bodies, sleep=True)
    start, end = course(scene, [state((0, 0, 0.02)), state()], (0.5, 1.5))[:, 0]
    turn = Rotation.from_quat(end[6:10]).as_rotvec()[2]
    if offset == 0.0:
        assert abs(turn) < 1e-4 and end[0] - start[0] == pytest.approx(0.01, abs=1e-4)
    else:
        # a force along x at (-0.07, offset) has the moment -offset F
        assert np.sign(turn) == -np.sign(offset)
        c2 = 0.06**2 + 0.04**2  # all of the load at the corners, at most
        assert 0.01 * abs(offset) / (c2 + offset**2) * 0.9 < abs(turn)
        assert abs(turn) < 0.01 * abs(offset) / ((c2 / 3) + offset**2) * 1.1
