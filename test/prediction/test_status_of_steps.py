"""Flags of motion that one step hides: fast passes, fast rotation, and bodies in the same place."""

import numpy as np
import pytest
from plain_scenes import BALL, BLOCK, ball, independent, packing, state, turned
from scipy.spatial.transform import Rotation

from unc_physics import Belief, Box, RigidBody, Scene, assess, load_model, predict
from unc_physics.prediction.body_status import Status
from unc_physics.prediction.diagnostics import raised
from unc_physics.prediction.status import assess_all
from unc_physics.scene.actions import PosePath
from unc_physics.scene.environment import Sphere
from unc_physics.spatial.rotation import left_jacobian

EXPLICIT = ("linearization", "surrogate", "local_sampling", "sigma_points", "monte_carlo", "cloud", "auto")
CAN, SMALL = load_model("can"), ball(0.02)
THICK = 0.1 + 0.04  # of a ball of 5 cm and one of 2 cm [m]
ALONG = Rotation.from_rotvec([0.3, -0.5, 0.9]).apply([1.0, 0.0, 0.0])  # no axis of the world
ACROSS = np.cross(ALONG, [0.0, 0.0, 1.0]) / np.hypot(*ALONG[:2])


def scene_of(*models, environment=(), **physics):
    """Bodies of 1 kg without gravity and damping, at 100 steps a second; contacts do almost nothing."""
    bodies = [
        model if isinstance(model, RigidBody) else RigidBody(f"body {k}", model, 1.0)
        for k, model in enumerate(models)
    ]
    physics = {"dt": 0.01, "stiffness": 1e-6, "gravity": (0, 0, 0), "damping": 0.0} | physics
    return Scene(bodies, environment=environment, **physics)


def flagged(scene, belief, horizon, name="linearization", rollouts=12):
    """Which measures of each body raise a flag, and all measures."""
    found = assess(predict(scene, belief, name, horizon), rollouts=rollouts)
    return [set(raised(status.measures)) for status in found], [status.measures for status in found]


@pytest.mark.parametrize("name", EXPLICIT)
@pytest.mark.parametrize("speed", [8.0, 200.0, 1e4])
def test_cans_that_pass_through_each_other_are_flagged(speed, name):
    """They meet in the middle of a step at 0.5 s, and touch at none."""
    scene = scene_of(CAN, CAN, stiffness=1e4)
    start = 0.5 * speed + 0.005 * speed
    belief = independent(
        state((-start, 0, 0), (speed, 0, 0)), state((start, 0.01, 0), (-speed, 0, 0)), position=3e-4
    )
    prediction = predict(scene, belief, name, 1.0, times=[0.3])
    before, after = assess_all(prediction)
    assert [status.flags for status in before] == [Status.FINE] * 2
    thickness = 4.0 * CAN.radii.max()
    for status in after:
        assert status.flags & Status.NOT_CONVERGED and "can pass through something" in status.message
        assert status.measures["step_motion"] == pytest.approx(0.02 * speed / thickness)
    if speed == 8.0:  # no time step has ever seen them in contact
        assert not np.isfinite(prediction.carry.contact_history.first_time).any()


def unequal(share, offset=0.0, gap=0.5):
    """A ball and a smaller one that fly towards each other, at a relative travel over their thickness."""
    v = share * THICK / 0.01
    return state(-gap * ALONG + offset * ACROSS, 0.25 * v * ALONG), state(gap * ALONG, -0.75 * v * ALONG)


PASSES = {  # scene, states, which bodies are flagged
    "below the limit": (scene_of(BALL, SMALL), unequal(0.49), [False, False]),
    "above": (scene_of(BALL, SMALL), unequal(0.51), [True, True]),
    "off the centre": (scene_of(BALL, SMALL), unequal(3.0, 0.065), [True, True]),
    "beside each other": (scene_of(BALL, SMALL), unequal(3.0, 0.075), [False, False]),
    "one after the other": (
        scene_of(BALL, SMALL),
        [state((-0.5, 0, 0), (80, 0, 0)), state((0, 0, 0), (79, 0, 0))],
        [False, False],
    ),
    "slowly, a fast one far away": (
        scene_of(BALL, SMALL, CAN),
        [*unequal(0.05, gap=0.08), state((0, 0, 3), (200, 0, 0))],
        [False, False, False],
    ),
    "alone": (scene_of(CAN), [state((0, 0, 0), (1e4, 0, 0), (1e3, 0, 0))], [False]),
    "at a wall": (
        scene_of(SMALL, environment=[Box((0.02, 2, 2), (2, 0, 0))]),
        [state((0, 0, 0), (3.1, 0, 0))],
        [True],
    ),
    "beside a turned wall": (
        scene_of(SMALL, environment=[Box((2, 0.02, 2), (2, 0.05, 0), turned(0, 0, 0.01))]),
        [state((0, 0, 0), (100, 0, 0))],
        [False],
    ),
    "at a turned wall": (
        scene_of(SMALL, environment=[Box((2, 0.02, 2), (2, 0.05, 0), turned(0, 0, 0.06))]),
        [state((0, 0, 0), (100, 0, 0))],
        [True],
    ),
    "at a far post": (
        scene_of(BALL, environment=[Sphere(0.01, 3e3 * ALONG)]),
        [state((0, 0, 0), 4e3 * ALONG)],
        [True],
    ),
    "at a fixed body": (
        scene_of(SMALL, RigidBody("post", BALL, fixed=True)),
        [state((-1, 0, 0), (20, 0, 0)), state()],
        [True, False],
    ),
    "a prescribed one": (
        scene_of(
            RigidBody(
                "hand",
                BALL,
                trajectory=PosePath(
                    times=[0, 1],
                    positions=[[-30.04, 0, 0], [29.96, 0, 0]],
                    linear_velocities=[[60, 0, 0]] * 2,
                ),
            ),
            SMALL,
            CAN,
        ),
        [state((-30.04, 0, 0)), state((0, 0.02, 0)), state((0, 1, 0))],
        [False, True, False],
    ),
}


