"""Contacts and regions of propagators without samples: simulated samples, or flights up to a contact."""

import numpy as np
import pytest
from plain_scenes import BALL, BLOCK, G, independent, state
from scipy.stats import norm

from unc_physics import (
    Belief,
    Box,
    BoxRegion,
    InRegion,
    Plane,
    RigidBody,
    Scene,
    Wrench,
    encounters,
    load_model,
    make_propagator,
    predict,
)
from unc_physics.prediction.events import ENVIRONMENT
from unc_physics.prediction.first_contacts import first_contacts
from unc_physics.scene.marks import whole

TABLE = [Box(name="table", size=(0.6, 0.6, 0.05), position=(0, 0, -0.025)), Plane(name="floor", offset=-0.7)]
BOXES = [RigidBody(name, load_model("salt_box").prefix(60), 1.0) for name in ("near", "edge")]
EVERYDAY = Scene.everyday(BOXES, exact=True, environment=TABLE)
EXPLICIT = Scene(BOXES, environment=TABLE, gravity=(0, 0, -G))
#: Both are thrown at a table that one of them may miss.
THROWN = independent(
    state((0, 0, 0.2), spin=(1, 0, 0)), state((0.3, 0.2, 0.3), spin=(0, 4, 1)), position=0.03, velocity=0.2
)


@pytest.mark.parametrize("horizon", [0.1, 0.25])
def test_flights_and_samples_agree_on_contacts(horizon):
    scene, belief = EVERYDAY, THROWN
    truth = predict(scene, belief, make_propagator("monte_carlo", samples=1000, seed=5), horizon)
    events = encounters(scene)
    points = predict(scene, belief, "sigma_points", horizon, events=events)
    assert any(truth.probability(event).estimate not in (0.0, 1.0) for event in events)
    for event in events:
        one, other = points.probability(event), truth.probability(event)
        assert (
            (one.method, one.rollouts) == ("flights", 1000)
            and one.low <= other.high
            and other.low <= one.high
        )
        times = points.contact_time(event), truth.contact_time(event)
        if min(one.estimate, other.estimate) > 0.05:
            assert times[0].mean == pytest.approx(times[1].mean, abs=0.02)
        assert one.high - one.low < 0.2 or event.other != ENVIRONMENT


def test_an_explicit_flight_is_the_prediction_until_it_touches_something():
    marks, count = [whole(steps, EXPLICIT.dt) for steps in (8, 25)], 50
    early, flights = first_contacts(EXPLICIT, THROWN, marks, count, seed=7)
    reference = predict(EXPLICIT, THROWN, make_propagator("monte_carlo", samples=count, seed=7), 0.25)
    first = reference.carry.contact_history.first_time
    own = np.minimum(first.min(axis=2), first[:, :, :2].min(axis=1))
    assert 0.1 < np.isfinite(flights.known_until).mean() < 1.0
    # of the samples' bodies that touch nothing, and meet none that was stopped
    free = np.isinf(flights.known_until) & np.isinf(own)
    np.testing.assert_array_equal(flights.states[free], reference.carry.states[free])
    (alone,) = first_contacts(EXPLICIT, THROWN, marks[:1], count, seed=7)
    for one, other in zip(early, alone, strict=True):
        np.testing.assert_array_equal(one, other)
    # whoever touches something first does so then
    np.testing.assert_array_equal(flights.known_until.min(axis=1), own.min(axis=1))


def test_what_was_stopped_stands():
    """The other one flies on, and may touch it."""
    belief, marks = Belief.exact([state((0, 0, 0.15)), state((0, 0, 0.6))]), (25, 100)
    still, flights = first_contacts(EXPLICIT, belief, [whole(steps, EXPLICIT.dt) for steps in marks], 1)
    table, other = flights.first_contacts[0, 0, 2], flights.first_contacts[0, 0, 1]
    assert 0.0 < table < other < 0.4  # the lower one, then the upper one on it
    assert flights.known_until[0].tolist() == [table, other]
    np.testing.assert_array_equal(flights.states[0, 0], still.states[0, 0])


def test_rollouts_of_scenes_with_actions_have_uncertain_friction():
    """A block slides v^2 / (2 mu g), beyond the distance for 0.8 mu if its friction is lower than this.

    The logarithm of its friction is normal with a standard deviation of ``std / mu``.
    """
    mu, std, speed = 0.4, 0.1, 1.0
    push = Wrench(force=(0.1, 0.0, 0.0), duration=0.1)
    scene = Scene.everyday(
        [RigidBody("block", BLOCK, 0.4), RigidBody("ball", BALL, 0.5, wrenches=[push])],
        exact=True,
        environment=[Plane(name="floor")],
        friction=mu,
        friction_std=std,
    )
    mean = [state((0.0, 0.0, 0.02), (speed, 0.0, 0.0)), state((0.0, 3.0, 1.0))]
    reach = speed**2 / (2.0 * 0.8 * mu * G)
    beyond = InRegion("block", BoxRegion("beyond", (2.0, 1.0, 1.0), (reach + 1.0, 0.0, 0.0)))
    found = predict(scene, Belief.exact(mean), "sigma_points", 0.8, events=[beyond]).probability(beyond)
    assert found.method == "flights" and found.rollouts == 1000
    assert found.estimate == pytest.approx(norm.cdf(np.log(0.8) * mu / std), abs=0.04)  # 3 standard errors
