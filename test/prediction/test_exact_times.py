"""Times that are no multiple of the time step: answered exactly, and without a trace in later answers."""

import numpy as np
import pytest
from plain_scenes import BALL, BLOCK, independent, state

from unc_physics import (
    Belief,
    BodyBelief,
    Plane,
    PosePath,
    RigidBody,
    Scene,
    Touches,
    Wrench,
    assess,
    load_model,
    make_propagator,
    predict,
)
from unc_physics.checks.errors import InvalidHorizonError
from unc_physics.propagators.registry import PROPAGATORS
from unc_physics.scene import contact_world
from unc_physics.scene.marks import mark_at, whole

DT = 1.0 / 240.0
G = 9.81
FEW = {"monte_carlo": {"samples": 8}, "cloud": {"runs": 12, "samples": 20}, "auto": {"samples": 40}}
ON_IMPLICIT = [name for name, kind in PROPAGATORS.items() if "implicit" in kind.integrators]
on_implicit = pytest.mark.parametrize("name", ON_IMPLICIT)


def of(name, **options):
    return make_propagator(name, **(FEW.get(name, {}) | options))


def belief_of(scene, position_std=0.01, velocity_std=0.1, **states):
    """A belief from states (13,) by names."""
    mean = np.array([states[body.name] for body in scene.bodies])
    P = np.diag(np.repeat([position_std, velocity_std, 0.02, 0.1], 3) ** 2)
    return Belief(mean, np.repeat(P[None], len(scene.moving), 0), scene.moving)


def straight(speed, time, ahead=0.0):
    """A path along x that begins 0.2 m behind the origin, or less."""
    return PosePath(
        times=[0.0, time],
        positions=[[ahead - 0.2, 0, 0.03], [ahead - 0.2 + speed * time, 0, 0.03]],
        orientations=[(0, 0, 0, 1)] * 2,
        linear_velocities=[[speed, 0, 0]] * 2,
    )


# -- the answer is right -----------------------------------------------------------------------------


def test_a_push_that_ends_between_two_steps_gives_its_impulse_up_to_then():
    """A force of 2 N on 0.4 kg from 7 ms on: its impulse at a time between two steps is that of this time."""
    wrench = Wrench(force=[2.0, 0.0, 0.0], start=0.007)
    scene = Scene.everyday(
        [RigidBody("box", BLOCK, 0.4, wrenches=[wrench])],
        exact=True,
        gravity=(0, 0, 0),
        environment=[Plane(offset=-5.0)],
    )
    belief = belief_of(scene, velocity_std=1e-6, box=state())
    times = [0.0069, 0.0075, 0.0101, 0.2003]
    prediction = predict(scene, belief, "linearization", times=times)
    for t in times:
        v = prediction.body("box", time=t).linear_velocity[0]
        assert v == pytest.approx(2.0 / 0.4 * max(t - 0.007, 0.0), abs=1e-9)


@pytest.mark.parametrize("part", [3e-7, 0.4])
def test_what_rests_and_slides_goes_on_through_a_short_step(part):
    """A block at rest stays within a micrometre; a sliding one is slowed as friction says."""
    bodies = [RigidBody(name, BLOCK, 0.4) for name in ("rests", "slides")]
    scene = Scene.everyday(bodies, exact=True, environment=[Plane()], friction=0.3, restitution=0.0)
    belief = independent(state((0, 0, 0.02)), state((0, 1, 0.02), (1, 0, 0)), position=1e-6)
    steps, t = 48, (48 + part) * DT
    times = [steps * DT, t, (steps + 1) * DT]
    prediction = predict(scene, belief, of("monte_carlo"), times=times)
    before, now, after = (snapshot.belief.mean for snapshot in prediction.snapshots)
    assert np.abs(now[0, :3] - before[0, :3]).max() < 1e-6 and np.abs(now[0, 3:6]).max() < 1e-4
    v = 1.0 - 0.3 * G * t
    assert now[1, 3] == pytest.approx(v, abs=0.01)
    assert now[1, 0] - before[1, 0] == pytest.approx(part * DT * (v + 0.15 * G * part * DT), abs=1e-5)
    assert before[1, 0] < now[1, 0] < after[1, 0]


def test_a_contact_between_two_steps_counts_from_then_on():
    """A ball falls 19.9 mm, 63.7 ms: shortly before it has touched nothing, shortly after it has."""
    fall = 0.0199
    scene = Scene.everyday([RigidBody("ball", BALL, 0.2)], exact=True, environment=[Plane(name="floor")])
    belief = belief_of(scene, 1e-7, 1e-7, ball=state((0, 0, 0.05 + fall)))
    moment = np.sqrt(2.0 * fall / G)
    assert 15.2 < moment / DT < 15.4
    times = [moment - 2e-4, moment + 2e-4]
    touches = Touches("ball", "floor")
    for propagator in (of("monte_carlo"), "linearization"):
        prediction = predict(scene, belief, propagator, 0.1, times=times, events=[touches])
        shares = [prediction.probability(touches, time=t).estimate for t in times]
        assert shares == [0.0, 1.0]
    assert prediction.contact_time(touches, time=times[1]).mean == pytest.approx(moment, abs=2e-4)


