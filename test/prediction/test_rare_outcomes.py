"""Rare outcomes and idle parts of a scene: rules of thumb with numbers, beside closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from plain_scenes import BALL, ball, independent, state
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from unc_physics import Belief, Plane, RigidBody, Scene, predict
from unc_physics.prediction.rare_outcomes import tail_factors
from unc_physics.prediction.simulated_scene import without_idle_parts

LARGE = ball(0.08)
AXIS = np.array([2.0, -1.0, 2.0]) / 3.0


@pytest.mark.parametrize("rollouts", [6, 24])
@pytest.mark.parametrize("small", [False, True])
def test_far_outcomes_widen_a_spread_by_their_probability(rollouts, small):
    """Those of a belief that is twice as wide, beyond eight standard deviations, each as a tail of a normal.

    Of one body they are positions, of another rotations; those of a third are near. Spreads are at least
    50 um and 1 mrad.
    """
    bodies = [RigidBody(name, BALL, 1.0, fixed=name == "b") for name in "abcd"]
    scene = Scene(bodies, integrator="implicit")
    mean = np.array([state((k, 2, 3), orientation=(0.5, -0.5, 0.5, 0.5)) for k in range(4)])
    position, rotation = (1e-6, 1e-6) if small else (3e-3, 2e-3)
    belief = independent(*mean[[0, 2, 3]], position=(position, 0, 0), rotation=(0, rotation, 0))
    belief = Belief(mean, belief.covariance, [0, 2, 3])
    units = (5e-5, 1e-3) if small else (position, rotation)
    distances = np.zeros(rollouts)
    distances[[1, 3, 4]] = 40.0, 8.1, 12.0
    near = np.where(distances > 0.0, 7.9, 0.0)
    wide = np.tile(mean, (rollouts, 1, 1))
    wide[:, 0, :3] += units[0] * distances[:, None] * AXIS
    turn = Rotation.from_rotvec(units[1] * distances[:, None] * AXIS)
    wide[:, 2, 6:10] = -(Rotation.from_quat(mean[2, 6:10]) * turn).as_quat()
    wide[:, 3, :3] += units[0] * near[:, None] * AXIS
    tails = norm.sf(2.0 * norm.isf(np.minimum((np.arange(3) + 0.5) / rollouts, 0.5)))
    factor = np.sqrt(1.0 + np.diff(tails, prepend=0.0) @ np.array([40.0, 12.0, 8.1]) ** 2)
    expected = [[factor, 1.0], [1.0, 1.0], [1.0, factor], [1.0, 1.0]]
    np.testing.assert_allclose(tail_factors(scene, belief, wide), expected, rtol=1e-4)


def scene_of(states, environment=(), **physics):
    """Balls, of which all but the first are larger; those with a velocity of NaN are fixed."""
    bodies = [
        RigidBody(
            f"b{k}", LARGE if k else BALL, 1.0, fixed=bool(np.isnan(x[3])), friction=0.4, friction_std=0.1
        )
        for k, x in enumerate(states)
    ]
    laws = {"integrator": "implicit", "gravity": (0, 0, 0), "impact_direction_std": 0.1}
    return Scene(bodies, environment=environment, **laws | physics)


def belief_of(scene, states, position=0.0, velocity=0.0):
    """A belief in which the first body's spreads are largest along one tilted axis."""
    R = Rotation.from_euler("xyz", [0.3, -0.8, 0.6]).as_matrix()
    P = np.zeros((len(scene.moving), 12, 12))
    for block, std in ((slice(0, 3), position), (slice(3, 6), velocity)):
        P[0, block, block] = R @ np.diag([0.3 * std, std, 0.0]) ** 2 @ R.T
    return Belief(np.nan_to_num(np.array(states)), P, scene.moving)


@pytest.mark.parametrize("wall", ["element", "fixed body"])
@pytest.mark.parametrize(
    ("velocity", "fall", "stds", "reach"),
    [
        ((0.0, 0.0, 0.0), 0.0, (0.02, 0.0), 0.12),
        ((0.0, 0.0, 0.0), 0.0, (0.0, 0.03), 0.18),
        ((0.0, 0.0, 0.0), 0.0, (0.02, 0.03), 0.30),
        ((0.8, 0.6, 0.0), 0.0, (0.0, 0.0), 0.8 + 0.5 / 63),  # half of the way between two of 64 times
        ((-0.2, 0.0, 0.0), 2.0, (0.0, 0.0), 0.8 + 0.5 * 2.2 / 63),
    ],
)
def test_laws_of_contacts_are_left_out_where_nothing_comes_within_six_standard_deviations(
    wall, velocity, fall, stds, reach
):
    """Just beyond, and not just within, of what a ball reaches along x in a second."""
    for factor, idle in ((1.002, True), (0.998, False)):
        at = 0.05 + factor * reach
        element = Plane((-1, 0, 0), -at, friction=0.3, friction_std=0.1)
        states = [state(velocity=velocity), state((at + 0.08, velocity[1], 0.0), (np.nan, 0, 0))]
        is_element = wall == "element"
        states = states[:1] if is_element else states
        scene = scene_of(states, [element] if is_element else [], gravity=(fall, 0.0, 0.0))
        found = without_idle_parts(scene, belief_of(scene, states, *stds), 1.0)
        assert (found is not scene) == idle
        if idle:
            assert not found.draws_impacts and not found.uncertain
            assert all(one.friction_std == 0.0 for one in (*found.bodies, *found.environment))


@pytest.mark.parametrize(("start", "idle"), [(-0.5, False), (-0.9, True)])
def test_bodies_that_pass_one_point_at_different_times_do_not_meet(start, idle):
    """One passes it after 0.5 s, the other one then or later; a third stays away."""
    states = [state(velocity=(1, 0, 0)), state((0.5, start, 0), (0, 1, 0)), state((9, 9, 9), (np.nan, 0, 0))]
    scene = scene_of(states)
    assert (without_idle_parts(scene, belief_of(scene, states), 1.0) is not scene) == idle


@pytest.mark.parametrize(
    ("physics", "body", "idle"),
    [
        ({}, {}, True),
        ({"damping": 0.1}, {}, False),
        ({"gravity": (0, 0, -1), "gravity_direction_std": 0.1}, {}, False),
        ({}, {"center_of_mass_std": (0.0, 0.01, 0.0)}, False),
        ({"gravity": (0, 0, -1)}, {"at_rest": True}, False),
    ],
)
def test_laws_of_contacts_stay_where_a_flight_is_not_known(physics, body, idle):
    """Of the second of two bodies; a propagator that cannot carry these laws then leaves them out itself."""
    states = [state((0, 0, 1)), state((5, 0, 1))]
    scene = scene_of(states, [Plane(offset=-100.0)], **physics)
    scene = replace(scene, bodies=[scene.bodies[0], replace(scene.bodies[1], **body)])
    belief = belief_of(scene, states, 1e-3)
    assert (without_idle_parts(scene, belief, 0.1) is not scene) == idle
    if "damping" in physics or not physics | body:
        left_out = predict(scene, belief, "linearization", 0.1).left_out
        assert left_out == (() if idle else ("impact_direction_std",))
