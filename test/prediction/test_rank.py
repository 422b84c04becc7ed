"""Rankings against answers from outside: closed forms, counts of draws, and single predictions."""

import time
from dataclasses import replace

import numba
import numpy as np
import pytest
from scipy.stats import norm

from unc_physics import (
    AtRest,
    Belief,
    BodyBelief,
    Box,
    BoxRegion,
    FellOff,
    InRegion,
    Plane,
    PosePath,
    RigidBody,
    Scene,
    Touches,
    UncPhysicsError,
    Upright,
    Wrench,
    assess,
    load_model,
    make_propagator,
    predict,
    rank,
)
from unc_physics.checks.errors import CanceledError
from unc_physics.prediction.actions import apply_action
from unc_physics.prediction.rank import Candidate, rank_candidates
from unc_physics.prediction.request_checks import marks_of

TABLE, HORIZON = -0.5, 0.5
SHELF = Box((0.4, 0.2, 0.02), (0.0, 0.0, -0.01), name="shelf")
ABOVE = BoxRegion("above", (0.4, 0.2, 0.4), (0.0, 0.0, 0.2))
BOX = load_model("salt_box").prefix(20)
SCENE = Scene.everyday(
    [RigidBody("box", BOX)], exact=True, environment=[Plane(offset=TABLE, name="floor"), SHELF]
)


def held(offset, std=0.02):
    return BodyBelief(
        position=(offset, 0.0, 0.05) - BOX.origin,
        position_std=std,
        orientation_std=0.1,
        linear_velocity_std=0.1,
    )


BELIEF = Belief.of(SCENE, {"box": held(0.0)})
OFFSETS = {"far": 0.3, "middle": 0.0, "edge": 0.19}
ACTIONS = {name: {"box": held(offset)} for name, offset in OFFSETS.items()}
ON_SHELF = InRegion("box", ABOVE)


@pytest.fixture(scope="module")
def ranking():
    return rank(SCENE, BELIEF, ACTIONS, ON_SHELF, HORIZON, rollouts=100, seed=3)


def test_an_action_turns_a_body_by_angles_or_by_a_quaternion():
    turned = {"roll_pitch_yaw": (0.0, 0.0, 1.0)}, {"orientation": (0.0, 0.0, np.sin(0.5), np.cos(0.5))}
    by_angles, by_quaternion = (apply_action(SCENE, BELIEF, {"box": change})[1] for change in turned)
    np.testing.assert_allclose(by_angles.mean, by_quaternion.mean, atol=1e-15)
    assert by_angles.mean[0, 8] == pytest.approx(np.sin(0.5))
    np.testing.assert_array_equal(by_angles.covariance, BELIEF.covariance)


# bodies at uncertain places in a slab of 2 m, where nothing moves: outcomes are counts of draws
FLOATING = Scene([RigidBody("box", BOX)])
SLAB = InRegion("box", BoxRegion("slab", (2.0, 1e3, 1e3)))
STD = 0.5
PLACES = {
    # offsets, rollouts, budget; names in order, those tied, those clearly worse, rollouts in that order
    "one": ({"a": 0.9}, 70, None, "a", "", "", [70]),
    "two": ({"out": 4.0, "in": 0.2}, 70, None, "in out", "", "out", [70, 20]),
    "all equal": ({"a": 0.5, "b": 0.5, "c": 0.5}, 50, 150, "a b c", "a b c", "", [50, 50, 50]),
    "none succeeds": ({"near": 4.0, "far": 6.0}, 50, None, "near far", "near far", "", [50, 50]),
    "all succeed": ({"off": -0.2, "mid": 0.0}, 8, None, "mid off", "mid off", "", [8, 8]),
    "many": (
        {"a": 0.4, "b": 3.0, "c": 0.8, "d": -1.2, "e": 0.0, "f": -2.0},
        160,
        400,
        "e a c d b f",
        "",
        "d b f",
        [140, 140, 40, 40, 20, 20],
    ),
    "a small budget": ({"a": 1.0, "b": 0.0, "c": 3.0}, 100, 4, "a b c", "a b", "", [1, 1, 1]),
}