@pytest.mark.parametrize("case", PASSES)
def test_only_things_that_meet_pass_through_each_other(case):
    scene, states, expected = PASSES[case]
    belief = Belief(np.array(states), np.zeros((len(scene.moving), 12, 12)), scene.moving)
    found, measures = flagged(scene, belief, 1.0, "sigma_points")
    assert ["step_motion" in own for own in found] == expected
    if case == "above":
        assert measures[0]["step_motion"] == pytest.approx(0.51)


def test_a_pass_in_some_outcomes_is_flagged():
    """The mean passes 3 cm beside, which is one standard deviation, or ten."""
    scene = scene_of(BALL, SMALL)
    belief = independent(*unequal(3.0, 0.1), position=0.03 / np.sqrt(2.0))
    for std, expected in ((1.0, True), (0.1, False)):
        own = Belief(belief.mean, std**2 * belief.covariance)
        found, _ = flagged(scene, own, 1.0, rollouts=0)
        assert ["step_motion" in one for one in found] == [expected] * 2


ROD = packing("rod", [[x, 0, 0] for x in np.arange(-25, 26) * 0.01], [0.01] * 51, np.diag([4e-5, 0.02, 0.02]))


@pytest.mark.parametrize(
    ("first", "second", "spin", "gap", "expected"),
    [
        (BLOCK, BALL, 49.0, 0.2, False),
        (BLOCK, BALL, 51.0, 0.2, True),
        (BALL, BALL, 1e3, 0.2, False),  # a ball looks alike
        (BALL, BLOCK, 1e3, 0.2, False),
        (BLOCK, BALL, 1e3, 2.0, False),  # they do not meet
        (ROD, SMALL, 2e2 * np.pi, 0.2, True),  # whole turns: each step sees the rod where it began
    ],
)
def test_rotation_in_a_step_counts_where_something_is_met(first, second, spin, gap, expected):
    scene = scene_of(first, second)
    belief = Belief.exact(
        np.array([state(spin=(0, 0.6 * spin, 0.8 * spin)), state((0.02, gap, 0), (0, -0.3, 0))])
    )
    found, measures = flagged(scene, belief, 1.0)
    assert [("step_motion" in own) for own in found] == [expected] * 2
    if expected:
        assert [own["step_motion"] for own in measures] == pytest.approx([0.01 * spin] * 2)


@pytest.mark.parametrize("name", EXPLICIT)
def test_free_rotation_is_exact_at_any_step(name):
    """``J dt`` times the uncertain spin, with 10 rad a step; first order in the step, where a spread is."""
    spin, std, time = np.array([600.0, 0, 800.0]), np.array([0.1, 0.2, 0.3]), 1.0
    scene = scene_of(BLOCK)
    mean, P = state(spin=spin)[None], np.zeros((1, 12, 12))
    P[0, range(9, 12), range(9, 12)] = std**2
    prediction = predict(scene, Belief(mean, P), name, time)
    J = time * left_jacobian(-time * spin)
    expected = np.sqrt(np.trace(J @ np.diag(std**2) @ J.T))
    assert np.sqrt(np.trace(prediction.belief.blocks[0, 6:9, 6:9])) == pytest.approx(expected, rel=0.1)
    (status,) = assess(prediction)
    assert status.flags == Status.FINE


