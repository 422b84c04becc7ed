"""Uncertain parameters of a scene, as directions of sigma points and Monte Carlo."""

import dataclasses

import numpy as np
import pytest

from unc_physics import make_propagator, predict
from unc_physics.checks.errors import NotSupportedError
from unc_physics.physics.paper.sphere_tree import EMPTY
from unc_physics.scene.belief import Belief
from unc_physics.scene.body import RigidBody
from unc_physics.scene.environment import Plane
from unc_physics.scene.parameters import vary
from unc_physics.scene.scene import Scene

ROUND_OFF = 1e-12
TIME, DT = 0.5, 0.01
SAMPLES = 4000
#: Five standard errors of a variance from that many normal samples, relative to it.
STATISTICS = 5.0 * np.sqrt(2.0 / SAMPLES)


@pytest.fixture(scope="module")
def model(loaded):
    """A packing of ten spheres."""
    return loaded("two_bodies").scene.bodies[0].model


def at_rest(count=1, spacing=100.0):
    """States of bodies at rest, far from each other along x, in different orientations."""
    mean = np.zeros((count, 13))
    mean[:, 0] = spacing * np.arange(count)
    mean[:, 9] = 1.0
    if count > 1:
        mean[1, 6:10] = [0.5, -0.5, 0.5, 0.5]
    return mean


def samplers():
    """The propagators that take uncertain parameters."""
    return make_propagator("sigma_points"), make_propagator("monte_carlo", samples=SAMPLES, seed=3)


def relative_error(propagator):
    """What a propagator's covariance may be off where the dynamics are linear in the uncertainty."""
    return STATISTICS if propagator.name == "monte_carlo" else 1e-3


def test_tilted_gravity_spreads_a_fall_sideways(model):
    std = 0.02
    scene = Scene([RigidBody("a", model, 1.0)], DT, gravity=[0.0, 0.0, -9.81], gravity_direction_std=std)
    fall = 9.81 * DT**2 * (TIME / DT) * (TIME / DT - 1.0) / 2.0
    for propagator in samplers():
        P = predict(scene, Belief.exact(at_rest()), propagator, TIME).belief.joint
        assert np.allclose(P[0, 0], (std * fall) ** 2, rtol=relative_error(propagator))
        assert np.allclose(P[1, 1], (std * fall) ** 2, rtol=relative_error(propagator))
        assert (
            P[2, 2] < (std * std * fall) ** 2 * 3.0
        )  # its size stays: only the second order is left along it
        assert np.allclose(P[0, 3], std**2 * fall * 9.81 * TIME, rtol=relative_error(propagator))


def test_gravity_that_hardly_tilts_falls_straight_down(model):
    scene = Scene([RigidBody("a", model, 1.0)], DT, gravity=[0.0, 0.0, -9.81], gravity_direction_std=1e-320)
    sigma_points = samplers()[0]
    mean = predict(scene, Belief.exact(at_rest()), sigma_points, TIME).belief.mean
    assert np.isfinite(mean).all() and np.allclose(mean[0, :2], 0.0)


def test_mass_spreads_the_velocities_after_an_impact_by_conserved_momentum(loaded):
    scene, belief, _ = loaded("undamped")
    left, right = scene.bodies
    heavy = dataclasses.replace(left, mass_std=0.01 * left.mass)
    scene = dataclasses.replace(scene, bodies=(heavy, right))
    prediction = predict(
        scene, Belief.exact(belief.mean), make_propagator("monte_carlo", samples=200, seed=1), 1.0
    )
    states, z = prediction.carry.states, prediction.carry.parameters
    mass = left.mass * np.exp(0.01 * z)
    momentum = mass * states[:, 0, 3:6] + right.mass * states[:, 1, 3:6]
    expected = mass * belief.mean[0, 3:6] + right.mass * belief.mean[1, 3:6]
    assert np.allclose(momentum, expected, atol=1e-10)
    assert prediction.belief.blocks[1, 3, 3] > 1e-6  # and the other body's velocity has learned of it
    points = predict(scene, Belief.exact(belief.mean), "sigma_points", 1.0).belief
    assert np.allclose(
        points.joint, prediction.belief.joint, atol=0.3 * np.diag(prediction.belief.joint).max()
    )