@pytest.mark.parametrize("case", PLACES)
def test_scores_are_counts_of_common_draws(case):
    offsets, rollouts, budget, order, tied, worse, counts = PLACES[case]
    belief = Belief.of(FLOATING, {"box": BodyBelief(position_std=(STD, 0.0, 0.0))})
    actions = {name: {"box": {"position": (x, 0.0, 0.0)}} for name, x in offsets.items()}
    found = rank(FLOATING, belief, actions, SLAB, 0.01, rollouts=rollouts, budget=budget, seed=5)
    assert [action.name for action in found] == order.split()
    assert [action.name for action in found if action.tied] == tied.split()
    assert [action.name for action in found if action.clearly_worse] == worse.split()
    assert [action.rollouts for action in found] == counts and found.rollouts == sum(counts)
    assert found.best is found.actions[0] is found[found.best.name]
    draws = belief.sample(rollouts, np.random.default_rng(5))[:, 0, 0]
    outcomes = {name: np.abs(draws + x) < 1.0 for name, x in offsets.items()}
    for action in found:
        x, p, n = offsets[action.name], action.score, action.rollouts
        depths = 1.0 - np.abs(draws[:n] + x)
        assert (p.estimate, p.method, p.rollouts) == ((depths > 0.0).mean(), "samples", n)
        assert p.low <= norm.cdf((1.0 - x) / STD) - norm.cdf((-1.0 - x) / STD) <= p.high
        if n > 1:
            assert action.margin == pytest.approx(np.clip(np.median(depths) / depths.std(), -8.0, 8.0))
        m = min(n, found.best.rollouts)
        pairs = outcomes[action.name][:m].astype(float) - outcomes[found.best.name][:m]
        assert action.difference.value == pairs.mean() and action.difference.draws == m
        assert (action.difference.std == 0.0) == (action is found.best)
    opposite = rank(FLOATING, belief, actions, ~SLAB, 0.01, rollouts=rollouts, budget=rollouts * len(actions))
    if worse:
        assert opposite.best.name in worse.split()


def test_the_example_of_a_shelf(ranking):
    assert [action.name for action in ranking] == ["middle", "edge", "far"]
    best, edge, far = ranking
    assert best.score.estimate > 0.7 > edge.score.estimate > 0.1 and far.score.estimate == 0.0
    assert far.clearly_worse and far.rollouts == 20 and best.rollouts == 100 and ranking.rollouts <= 200
    with pytest.raises(UncPhysicsError, match="name is no action's name; did you mean 'middle'"):
        ranking["midle"]
    contacts = rank(SCENE, BELIEF, ACTIONS, Touches("box", "shelf"), 0.05, rollouts=20)
    assert contacts.best.margin is None


def test_a_ranking_depends_on_nothing_but_its_seed(ranking):
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        again = rank(SCENE, BELIEF, ACTIONS, ON_SHELF, HORIZON, rollouts=100, seed=3)
    finally:
        numba.set_num_threads(threads)
    told = []
    within_time = rank(
        SCENE,
        BELIEF,
        ACTIONS,
        ON_SHELF,
        times=[0.2, HORIZON],
        rollouts=100,
        seed=3,
        max_computation_time=600.0,
        progress=lambda done, budget: told.append((done, budget)),
    )
    for one in (again, within_time):
        for got, expected in zip(one, ranking, strict=True):
            np.testing.assert_array_equal(got.prediction.samples(), expected.prediction.samples())
            assert (got.name, got.score) == (expected.name, expected.score)
    assert within_time.best.prediction.times == pytest.approx((0.2, HORIZON), abs=SCENE.dt)
    assert told[-1] == (within_time.rollouts, 200) and told[0] == (0, 200)
    assert sorted({done for done, _ in told}) == [0, 60, 100, within_time.rollouts][: len({*told})]


