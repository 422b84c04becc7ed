"""Beliefs that reach into tables, walls and neighbours: what must hold of them before time 0 and after it."""

import re
from dataclasses import replace
from functools import partial

import numba
import numpy as np
import pytest
from plain_scenes import energy, sphere_centers
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from unc_physics import Box, Plane, RigidBody, Scene, assess, load_model, make_propagator, predict
from unc_physics.checks.errors import (
    InvalidOptionError,
    InvalidRequestError,
    LimitExceededError,
    NotSupportedError,
    UncPhysicsError,
)
from unc_physics.scene.belief import Belief
from unc_physics.scene.stiffness import with_stiffness

FLAT = 5e-5  # m, overlap that counts as none
LEFT = 2e-4  # m, the most that the search may leave where it frees bodies of each other
STD, ANGLE = 0.005, np.radians(3.0)
FLOOR = Plane(name="table")
SPHERES = 800  # with fewer, a can stands tilted on the holes of a brick


def body(name, model, **fields):
    packing = load_model(model)
    return RigidBody(name, packing.prefix(SPHERES), **fields)


def standing(model, x=0.0, below=0.0):
    """The mean (13,) of a model that stands upright at x, on what is ``below`` high."""
    mean = np.zeros(13)
    mean[[0, 2, 9]] = x, below - load_model(model).bounds[0][2], 1.0
    return mean


def uncertain(mean, position=STD, angle=ANGLE, moving=None):
    mean = np.atleast_2d(mean)
    P = np.zeros((len(mean) if moving is None else len(moving), 12, 12))
    P[:, range(3), range(3)], P[:, range(6, 9), range(6, 9)] = position**2, angle**2
    return Belief(mean, P, moving)


def on_table(*models, at_rest=False, **options):
    bodies = [body(name, model, at_rest=at_rest) for name, model in models]
    return Scene.everyday(bodies, exact=True, environment=[FLOOR], **options)


alone = partial(on_table, ("box", "salt_box"))
beside = partial(on_table, ("can", "can"), ("brick", "brick"))  # 1 mm apart
stacked = partial(on_table, ("brick", "brick"), ("can", "can"))
ALONE = uncertain(standing("salt_box"))
BESIDE = uncertain([standing("can"), standing("brick", 0.038 + 0.001 + 0.12)])
STACKED = uncertain([standing("brick"), standing("can", 0.0, 0.071)])
CASES = {"alone": (alone, ALONE), "beside": (beside, BESIDE), "stacked": (stacked, STACKED)}


def begun(scene, belief, samples=40, seed=0):
    """Monte Carlo's states at time 0."""
    scene = with_stiffness(scene, belief.mean)
    return make_propagator("monte_carlo", samples=samples, seed=seed).init(scene, belief).states


def deepest(scene, state):
    """How deep any two spheres, or a sphere and an element, reach into each other at a state (B, 13) [m]."""
    centers = [sphere_centers(one, x) for one, x in zip(scene.bodies, state, strict=True)]
    radii = [one.model.radii for one in scene.bodies]
    found = [0.0]
    for k in scene.moving:
        found += [np.max(radii[k] - element.surface(centers[k])[0]) for element in scene.environment]
    for j in range(len(centers)):
        for i in range(j):
            found.append(np.max(radii[i][:, None] + radii[j] - cdist(centers[i], centers[j])))
    return max(found)


def deepest_of(scene, states):
    return max(deepest(scene, state) for state in states)