# -- later answers are the same to the last bit ------------------------------------------------------

ODD = [0.01, 0.1234, 0.2 + 1e-6]
LATER = [0.25, 0.5]


def meeting(**options):
    """Bodies that fall, meet, and come to rest."""
    scene = Scene.everyday(
        [RigidBody("a", BLOCK, 0.4), RigidBody("b", BALL, 0.3), RigidBody("far", BALL, 0.3)],
        exact=True,
        environment=[Plane(name="floor")],
        **options,
    )
    return scene, belief_of(
        scene,
        a=state((0, 0, 0.1), spin=(1, 2, 0)),
        b=state((0.02, 0, 0.25)),
        far=state((3.0, 0, 0.3), (0.5, 0, 0)),
    )


def acted(**options):
    """A finger pushes a block, a wrench another; a hand takes a ball and lets it go between two steps."""
    path = straight(0.45, 1.0, 0.05)
    bodies = [
        RigidBody("pushed", BLOCK, 0.4),
        RigidBody("finger", BALL.scaled(0.2), trajectory=path),
        RigidBody("blown", BLOCK, 0.4, wrenches=[Wrench(force=[3.0, 0, 0], start=0.05, duration=0.0837)]),
        RigidBody("held", BALL, 0.1, attached_to="finger", attached_at=0.0513, released_at=0.2231),
    ]
    scene = Scene.everyday(bodies, exact=True, environment=[Plane(name="floor")], **options)
    places = state((0, 0, 0.02)), state((-0.15, 0, 0.03)), state((0, 1.0, 0.021)), state((-0.15, 0, 0.3))
    return scene, belief_of(
        scene, 0.003, 0.01, **dict(zip(("pushed", "finger", "blown", "held"), places, strict=True))
    )


def uncertain(**options):
    return meeting(friction_std=0.1, impact_direction_std=0.05, **options)


CASES = {
    "meeting": lambda: meeting(),
    "sleep": lambda: meeting(sleep=True),
    "actions": lambda: acted(),
    "uncertain": lambda: uncertain(),
}


@on_implicit
@pytest.mark.parametrize("case", CASES)
def test_later_answers_are_those_without_the_question(name, case):
    scene, belief = CASES[case]()
    propagator = of(name)
    if case == "actions" and "implicit" not in propagator.supports.actions:
        pytest.skip("takes no actions")
    if case == "uncertain" and not propagator.supports.impact_errors:
        pytest.skip("draws no impacts")
    plain = predict(scene, belief, propagator, times=LATER)
    asked = predict(scene, belief, propagator, times=sorted(ODD + LATER))
    assert asked.times == tuple(sorted(ODD + LATER))
    for time in LATER:
        one, other = plain.at(time), asked.at(time)
        np.testing.assert_array_equal(one.belief.mean, other.belief.mean)
        np.testing.assert_array_equal(one.belief.covariance, other.belief.covariance)
        np.testing.assert_array_equal(one.first_contacts, other.first_contacts)
        if one.samples is not None:
            np.testing.assert_array_equal(one.samples, other.samples)


def test_fifty_times_call_the_kernel_as_often_as_one(monkeypatch):
    """A call costs as much as dozens of steps, and two for each time would cost more than the prediction."""
    scene, belief = meeting()
    calls, own = [], contact_world.recorded
    monkeypatch.setattr(contact_world, "recorded", lambda *given: calls.append(1) or own(*given))
    numbers = []
    for times in (None, np.linspace(0.01, 0.5, 50)):
        calls.clear()
        predict(scene, belief, of("monte_carlo"), 0.5, times=times)
        numbers.append(len(calls))
    assert 0 < numbers[0] == numbers[1]


# -- what is asked for -------------------------------------------------------------------------------


def test_the_explicit_integrator_names_the_nearest_possible_time():
    scene = Scene([RigidBody("ball", BALL, 0.2)])
    belief = belief_of(scene, ball=state())
    with pytest.raises(
        InvalidHorizonError, match=r"horizon is no multiple of dt = 0.01 s.* time is 0.03 s \(got 0.031\)"
    ):
        predict(scene, belief, "sigma_points", 0.031)
    with pytest.raises(InvalidHorizonError, match=r"times\[1\] is no multiple .* time is 0.01 s"):
        predict(scene, belief, "sigma_points", 1.0, times=[0.01, 0.0149])
    assert predict(scene, belief, "sigma_points", 0.03).times == (0.03,)


def test_a_nanosecond_is_no_step():
    """Messages have whole nanoseconds: what is off by less is a multiple of the step."""
    assert mark_at(0.020833333, DT) == whole(5, DT)
    assert mark_at(0.1 + 0.2, 0.1) == whole(3, 0.1)
    assert mark_at(0.01, DT).steps == 2 and mark_at(0.01, DT).time == 0.01
    assert mark_at(5e-10, DT).steps == 0


# -- times that share a snapshot ---------------------------------------------------------------------


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
