"""Laws of the implicit step: impacts, friction, rest, stacks, the environment's shapes, momentum; at several
time steps.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from plain_scenes import (
    BALL,
    BLOCK,
    FLOOR,
    PLATE,
    G,
    at_steps,
    course,
    energy,
    lowest,
    momenta,
    run,
    sphere_centers,
    state,
    turned,
    world,
)
from scipy.spatial.transform import Rotation

from unc_physics import RigidBody, load_model
from unc_physics.scene.environment import Box, Capsule, Cylinder, Plane, Sphere

R = 0.05  # m, the ball's radius


def depth_in(element, body, s):
    """How deep a body at state ``s`` (13,) is in an element [m]; negative for a gap."""
    distance, _ = element.surface(sphere_centers(body, s))
    return float((body.model.radii - distance).max())


# -- impacts -----------------------------------------------------------------------------------------


@at_steps
@pytest.mark.parametrize("e", [0.0, 0.05, 0.25, 0.5, 0.8, 1.0])
def test_an_impact_has_newtons_restitution_and_coulombs_friction(dt, e):
    """Without gravity, which would go on rubbing after the impact."""
    for mu in (0.05, 0.1, 0.5):
        for normal, across in ((1.0, 1.0), (0.3, 2.0), (3.0, 0.5)):
            scene = world(RigidBody("ball", BALL, 0.3), dt=dt, gravity=None, friction=mu, restitution=e)
            x = run(scene, state((0, 0, R + 0.01), (across, 0, -normal)), 0.06)[0]
            lost = min(mu * (1.0 + e) * normal, 2.0 / 7.0 * across)
            assert x[5] == pytest.approx(e * normal, abs=0.02 * normal)
            assert across - x[3] == pytest.approx(lost, rel=0.02)
            assert x[11] == pytest.approx(2.5 * lost / R, rel=0.02)  # the impulse's moment, and no other
            np.testing.assert_allclose(x[[4, 10, 12]], 0.0, atol=1e-9)


@at_steps
@pytest.mark.parametrize("e", [0.0, 0.5, 0.8])
@pytest.mark.parametrize("closing", [0.3, 1.0, 3.0])
def test_friction_of_an_impact_falls_with_its_closing_speed(dt, e, closing):
    """The impulse ratio of a ball that slips throughout; no spin, no gravity."""
    mu, half, across = 0.2, 2.0, 4.0
    body = RigidBody("ball", BALL, 0.3)
    scene = world(body, dt=dt, gravity=None, friction=mu, restitution=e, impact_friction_speed=half)
    x = run(scene, state((0, 0, R + 0.01), (across, 0, -closing)), 0.06)[0]
    ratio = (across - x[3]) / (x[5] + closing)
    assert ratio == pytest.approx(mu / (1.0 + closing / half), rel=0.01)
    assert x[11] == pytest.approx(2.5 * (across - x[3]) / R, rel=0.01)


@at_steps
def test_friction_of_an_impact_still_stops_slip(dt):
    """A ball that would stop slipping with half the friction of this impact."""
    body = RigidBody("ball", BALL, 0.3)
    scene = world(body, dt=dt, gravity=None, friction=0.6, impact_friction_speed=1.0)
    x = run(scene, state((0, 0, R + 0.01), (0.5, 0, -1.0)), 0.06)[0]
    assert x[3] == pytest.approx(5.0 / 7.0 * 0.5, rel=0.01)


@at_steps
@pytest.mark.parametrize("e", [0.25, 0.5, 0.8, 1.0])
def test_a_dropped_ball_rebounds_with_e_times_its_speed(dt, e):
    scene = world(RigidBody("ball", BALL, 0.3), dt=dt, restitution=e)
    height = 0.2
    speed = math.sqrt(2.0 * G * height)
    apex = (1.0 + e) * speed / G
    path = course(scene, state((0, 0, R + height)), np.linspace(0.8, 1.2, 201) * apex)
    assert path[:, 0, 2].max() - R == pytest.approx(e * e * height, rel=0.04)


@at_steps
def test_elastic_bounces_lose_nothing(dt):
    """A ball's; and, but for 1.5 % each at a tenth of a radian a step, those of a block that tumbles between
    walls.
    """
    scene = world(RigidBody("ball", BALL, 0.3), dt=dt, restitution=1.0, friction=None)
    x = state((0, 0, R + 0.2), (0.1, 0, 0))
    floor = 0.3 * G * R  # of potential energy that the ball cannot give
    ends = [energy(scene, s) - floor for s in course(scene, x, np.arange(0.0, 3.0, 0.1))]
    np.testing.assert_allclose(ends, ends[0], rtol=0.002)
    walls = [Plane(n, -0.2) for n in (*np.eye(3), *-np.eye(3))]
    free = world(
        RigidBody("block", BLOCK, 0.3), dt=dt, restitution=1.0, friction=None, gravity=None, environment=walls
    )
    x = state((0, 0, 0), (1.1, 0.6, -0.8), (1, -3, 2))
    ends = np.array([energy(free, s) for s in course(free, x, np.arange(0.0, 2.0, 0.025))])
    assert (ends[1:] > 0.985 * ends[:-1]).all() and (ends < 1.001 * ends[0]).all()


@at_steps
def test_a_fast_ball_stops_at_a_thin_wall(dt):
    wall = Box((0.01, 1, 1), (1, 0, 0))
    for e in (0.0, 0.5):
        scene = world(RigidBody("ball", BALL, 0.3), dt=dt, gravity=None, environment=[wall], restitution=e)
        x = run(scene, state((0.3, 0, 0), (20, 0, 0)), 0.1)[0]
        assert x[3] == pytest.approx(-20.0 * e, abs=0.01)
        assert x[0] < 1.0 - 0.005 - R + 1e-4


@at_steps
def test_bodies_meet_as_their_common_restitution_says(dt):
    """The geometric mean of both; masses as in textbooks."""
    bodies = [RigidBody("a", BALL, 0.3, restitution=0.9), RigidBody("b", BALL, 1.2, restitution=0.4)]
    scene = world(*bodies, dt=dt, gravity=None, environment=())
    x = run(scene, [state((0, 0, 0), (2, 0, 0)), state((0.13, 0, 0), (-0.5, 0, 0))], 0.1)
    before, e = (0.3 * 2.0 - 1.2 * 0.5) / 1.5, math.sqrt(0.36)
    assert x[0, 3] == pytest.approx(before - 1.2 / 1.5 * e * 2.5, rel=0.001)
    assert x[1, 3] == pytest.approx(before + 0.3 / 1.5 * e * 2.5, rel=0.001)


# -- friction ----------------------------------------------------------------------------------------


@at_steps
@pytest.mark.parametrize("mu", [0.2, 0.5, 1.0])
def test_an_incline_holds_below_the_angle_of_friction_and_not_above(dt, mu):
    for past in (-0.003, 0.003):  # rad
        slope = math.atan(mu) + past
        n, q = np.array([-math.sin(slope), 0, math.cos(slope)]), turned(0, -slope, 0)
        scene = world(RigidBody("b", BLOCK, 0.5), dt=dt, friction=mu, environment=[Plane(n)])
        settled, later = course(scene, state(0.02 * n, orientation=q), (0.5, 1.5))[:, 0]
        gained = np.linalg.norm(later[3:6]) - np.linalg.norm(settled[3:6])
        if past < 0:
            assert np.linalg.norm(later[:3] - settled[:3]) < 1e-6
        else:
            assert gained == pytest.approx(G * (math.sin(slope) - mu * math.cos(slope)), rel=0.01)


@at_steps
def test_a_block_slides_as_far_as_friction_lets_it(dt):
    """Also where friction of impacts falls with their speed."""
    for mu, speed, half in ((0.5, 0.5, None), (0.5, 2.0, None), (0.2, 1.0, None), (0.2, 2.0, 0.5)):
        scene = world(RigidBody("b", BLOCK, 0.5), dt=dt, friction=mu, impact_friction_speed=half)
        x = run(scene, state((0, 0, 0.02), (speed, 0, 0)), speed / (mu * G) + 0.3)[0]
        assert x[0] == pytest.approx(speed**2 / (2.0 * mu * G), rel=0.01)
        assert np.linalg.norm(x[3:6]) < 1e-4


@at_steps
def test_a_ball_that_slides_begins_to_roll_with_five_sevenths_of_its_speed(dt):
    scene = world(RigidBody("b", BALL, 0.3), dt=dt, friction=0.3)
    x = run(scene, state((0, 0, R), (2, 0, 0)), 0.5)[0]
    assert x[3] == pytest.approx(10.0 / 7.0, rel=2e-3) and x[11] * R == pytest.approx(x[3], rel=2e-3)


# -- rest --------------------------------------------------------------------------------------------


@at_steps
@pytest.mark.parametrize("model", ["salt_box", "can", "mug", "brick", "bowl", "plate"])
@pytest.mark.parametrize("mass", [0.1, 5.0])
def test_what_lies_on_the_floor_stays(dt, model, mass):
    """Within 2 um and 0.006 degrees in 10 s, and no deeper than 0.1 mm at the stiffness that is chosen."""
    body = RigidBody("b", load_model(model).prefix(1000), mass)
    settled, later = course(world(body, dt=dt), state((0, 0, 0.0002 - lowest(body.model))), (3.0, 13.0))[:, 0]
    assert np.linalg.norm(later[:3] - settled[:3]) < 2e-6
    assert 0.0 < depth_in(FLOOR, body, later) < 1e-4
    apart = Rotation.from_quat(settled[6:10]).inv() * Rotation.from_quat(later[6:10])
    assert apart.magnitude() < 1e-4


STACKS = (  # kg, from below
    (1, 1, 1, 1, 1),
    (1, 1, 1, 1, 100),
    (100, 1, 100, 1, 100),
    (100, 10, 1, 0.5, 0.2),
    (0.01, 50),
)


@at_steps
@pytest.mark.parametrize("masses", STACKS, ids=str)
def test_a_stack_stands(dt, masses):
    brick = load_model("brick").prefix(1000)
    height = brick.bounds[1][2] - brick.bounds[0][2]
    bodies = [RigidBody(f"b{k}", brick, mass) for k, mass in enumerate(masses)]
    start = np.array(
        [
            state((0.003 * (k % 2), 0, 0.5 * height + (height + 0.0002) * k + 0.0001))
            for k in range(len(masses))
        ]
    )
    end = run(world(*bodies, dt=dt), start, 3.0)
    away = np.abs(end[:, :3] - start[:, :3]).max()
    assert away < 0.002  # the gaps add up to 0.9 mm
    assert Rotation.from_quat(end[:, 6:10]).magnitude().max() < 0.005


@at_steps
def test_the_corner_of_a_bin_holds_a_box(dt):
    """Gravity leans into a corner of floor and two walls; the box slides into it and stays."""
    body = RigidBody("box", load_model("salt_box").prefix(1000), 0.5)
    walls = [FLOOR, Box((0.02, 1, 1), (-0.21, 0, 0.4)), Box((1, 0.02, 1), (0, -0.21, 0.4))]
    scene = world(body, dt=dt, gravity=(-5, -6, -7), friction=0.3, environment=walls)
    start = state((-0.05, -0.04, 0.02 - lowest(body.model)), orientation=turned(0, 0, 0.2))
    settled, later = course(scene, start, (2.0, 4.0))[:, 0]
    assert np.linalg.norm(later[:3] - settled[:3]) < 1e-6
    for wall in walls:
        assert 0.0 < depth_in(wall, body, later) < 1e-4


# -- shapes of the environment -----------------------------------------------------------------------


def _plane(point, normal, across):
    return Plane(normal, normal @ point)


def _box(point, normal, across):
    return Box((0.3, 0.2, 0.1), point - 0.05 * normal, _axes(across, normal))


def _sphere(point, normal, across):
    return Sphere(0.07, point - 0.07 * normal)


def _cylinder(point, normal, across):
    return Cylinder(0.06, 0.3, point - 0.06 * normal, _axes(normal, across))


def _end_of_cylinder(point, normal, across):
    return Cylinder(0.06, 0.3, point - 0.15 * normal, _axes(across, normal))


def _capsule(point, normal, across):
    return Capsule(0.06, 0.3, point - 0.06 * normal, _axes(normal, across))


def _axes(x, z):
    """Quaternion of the frame with these two axes."""
    return Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z])).as_quat()


SHAPES = (_plane, _box, _sphere, _cylinder, _end_of_cylinder, _capsule)
at_shapes = pytest.mark.parametrize("shape", SHAPES, ids=lambda make: make.__name__.strip("_"))


@at_shapes
@at_steps
def test_each_shape_stops_a_ball(shape, dt):
    normal, across = np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.0])
    element = shape(np.array([0.2, 0.1, -0.3]), normal, across)
    for e in (0.0, 0.7):
        scene = world(RigidBody("b", BALL, 0.3), dt=dt, gravity=None, restitution=e, environment=[element])
        x = run(scene, state((0.2, 0.1, -0.3) + (R + 0.03) * normal, -5.0 * normal), 0.05)[0]
        np.testing.assert_allclose(x[3:6], 5.0 * e * normal, atol=0.01)


@at_shapes
@at_steps
def test_each_shape_holds_a_ball(shape, dt):
    """Three of them make a hollow, into which it falls."""
    middle, elements = np.array([0.1, -0.2, 0.3]), []
    for angle in 2.0 * np.pi / 3.0 * np.arange(3):
        out, across = (
            np.array([np.cos(angle), np.sin(angle), 0]),
            np.array([-np.sin(angle), np.cos(angle), 0]),
        )
        normal = 0.8 * np.array([0, 0, 1]) - 0.6 * out
        elements.append(shape(middle - R * normal, normal, across))
    scene = world(RigidBody("b", BALL, 0.3), dt=dt, environment=elements)
    settled, later = course(scene, state(middle + (0.002, 0.001, 0.03)), (2.0, 4.0))[:, 0]
    np.testing.assert_allclose(later[:3], middle, atol=2e-4)
    assert np.linalg.norm(later[:3] - settled[:3]) < 1e-6
    for element in elements:
        assert 0.0 < depth_in(element, scene.bodies[0], later) < 1e-4


# -- momentum ----------------------------------------------------------------------------------------


@at_steps
def test_momentum_is_kept(dt):
    """Linear momentum through impacts and lasting contact; angular too, up to what bodies travel
    in a step.
    """
    brick, can = load_model("brick").prefix(300), load_model("can").prefix(300)
    bodies = [
        RigidBody("a", brick, 0.5, restitution=0.7),
        RigidBody("b", can, 1.5),
        RigidBody("c", brick, 0.2),
    ]
    scene = world(*bodies, dt=dt, gravity=None, environment=())
    x = np.array(
        [
            state((-0.2, 0, 0.01), (1, 0, 0), (3, -2, 5), turned(0.3, 0.2, 0.1)),
            state((0.1, 0.01, 0), (-0.5, 0.1, 0), (-1, 4, 2), turned(-0.4, 0.5, 1)),
            state((0.3, 0.02, 0.02), (-1.5, 0.0, 0.1), (2, 1, 0), turned(1.4, 0.1, 0.3)),
        ]
    )
    y = run(scene, x, 0.6)
    assert (np.linalg.norm(y[:, 3:6] - x[:, 3:6], axis=1) > 0.1).all(), "they must have met"
    (p, L), (q, M) = momenta(scene, x), momenta(scene, y)
    np.testing.assert_allclose(q, p, rtol=0, atol=1e-9)
    np.testing.assert_allclose(M, L, rtol=0, atol=2e-3 * np.linalg.norm(L))
    assert energy(scene, y) < energy(scene, x)


@at_steps
def test_free_flight_keeps_momentum_and_energy(dt):
    scene = world(RigidBody("p", PLATE, 2.0), dt=dt)
    x = state((0, 0, 100), (1, 2, 3), (0.5, 20.0, 0.3), turned(0.2, -0.1, 0.3))[None]
    y = run(scene, x, 2.0)
    np.testing.assert_allclose(y[0, 3:6], [1, 2, 3 - 2 * G], atol=1e-9)
    np.testing.assert_allclose(y[0, :3], [2, 4, 106 - 2 * G], atol=1e-9)
    (p, L), (q, M) = momenta(scene, x), momenta(scene, y)
    spin, fallen = M - np.cross(y[0, :3], q), L - np.cross(x[0, :3], p)  # about the centre of mass
    np.testing.assert_allclose(spin, fallen, rtol=0, atol=1e-9)
    assert energy(scene, y) == pytest.approx(energy(scene, x), rel=1e-3)


def test_damping_slows_what_flies():
    scene = world(RigidBody("p", PLATE, 2.0), gravity=None, gyroscopic=False, damping=0.7, environment=())
    y = run(scene, state((0, 0, 0), (1, 2, 3), (3, 2, 1)), 1.5)[0]
    np.testing.assert_allclose(y[3:6], np.exp(-0.7 * 1.5) * np.array([1, 2, 3]), rtol=1e-9)
    np.testing.assert_allclose(y[10:], np.exp(-0.7 * 1.5) * np.array([3, 2, 1]), rtol=1e-9)


# -- sleep -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dt", [1 / 240, 1 / 960])
def test_sleep_changes_no_outcome(loaded, dt):
    scene, belief, _ = loaded("everyday")
    awake, asleep = (run(replace(scene, dt=dt, sleep=sleep), belief.mean, 4.0) for sleep in (False, True))
    assert np.linalg.norm(asleep[:, 3:6]) == 0.0, "they must sleep"
    np.testing.assert_allclose(asleep[:, :3], awake[:, :3], atol=1e-4)
    apart = Rotation.from_quat(asleep[:, 6:10]).inv() * Rotation.from_quat(awake[:, 6:10])
    assert apart.magnitude().max() < 5e-3


def test_what_slides_slowly_does_not_fall_asleep():
    """On an incline 1 mrad above the angle of friction."""
    angle = math.atan(0.5) + 1e-3
    normal = np.array([-math.sin(angle), 0.0, math.cos(angle)])
    start = state(0.02 * normal, orientation=Rotation.from_rotvec([0, -angle, 0]).as_quat())
    scene = world(RigidBody("block", BLOCK, 0.5), friction=0.5, environment=[Plane(normal)])
    awake, asleep = (run(replace(scene, sleep=sleep), start, 2.0)[0] for sleep in (False, True))
    assert np.linalg.norm(awake[:3] - start[:3]) > 0.01
    np.testing.assert_array_equal(asleep, awake)


def test_what_sleeps_wakes_when_it_is_hit():
    """A ball rolls at a block that has rested for a second; before, nothing else is near that could keep it
    awake.
    """
    scene = world(RigidBody("block", BLOCK, 0.1), RigidBody("ball", BALL, 0.5), sleep=True)
    x = [state((0, 0, 0.02)), state((-1.57, 0, R), (1.5, 0, 0), (0, 1.5 / R, 0))]
    times = np.arange(0.5, 2.6, 0.1)
    asleep, awake = course(scene, x, times), course(replace(scene, sleep=False), x, times)
    assert not asleep[0, 0, 3:6].any() and asleep[-1, 0, 0] > 0.1
    np.testing.assert_allclose(asleep[:, :, :3], awake[:, :, :3], atol=1e-3)
