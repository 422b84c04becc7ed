"""Uncertain parameters on the implicit step: each changes what it should."""

from dataclasses import replace

import numpy as np
import pytest
from plain_scenes import ball

from unc_physics import Belief, Box, Plane, RigidBody, Scene, load_model, make_propagator, predict
from unc_physics.physics import contact_history as histories
from unc_physics.physics.paper.rollout import rollout
from unc_physics.scene.parameters import vary

R, G = 0.03, 9.81
BALL = ball(R)
FLOOR = Plane(name="floor")


def state(*position, velocity=(0.0, 0.0, 0.0)):
    return np.concatenate([position, velocity, (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)])


def sampled(scene, mean, horizon, samples=60):
    """Standard normal numbers (N,) of the one uncertain parameter, and the samples' states (N, B, 13)."""
    prediction = predict(
        scene,
        Belief.exact(np.atleast_2d(mean), scene.moving),
        make_propagator("monte_carlo", samples=samples, seed=3),
        horizon,
    )
    return prediction.carry.parameters[:, 0], prediction.samples()


def test_mass_decides_who_pushes_whom():
    """Balls that collide straight: velocities by conserved momentum, and restitution."""
    scene = Scene.everyday(
        [RigidBody("a", BALL, 1.0, mass_std=0.2), RigidBody("b", BALL, 0.5)],
        exact=True,
        gravity=None,
        restitution=0.6,
    )
    z, ends = sampled(scene, [state(0, 0, 0, velocity=(1, 0, 0)), state(2 * R + 0.02, 0, 0)], 0.2)
    mass = np.exp(0.2 * z)
    np.testing.assert_allclose(ends[:, 1, 3], 1.6 * mass / (mass + 0.5), rtol=0.02)
    np.testing.assert_allclose(mass * ends[:, 0, 3] + 0.5 * ends[:, 1, 3], mass, rtol=1e-9)


def test_mass_decides_how_deep_a_body_sinks_in():
    scene = replace(
        Scene.everyday([RigidBody("a", BALL, 1.0, mass_std=0.3)], exact=True, environment=[FLOOR]),
        stiffness=1e10,
    )
    z, ends = sampled(scene, state(0, 0, R), 1.0)
    depth = np.sqrt(np.exp(0.3 * z) * G / (1e10 * np.pi * R))
    np.testing.assert_allclose(R - ends[:, 0, 2], depth, rtol=0.01)


def test_stiffness_decides_how_deep_a_body_sinks_in():
    scene = replace(
        Scene.everyday([RigidBody("a", BALL, 1.0)], exact=True, environment=[FLOOR]),
        stiffness=1e10,
        stiffness_std=3e9,
    )
    z, ends = sampled(scene, state(0, 0, R), 1.0)
    np.testing.assert_allclose(
        R - ends[:, 0, 2], np.sqrt(G / (1e10 * np.exp(0.3 * z) * np.pi * R)), rtol=0.01
    )


@pytest.mark.parametrize("owner", ["scene", "body", "element"])
def test_friction_decides_how_far_a_brick_slides(owner):
    """Each owner's share is by the geometric mean: all of the scene's, half of a partner's."""
    mu, std, speed = 0.4, 0.04, 1.0
    brick = load_model("brick").prefix(200)
    own = {"friction": mu, "friction_std": std}
    scene = Scene.everyday(
        [RigidBody("a", brick, 1.0, **(own if owner == "body" else {}))],
        exact=True,
        environment=[Plane(**(own if owner == "element" else {}))],
        friction=mu,
        friction_std=std if owner == "scene" else 0.0,
        stiffness=1e10,
    )
    low = (brick.centers[:, 2] - brick.radii).min()
    z, ends = sampled(scene, state(0, 0, -low, velocity=(speed, 0, 0)), 1.0, samples=30)
    found = mu * np.exp((1.0 if owner == "scene" else 0.5) * z * std / mu)
    np.testing.assert_allclose(ends[:, 0, 0], speed**2 / (2.0 * found * G), rtol=0.03)


@pytest.mark.parametrize("owner", ["scene", "body", "element"])
def test_restitution_decides_how_fast_a_ball_comes_back(owner):
    e, std = 0.5, 0.1
    own = {"restitution": e, "restitution_std": std}
    scene = Scene.everyday(
        [RigidBody("a", BALL, 1.0, **(own if owner == "body" else {}))],
        exact=True,
        environment=[Plane(**(own if owner == "element" else {}))],
        gravity=None,
        restitution=e,
        restitution_std=std if owner == "scene" else 0.0,
    )
    z, ends = sampled(scene, state(0, 0, R + 0.01, velocity=(0, 0, -1)), 0.1)
    varied = np.clip(e + std * z, 0.0, 1.0)
    np.testing.assert_allclose(ends[:, 0, 5], varied if owner == "scene" else np.sqrt(e * varied), rtol=0.02)


