"""Release poses over a bin, ranked by the probability that a box ends inside."""

import time
from dataclasses import replace

import numba
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics import (
    AtRest,
    Belief,
    BodyBelief,
    Box,
    BoxRegion,
    Capsule,
    Cylinder,
    FellOff,
    InRegion,
    Plane,
    RigidBody,
    Scene,
    Sphere,
    Touches,
    UncPhysicsError,
    Upright,
    assess,
    load_model,
    make_propagator,
    predict,
    rank,
)
from unc_physics.prediction.events import RolloutOutcomes

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


def test_the_best_comes_first_and_losers_get_few_rollouts(ranking):
    assert [action.name for action in ranking] == ["middle", "edge", "far"]
    best, edge, far = ranking
    assert ranking.best is best is ranking["middle"] and best.difference == (0.0, 0.0, best.rollouts)
    assert best.score.estimate > 0.7 > edge.score.estimate > 0.1 and far.score.estimate == 0.0
    assert far.clearly_worse and far.rollouts == 20 and best.rollouts == 100 and not best.clearly_worse
    assert ranking.rollouts <= 200
    for action in ranking:
        score = action.score
        assert 0.0 <= score.low <= score.estimate <= score.high <= 1.0 and score.high > score.low
        assert (score.method, score.rollouts) == ("samples", action.rollouts)
        assert action.difference.value <= 0.0


def test_each_answer_is_that_of_predict(ranking):
    """To the last bit: rollouts do not know that they share a batch, or come in rounds."""
    for action in ranking:
        alone = Belief.of(SCENE, {"box": held(OFFSETS[action.name])})
        propagator = make_propagator("monte_carlo", samples=action.rollouts, seed=3)
        expected = predict(SCENE, alone, propagator, HORIZON)
        got = action.prediction
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
    assert told[-1] == (within_time.rollouts, 200) and told[0][1] == 200


def test_ties_are_in_order_of_their_margins():
    """Each of three places is as good as certain; the one in the middle is the farthest from the edges."""
    offsets = {"right": 0.14, "left": -0.12, "middle": 0.0}
    actions = {name: {"box": held(offset, std=0.015)} for name, offset in offsets.items()}
    found = rank(SCENE, BELIEF, actions, ON_SHELF, 0.05, rollouts=40)
    assert [action.name for action in found] == ["middle", "left", "right"]
    assert all(action.tied and action.score.estimate == 1.0 for action in found)
    for action in found:
        depths = ABOVE.depths(action.prediction.samples()[:, 0, :3])
        assert action.margin == pytest.approx(min(np.median(depths) / depths.std(), 8.0))
    worst = rank(SCENE, BELIEF, actions, ~ON_SHELF, 0.05, rollouts=40, smallest_first=True)
    assert [action.margin for action in worst] == pytest.approx([action.margin for action in found])
    assert rank(SCENE, BELIEF, actions, Touches("box", "shelf"), 0.05, rollouts=20).best.margin is None


def test_there_is_no_margin_where_contacts_decide():
    """The box is never above the far region, but touches the shelf: a margin would be negative."""
    far = InRegion("box", BoxRegion("far", (0.1, 0.1, 0.1), (5.0, 0.0, 0.0)))
    actions = {"held": {"box": held(0.0)}}
    for score, estimate, has_margin in (
        (far | Touches("box", "shelf"), 1.0, False),
        (~(far & Touches("box", "shelf")), 1.0, True),
        (~far & ~Touches("box", "shelf"), 0.0, False),
        (far & Touches("box", "shelf"), 0.0, True),
    ):
        (found,) = rank(SCENE, BELIEF, actions, score, HORIZON, rollouts=20)
        assert found.score.estimate == estimate and (found.margin is not None) == has_margin
        if has_margin:
            assert (found.margin > 0.0) == (estimate == 1.0)


