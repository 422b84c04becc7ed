"""What rollouts do not depend on, what they remember, and what is drawn for each of them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from everyday_worlds import belief_of, solid_ball, solid_box, world
from plain_scenes import FLOOR, G, independent, state

from unc_physics import (
    Belief,
    BodyBelief,
    Box,
    PosePath,
    RigidBody,
    Scene,
    load_model,
    make_propagator,
    predict,
    primitive_model,
)
from unc_physics.checks.errors import DivergedError, NotSupportedError
from unc_physics.physics import contact_history as histories
from unc_physics.physics.everyday import rollouts
from unc_physics.physics.everyday.columns import BODY_A, BODY_B, CONTACTS, SEARCHES


def carry_after(scene, belief, propagator, steps):
    """Return the carry after a number of steps."""
    return propagator.advance(propagator.init(scene, belief), scene, steps)


@pytest.fixture(scope="module")
def pile():
    names = ("mug", "can", "salt_box")
    scene = Scene.everyday(
        [RigidBody(name, load_model(name), mass_std=0.01) for name in names],
        environment=[FLOOR, Box((0.1, 1.0, 0.3), position=(0.12, 0.0, 0.15))],
    )
    states = {
        name: {"position": (0.01 * k, 0.0, 0.1 + 0.13 * k), "position_std": 0.003, "orientation_std": 0.1}
        for k, name in enumerate(names)
    }
    return scene, belief_of(scene, **states)


def test_a_shorter_last_step_leaves_the_rollouts_as_they_are(pile):
    scene, belief = pile
    propagator = make_propagator("monte_carlo", samples=3)
    p = predict(scene, belief, propagator, times=[0.3011, 0.5])
    q = predict(scene, belief, propagator, 0.5)
    assert np.array_equal(p.samples(time=0.5), q.samples())


def test_rollouts_depend_neither_on_order_nor_number(pile):
    scene, belief = pile
    propagator = make_propagator("monte_carlo", samples=8)
    carry = carry_after(scene, belief, propagator, 120)
    few = carry_after(scene, belief, make_propagator("monte_carlo", samples=3), 120)
    assert np.array_equal(few.states, carry.states[:3]) and np.ptp(carry.states, axis=0).max() > 0.01
    first = propagator.init(scene, belief)
    order = np.array([5, 2, 7, 0, 1, 6, 4, 3])
    mixed = first._replace(
        states=first.states[order],
        parameters=first.parameters[order],
        contact_history=histories.samples(first.contact_history, order),
    )
    mixed = propagator.advance(mixed, scene, 120)
    assert np.array_equal(mixed.states, carry.states[order])


def counted(monkeypatch):
    """Return a list to which each call of the kernel adds what it counts."""
    counts, kernel = [], rollouts.advance

    def count(*arguments):
        answer = kernel(*arguments)
        counts.append(arguments[-1])
        return answer

    monkeypatch.setattr(rollouts, "advance", count)
    return counts


def test_more_contacts_than_there_is_room_for_change_nothing_and_repeat_one_rollout(pile, monkeypatch):
    scene, belief = pile
    propagator = make_propagator("monte_carlo", samples=8)
    carry = carry_after(scene, belief, propagator, 120)
    begin, counts = propagator.init(scene, belief), counted(monkeypatch)
    propagator.advance(begin, scene, 120)
    once = sum(counts)[CONTACTS]
    counts.clear()
    monkeypatch.setattr(rollouts, "FIRST_ROOM", 0)
    few = propagator.advance(begin, scene, 120)
    assert np.array_equal(few.states, carry.states)
    solver, other = few.contact_history.solver, carry.contact_history.solver
    assert np.array_equal(solver.count, other.count) and solver.count.max() > 8
    most = solver.count.max()
    assert np.array_equal(solver.contact[:, :most], other.contact[:, :most])
    assert len(counts) > 1 and sum(counts)[CONTACTS] < 1.5 * once


def test_long_steps_of_a_fast_pile_search_little_more_than_short_ones(monkeypatch):
    names, searches = ("plate", "bowl", "mug", "can", "bottle"), {}
    for rate in (60, 120):
        scene = world(*(RigidBody(name, load_model(name)) for name in names), dt=1 / rate)
        states = {name: {"position": (0.01 * k, 0.0, 1.0 + 0.15 * k)} for k, name in enumerate(names)}
        counts = counted(monkeypatch)
        predict(scene, belief_of(scene, **states), make_propagator("monte_carlo", samples=1), 0.8)
        searches[rate] = sum(counts)[SEARCHES]
        monkeypatch.undo()
    assert 0 < searches[60] < 2.0 * searches[120]


# -- contacts ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("sleep", [False, True])
def test_contacts_can_be_read_and_carry_the_weight(sleep):
    scene = world(RigidBody("box", load_model("salt_box")), sleep=sleep)
    belief = belief_of(scene, box={"position": (0.0, 0.0, 0.061)})
    p = predict(scene, belief, make_propagator("monte_carlo", samples=2), times=[0.01, 0.25])
    found = p.contacts()
    assert found["rollout"].tolist() == [0] * 4 + [1] * 4
    np.testing.assert_allclose(found["normal"], np.tile([0.0, 0.0, 1.0], (8, 1)), atol=1e-6)
    assert set(found["first"]) == {1} and set(found["second"]) == {0}
    np.testing.assert_allclose(abs(found["point"]), np.tile([0.039, 0.023, 0.0], (8, 1)), atol=1e-4)
    assert (abs(found["gap"]) < 5e-5).all()
    weight = [0.0, 0.0, scene.bodies[0].mass * G * scene.dt]
    np.testing.assert_allclose(found["impulse"][:4].sum(axis=0), weight, atol=1e-6)


def test_contacts_of_a_shorter_last_step_have_its_impulse_and_its_things():
    low, high = (Box((1, 1, 0.1), (x, 0, -0.05), name=f"at {x}") for x in (-0.51, 0.51))
    bodies = [RigidBody(name, load_model("salt_box")) for name in ("a", "b")]
    scene = world(*bodies, environment=[low, high])
    belief = belief_of(scene, a={"position": (0.0, 0.0, 0.061)}, b={"position": (0.0, 0.0, 0.183)})
    p = predict(scene, belief, make_propagator("monte_carlo", samples=1), 0.251)
    found = p.contacts()
    assert set(zip(found["first"], found["second"], strict=True)) == {(0, 1), (2, 0), (3, 0)}
    rest, m = 0.251 - 60 * scene.dt, scene.bodies[0].mass
    for ground, weight in ((found["second"] == 0, 2.0), (found["second"] == 1, 1.0)):
        np.testing.assert_allclose(found["impulse"][ground].sum(axis=0)[2], weight * m * G * rest, rtol=1e-3)


def test_what_rests_slides_with_less_friction_and_falls_when_it_is_lifted():
    angle, half = 0.2, 0.061
    slope = world(
        solid_box("box", (0.078, 0.046, 2.0 * half), 0.52),
        gravity=(G * math.sin(angle), 0.0, -G * math.cos(angle)),
    )
    propagator = make_propagator("monte_carlo", samples=1)
    rested = carry_after(slope, belief_of(slope, box={"position": (0.0, 0.0, half)}), propagator, 240)
    assert (rested.states[0, 0, 3:6] == 0.0).all()
    slid = propagator.advance(rested, replace(slope, friction=0.05), 240)
    way = 0.5 * G * (math.sin(angle) - 0.05 * math.cos(angle))
    assert slid.states[0, 0, 0] == pytest.approx(way, rel=1e-3)

    lifted = rested.states + np.eye(1, 13, 2) * 1e-6
    histories_ = histories.moved(rested.contact_history)
    fell = propagator.advance(rested._replace(states=lifted, contact_history=histories_), slope, 2)
    assert fell.states[0, 0, 2] < half - 1e-7


def test_contacts_of_the_explicit_step_are_no_data():
    scene = Scene([RigidBody("box", load_model("salt_box"))])
    belief = belief_of(scene, box={"position": (0.0, 0.0, 0.2)})
    with pytest.raises(NotSupportedError, match="no contacts as data"):
        predict(scene, belief, make_propagator("monte_carlo", samples=1), 0.01).contacts()


def test_the_memory_of_fewer_and_more_bodies():
    """As a tracker has them: contacts are found again, times of first contact and rest stay."""
    box = solid_box("box", (0.1, 0.1, 0.04), 0.5).model
    scene = world(*(RigidBody(name, box, 0.5) for name in ("lower", "upper", "beside")))
    belief = independent(*(state(p) for p in ((0, 0, 0.02), (0, 0, 0.06), (1, 0, 0.02))), position=1e-5)
    old = carry_after(scene, belief, make_propagator("monte_carlo", samples=2), 30).contact_history
    assert (old.first_time[:, [0, 0, 2], [1, 3, 3]] < 0.1).all() and (old.solver.quiet > 0.05).all()
    kept = histories.of_bodies(old, np.array([1, 2]))
    np.testing.assert_array_equal(kept.first_time[:, 1, 2], old.first_time[:, 2, 3])
    assert np.isinf(kept.first_time[:, 0]).all() and not kept.solver.count.any()
    np.testing.assert_array_equal(kept.solver.quiet, old.solver.quiet[:, 1:])
    new = histories.with_another_body(old)
    assert np.isinf(new.first_time[:, 3]).all() and np.isinf(new.first_time[:, :, 3]).all()
    np.testing.assert_array_equal(new.solver.quiet, np.pad(old.solver.quiet, ((0, 0), (0, 1))))
    np.testing.assert_array_equal(new.first_time[:, :3][..., [0, 1, 2, 4]], old.first_time)
    np.testing.assert_array_equal(new.solver.key, old.solver.key)
    awake = histories.renewed(old, [1])
    assert not awake.solver.quiet[:, 1].any() and (awake.solver.quiet[:, [0, 2]] > 0.05).all()
    pairs = awake.solver.contact[0, : awake.solver.count[0], BODY_A : BODY_B + 1]
    assert len(pairs) and 1 not in pairs


# -- what is drawn -----------------------------------------------------------------------------------


def test_each_of_two_boxes_on_a_tray_has_friction_of_its_own():
    # the upper one slides where its friction is below the acceleration and below the lower one's on the tray
    acceleration, mu, std, samples = 1.5, 0.3, 0.12, 400
    t = np.arange(0.0, 0.8001, 0.1)
    path = PosePath(
        times=t,
        positions=np.stack([0.5 * acceleration * t * t, 0 * t, 0 * t - 0.01], axis=1),
        linear_velocities=np.stack([acceleration * t, 0 * t, 0 * t], axis=1),
    )
    tray = RigidBody("tray", primitive_model("box", size=(1.6, 0.4, 0.02)), trajectory=path)
    lower = RigidBody("lower", primitive_model("box", size=(0.3, 0.2, 0.02)), 1.0)
    upper = RigidBody("upper", primitive_model("box", size=(0.06, 0.06, 0.04)), 0.2)
    scene = Scene.everyday([tray, lower, upper], friction=mu, friction_std=std, environment=[])
    belief = belief_of(scene, lower={"position": (0, 0, 0.01)}, upper={"position": (0, 0, 0.04)})
    x = predict(scene, belief, make_propagator("monte_carlo", samples=samples), 0.75).samples()
    slid = np.mean(x[:, 1, 0] - x[:, 2, 0] > 2e-3)
    own = np.random.default_rng(1).standard_normal((200000, 3)) * math.sqrt(2.0) * std / mu
    of_upper = mu * np.exp(0.5 * (own[:, 1] + own[:, 2]))
    of_lower = mu * np.exp(0.5 * (own[:, 0] + own[:, 1]))
    right = np.mean(of_upper < np.minimum(acceleration / G, of_lower))
    assert slid == pytest.approx(right, abs=4.0 * math.sqrt(right * (1.0 - right) / samples))


def test_floors_tilt_and_paths_are_offset_by_each_rollouts_own_draws():
    yaw = 0.4
    floor = Box(
        (4, 4, 0.2), (0, 0, -0.1), (0, 0, math.sin(yaw / 2), math.cos(yaw / 2)), surface_tilt_std=0.01
    )
    path = PosePath(times=[0, 1], positions=[[1, 0, 0.5], [1, 1, 0.5]], orientations=[[0, 0, 1, 0]] * 2)
    ball = primitive_model("sphere", radius=0.03)
    hand = RigidBody("hand", ball, trajectory=path, trajectory_std=[0.1, 0, 0, 0, 0, 0.5])
    scene = world(hand, RigidBody("ball", ball, 0.1), environment=[floor], friction=1.0)
    belief = belief_of(scene, ball={"position": (0.0, 0.0, 0.0301)})
    p = predict(scene, belief, make_propagator("monte_carlo", samples=20), 0.5)
    names = [(parameter.name, parameter.axis) for parameter in scene.uncertain]
    z = {name: p.carry.parameters[:, k] for k, name in enumerate(names)}
    x, y = (0.01 * z["surface_tilt", axis] for axis in range(2))  # about the element's own axes
    tilt = np.column_stack([x * math.cos(yaw) - y * math.sin(yaw), x * math.sin(yaw) + y * math.cos(yaw)])
    expected = 0.5 * 5.0 / 7.0 * G * 0.25 * np.column_stack([tilt[:, 1], -tilt[:, 0]])
    np.testing.assert_allclose(p.samples()[:, 1, :2], expected, atol=2e-2 * abs(expected).max())
    # the path's own axes are turned by half a turn
    a, turn = -0.1 * z["trajectory", 0], 0.5 * z["trajectory", 5]
    expected = np.column_stack([1.0 + a - 0.5 * np.sin(turn), 0.5 * np.cos(turn), np.full(20, 0.5)])
    np.testing.assert_allclose(p.samples()[:, 0, :3], expected, atol=1e-9)


@pytest.mark.parametrize("radius", [0.005, 0.01, 0.02])
@pytest.mark.parametrize("fixed", [True, False])
def test_no_sample_of_a_ball_passes_through_a_tabletop(radius, fixed):
    mass = 4000 * radius**3
    ball = RigidBody("ball", solid_ball("ball", radius, mass).model, mass)
    start = {"ball": BodyBelief(position=(0, 0, 0.2), position_std=0.01)}
    bodies, environment = [ball], [Box((1.2, 0.8, 0.02), (0, 0, -0.01))]
    if fixed:
        top = RigidBody("top", primitive_model("box", size=(1.2, 0.8, 0.02)), 1.0, fixed=True)
        bodies, environment = [ball, top], []
        start["top"] = BodyBelief(position=(0, 0, -0.01))
    scene = Scene.everyday(bodies, environment=environment)
    x = predict(scene, Belief.of(scene, start), make_propagator("auto"), 0.6).samples()[:, 0]
    above = (np.abs(x[:, :2]) < [0.6, 0.4]).all(axis=1)
    assert above.sum() > 0.9 * len(x)
    assert x[above, 2].min() > radius - 3e-4


def test_an_uncertain_mass_changes_no_motion_before_contacts():
    scene = world(RigidBody("b", solid_box("b", (0.1, 0.08, 0.06), 0.5).model, 0.5, mass_std=0.1))
    belief = Belief.exact(state((0, 0, 0.5), (1, 0, 0), (2, 20, 1))[None], scene.moving)
    p = predict(scene, belief, make_propagator("monte_carlo", samples=8), times=[0.2, 0.6])
    assert np.ptp(p.carry.parameters) > 0.1
    flown = p.samples(time=0.2)
    np.testing.assert_allclose(flown, np.broadcast_to(flown[:1], flown.shape), rtol=0, atol=1e-9)


def test_what_leaves_the_range_of_numbers_is_named():
    scene = world(RigidBody("box", load_model("salt_box")))
    belief = belief_of(scene, box={"position": (0, 0, 0.2), "linear_velocity": (1e200, 0.0, 0.0)})
    with pytest.raises(DivergedError):
        predict(scene, belief, make_propagator("monte_carlo", samples=1), 0.1)