def test_the_direction_of_gravity_decides_where_a_ball_rolls():
    scene = Scene.everyday(
        [RigidBody("a", BALL, 1.0)], exact=True, environment=[FLOOR], gravity_direction_std=0.02
    )
    prediction = predict(
        scene, Belief.exact([state(0, 0, R)]), make_propagator("monte_carlo", samples=60, seed=3), 0.5
    )
    tilt = 0.02 * np.linalg.norm(prediction.carry.parameters, axis=1)
    way = np.linalg.norm(prediction.samples()[:, 0, :2], axis=1)
    np.testing.assert_allclose(way, 5.0 / 7.0 * G * np.sin(tilt) * 0.5**2 / 2.0, rtol=0.02)


def test_a_shifted_centre_of_mass_decides_who_falls_off_a_table():
    """A brick that overhangs by the half: it falls where the centre of mass is beyond the edge."""
    brick = load_model("brick").prefix(200)
    low, end = (brick.centers[:, 2] - brick.radii).min(), (brick.centers[:, 0] + brick.radii).max()
    std = 0.2 * end
    scene = Scene.everyday(
        [RigidBody("a", brick, 1.0, center_of_mass_std=(std, 0.0, 0.0))],
        exact=True,
        stiffness=1e10,
        environment=[Box(name="table", size=(1.0, 1.0, 0.1), position=(-0.5, 0, -0.05)), Plane(offset=-1.0)],
    )
    z, ends = sampled(scene, state(0, 0, -low), 2.0)
    clear = np.abs(z) > 0.3  # the packing's edge is not a box's
    np.testing.assert_array_equal(ends[clear, 0, 2] < -0.5, z[clear] > 0.0)


def test_the_hull_and_the_box_about_the_spheres_move_with_the_centre_of_mass():
    brick = load_model("brick").prefix(200)
    scene = Scene.everyday(
        [RigidBody("a", brick, 1.0, center_of_mass_std=0.01), RigidBody("b", brick, 1.0)],
        exact=True,
        stiffness=1e9,
    )
    world, plain = vary(scene, np.array([1.0, -2.0, 0.5])), scene.world.implicit
    shift, found = 0.01 * np.array([1.0, -2.0, 0.5]), world.implicit
    (first, last), other = plain.hull_range[0], slice(*plain.hull_range[1])
    np.testing.assert_allclose(found.hull[:3, first:last].T, plain.hull[:3, first:last].T - shift, atol=1e-15)
    np.testing.assert_array_equal(found.hull[3], plain.hull[3])
    np.testing.assert_array_equal(found.hull[:, other], plain.hull[:, other])
    np.testing.assert_allclose(
        found.extent[0], [*(plain.extent[0, :3] - shift), *plain.extent[0, 3:]], atol=1e-15
    )
    np.testing.assert_array_equal(found.extent[1], plain.extent[1])
    columns = found.hull[:3, : len(found.hull_sphere)].T
    np.testing.assert_array_equal(world.tree.centers[found.hull_sphere], columns)


@pytest.mark.parametrize("name", ["sigma_points", "monte_carlo"])
def test_each_state_runs_in_the_world_of_its_parameters(name):
    brick = load_model("brick").prefix(60)
    bodies = [
        RigidBody("a", brick, 1.0, mass_std=0.1, center_of_mass_std=0.002, friction=0.4, friction_std=0.1),
        RigidBody("b", brick, 1.0, restitution=0.3, restitution_std=0.1),
    ]
    scene = Scene.everyday(
        bodies,
        exact=True,
        environment=[FLOOR],
        stiffness=1e9,
        stiffness_std=1e8,
        friction_std=0.1,
        gravity_direction_std=0.02,
    )
    mean = np.array([state(0, 0, 0.1, velocity=(1, 0, 0)), state(0.35, 0, 0.1)])
    propagator = make_propagator(name, **({"samples": 12} if name == "monte_carlo" else {}))
    begun, steps = propagator.init(scene, Belief.exact(mean)), 120
    ended = propagator.advance(begun, scene, steps)
    assert len(scene.uncertain) == 10
    for n, z in enumerate(begun.parameters):
        own, world = begun.states[n : n + 1].copy(), vary(scene, z)
        rollout(own, histories.fresh(1, world), world, 0, steps)
        np.testing.assert_array_equal(own[0], ended.states[n])