def other_scenes():
    """Actions of every kind, with other bodies, paths, wrenches, materials and steps: (scene, belief)."""
    mean = BELIEF.mean.copy()
    mean[0, :3] = held(0.19).position
    moved = Belief(mean, BELIEF.covariance)
    smooth = replace(SCENE, environment=[SCENE.environment[0], replace(SHELF, friction=0.0)])
    (box,) = SCENE.bodies
    pusher = RigidBody(
        "pusher", BOX, trajectory=PosePath(times=[0.0, 1.0], positions=[(-0.3, 0.0, 0.1), (0.3, 0.0, 0.1)])
    )
    two = replace(SCENE, bodies=[box, RigidBody("other", BOX), pusher])
    about_two = Belief.of(two, {"box": held(0.1), "other": held(-0.1)})
    pushed = replace(SCENE, bodies=[replace(box, wrenches=[Wrench(force=(3.0, 0.0, 0.0), duration=0.2)])])
    vague = replace(SCENE, environment=[SCENE.environment[0], replace(SHELF, friction=0.3, friction_std=0.2)])
    fine = replace(SCENE, dt=0.5 * SCENE.dt)
    return {
        "belief": (moved, (SCENE, moved)),
        "pair": ((SCENE, moved), (SCENE, moved)),
        "function": (lambda scene, belief: (scene, moved), (SCENE, moved)),
        "fields": ({"box": {"position": held(0.19).position}}, (SCENE, moved)),
        "whole": ({"box": held(0.19)}, (SCENE, moved)),
        "of the shelf": (
            {"shelf": {"friction": 0.0}, "box": {"position": held(0.19).position}},
            (smooth, moved),
        ),
        "other bodies": ((two, about_two), (two, about_two)),
        "a wrench": ({"box": {"wrenches": [Wrench(force=(3.0, 0.0, 0.0), duration=0.2)]}}, (pushed, BELIEF)),
        "uncertain friction": ({"shelf": {"friction": 0.3, "friction_std": 0.2}}, (vague, BELIEF)),
        "smaller steps": ((fine, BELIEF), (fine, BELIEF)),
    }


def test_an_executor_changes_no_bit(ranking):
    found = rank(SCENE, BELIEF, ACTIONS, ON_SHELF, HORIZON, rollouts=100, seed=3, executor="processes:2")
    assert found.to_dict() == ranking.to_dict()
    for one, other in zip(found, ranking, strict=True):
        np.testing.assert_array_equal(one.prediction.samples(), other.prediction.samples())


def test_each_answer_is_that_of_predict():
    """To the last bit, for all kinds of actions together: rollouts come in rounds, and do not interact."""
    cases = other_scenes()
    actions = {name: action for name, (action, _) in cases.items()}
    found = rank(SCENE, BELIEF, actions, ON_SHELF, 0.25, rollouts=48, budget=48 * len(actions), seed=3)
    assert len(found) == len(actions) and {action.rollouts for action in found} >= {48}
    for action in found:
        propagator = make_propagator("monte_carlo", samples=action.rollouts, seed=3)
        expected, got = predict(*cases[action.name][1], propagator, 0.25), action.prediction
        np.testing.assert_array_equal(got.samples(), expected.samples())
        np.testing.assert_array_equal(got.belief.covariance, expected.belief.covariance)
        np.testing.assert_array_equal(got.start.mean, expected.start.mean)
        assert assess(got) == assess(expected)
        for event in (
            ON_SHELF,
            ~Upright("box"),
            FellOff("box") | AtRest("box"),
            Touches("box", "floor") & ~ON_SHELF,
        ):
            assert got.probability(event) == expected.probability(event)
        assert action.score == expected.probability(ON_SHELF)


def test_actions_change_what_they_name_and_nothing_else():
    changes = {"box": {"friction": 2.0, "position_std": 0.0}}
    (action,) = rank(SCENE, BELIEF, {"a": changes}, ON_SHELF, 0.05, rollouts=4)
    body = action.prediction
    assert body.scene.bodies[0].friction == 2.0
    P = body.initial.covariance[0]
    assert not P[:3].any() and np.array_equal(P[3:, 3:], BELIEF.covariance[0, 3:, 3:])


