"""Flags of energy that no law explains, gained or lost."""

from dataclasses import replace

import numpy as np
import pytest
from plain_scenes import BALL, BLOCK, independent, lowest, state

from unc_physics import Belief, PosePath, RigidBody, Scene, Status, load_model, make_propagator, predict
from unc_physics.prediction.status import assess, assess_all
from unc_physics.scene.environment import Box, Plane

BOX = load_model("salt_box").prefix(200)
TILTED = np.array((0.3, 0.2, 0.1, 0.9)) / np.linalg.norm((0.3, 0.2, 0.1, 0.9))
FLOOR = (Plane(),)


def certain(scene, *states):
    """A belief without uncertainty."""
    return Belief(np.array(states), np.zeros((len(scene.moving), 12, 12)), scene.moving)


def predicted(scene, states, horizon, times=None, name="monte_carlo", **options):
    options = options or ({"samples": 1} if name == "monte_carlo" else {})
    return predict(scene, certain(scene, *states), make_propagator(name, **options), horizon, times=times)


def with_states(prediction, change):
    """The same prediction with other states of its rollouts at the end."""
    propagator = prediction.propagator
    if propagator.traits.mean_update != "nominal" and getattr(propagator, "samples", 2) != 1:
        change(prediction.carry.states)
        return prediction
    mean = prediction.belief.mean.copy()  # that of the only rollout
    change(mean[None])
    belief = Belief(mean, prediction.belief.covariance, prediction.belief.moving)
    return replace(prediction, snapshots=(replace(prediction.at(), belief=belief),))


def says(status, measure):
    """Whether a flag is raised by a measure."""
    return bool(status.flags & Status.NOT_CONVERGED) and f"({measure} " in status.message


def resting(model=BOX, below=FLOOR, **physics):
    scene = Scene.everyday([RigidBody("a", model, 1.0)], exact=True, environment=below, **physics)
    return scene, state((0, 0, -lowest(model)))


def test_actions_may_add_energy():
    scene, x = resting()
    path = PosePath(times=[0.0, 1.0], positions=[(0, 0, 1.0), (0, 0, 1.0)])
    hand = RigidBody("hand", BALL, trajectory=path)
    scene = replace(scene, bodies=[*scene.bodies, hand])
    (status, _) = assess(predicted(scene, [x, state((0, 0, 1.0))], 0.1))
    assert "energy_error" not in status.measures


def elastic(bodies, below=FLOOR, **physics):
    return Scene.everyday(
        bodies, exact=True, environment=below, **{"friction": 0.0, "restitution": 1.0} | physics
    )


@pytest.mark.parametrize("model", [BALL, BOX], ids=["ball", "box"])
@pytest.mark.parametrize("name", ["monte_carlo", "sigma_points", "cloud"])
def test_what_bounces_elastically_loses_no_energy(model, name):
    """Whether it is at the top of its path or at the bottom."""
    scene = elastic([RigidBody("a", model, 0.3)])
    options = {"samples": 1} if name == "monte_carlo" else {}
    belief = independent(state((0, 0, 0.3), orientation=TILTED), position=0.0 if options else 0.002)
    times = np.arange(72, 480, 24) / 240
    prediction = predict(scene, belief, make_propagator(name, **options), 2.0, times=times)
    for (status,) in assess_all(prediction):
        assert status.measures["energy_error"] < 0.02
        assert name != "monte_carlo" or status.measures["energy_error"] > -0.02


def slower(factor):
    """Velocities times a factor."""

    def change(states):
        states[:, :, 3:6] *= factor
        states[:, :, 10:] *= factor

    return change


@pytest.mark.parametrize("name", ["monte_carlo", "many", "sigma_points", "cloud", "linearization"])
def test_elastic_bodies_that_are_slower_than_they_should_be_are_flagged(name):
    scene = elastic([RigidBody("a", BALL, 0.3)], below=(Box((0.1, 3.0, 3.0), (0.05, 0, 0)),), gravity=None)
    options = {"many": {"samples": 50}, "monte_carlo": {"samples": 1}}.get(name, {})
    own = "monte_carlo" if name == "many" else name
    for factor, flagged in ((1.0, False), (0.995, False), (0.985, True), (0.3, True)):
        prediction = predict(
            scene, certain(scene, state((-0.1, 0, 0), (1.0, 0.2, 0))), make_propagator(own, **options), 0.2
        )
        (status,) = assess(with_states(prediction, slower(factor)))
        assert status.measures["energy_error"] == pytest.approx(1.0 - factor**2, abs=2e-3)
        assert says(status, "energy_error") == flagged
        assert not flagged or "lost in contacts that conserve it; a smaller dt" in status.message


def test_energy_that_bodies_give_each_other_is_not_lost():
    """One that stops as it hits another one; and what none of them has any more."""
    scene = elastic([RigidBody(name, BALL, 1.0) for name in "abc"], (), gravity=None)
    states = [state((0, 0, 0), (1, 0, 0)), state((0.2, 0, 0)), state((5.0, 0, 0))]
    prediction = predicted(scene, states, 0.3)
    assert np.abs(prediction.belief.mean[0, 3:6]).max() < 1e-6, "it stopped"
    found = assess(prediction)
    assert [status.measures.get("energy_error", 1.0) < 1e-6 for status in found] == [True, True, False]
    found = assess(with_states(prediction, slower(0.9)))
    assert [says(status, "energy_error") for status in found] == [True, True, False]


def test_a_rotating_body_keeps_energy_without_the_gyroscopic_term_only_if_its_axes_are_alike():
    for model, judged in ((BALL, True), (BLOCK, False)):
        for gyroscopic in (True, False):
            scene = elastic([RigidBody("a", model, 1.0)], gyroscopic=gyroscopic)
            prediction = predicted(scene, [state((0, 0, 0.2), spin=(1, 2, 3))], 0.3)
            (status,) = assess(with_states(prediction, slower(0.3)))
            assert says(status, "energy_error") == (judged or gyroscopic)


@pytest.mark.parametrize(
    "physics",
    [
        {"restitution": 0.9},
        {"friction": 0.1},
        {"damping": 0.01},
        {"gravity_direction_std": 0.01},
        {"impact_direction_std": 0.01},
    ],
)
def test_what_a_law_takes_is_not_lost(physics):
    scene = elastic([RigidBody("a", BALL, 1.0)], **physics)
    (status,) = assess(with_states(predicted(scene, [state((0, 0, 0.1), (0.3, 0, 0))], 1.0), slower(0.9)))
    assert status.measures["energy_error"] < 1e-6


def test_what_a_partner_takes_is_not_lost():
    """A soft floor takes from what lands on it, and from what hits that, and from nothing else."""
    ball = [RigidBody(name, BALL, 1.0) for name in "abc"]
    below = (
        Box((1, 1, 0.1), (0, 0, -0.05), restitution=0.5, name="soft"),
        Box((1, 1, 0.1), (5, 0, -0.05), name="hard"),
    )
    scene = elastic(ball, below)
    states = [state((0, 0, 0.1)), state((0.01, 0, 0.25)), state((5, 0, 0.1))]
    found = assess(with_states(predicted(scene, states, 0.5), slower(0.9)))
    assert [says(status, "energy_error") for status in found] == [False, False, True]