def test_actions_may_be_given_in_many_ways():
    """As another belief, scene and belief, a function, or fields; also of what is not a belief."""
    mean = BELIEF.mean.copy()
    mean[0, :3] = held(0.19).position
    moved = Belief(mean, BELIEF.covariance)
    smooth = replace(SCENE, environment=[SCENE.environment[0], replace(SHELF, friction=0.0)])
    actions = {
        "belief": moved,
        "pair": (SCENE, moved),
        "function": lambda scene, belief: (scene, moved),
        "fields": {"box": {"position": held(0.19).position}},
        "whole": {"box": held(0.19)},
        "of the shelf": {"shelf": {"friction": 0.0}, "box": {"position": held(0.19).position}},
        "of the body": {"box": {"friction": 2.0, "position_std": 0.0}},
    }
    ranking = rank(SCENE, BELIEF, actions, ON_SHELF, 0.1, rollouts=16, budget=16 * len(actions))
    one = ranking["belief"].prediction.samples()
    for name in ("pair", "function", "fields", "whole"):
        np.testing.assert_array_equal(ranking[name].prediction.samples(), one)
    expected = predict(smooth, moved, make_propagator("monte_carlo", samples=16), 0.1)
    np.testing.assert_array_equal(ranking["of the shelf"].prediction.samples(), expected.samples())
    body = ranking["of the body"].prediction
    assert body.scene.bodies[0].friction == 2.0
    P = body.initial.covariance[0]
    assert not P[:3].any() and np.array_equal(P[3:, 3:], BELIEF.covariance[0, 3:, 3:])


def test_smallest_first_and_combined_events(ranking):
    fell = rank(SCENE, BELIEF, ACTIONS, ~ON_SHELF, HORIZON, rollouts=100, seed=3, smallest_first=True)
    assert [action.name for action in fell] == [action.name for action in ranking]
    for one, other in zip(fell, ranking, strict=True):
        assert one.score.estimate == pytest.approx(1.0 - other.score.estimate)
        assert one.difference.value == pytest.approx(-other.difference.value)
    both = ON_SHELF & ~Touches("box", "floor")
    edge = ranking["edge"]
    assert str(both) == "box in above and not box touches floor"
    assert edge.prediction.probability(both).estimate <= edge.score.estimate
    assert edge.prediction.probability(Touches("box", "environment")).estimate == 1.0


def test_events_are_what_they_say():
    rng = np.random.default_rng(0)
    states = np.zeros((200, 1, 13))
    states[:, 0, :3] = rng.uniform(-1.0, 1.0, (200, 3))
    turns = Rotation.random(200, rng)
    states[:, 0, 6:10] = turns.as_quat()
    start = BELIEF.mean.copy()
    held_turn = Rotation.from_euler("xyz", [0.4, -0.3, 1.0])
    start[0, 6:10], start[0, 2] = held_turn.as_quat(), 0.5
    outcomes = RolloutOutcomes(SCENE, start, states, np.full((200, 1, 3), np.inf))

    def lean(axis):
        return np.degrees(np.arccos(np.clip(turns.apply(axis)[:, 2], -1.0, 1.0)))

    np.testing.assert_array_equal(
        Upright("box").happened(outcomes), lean(held_turn.inv().apply([0.0, 0.0, 1.0])) < 45.0
    )
    on_its_side = Upright("box", axis=(2.0, 0.0, 0.0), angle=np.radians(20.0)).happened(outcomes)
    np.testing.assert_array_equal(on_its_side, lean([1.0, 0.0, 0.0]) < 20.0)
    height = states[:, 0, 2]
    np.testing.assert_array_equal(FellOff("box").happened(outcomes), height < 0.5 - BOX.bounding_radius)
    np.testing.assert_array_equal(FellOff("box", drop=0.1).happened(outcomes), height < 0.4)
    np.testing.assert_array_equal(FellOff("box", "shelf").happened(outcomes), height < 0.0)
    np.testing.assert_array_equal(FellOff("box", "floor").happened(outcomes), height < TABLE)
    tilted = Box((0.4, 0.2, 0.02), (0.0, 0.0, 0.1), (0.0, np.sin(0.25), 0.0, np.cos(0.25)), name="ramp")
    post = RigidBody("post", load_model("can").prefix(20), fixed=True)
    scene = replace(SCENE, bodies=[*SCENE.bodies, post], environment=[tilted])
    states = np.concatenate([states, np.tile(np.eye(13)[9], (200, 1, 1))], axis=1)
    outcomes = RolloutOutcomes(scene, start, states, np.full((200, 2, 3), np.inf))
    top = 0.1 + 0.2 * np.sin(0.5) + 0.01 * np.cos(0.5)
    np.testing.assert_array_equal(FellOff("box", "ramp").happened(outcomes), height < top)
    top = (post.model.centers[:, 2] + post.model.radii).max()
    np.testing.assert_array_equal(FellOff("box", "post").happened(outcomes), height < top)