def test_candidates_that_fail_leave_the_others():
    """Before the first round (no such body), and in it (beyond all numbers)."""
    fast = Belief.of(SCENE, {"box": BodyBelief(linear_velocity=(1e200, 0.0, 0.0))})
    cup = replace(SCENE, bodies=[replace(SCENE.bodies[0], name="cup")])
    good = {name: Belief.of(SCENE, {"box": held(offset)}) for name, offset in OFFSETS.items()}
    marks = marks_of(SCENE, 0.2, None)
    well = {name: Candidate(SCENE, belief, marks) for name, belief in good.items()}
    bad = {"fast": Candidate(SCENE, fast, marks), "cup": Candidate(cup, BELIEF, marks)}
    propagator, errors = make_propagator("monte_carlo", samples=40), {}
    with np.errstate(all="ignore"):
        found = rank_candidates(bad | well, propagator, ON_SHELF, errors.setdefault)
        assert {k: error.field for k, error in errors.items()} == {
            "fast": "prediction",
            "cup": "score.object",
        }
        alone = rank_candidates(well, propagator, ON_SHELF, None, budget=found.rollouts)
        none = rank_candidates(bad, propagator, ON_SHELF, lambda *_: None)
    assert [action.name for action in found] == [action.name for action in alone]
    for one, other in zip(found, alone, strict=True):
        count = min(one.rollouts, other.rollouts)
        assert np.array_equal(one.prediction.samples()[:count], other.prediction.samples()[:count])
    assert len(none) == 0


BAD = {
    "no actions": ({"actions": {}}, "actions must have at least one action"),
    "no such body": (
        {"actions": {"a": {"bx": held(0.0)}}},
        r"actions\['a'\] is neither a body .*mean 'box'.*bx",
    ),
    "no such field": (
        {"actions": {"a": {"box": {"mas": 1.0}}}},
        r"actions\['a'\]: 'box' has no field.*'mass'",
    ),
    "a bad value": (
        {"actions": {"a": {"box": {"mass": -1.0}}}},
        r"actions\['a'\]: mass of body 'box' must.*-1",
    ),
    "a bad std": (
        {"actions": {"a": {"box": {"position_std": -1.0}}}},
        r"\['a'\]: 'box'.position_std must not",
    ),
    "no action": ({"actions": {"a": 3}}, r"actions\['a'\] must be a Belief, a Scene and .*\(got 3\)"),
    "returns nothing": (
        {"actions": {"a": lambda *_: None}},
        r"actions\['a'\] must return a Scene and a Belief",
    ),
    "no score": ({"score": "upright"}, "score must be an Event, not a str"),
    "a stranger": ({"score": Upright("cup")}, "score.object names no body of the scene; there is box.*cup"),
    "an argument of version 0.2": (
        {"smallest_first": True},
        "smallest_first was removed in version 0.3: negate the score",
    ),
    "no rollouts": ({"rollouts": 0}, "rollouts must be at least 1"),
    "a small budget": ({"budget": 2}, "budget must be at least one rollout for each of 3 actions.*got 2"),
    "no horizon": ({"horizon": -1.0}, r"actions\['far'\]: horizon must be positive"),
    "not finite": (
        {"actions": {"a": {"box": {"linear_velocity": (1e200, 0.0, 0.0)}}}},
        r"actions\['a'\]: prediction diverged",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_told_in_a_sentence(case):
    arguments = {"actions": ACTIONS, "score": ON_SHELF, "horizon": 0.05, "rollouts": 16} | BAD[case][0]
    with pytest.raises(UncPhysicsError, match=BAD[case][1]):
        rank(SCENE, BELIEF, **arguments)


def test_the_time_runs_out(monkeypatch):
    with pytest.raises(UncPhysicsError, match=r"max_computation_time ran out in the first round") as caught:
        rank(SCENE, BELIEF, ACTIONS, ON_SHELF, 5.0, max_computation_time=1e-3)
    assert caught.value.prediction is None
    now, limit = [0.0], 1e3
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])

    def pass_time(done, _):
        now[0] += limit if done else 0.0

    with pytest.raises(UncPhysicsError, match="ran out after 60 rollouts of 2000") as caught:
        rank(SCENE, BELIEF, ACTIONS, ON_SHELF, HORIZON, max_computation_time=limit, progress=pass_time)
    assert caught.value.prediction.best.name == "middle" and caught.value.prediction.rollouts == 60

    told = []

    def cancel(done, _):
        told.append(done)
        if told.count(60) == 2:  # within the second round: no action failed
            raise CanceledError("is closing", field="the node")

    with pytest.raises(CanceledError, match="^the node is closing$") as caught:
        rank(SCENE, BELIEF, ACTIONS, ON_SHELF, 0.1, progress=cancel)
    assert caught.value.prediction.rollouts == 60