def course(scene, belief, samples, horizon=1.0, every=4, seed=0):
    """(T, N, B, 13): Monte Carlo's states from time 0 on, every few steps."""
    scene = with_stiffness(scene, belief.mean)
    propagator = make_propagator("monte_carlo", samples=samples, seed=seed)
    carry = propagator.init(scene, belief)
    states = [carry.states.copy()]
    for _ in range(round(horizon / scene.dt) // every):
        carry = propagator.advance(carry, scene, every)
        states.append(carry.states.copy())
    return np.array(states)


# -- projected -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", CASES)
def test_nothing_overlaps_at_the_start_and_what_did_not_stays(case):
    make, belief = CASES[case]
    scene = make()
    drawn = belief.sample(40, np.random.default_rng(0))
    depths, states = np.array([deepest(scene, state) for state in drawn]), begun(scene, belief)
    assert depths.max() > STD, "or else the test says nothing"
    left = np.array([deepest(scene, state) for state in states])
    assert np.quantile(left, 0.9) < FLAT and left.max() < (FLAT if case == "alone" else LEFT)
    free = depths < 0.9 * FLAT
    assert case != "alone" or free.any()
    np.testing.assert_array_equal(states[free], drawn[free])


def test_no_energy_comes_of_it():
    for make, belief in CASES.values():
        scene = make()
        states = course(scene, belief, 20)
        found = np.array([[energy(scene, x) for x in some] for some in states.swapaxes(0, 1)])
        assert np.max(found - found[:, :1]) < 0.005
        height = states[..., 2]
        assert np.max(height - height[0]) < 1e-3


def test_a_body_goes_the_nearest_way_in_the_metric_of_its_belief():
    """Without rotation the way out of a plane is known: Sigma n / (n' Sigma n) times the depth."""
    root = np.array([[3.0, 0.0, 0.0], [1.0, 2.0, 0.0], [2.0, -1.0, 1.5]]) * 1e-3
    P = np.zeros((1, 12, 12))
    P[0, :3, :3] = root @ root.T
    belief, scene = Belief(ALONE.mean, P), alone()
    drawn, states = belief.sample(60, np.random.default_rng(0)), begun(scene, belief, 60)
    depth = np.array([deepest(scene, state) for state in drawn])
    inside = depth > FLAT
    assert inside.sum() > 20
    way = np.outer(depth, P[0, :3, 2] / P[0, 2, 2])
    np.testing.assert_allclose((states - drawn)[inside, 0, :3], way[inside], atol=6e-5)
    np.testing.assert_array_equal(states[:, 0, 6:10], drawn[:, 0, 6:10])


def test_what_bodies_share_they_keep():
    """Both have the same error, of the camera say: they come up together."""
    exact = Belief.exact(BESIDE.mean)
    belief = exact.with_common_pose_std([0.0, 0.0, 0.01, 0.0, 0.0, 0.0])
    assert belief.covariance.shape == (24, 24)
    scene = beside()
    states = begun(scene, belief)
    assert deepest_of(scene, states) < FLAT
    apart = states[:, 1, :3] - states[:, 0, :3]
    np.testing.assert_allclose(apart, np.broadcast_to(apart[0], apart.shape), atol=1e-9)
    assert states[:, 0, 2].std() > 0.003


def test_a_fixed_body_stays_and_keeps_others_out():
    bodies = [body("can", "can"), body("brick", "brick", fixed=True)]
    scene = Scene.everyday(bodies, exact=True, environment=[FLOOR])
    belief = uncertain(BESIDE.mean[:2], moving=[0])
    states = begun(scene, belief)
    np.testing.assert_array_equal(states[:, 1], np.broadcast_to(belief.mean[1], (40, 13)))
    assert deepest_of(scene, states) < FLAT


def test_directions_without_covariance_do_not_move_and_are_told():
    P = np.zeros((1, 12, 12))
    P[0, range(2), range(2)] = STD**2  # the height is certain, and 3 mm too low
    belief, scene = Belief(ALONE.mean - np.eye(13)[2] * 0.003, P), alone()
    states = course(scene, belief, 10)
    np.testing.assert_array_equal(states[0, :, 0, 2], belief.mean[0, 2])
    assert np.ptp(states[..., 2]) < 1e-3, "nor is it pushed out later"
    prediction = predict(scene, belief, make_propagator("monte_carlo", samples=10), 0.1)
    (status,) = assess(prediction)
    assert status.measures["overlap_certain"] == 1.0 and status.flags


def test_velocities_into_the_contact_are_no_impact():
    mean = ALONE.mean.copy()
    mean[0, 5] = -0.05
    P = ALONE.covariance.copy()
    P[0, range(3, 6), range(3, 6)], P[0, range(9, 12), range(9, 12)] = 0.05**2, 0.5**2
    scene = alone()
    states = course(scene, Belief(mean, P), 40)
    assert deepest_of(scene, states[0]) < FLAT
    found = np.array([[energy(scene, x) for x in some] for some in states.swapaxes(0, 1)])
    assert np.max(found - found[:, :1]) < 0.005


# -- the same whatever the run --------------------------------------------------------------------------


@pytest.mark.parametrize("at_rest", [False, True])
def test_few_samples_are_the_first_of_many_on_any_number_of_threads(at_rest):
    scene = beside(at_rest=at_rest)
    many = begun(scene, BESIDE, 30)
    np.testing.assert_array_equal(begun(scene, BESIDE, 11), many[:11])
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        np.testing.assert_array_equal(begun(scene, BESIDE, 30), many)
    finally:
        numba.set_num_threads(before)


# -- what has no room ----------------------------------------------------------------------------------


def slot(less):
    """A salt box between two walls that are that much closer than it is wide."""
    y = 0.023 - 0.5 * less + 0.01
    walls = [
        Box((0.4, 0.02, 0.2), (0.0, side * y, 0.1), name=name)
        for side, name in ((-1.0, "right"), (1.0, "left"))
    ]
    return Scene.everyday([body("box", "salt_box")], exact=True, environment=[FLOOR, *walls])


@pytest.mark.parametrize("less", [0.002, 0.01])
def test_a_slot_too_narrow_does_not_explode(less):
    scene = slot(less)
    states = course(scene, ALONE, 20)
    found = np.array([[energy(scene, x) for x in some] for some in states.swapaxes(0, 1)])
    assert np.max(found - found[:, :1]) < 1e-3
    prediction = predict(scene, ALONE, make_propagator("monte_carlo", samples=20), 0.1)
    (status,) = assess(prediction)
    assert status.measures["overlap_kept"] > 0.0 and status.flags
    words = r"overlaps '(left|right)' by 0.01\d+ m at the start and has no free pose within its covariance; "
    assert re.search(words, status.message)


# -- at rest -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", CASES)
def test_what_is_at_rest_stays_still(case):
    make, belief = CASES[case]
    scene = make(at_rest=True)
    small = uncertain(belief.mean, 0.003, np.radians(1.0))
    states = course(scene, small, 20)
    assert deepest_of(scene, states[0]) < 1.2e-4  # as deep as its weight presses it
    moved = np.linalg.norm(states[..., :3] - states[0, ..., :3], axis=-1)
    assert moved.max() < 1e-4
    assert np.abs(states[0, ..., 3:6]).max() == 0.0 and np.abs(states[0, ..., 10:]).max() == 0.0


def test_height_and_tilt_come_from_contact_and_the_rest_from_the_belief():
    drawn, states = ALONE.sample(100, np.random.default_rng(0)), begun(alone(at_rest=True), ALONE, 100)
    assert np.ptp(states[:, 0, 2]) < 2e-4
    up = Rotation.from_quat(states[:, 0, 6:10]).as_matrix()[:, 2, 2]
    assert np.degrees(np.arccos(up.min())) < 0.3
    np.testing.assert_allclose(states[:, 0, :2].std(axis=0), drawn[:, 0, :2].std(axis=0), rtol=0.05)


# -- what can be asked, and what is told ----------------------------------------------------------------


def test_the_status_tells_how_much_overlapped():
    scene = alone()
    prediction = predict(scene, ALONE, make_propagator("monte_carlo", samples=60), 0.1)
    (status,) = assess(prediction)
    drawn = ALONE.sample(60, np.random.default_rng(0))
    share = np.mean([deepest(scene, state) > FLAT for state in drawn])
    assert status.measures["overlap_share"] == pytest.approx(share, abs=0.02)


@pytest.mark.parametrize("propagator", ["monte_carlo", "sigma_points"])
def test_the_belief_that_was_used_can_be_had(propagator):
    scene = alone()
    prediction = predict(scene, ALONE, make_propagator(propagator), 0.05)
    assert prediction.start.mean[0, 2] > ALONE.mean[0, 2] + 1e-3
    kept = predict(replace(scene, overlap="keep"), ALONE, make_propagator(propagator), 0.05)
    np.testing.assert_allclose(kept.start.mean, ALONE.mean, atol=1e-3)


def test_kept_overlap_is_as_drawn():
    np.testing.assert_array_equal(
        begun(alone(overlap="keep"), ALONE), ALONE.sample(40, np.random.default_rng(0))
    )


def test_rejection_leaves_samples_without_overlap():
    belief = uncertain(standing("salt_box", below=0.002), 0.003, np.radians(1.0))
    scene = alone(overlap="reject")
    states = begun(scene, belief, 30)
    assert deepest_of(scene, states) < FLAT
    np.testing.assert_array_equal(begun(scene, belief, 12), states[:12])
    with pytest.raises(NotSupportedError, match="overlap"):
        predict(scene, belief, "sigma_points", 0.1)
    hopeless = uncertain(standing("salt_box", below=-0.05), 0.003, np.radians(1.0))
    with pytest.raises(LimitExceededError, match="overlap"):
        predict(scene, hopeless, make_propagator("monte_carlo", samples=30), 0.1)


def test_the_explicit_step_begins_as_ever():
    scene = Scene([body("box", "salt_box")], environment=[FLOOR], gravity=(0.0, 0.0, -9.81))
    assert scene.overlap in (None, "keep")
    np.testing.assert_array_equal(begun(scene, ALONE), ALONE.sample(40, np.random.default_rng(0)))
    for overlap in ("project", "reject"):
        with pytest.raises(InvalidOptionError, match="overlap"):
            replace(scene, overlap=overlap)
    with pytest.raises(InvalidOptionError, match="overlap"):
        alone(overlap="ignore")


def test_what_is_at_rest_needs_gravity_and_the_implicit_step_and_no_velocity():
    resting = body("box", "salt_box", at_rest=True)
    for make in (
        lambda: Scene([resting], environment=[FLOOR], gravity=(0.0, 0.0, -9.81)),
        lambda: Scene.everyday([resting], exact=True, environment=[FLOOR], gravity=None),
        lambda: body("box", "salt_box", at_rest=True, fixed=True),
    ):
        with pytest.raises(UncPhysicsError, match="at_rest"):
            make()
    mean = ALONE.mean.copy()
    mean[0, 3] = 0.1
    with pytest.raises(InvalidRequestError, match="velocity"):
        predict(alone(at_rest=True), Belief(mean, ALONE.covariance), "sigma_points", 0.1)
