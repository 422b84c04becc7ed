"""Laws of the implicit step: impacts, friction, rest, stacks, the environment's shapes, momentum; at several time steps."""

import math
from dataclasses import replace

import numba
import numpy as np
import pytest
from conftest import parts_of
from plain_scenes import BALL, BLOCK, PLATE, G, course, energy, lowest, run, sphere_centers, state
from scipy.spatial.transform import Rotation

from unc_physics import Belief, RigidBody, Scene, load_model, make_propagator
from unc_physics.environment import Box, Capsule, Cylinder, Plane, Sphere

R = 0.05  # m, the ball's radius
STEPS = (1 / 120, 1 / 240, 1 / 960, 1 / 2000)  # s
FLOOR = Plane(name="floor")
at_steps = pytest.mark.parametrize("dt", STEPS, ids=lambda dt: f"{round(1 / dt)}Hz")


def world(*bodies, environment=(FLOOR,), **physics):
    """A robot's world: gravity, friction 0.5; no rebound unless asked for."""
    return Scene.everyday(bodies, environment=environment, **{"restitution": 0.0} | physics)


def turned(*rotation_vector):
    """Quaternion of a rotation vector [rad]."""
    return Rotation.from_rotvec(rotation_vector).as_quat()


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
    """A ball's, and those of a block that flies and turns about in a box without gravity."""
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
    ends = np.array([energy(free, s) for s in course(free, x, np.arange(0.0, 2.0, 0.1))])
    np.testing.assert_allclose(ends, ends[0], rtol=0.005)


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
    for mu, speed in ((0.5, 0.5), (0.5, 2.0), (0.2, 1.0)):
        scene = world(RigidBody("b", BLOCK, 0.5), dt=dt, friction=mu)
        x = run(scene, state((0, 0, 0.02), (speed, 0, 0)), speed / (mu * G) + 0.3)[0]
        assert x[0] == pytest.approx(speed**2 / (2.0 * mu * G), rel=0.01)
        assert np.linalg.norm(x[3:6]) < 1e-4


@at_steps
def test_a_ball_that_rolls_goes_on(dt):
    scene = world(RigidBody("b", BALL, 0.3), dt=dt)
    x = run(scene, state((0, 0, R), (1, 0, 0), (0, 1 / R, 0)), 5.0)[0]
    assert x[3] == pytest.approx(1.0, rel=1e-3) and x[11] == pytest.approx(1.0 / R, rel=1e-3)


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
    """Within 1 um in 10 s, and no deeper than 0.1 mm at the stiffness that is chosen."""
    body = RigidBody("b", load_model(model).prefix(1000), mass)
    settled, later = course(
        world(body, dt=dt), state((0, 0, 0.0002 - lowest(body.model))), (1.0, 11.0)
    )[:, 0]
    assert np.linalg.norm(later[:3] - settled[:3]) < 1e-6
    assert 0.0 < depth_in(FLOOR, body, later) < 1e-4
    apart = Rotation.from_quat(settled[6:10]).inv() * Rotation.from_quat(later[6:10])
    assert apart.magnitude() < 2e-5
