"""Errors of impacts: as wide as asked for, keyed by sample, partners and impact, and within the laws."""

from dataclasses import replace

import numpy as np
import pytest
from everyday_worlds import solid_box
from plain_scenes import BALL, state

from unc_physics import Belief, Plane, RigidBody, Scene, UncPhysicsError, assess, make_propagator, predict
from unc_physics.propagators.base import rollout_count
from unc_physics.scene.scene_file import scene_from_dict

R = 0.05  # m, the ball's radius
COUNT = 2000
STATISTICS = 4.0 / np.sqrt(2.0 * COUNT)  # four standard errors of a standard deviation


def dropped(count=COUNT, friction=0.5, restitution=0.6, seed=3, **errors):
    """States of a ball that fell onto the floor at 1 m/s, just after its impact, (count, 13)."""
    scene = Scene.everyday(
        [RigidBody("ball", BALL, 0.3)],
        exact=True,
        gravity=None,
        environment=[Plane()],
        friction=friction,
        restitution=restitution,
        **errors,
    )
    belief = Belief.exact(state((0.0, 0.0, R + 0.01), (0.0, 0.0, -1.0))[None])
    return predict(scene, belief, make_propagator("monte_carlo", samples=count, seed=seed), 0.02).samples(
        count
    )[:, 0]


def test_the_impulse_turns_by_as_much_as_asked_for():
    """Without friction it is along the normal: the ball leaves at twice the angle of an elastic one's."""
    v = dropped(friction=None, restitution=0.0, impact_direction_std=0.05)[:, 3:6]
    angle = np.arctan2(v[:, :2], -np.ones((COUNT, 1)) + 1.0 + 1.0)  # impulse over m: v + (0, 0, 1)
    np.testing.assert_allclose(angle.std(axis=0), 0.05, rtol=STATISTICS + 0.01)
    np.testing.assert_allclose(angle.mean(axis=0), 0.0, atol=4.0 * 0.05 / np.sqrt(COUNT))


def test_the_impulse_acts_elsewhere_by_as_much_as_asked_for():
    """Its moment about the centre is the shift times the impulse, m (1 + e) v; nothing rubs."""
    x = dropped(friction=None, impact_point_std=0.002)
    inertia = BALL.inertia[0, 0]
    assert abs(x[:, 3:5]).max() == 0.0
    shift = x[:, 10:12] * inertia / (x[:, 5:6] + 1.0)
    np.testing.assert_allclose(shift.std(axis=0), 0.002, rtol=STATISTICS + 0.03)
    assert abs(x[:, 12]).max() < 1e-9


def test_friction_varies_from_impact_to_impact():
    scene = Scene.everyday(
        [solid_box("block", (0.14, 0.1, 0.04), 1.0)],
        exact=True,
        gravity=None,
        environment=[Plane()],
        friction=0.2,
        restitution=0.0,
        impact_friction_std=0.1,
    )
    belief = Belief.exact(state((0.0, 0.0, 0.03), (2.0, 0.0, -1.0))[None])
    x = predict(scene, belief, make_propagator("monte_carlo", samples=COUNT), 0.0125).samples(COUNT)[:, 0]
    factor = np.log((2.0 - x[:, 3]) / 0.2)  # the impulse's tangential part over the normal one, 1 m/s
    assert factor.std() == pytest.approx(0.1, rel=0.3)


def test_no_energy_is_gained():
    x = dropped(restitution=0.9, impact_direction_std=0.2, impact_point_std=0.01, impact_friction_std=0.5)
    energy = 0.5 * (x[:, 3:6] ** 2).sum(axis=1) + 0.5 * BALL.inertia[0, 0] * (x[:, 10:13] ** 2).sum(axis=1)
    assert energy.max() <= 0.5 * (1.0 + 1e-6)


def test_draws_depend_on_sample_and_seed_alone():
    errors = {"impact_direction_std": 0.05, "impact_point_std": 0.002, "impact_friction_std": 0.1}
    many = dropped(40, **errors)
    np.testing.assert_array_equal(dropped(10, **errors), many[:10])
    assert not np.array_equal(dropped(10, seed=4, **errors), many[:10])
    assert len(np.unique(many[:, 3])) == 40
    np.testing.assert_array_equal(dropped(3), dropped(3, seed=4))