def test_a_shifted_centre_of_mass_leaves_the_belief_about_the_model_s(model):
    std = np.array([0.0, 0.03, 0.0])
    scene = Scene(
        [
            RigidBody("a", model, 1.0, center_of_mass_std=std),
            RigidBody("b", model, 1.0, center_of_mass_std=0.01),
        ],
        DT,
    )
    mean = at_rest(2)
    mean[0, 10:13] = [0.0, 0.0, 2.0]
    for propagator in samplers():
        carry = propagator.init(scene, Belief.exact(mean))
        belief = propagator.belief(carry, scene)
        assert np.allclose(belief.mean, mean, atol=1e-10)
        assert np.allclose(belief.joint, 0.0, atol=1e-14)
        # a free body turns about its centre of mass: half a turn and the model's moves by twice the offset
        half_turn = predict(scene, Belief.exact(mean), propagator, np.pi / 2.0 // DT * DT).belief
        angle = 2.0 * (np.pi / 2.0 // DT * DT)
        along, across = std[1] * np.sin(angle), std[1] * (1.0 - np.cos(angle))
        offset = np.array([along, across]) + std[1] * 2.0 * (np.pi / 2.0 // DT * DT) * np.array([-1.0, 0.0])
        assert np.allclose(
            half_turn.joint[:2, :2], np.outer(offset, offset), rtol=relative_error(propagator), atol=1e-12
        )
        assert np.allclose(half_turn.blocks[1], 0.0, atol=1e-14)


def test_a_shifted_centre_of_mass_moves_the_spheres_and_what_bounds_them(model):
    scene = Scene([RigidBody("a", model, 1.0, center_of_mass_std=0.1), RigidBody("b", model, 1.0)])
    world = vary(scene, np.array([1.0, -2.0, 0.5]))
    shift, count = np.array([0.1, -0.2, 0.05]), len(model)
    assert np.allclose(world.tree.centers[:count], model.centers - shift, atol=ROUND_OFF)
    assert np.array_equal(world.tree.centers[count:], model.centers)
    assert np.allclose(
        world.bodies.radius[0], np.max(np.linalg.norm(model.centers - shift, axis=1) + model.radii)
    )
    bounds, child = world.tree.bounds.astype(float), world.tree.child
    node, k = np.nonzero((child < 0) & (child != EMPTY))
    spheres = ~child[node, k]
    gap = (
        np.linalg.norm(world.tree.centers[spheres] - bounds[node, :3, k], axis=1) + world.tree.radii[spheres]
    )
    assert np.all(gap <= bounds[node, 3, k])


def test_an_off_centre_push_turns_by_the_shifted_centre_of_mass(model):
    ball = model.prefix(1)
    scene = Scene(
        [RigidBody("a", ball, 1.0, center_of_mass_std=[0.1 * ball.radii[0], 0.0, 0.0])],
        0.001,
        1e6,
        gravity=(0.0, 0.0, 0.0),
        environment=[Plane()],
    )
    mean = at_rest()
    mean[0, 2], mean[0, 5] = ball.radii[0] - ball.centers[0, 2] + 0.001, -1.0
    prediction = predict(scene, Belief.exact(mean), make_propagator("monte_carlo", samples=50, seed=2), 0.1)
    offset = prediction.carry.parameters[:, 0]
    spin = prediction.carry.states[:, 0, 11]
    assert (
        np.corrcoef(offset, spin)[0, 1] > 0.98
    )  # support left of the centre of mass turns the body about +y


def test_draws_of_the_state_stay_the_same(loaded):
    scene, belief, _ = loaded("two_bodies")
    left, right = scene.bodies
    uncertain = dataclasses.replace(scene, bodies=(dataclasses.replace(left, mass_std=0.1), right))
    propagator = make_propagator("monte_carlo", samples=20, seed=9)
    carries = [propagator.init(s, belief) for s in (scene, uncertain)]
    assert np.array_equal(carries[0].states, carries[1].states)
    assert carries[0].parameters.size == 0
    more = dataclasses.replace(propagator, samples=30).init(uncertain, belief)
    assert np.array_equal(more.parameters[:20], carries[1].parameters)


@pytest.mark.parametrize("name", ["sigma_points", "monte_carlo"])
def test_pieces_and_repetitions_give_the_same_numbers(loaded, name):
    scene, belief, _ = loaded("two_bodies")
    bodies = [dataclasses.replace(body, mass_std=0.1, center_of_mass_std=0.01) for body in scene.bodies]
    scene = dataclasses.replace(scene, bodies=bodies, stiffness_std=1e3)
    propagator = make_propagator(name, **({"samples": 20} if name == "monte_carlo" else {}))
    at_once = predict(scene, belief, propagator, 1.0)
    in_pieces = predict(scene, belief, propagator, 1.0, progress=lambda done, steps: None)
    assert np.array_equal(at_once.carry.states, in_pieces.carry.states)
    assert np.array_equal(at_once.belief.joint, in_pieces.belief.joint)


@pytest.mark.parametrize("name", ["linearization", "surrogate", "local_sampling"])
def test_other_propagators_name_the_field(loaded, name):
    scene, belief, _ = loaded("two_bodies")
    left, right = scene.bodies
    scene = dataclasses.replace(scene, bodies=(left, dataclasses.replace(right, mass_std=0.1)))
    with pytest.raises(NotSupportedError, match="mass_std of body 'right'"):
        predict(scene, belief, name, 0.5)


def test_zero_is_none_and_costs_nothing(loaded):
    scene, belief, _ = loaded("two_bodies")
    zeros = [
        dataclasses.replace(body, mass_std=0.0, center_of_mass_std=[0.0, 0.0, 0.0]) for body in scene.bodies
    ]
    same = dataclasses.replace(scene, bodies=zeros, stiffness_std=0.0)
    assert same.uncertain == () and same.world.environment is None
    for propagator in (make_propagator("sigma_points"), make_propagator("monte_carlo", samples=20)):
        a, b = (predict(s, belief, propagator, 1.0).carry for s in (scene, same))
        assert np.array_equal(a.states, b.states)
