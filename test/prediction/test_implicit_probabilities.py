"""Contact, region and rest on the implicit step: flights up to the first contact, and samples."""

import numpy as np
import pytest

from unc_physics import Belief, Box, Plane, RigidBody, Scene, load_model, make_propagator, predict
from unc_physics.prediction.events import ENVIRONMENT
from unc_physics.prediction.first_contacts import first_contacts
from unc_physics.prediction.probabilities import (
    TOLERANCE,
    BoxRegion,
    contact_probabilities,
    region_probabilities,
    rest_probabilities,
)


@pytest.fixture(scope="module")
def thrown():
    """Two boxes thrown at a table that one of them may miss."""
    box = load_model("salt_box").prefix(60)
    table = [
        Box(name="table", size=(0.6, 0.6, 0.05), position=(0, 0, -0.025)),
        Plane(name="floor", offset=-0.7),
    ]
    scene = Scene.everyday([RigidBody("near", box, 1.0), RigidBody("edge", box, 1.0)], environment=table)
    mean = np.zeros((2, 13))
    mean[:, 9] = 1.0
    mean[:, :3] = [[0.0, 0.0, 0.2], [0.3, 0.2, 0.3]]
    mean[:, 10:] = [[1.0, 0.0, 0.0], [0.0, 4.0, 1.0]]
    P = np.zeros((2, 12, 12))
    P[:, range(6), range(6)] = np.repeat([0.03, 0.2], 3) ** 2
    return scene, Belief(mean, P)


@pytest.mark.parametrize("horizon", [0.1, 0.25])
def test_flights_and_samples_agree_on_contacts(thrown, horizon):
    scene, belief = thrown
    points, samples = (
        predict(scene, belief, p, horizon)
        for p in ("sigma_points", make_propagator("monte_carlo", samples=1000, seed=5))
    )
    told, right = (contact_probabilities(p) for p in (points, samples))
    assert any(answer.probability not in (0.0, 1.0) for answer in right)
    for one, other in zip(told, right, strict=True):
        assert (one.object_a, one.object_b) == (other.object_a, other.object_b) and other.available
        assert not one.available or abs(one.probability - other.probability) < TOLERANCE
        if one.first_contact_time_available and other.first_contact_time_available:
            assert one.first_contact_time_mean == pytest.approx(other.first_contact_time_mean, abs=0.02)
    assert all(one.available for one in told if one.object_b == ENVIRONMENT)


def test_a_flight_is_the_prediction_until_it_touches_something(thrown):
    scene, belief = thrown
    scene = predict(scene, belief, "sigma_points", scene.dt).scene
    steps, count = 60, 50
    flights = first_contacts(scene, belief, steps, count, seed=7)
    whole = predict(scene, belief, make_propagator("monte_carlo", samples=count, seed=7), steps * scene.dt)
    first = whole.carry.contact_history.first_time
    own = np.minimum(first.min(axis=2), first[:, :, :2].min(axis=1))
    assert 0.1 < np.isfinite(flights.stopped).mean() < 1.0
    # of the samples' bodies that touch nothing, and meet none that was stopped
    free = np.isinf(flights.stopped) & np.isinf(own)
    np.testing.assert_array_equal(flights.states[free], whole.carry.states[free])
    # whoever touches something first does so then
    np.testing.assert_array_equal(flights.stopped.min(axis=1), own.min(axis=1))


def test_what_was_stopped_stands(thrown):
    """The other one flies on, and may touch it."""
    scene, _ = thrown
    scene = predict(scene, thrown[1], "sigma_points", scene.dt).scene
    mean = thrown[1].mean.copy()
    mean[:, :3], mean[:, 3:] = [[0.0, 0.0, 0.15], [0.0, 0.0, 0.6]], [0, 0, 0, 0, 0, 0, 1, 0, 0, 0]
    flights = first_contacts(scene, Belief.exact(mean), 240, 1)
    table, other = flights.first[0, 0, 2], flights.first[0, 0, 1]
    assert 0.0 < table < other < 0.4  # the lower one, then the upper one on it
    assert flights.stopped[0].tolist() == [table, other]
    still = first_contacts(scene, Belief.exact(mean), 60, 1)
    np.testing.assert_array_equal(flights.states[0, 0], still.states[0, 0])


def test_what_lies_on_a_table_stays_there(thrown):
    scene, belief = thrown
    lying = Belief(belief.mean, 1e-8 * np.tile(np.eye(12), (2, 1, 1)))
    prediction = predict(scene, lying, make_propagator("monte_carlo", samples=300), 3.0)
    rests = rest_probabilities(prediction)
    assert all(rest.available and rest.probability > 0.95 for rest in rests)
    on_table = BoxRegion("on the table", (0.6, 0.6, 0.4), (0, 0, 0.2))
    on_floor = BoxRegion("on the floor", (9.0, 9.0, 0.4), (0, 0, -0.5))
    near, _, other, edge = region_probabilities(prediction, [on_table, on_floor])
    assert near.object == "near" and near.probability > 0.95 and other.probability < 0.05
    assert edge.object == "edge" and edge.available
    points = predict(scene, lying, "sigma_points", 3.0)  # which can't tell what comes after a contact
    assert not any(answer.available for answer in rest_probabilities(points))
