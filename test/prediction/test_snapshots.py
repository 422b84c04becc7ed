"""What is said of an earlier time is what a prediction that ends there says."""

from dataclasses import replace

import numpy as np
import pytest

from unc_physics import (
    PROPAGATORS,
    AtRest,
    Belief,
    BodyBelief,
    FellOff,
    Plane,
    RigidBody,
    Scene,
    Touches,
    UncPhysicsError,
    Upright,
    assess,
    assess_all,
    load_model,
    make_propagator,
    predict,
)
from unc_physics.propagators.base import Samples

TIMES = (0.05, 0.2, 0.3)  # of a fall: before contact, at contact, later [s]
#: Options that make answers short; those of `auto` keep one number of rollouts for all horizons.
OPTIONS = {"monte_carlo": {"samples": 40}, "cloud": {"samples": 100}, "auto": {"samples": 100, "runs": 16}}


EVENTS = AtRest("left"), Upright("right") & ~FellOff("left"), ~Touches("left", "right") | AtRest("right")


def propagator(name):
    return make_propagator(name, **OPTIONS.get(name, {}))


def scene_and_belief(integrator):
    """A box that drops on a table beside another one, fast enough to bounce."""
    box = load_model("salt_box").prefix(30)
    bodies = [RigidBody("left", box), RigidBody("right", box)]
    physics = {"environment": [Plane()], "gravity": (0.0, 0.0, -9.81)}
    if integrator == "implicit":
        scene = Scene.everyday(bodies, exact=True, **physics)
    else:
        scene = Scene(bodies, **physics)
    places = {"left": (0.0, 0.0, 0.2), "right": (0.3, 0.05, 0.35)}
    known = {
        name: BodyBelief(
            position=place,
            orientation=(0.1, 0.2, 0.0, 0.95**0.5),
            linear_velocity=(0.5, 0.0, -0.5),
            position_std=0.01,
            orientation_std=0.05,
        )
        for name, place in places.items()
    }
    return scene, Belief.of(scene, known)


@pytest.fixture(scope="module", params=["explicit", "implicit"])
def predicted(request):
    """By each propagator: a prediction at all times, and those that end at each."""
    scene, belief = scene_and_belief(request.param)
    found = {}
    for name, kind in PROPAGATORS.items():
        if scene.integrator in kind.integrators:
            whole = predict(scene, belief, propagator(name), times=TIMES)
            found[name] = (
                whole,
                [predict(scene, belief, propagator(name), times=TIMES[: k + 1]) for k in range(len(TIMES))],
            )
    return found


def test_an_earlier_time_is_answered_as_by_a_prediction_that_ends_there(predicted):
    """Times that share a surface have the same rollouts alone."""
    for whole, ends in predicted.values():
        count = None if isinstance(whole.propagator, Samples) else 10
        for k, (statuses, end) in enumerate(zip(assess_all(whole), ends, strict=True)):
            assert statuses == assess(whole[: k + 1])
            if shares(whole):
                np.testing.assert_array_equal(whole.at(end.time).rollout_states, end.at().rollout_states)
                continue
            assert statuses == assess(end)
            np.testing.assert_array_equal(whole.samples(count, time=end.time), end.samples(count))
            for event in EVENTS:
                assert whole.probability(event, time=end.time) == end.probability(event)
            for body in ("left", "right"):
                modes = whole.body(body, time=end.time).modes
                for one, other in zip(modes, end[body].modes, strict=True):
                    for part, expected in zip(one, other, strict=True):
                        np.testing.assert_array_equal(part, expected)
        assert "energy_error" in statuses[0].measures, "the case must have contacts"


def shares(prediction):
    """Whether times share a surface, which another time then has no part in."""
    return isinstance(prediction.propagator, Samples) and prediction.propagator.resamples


def test_slices_are_predictions(predicted):
    whole, _ = predicted["linearization"]
    part = whole[1:]
    assert part.times == whole.times[1:] and part.beliefs == whole.beliefs[1:] and part.time == whole.time
    assert whole[:1].belief is whole.beliefs[0] and part.start is whole.start
    assert replace(whole, snapshots=whole.snapshots[::2]).times == whole.times[::2]
    assert whole.at(TIMES[1]) is whole.snapshots[1] and whole.at() is whole.snapshots[-1]
    with pytest.raises(UncPhysicsError, match="is no time of the prediction"):
        whole.at(0.1)


def test_times_at_which_all_sleep_share_what_is_computed():
    """Each has the answer of a prediction that ends there."""
    box = RigidBody("box", load_model("salt_box"), at_rest=True)
    scene = Scene.everyday([box], environment=[Plane(name="table")], sleep=True)
    start = BodyBelief(position=(0, 0, 0.061), position_std=0.003, orientation_std=0.02)
    belief = Belief.of(scene, {"box": start})
    prediction = predict(scene, belief, "cloud", 2.0, times=[0.5, 1.0])
    early, _, last = prediction.snapshots
    assert early.time == 0.5 and last.time == 2.0
    assert early.belief is last.belief
    alone = predict(scene, belief, "cloud", 0.5)
    np.testing.assert_array_equal(early.belief.mean, alone.belief.mean)
    np.testing.assert_array_equal(early.belief.covariance, alone.belief.covariance)
    assert prediction.at(0.5).at_model_origins(scene) is last.at_model_origins(scene)
    assert prediction.at(0.5).samples is last.samples
    assert [status.flags for status in assess(alone)] == [status.flags for status in assess(prediction)]
