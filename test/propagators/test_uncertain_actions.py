"""Beliefs about what a robot does: uncertain paths, releases and grasps, by all propagators that take
them.
"""

import numpy as np
import pytest
from plain_scenes import BALL, G, packing

from unc_physics import (
    Belief,
    BodyBelief,
    PosePath,
    RigidBody,
    Scene,
    Touches,
    Wrench,
    make_propagator,
    predict,
)

PROPAGATORS = {
    "sigma_points": {},
    "linearization": {},
    "monte_carlo": {"samples": 4000},
    "cloud": {},
    "auto": {},
}
at_propagators = pytest.mark.parametrize("name", PROPAGATORS)


def predicted(scene, beliefs, name, horizon, **options):
    return predict(
        scene, Belief.of(scene, beliefs), make_propagator(name, **PROPAGATORS[name] | options), horizon
    )


@at_propagators
def test_a_throw_at_an_uncertain_time_from_an_uncertain_hand(name):
    """The hand moves along x at 1 m/s and is off by 1 cm across; the ball is off by 2 mm in the hand. What is
    released late falls for less long.
    """
    hand = PosePath(times=[0, 1], positions=[[0, 0, 0], [1, 0, 0]], linear_velocities=[[1, 0, 0]] * 2)
    bodies = [
        RigidBody("ball", BALL, 0.3, attached_to="hand", released_at=0.3, released_at_std=0.01),
        RigidBody("hand", BALL, trajectory=hand, trajectory_std=[0, 0.01, 0, 0, 0, 0.02]),
    ]
    scene = Scene.everyday(bodies, exact=True)
    given = {"ball": BodyBelief(position=(0, 0, -0.2), position_std=2e-3, linear_velocity_std=5.0)}
    prediction = predicted(scene, given, name, 0.8)
    end = prediction.body("ball")
    np.testing.assert_allclose(end.position, [0.8, 0, -0.2 - 0.5 * G * 0.25], atol=2e-3)
    # the path turns about its beginning, by 0.02 rad about z
    expected = [2e-3, np.sqrt(4e-6 + 0.01**2 + (0.02 * 0.8) ** 2), np.sqrt(4e-6 + (G * 0.5 * 0.01) ** 2)]
    np.testing.assert_allclose(end.position_std, expected, rtol=0.06)
    np.testing.assert_allclose(end.linear_velocity_std[2], G * 0.01, rtol=0.06)
    np.testing.assert_allclose(prediction.body("hand").position, [0.8, 0, 0], atol=1e-12)
    assert prediction.body("hand").prescribed and not prediction.body("hand").position_std.any()


def test_an_explicit_scene_has_prescribed_bodies_and_wrenches():
    """A wall that comes at 1 m/s throws a ball at twice that; a force throws another one."""
    wall = packing("wall", [[-5.0, 0, 0]], [5.0], np.eye(3))
    path = PosePath(times=[0, 1], positions=[[-0.3, 0, 0], [0.7, 0, 0]], linear_velocities=[[1, 0, 0]] * 2)
    push = Wrench(force=(0, 0.2, 0), start=0.1, duration=0.5)
    bodies = [
        RigidBody("ball", BALL, 0.3),
        RigidBody("wall", wall, trajectory=path),
        RigidBody("other", BALL, 0.4, wrenches=[push]),
    ]
    scene = Scene(bodies, dt=1e-3, stiffness=1e7)
    given = {"ball": BodyBelief(), "other": BodyBelief(position=(50, 0, 0))}
    for name in ("sigma_points", "monte_carlo"):
        prediction = predict(scene, Belief.of(scene, given), name, 0.8)
        assert prediction.body("ball").linear_velocity[0] == pytest.approx(2.0, rel=0.01)
        np.testing.assert_allclose(prediction.body("wall").position, [0.5, 0, 0], atol=1e-9)
        assert prediction.body("other").linear_velocity[1] == pytest.approx(0.25, rel=1e-9)
        assert prediction.probability(Touches("ball", "wall")).estimate == 1.0


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_beliefs_of_a_body_with_drag_are_those_of_samples(integrator):
    """Uncertain speeds approach each other: ``v / (1 + k v t)`` of all, of which no flight is a parabola."""
    scene = Scene([RigidBody("ball", BALL, 0.05, drag=0.05)], gravity=(0, 0, 0), integrator=integrator)
    start = BodyBelief(linear_velocity=(4.0, 0, 0), linear_velocity_std=(0.4, 0, 0), angular_velocity_std=0.1)
    belief, rate = Belief.of(scene, {"ball": start}), 0.5 * 1.2 * 0.05 / 0.05
    v = np.random.default_rng(0).normal(4.0, 0.4, 100_000)
    ends, mean, std = v / (1.0 + rate * v), np.log1p(rate * v) / rate, 1.0 / (1.0 + 4.0 * rate) ** 2
    names = ("sigma_points", "cloud", "monte_carlo", *(["linearization"] if integrator != "explicit" else []))
    for name in names:
        found = predict(scene, belief, name, 1.0).body("ball")
        assert found.linear_velocity[0] == pytest.approx(ends.mean(), rel=0.03)
        assert found.linear_velocity_std[0] == pytest.approx(0.4 * std, rel=0.15)
        assert found.position[0] == pytest.approx(mean.mean(), rel=0.01)