@pytest.mark.parametrize("name", ["impact_direction_std", "impact_point_std", "impact_friction_std"])
@pytest.mark.parametrize("propagator", ["sigma_points", "linearization", "surrogate", "local_sampling"])
def test_others_than_sampling_propagators_leave_it_out_and_say_so(name, propagator):
    floor = [Plane(name="floor")]
    scene = Scene.everyday([RigidBody("ball", BALL, 0.3)], exact=True, environment=floor, **{name: 0.1})
    belief = Belief(state((0, 0, 0.1), (0.3, 0, 0))[None], 1e-6 * np.eye(12)[None], np.arange(1))
    found = predict(scene, belief, propagator, 0.3)
    plain = predict(replace(scene, **{name: 0.0}), belief, propagator, 0.3)
    np.testing.assert_array_equal(found.belief.covariance, plain.belief.covariance)
    assert found.left_out == (name,) and plain.left_out == ()
    (status,) = assess(found, rollouts=0)
    assert any(name in reason for reason in status.reasons)
    assert not any(name in reason for reason in assess(plain, rollouts=0)[0].reasons)
    assert "spread_disagreement" in assess(found)[0].measures  # compared with rollouts that have it


@pytest.mark.parametrize("propagator", ["auto", "cloud", "monte_carlo", "sigma_points", "linearization"])
def test_flight_costs_nothing(propagator):
    """Above a floor that is out of reach, uncertain materials and errors of impacts change nothing."""
    bodies, floor = [RigidBody("ball", BALL, 0.3)], [Plane(name="floor")]
    belief = Belief(state((0, 0, 1.0), (0.3, 0, 0))[None], 1e-6 * np.eye(12)[None], np.arange(1))
    found, certain = (
        predict(Scene.everyday(bodies, exact=exact, environment=floor), belief, propagator, 0.3)
        for exact in (False, True)
    )
    assert found.left_out == () and not found.scene.uncertain
    np.testing.assert_array_equal(found.belief.covariance, certain.belief.covariance)
    assert rollout_count(found.carry) == rollout_count(certain.carry)


@pytest.mark.parametrize(
    "velocity, horizon, meets",
    [((0, 0, 0), 0.3, False), ((0, 0, 0), 0.5, True), ((0, 0, -2.0), 0.3, True), ((0, 0, 2.0), 0.3, False)],
)
def test_contacts_within_the_horizon_keep_what_is_uncertain(velocity, horizon, meets):
    """A ball above a floor, by the time at which it falls onto it."""
    bodies, floor = [RigidBody("ball", BALL, 0.3)], [Plane(name="floor")]
    scene = Scene.everyday(bodies, environment=floor)
    belief = Belief(state((0, 0, 1.0), velocity)[None], 1e-6 * np.eye(12)[None], np.arange(1))
    prediction = predict(scene, belief, "monte_carlo", horizon)
    assert bool(prediction.scene.uncertain) == meets
    assert np.isfinite(prediction.carry.contact_history.first_time).any() == meets


@pytest.mark.parametrize("name", ["impact_direction_std", "impact_point_std", "impact_friction_std"])
def test_the_explicit_step_has_no_errors_of_impacts(name):
    with pytest.raises(UncPhysicsError, match=f"{name} .*needs 'integrator: implicit'"):
        Scene([RigidBody("ball", BALL, 0.3)], **{name: 0.1})


def test_a_surface_tilts():
    """On a table that tilts, without friction, a ball runs off: at g sin(tilt)."""
    content = {
        "physics": "everyday",
        "exact": True,
        "friction": None,
        "bodies": [{"name": "pin", "model": "pin", "position": [0, 0, 1]}],
        "environment": [{"plane": {}, "surface_tilt_std": 1e-2}],
    }
    plane = scene_from_dict(content).scene.environment[0]
    assert plane.surface_tilt_std == 0.01
    scene = Scene.everyday([RigidBody("ball", BALL, 0.3)], exact=True, friction=None, environment=[plane])
    belief = Belief.exact(state((0.0, 0.0, R))[None])
    x = predict(scene, belief, make_propagator("monte_carlo", samples=300), 0.5).samples(300)[:, 0]
    np.testing.assert_allclose(x[:, 3:5].std(axis=0), 9.81 * 0.5 * 0.01, rtol=0.2)
    points = predict(scene, belief, make_propagator("sigma_points"), 0.5)
    np.testing.assert_allclose(points["ball"].linear_velocity_std[:2], 9.81 * 0.5 * 0.01, rtol=0.02)
    with pytest.raises(UncPhysicsError, match=r"environment\[0\]\.surface_tilt_std must not exceed 0.5 rad"):
        scene_from_dict(content | {"environment": [{"plane": {}, "surface_tilt_std": 0.7}]})
