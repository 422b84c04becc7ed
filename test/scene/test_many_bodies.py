"""Beliefs about many bodies, which cost as much as their blocks, against the joint covariance."""

import pickle

import numpy as np
import pytest

from unc_physics import Belief, BodyBelief, RigidBody, Scene, predict, primitive_model
from unc_physics.prediction import request_checks
from unc_physics.prediction.request_checks import check_memory
from unc_physics.propagators.monte_carlo import MonteCarlo
from unc_physics.spatial.moments import mean_and_errors, second_moment, spread_states

COUNT = 20  # bodies: so many that each block is factored by itself
ROUND_OFF = 1e-13


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def belief_of(kind, rng):
    """A belief about independent bodies: of full rank, of several scales, or of lower rank."""
    mean = np.zeros((COUNT, 13))
    mean[:, 9] = 1.0
    if kind == "scales":
        roots = [np.diag(10.0 ** rng.integers(-8, 0, 12)) for _ in range(COUNT)]
    else:
        ranks = [12] * COUNT if kind == "full" else rng.integers(0, 13, COUNT)
        roots = [rng.normal(size=(12, rank)) * 10.0 ** rng.uniform(-4.0, 0.0, (12, 1)) for rank in ranks]
    return Belief(mean, np.array([root @ root.T for root in roots]))


@pytest.mark.parametrize("kind", ["full", "scales", "low"])
def test_states_along_columns_are_those_of_the_joint_factor(kind, rng):
    belief = belief_of(kind, rng)
    root = belief.root()
    assert belief.rank == root.shape[1]
    z = rng.normal(size=(5, belief.rank))
    expected = spread_states(belief.mean.copy(), belief.moving.copy(), z @ root.T)
    np.testing.assert_allclose(belief.states_along(z), expected, atol=ROUND_OFF)


def test_fewer_draws_are_the_first_of_more(rng):
    belief = belief_of("full", rng)
    more, fewer = (belief.sample(count, np.random.default_rng(1)) for count in (9, 1))
    np.testing.assert_array_equal(more[:1], fewer)


def test_many_exact_bodies_have_one_state():
    belief = Belief.exact(belief_of("full", np.random.default_rng(0)).mean)
    assert belief.rank == 0
    np.testing.assert_array_equal(belief.sample(2, np.random.default_rng(1)), [belief.mean] * 2)


def test_the_joint_covariance_of_samples_is_computed_when_it_is_used():
    cube = primitive_model("box", size=[0.04, 0.04, 0.04])
    scene = Scene.everyday([RigidBody(f"cube{k}", cube, 0.1) for k in range(COUNT)], dt=0.01)
    at = {
        f"cube{k}": BodyBelief(position=[0.2 * k, 0.0, 1.0], position_std=0.01, orientation_std=0.1)
        for k in range(COUNT)
    }
    prediction = predict(scene, Belief.of(scene, at), MonteCarlo(samples=6), 0.02)
    belief = prediction.belief
    assert prediction["cube3"].position_std.all() and prediction["cube3"].status().measures
    assert prediction.body("cube3", origin="model").position_std.all()
    assert "covariance" not in vars(belief) and not belief.independent
    mean, errors = mean_and_errors(prediction.samples(), scene.moving.copy())
    expected = second_moment(errors)
    other = pickle.loads(pickle.dumps(belief))
    for one in (belief, other, belief.with_mean(mean)):
        np.testing.assert_array_equal(one.joint, expected)
        np.testing.assert_array_equal(one.marginal(3), expected[36:48, 36:48])


def test_samples_need_no_memory_for_joint_covariances(monkeypatch):
    cube = primitive_model("box", size=[0.04, 0.04, 0.04])
    needed, count, times = [], 200, 10
    monkeypatch.setattr(request_checks, "require_memory", lambda size, *_: needed.append(size))
    scene = Scene([RigidBody(f"cube{k}", cube, 0.1) for k in range(count)])
    belief = Belief.exact(np.tile(np.eye(13)[9], (count, 1)))
    check_memory(scene, belief, MonteCarlo(samples=2), times)
    assert needed[0] < 0.05 * times * 8.0 * (12 * count) ** 2  # of joint covariances, in bytes