@pytest.mark.parametrize(
    ("support", "top"),
    [
        (Cylinder(0.1, 1.0, (0.0, 0.0, 0.1), (0.5, 0.5, 0.5, 0.5)), 0.2),
        # lying along x, and turned by 45 degrees about its own axis
        (
            Cylinder(
                0.1,
                1.0,
                (0.0, 0.0, 0.1),
                tuple((Rotation.from_euler("y", 90, True) * Rotation.from_euler("z", 45, True)).as_quat()),
            ),
            0.2,
        ),
        (
            Capsule(0.1, 0.5, (0.0, 0.0, 0.0), tuple(Rotation.from_euler("y", 45, True).as_quat())),
            0.1 + 0.25 * np.sqrt(0.5),
        ),
        (Sphere(0.1, (0.0, 0.0, 0.3)), 0.4),
    ],
)
def test_the_top_of_a_round_support_is_its_highest_point(support, top):
    scene = replace(SCENE, environment=[replace(support, name="support")])
    states = np.zeros((2, 1, 13))
    states[:, 0, 2], states[..., 9] = (top - 1e-5, top + 1e-5), 1.0
    outcomes = RolloutOutcomes(scene, BELIEF.mean, states)
    assert FellOff("box", "support").happened(outcomes).tolist() == [True, False]


BAD = {
    "no actions": ({"actions": {}}, "actions must name at least one action"),
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
    "touches nothing": ({"score": Touches("box", "wall")}, "score.other is neither .*wall"),
    "touches itself": ({"score": Touches("box", "box")}, "score.other must be another one"),
    "off a stranger": (
        {"score": ~FellOff("box", "shelve")},
        "score.support is neither.*did you mean 'shelf'",
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


def test_events_refuse_what_they_cannot_be():
    for make, words in (
        (lambda: Upright("box", angle=0.0), "angle must be positive"),
        (lambda: Upright("box", axis=(0.0, 0.0, 0.0)), "axis must have a direction"),
        (lambda: FellOff("box", "shelf", drop=1.0), "drop must not be given beside support"),
        (lambda: AtRest("box", speed=-1.0), "speed must be positive"),
        (lambda: InRegion("box", "above"), "region must be a BoxRegion, not a str"),
        (lambda: ON_SHELF & True, "must be an Event, not a bool"),
    ):
        with pytest.raises(UncPhysicsError, match=words):
            make()
    slope = replace(SCENE, environment=[Plane(normal=(1.0, 0.0, 1.0), name="slope")])
    with pytest.raises(UncPhysicsError, match="support is a plane that is not level"):
        rank(slope, BELIEF, ACTIONS, FellOff("box", "slope"), 0.05)


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


@pytest.mark.parametrize("combine", [lambda a, b: a and b, lambda a, b: a or b, lambda a, b: not a])
def test_events_are_not_combined_by_words(combine):
    with pytest.raises(TypeError, match="combine events by &"):
        combine(Upright("box"), Touches("box", "floor"))
