"""Rollouts as arrays, against closed forms, Monte Carlo's samples, and each other."""

import dataclasses

import numpy as np
import pytest

from unc_physics import (
    Belief,
    BodyBelief,
    Plane,
    RigidBody,
    Scene,
    make_propagator,
    predict,
    primitive_model,
    rollouts,
)
from unc_physics.checks.errors import InvalidHorizonError, InvalidRequestError, NotSupportedError
from unc_physics.prediction import rollouts as module

G, DT = 9.81, 1.0 / 240.0
SIZE = 0.1  # edge of the cube [m]
CUBE = primitive_model("box", size=[SIZE, SIZE, SIZE])
SOLVER = 1e-5  # m/s: what the contact solver leaves
FIRST_ORDER = G * DT  # m/s, and times the duration in metres: what a semi-implicit step is off by


def on_floor(speed=1.0, **options):
    """A cube that slides on a floor, and the belief about it, with an uncertain speed."""
    scene = Scene.everyday([RigidBody("cube", CUBE, 0.5)], environment=[Plane((0, 0, 1), 0.0)], **options)
    body = BodyBelief(
        position=[0, 0, SIZE / 2], linear_velocity=[speed, 0, 0], linear_velocity_std=[0.1, 0.0, 0.0]
    )
    return scene, Belief.of(scene, {"cube": body})


def test_a_fall_is_the_closed_form():
    scene = Scene.everyday([RigidBody("cube", CUBE, 0.5)], exact=True)
    belief = Belief.of(
        scene, {"cube": BodyBelief(position=[0, 0, 5.0], linear_velocity=[1, 0, 2], linear_velocity_std=0.3)}
    )
    times = [0.25, 0.5]
    found = rollouts(scene, belief, 20, times, seed=3)
    assert found.states.shape == (20, 2, 1, 13) and found.seed == 3 and found.contacts is None
    drawn = belief.sample(20, np.random.default_rng(3))[:, 0]
    for t, time in enumerate(times):
        expected = drawn[:, :3] + time * drawn[:, 3:6] - [0.0, 0.0, 0.5 * G * time**2]
        np.testing.assert_allclose(found.states[:, t, 0, :3], expected, atol=FIRST_ORDER * time)


def test_a_slide_stops_where_the_drawn_friction_stops_it():
    scene, belief = on_floor(friction=0.4, friction_std=0.1)
    found = rollouts(scene, belief, 30, 1.5)
    speed = belief.sample(30, np.random.default_rng(0))[:, 0, 3]
    friction = np.sqrt(found.friction.prod(axis=1))  # of the contact: the geometric mean of both surfaces
    assert friction.std() > 0.05
    way = speed**2 / (2.0 * friction * G)
    slid = speed > 0.0
    np.testing.assert_allclose(found.states[slid, 0, 0, 0], way[slid], atol=0.01)


def test_states_are_monte_carlo_s_samples_in_portions_too(monkeypatch):
    scene, belief = on_floor(impact_direction_std=0.1)
    times = [0.1, 0.3 + 0.3 * DT]
    prediction = predict(scene, belief, make_propagator("monte_carlo", samples=80, seed=5), times=times)
    for portion in (2.0**30, 1.0):  # of all, and of as few rollouts as possible
        monkeypatch.setattr(module, "_PORTION", portion)
        found = rollouts(scene, belief, 80, times, seed=5)
        for t, time in enumerate(prediction.times):
            np.testing.assert_array_equal(found.states[:, t], prediction.samples(time=time))
    np.testing.assert_allclose(found.times, prediction.times)


def test_actions_have_common_draws():
    scene, belief = on_floor()
    faster = {"cube": {"linear_velocity": [2.0, 0.0, 0.0]}}
    found = rollouts(scene, belief, 25, [DT, 0.4], [belief, faster, belief], contacts=True)
    assert found.states.shape == (3, 25, 2, 1, 13) and found.friction.shape == (3, 25, 2)
    np.testing.assert_array_equal(found.states[0], found.states[2])
    np.testing.assert_array_equal(found.friction[0], found.friction[1])
    np.testing.assert_allclose(
        found.states[1, :, 0, 0, 3] - found.states[0, :, 0, 0, 3], 1.0, atol=SOLVER
    )  # both slide with the same friction
    alone = rollouts(scene, belief, 25, [DT, 0.4], {"faster": faster})
    np.testing.assert_array_equal(alone.states[0], found.states[1])
    assert set(found.contacts["action"]) == {0, 1, 2} and set(found.contacts["time"]) == {0, 1}


def test_contacts_carry_the_weight():
    scene, belief = on_floor(speed=0.0)
    found = rollouts(scene, belief, 8, [0.5, 1.0], contacts=True)
    rows = found.contacts[(found.contacts["time"] == 1) & (found.contacts["sample"] == 7)]
    assert set(rows["body"]) == {0} and set(rows["partner"]) == {1}
    np.testing.assert_allclose(rows["normal"], [[0.0, 0.0, 1.0]] * len(rows), atol=1e-3)
    np.testing.assert_allclose(rows["impulse"][:, 2].sum(), 0.5 * G * DT, rtol=1e-3)
    np.testing.assert_allclose(rows["point"][:, 2], 0.0, atol=1e-3)


@pytest.mark.parametrize(
    ("error", "field", "arguments"),
    [
        (InvalidHorizonError, "times", {"times": [0.1, 0.1]}),
        (InvalidRequestError, "actions", {"actions": []}),
        (InvalidRequestError, "actions[0]", {"actions": [{"mug": {"friction": 0.1}}]}),
        (InvalidRequestError, "contacts", {"contacts": 1}),
    ],
)
def test_wrong_arguments(error, field, arguments):
    scene, belief = on_floor()
    with pytest.raises(error) as caught:
        rollouts(scene, belief, **{"samples": 3, "times": 0.1, **arguments})
    assert caught.value.field == field


def test_other_bodies_and_the_explicit_integrator_are_refused(loaded):
    scene, belief = on_floor()
    renamed = dataclasses.replace(scene, bodies=[dataclasses.replace(scene.bodies[0], name="other")])
    with pytest.raises(InvalidRequestError, match="keep the names"):
        rollouts(scene, belief, 3, 0.1, [(renamed, belief)])
    paper, about, _ = loaded("two_bodies")
    assert rollouts(paper, about, 3, 10 * paper.dt).states.shape == (3, 1, len(paper.bodies), 13)
    with pytest.raises(NotSupportedError):
        rollouts(paper, about, 3, 10 * paper.dt, contacts=True)