@pytest.mark.parametrize("name", ["surrogate", "local_sampling", "linearization"])
def test_spreads_of_first_order_in_a_steps_rotation_are_compared(name):
    """Across the axis it is ``2 sin(w t / 2) / w``; Eq. 14 leaves out ``sin(x) / x`` at ``w dt / 2``."""
    for turn, wrong in ((1.9, False), (2.1, False), (5.0, True)):
        spin, std = turn / 0.01, 0.3
        mean, P = state(spin=(spin, 0, 0))[None], np.zeros((1, 12, 12))
        P[0, 10, 10] = std**2
        prediction = predict(scene_of(BLOCK), Belief(mean, P), name, 0.97)
        exact = std * abs(2.0 * np.sin(0.5 * 0.97 * spin) / spin)
        first_order = name != "linearization"
        factor = 0.5 * turn / abs(np.sin(0.5 * turn)) if first_order else 1.0
        found = np.sqrt(np.trace(prediction.belief.blocks[0, 6:9, 6:9]))
        assert found == pytest.approx(factor * exact, rel=0.02)
        (status,), (alone,) = assess(prediction), assess(prediction, rollouts=0)
        assert bool(status.flags) == (wrong and first_order)
        assert ("spread_disagreement" in status.measures) == (turn > 2.0 and first_order)
        assert bool(alone.flags) == (turn > 2.0 and first_order)
        assert not alone.flags or "first order in the rotation" in alone.message


@pytest.mark.parametrize("spin", [0.0, 1e3])
@pytest.mark.parametrize("physics", [{}, {"integrator": "implicit", "overlap": None, "stiffness": None}])
def test_points_of_a_free_body_that_turn_beyond_half_a_turn_are_flagged(physics, spin):
    """Three directions have points at 1.87 standard deviations, which are 3.05 and 3.24 rad after 3 s."""
    scene = scene_of(BLOCK, **physics)
    for std, wrapped in ((0.543, False), (0.577, True), (1.1, True)):
        belief = independent(state(spin=(0, 0, spin)), spin=(std, 0.9 * std, std))
        prediction = predict(scene, belief, "sigma_points", 3.0)
        (alone,), (status,) = assess(prediction, rollouts=0), assess(prediction)
        assert ("may turn by half a turn" in alone.message) == wrapped
        assert ("spread_disagreement" in status.measures) == wrapped
        assert bool(status.flags) == (3.0 * std > 1.0)
        if std == 1.1:
            sampled = predict(scene, belief, "monte_carlo", 3.0)
            spreads = [np.sqrt(np.trace(one.belief.blocks[0, 6:9, 6:9])) for one in (prediction, sampled)]
            assert spreads[0] < 0.5 * spreads[1]


def test_points_of_a_fast_gyroscopic_body_are_compared():
    """Small tilts of a body at 100 rad/s change by how far it turns, by their squares."""
    for spin, rotation, wrong in ((10.0, 0.02, False), (100.0, 0.2, True)):
        belief = independent(
            state(spin=(spin, 0, 0)), position=0.01, rotation=rotation, velocity=0.05, spin=0.05
        )
        spreads = []
        for name in ("sigma_points", "monte_carlo"):
            prediction = predict(scene_of(BLOCK, gyroscopic=True), belief, name, 1.0)
            spreads.append(np.sqrt(np.trace(prediction.belief.blocks[0, 6:9, 6:9])))
            (status,) = assess(prediction)
            if name == "sigma_points":
                assert bool(status.flags) == wrong
        assert (spreads[0] < 0.5 * spreads[1]) == wrong


DUMBBELL = packing("dumbbell", [[0.1, 0, 0], [-0.1, 0, 0]], [0.05, 0.04], 0.01 * np.eye(3))


@pytest.mark.parametrize("everyday", [False, True])
@pytest.mark.parametrize(
    ("models", "apart", "std", "flags"),
    [
        ((BALL, SMALL), 0.0003, 0.02, (True, True)),
        ((BALL, SMALL), 0.0005, 0.02, (True, False)),  # 2.5 % of the smaller radius: free within its belief
        ((CAN.prefix(100), CAN.prefix(100)), 0.0, 0.0, (True, True)),
        ((DUMBBELL, DUMBBELL), 0.0, 0.0, (True, True)),
        ((packing("half", [[0.1, 0, 0]], [0.02], np.eye(3)), SMALL), 0.1, 0.0, (True, True)),  # spheres alone
        ((packing("ring", DUMBBELL.centers, [0.02, 0.02], np.eye(3)), SMALL), 0.0, 0.0, (False, False)),
    ],
)
def test_the_edge_of_the_same_place(models, apart, std, flags, everyday):
    bodies = [RigidBody(name, model, 1.0) for name, model in zip("ab", models, strict=True)]
    scene = Scene.everyday(bodies, exact=True) if everyday else scene_of(*bodies, stiffness=1e4)
    belief = independent(state(), state((apart, 0, 0)), position=std)
    found = assess(predict(scene, belief, "sigma_points", 0.02))
    assert [bool(status.flags & Status.INITIAL_OVERLAP) for status in found] == [flags[everyday]] * 2


def test_the_left_jacobian_is_the_derivative_of_a_rotation():
    rng = np.random.default_rng(0)
    for size in (0.0, 1e-6, 1e-3, 1.0, 3.1, 40.0):
        v = size * rng.standard_normal(3)
        step = 1e-6 * np.eye(3)
        found = [
            (Rotation.from_rotvec(v + d) * Rotation.from_rotvec(v - d).inv()).as_rotvec() / 2e-6 for d in step
        ]
        np.testing.assert_allclose(left_jacobian(v), np.transpose(found), atol=1e-8)
