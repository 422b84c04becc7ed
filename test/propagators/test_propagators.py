"""What every propagator in the registry must keep."""

import dataclasses

import numpy as np
import pytest
from example_scenes import parts_of
from scipy.spatial.transform import Rotation
from twins import states as twin

from unc_physics import PROPAGATORS, Belief, RigidBody, Scene, make_propagator
from unc_physics.propagators.base import PointPairs, Rollouts, Samples, rollout_count

ROUND_OFF = 1e-9  # relative to the largest variance

OPTIONS = {
    "monte_carlo": [{"samples": 40}],
    "sigma_points": [{"points": "minimal"}, {"points": "full"}],
    "local_sampling": [{"samples": 16}],
}
CASES = [(name, options) for name in PROPAGATORS for options in OPTIONS.get(name, [{}])]
every_propagator = pytest.mark.parametrize(
    "propagator",
    [make_propagator(name, **options) for name, options in CASES],
    ids=[" ".join([name, *(f"{k}={v}" for k, v in options.items())]) for name, options in CASES],
)
NOMINAL_EQUIVARIANT = [name for name in PROPAGATORS if name in ("linearization", "surrogate")]


@every_propagator
def test_what_others_ask_of_a_propagator_fits_together(loaded, propagator):
    scene, belief, _ = loaded("two_bodies")
    carry = propagator.init(scene, belief)
    first = carry.contact_history.first_time
    assert first.shape[1:] == (2, 2) and np.isinf(first).all() and carry.step == 0
    assert rollout_count(carry) == len(first)
    if isinstance(propagator, Samples):
        assert len(propagator.own_samples(carry, scene)) == propagator.own_sample_count
        assert len(propagator.rollout_states(carry, scene)) == len(first)
    else:
        assert len(first) <= propagator.most_rollouts(scene, belief)
    if isinstance(propagator, PointPairs):
        assert propagator.directions(belief).shape == (2,)
        assert len(propagator.point_states(carry, scene)) == len(first)
    if isinstance(propagator, Rollouts):
        parts = [propagator.init_rollouts(scene, belief, *part) for part in ((0, 5), (5, len(first)))]
        assert_identical(propagator.concatenate(*parts), carry)
    described = propagator.described_options()
    assert [option.name for option in described] == list(propagator.options())
    assert all(option.description and option.name in propagator.options() for option in described)
    assert propagator.description().endswith(".")


def assert_identical(a, b):
    assert type(a) is type(b)
    for x, y in zip(parts_of(a), parts_of(b), strict=True):
        np.testing.assert_array_equal(x, y)


@every_propagator
def test_finite_symmetric_and_semidefinite_at_every_step(loaded, propagator):
    """Before, in, and after a collision with gravity and a fixed body."""
    scene, belief, _ = loaded("three_bodies")
    carry = propagator.init(scene, belief)
    start = propagator.belief(carry, scene)
    for step in range(90):
        carry = propagator.advance(carry, scene, 1)
        now = propagator.belief(carry, scene)
        P = now.joint
        assert np.isfinite(now.mean).all() and np.isfinite(P).all(), step
        np.testing.assert_array_equal(P, P.T)
        assert np.linalg.eigvalsh(P)[0] >= -ROUND_OFF * np.abs(P).max(), step
        np.testing.assert_allclose(np.linalg.norm(now.mean[:, 6:10], axis=1), 1.0, atol=1e-12)
    assert np.linalg.norm(now.mean[0, 3:6] - start.mean[0, 3:6]) > 0.5, "no collision"
    np.testing.assert_array_equal(now.mean[1], belief.mean[1])
    assert not now.marginal(1).any() and len(now.blocks) == 2
    # the result is a belief like any other
    Belief(now.mean, now.covariance, now.moving)


@every_propagator
def test_the_belief_at_time_zero_is_the_given_one(loaded, propagator):
    scene, belief, _ = loaded("three_bodies")
    now = propagator.belief(propagator.init(scene, belief), scene)
    if isinstance(propagator, Samples) and propagator.random_moments:
        # in directions of unit variance, the standard errors of mean and covariance are at most sqrt(2 / n)
        bound = 6.0 * np.sqrt(2.0 / (0.5 * propagator.own_sample_count))
        whiten = np.linalg.pinv(belief.root())
        mean = twin.boxminus(now.mean, belief.mean)[belief.moving].ravel()
        assert np.abs(whiten @ mean).max() < bound
        covariance = whiten @ now.joint @ whiten.T
        assert np.abs(covariance - np.eye(len(covariance))).max() < bound
        return
    np.testing.assert_allclose(twin.boxminus(now.mean, belief.mean), 0.0, atol=1e-12)
    np.testing.assert_allclose(now.joint, belief.joint, atol=ROUND_OFF * np.abs(belief.joint).max())


@pytest.mark.parametrize("name", [name for name in PROPAGATORS if "seed" in PROPAGATORS[name].options()])
def test_another_seed_gives_other_draws(loaded, name):
    scene, belief, _ = loaded("two_bodies")
    few = {"samples": 16} if "samples" in PROPAGATORS[name].options() else {}
    ends = []
    for seed in (0, 1):
        propagator = make_propagator(name, seed=seed, **few)
        ends.append(
            propagator.belief(propagator.advance(propagator.init(scene, belief), scene, 80), scene).joint
        )
    assert np.abs(ends[0] - ends[1]).max() > 1e-6


@every_propagator
@pytest.mark.parametrize(
    ("name", "more"), [("three_bodies", {}), ("everyday", {}), ("everyday", {"sleep": True})]
)
def test_advancing_in_pieces_equals_one_call_to_the_last_bit(loaded, propagator, name, more):
    """With all that is remembered of contacts and rest."""
    scene, belief, _ = loaded(name)
    scene, pieces = dataclasses.replace(scene, **more), (1, 30, 2, 40, 97)
    begin = propagator.init(scene, belief)
    kept = [np.array(part) for part in parts_of(begin)]
    whole = propagator.advance(begin, scene, sum(pieces))
    for before, part in zip(kept, parts_of(begin), strict=True):
        np.testing.assert_array_equal(before, part, "advance must leave its carry as it is")
    carry = begin
    for steps in pieces:
        carry = propagator.advance(carry, scene, steps)
        propagator.belief(carry, scene)  # looking changes nothing
    assert_identical(carry, whole)
    assert name != "everyday" or whole.contact_history.solver.count.any()


def advanced(propagator, scene, belief, steps):
    """The belief some steps later."""
    return propagator.belief(propagator.advance(propagator.init(scene, belief), scene, steps), scene)


# -- equivariance ----------------------------------------------------------------------------------


def moved_belief(belief, Q, t):
    mean = belief.mean.copy()
    mean[:, :3] = Q.apply(mean[:, :3]) + t
    mean[:, 3:6] = Q.apply(mean[:, 3:6])
    mean[:, 6:10] = (Q * Rotation.from_quat(mean[:, 6:10])).as_quat()
    mean[:, 10:13] = Q.apply(mean[:, 10:13])
    T = np.zeros((12, 12))
    R = Q.as_matrix()
    T[0:3, 0:3] = T[3:6, 3:6] = T[9:12, 9:12] = R
    T[6:9, 6:9] = np.eye(3)  # dtheta is on the body side
    M = len(belief.moving)
    joint = np.kron(np.eye(M), T) @ belief.joint @ np.kron(np.eye(M), T).T
    blocks = [joint[12 * k : 12 * k + 12, 12 * k : 12 * k + 12] for k in range(M)]
    return Belief(mean, np.array(blocks) if belief.independent else joint, belief.moving)


def assert_same_belief(a, b, tolerance):
    np.testing.assert_allclose(twin.boxminus(a.mean, b.mean), 0.0, atol=tolerance)
    np.testing.assert_allclose(a.joint, b.joint, atol=tolerance * max(1.0, np.abs(a.joint).max()))


@pytest.mark.parametrize("name", NOMINAL_EQUIVARIANT)
@pytest.mark.parametrize("scene_name", ["two_bodies", "three_bodies"])
def test_a_change_of_frame_changes_only_the_frame(loaded, name, scene_name):
    scene, belief, _ = loaded(scene_name)
    Q, t = Rotation.from_rotvec([0.4, -1.1, 2.0]), np.array([1.0, -2.0, 0.5])
    turned = Scene(scene.bodies, scene.dt, scene.stiffness, scene.damping, Q.apply(scene.gravity.copy()))
    propagator = make_propagator(name)
    after = advanced(propagator, scene, belief, 60)
    other = advanced(propagator, turned, moved_belief(belief, Q, t), 60)
    ROUND_OFF_GROWN_BY_COLLISIONS = 1e-7
    assert_same_belief(moved_belief(after, Q, t), other, ROUND_OFF_GROWN_BY_COLLISIONS)


@every_propagator
def test_a_certain_belief_stays_certain_and_follows_the_rollout(loaded, propagator):
    scene, belief, _ = loaded("two_bodies")
    after = advanced(propagator, scene, Belief.exact(belief.mean), 60)
    truth = advanced(make_propagator("monte_carlo", samples=1), scene, Belief.exact(belief.mean), 60)
    np.testing.assert_allclose(twin.boxminus(after.mean, truth.mean), 0.0, atol=1e-10)
    np.testing.assert_allclose(after.joint, 0.0, atol=1e-20)


@every_propagator
def test_only_fixed_bodies(loaded, propagator):
    scene, belief, _ = loaded("two_bodies")
    fixed = Scene([RigidBody(body.name, body.model, fixed=True) for body in scene.bodies])
    mean = belief.mean.copy()
    mean[:, 3:6] = mean[:, 10:13] = 0.0
    after = advanced(propagator, fixed, Belief.exact(mean, []), 10)
    np.testing.assert_array_equal(after.mean, mean)
    assert after.joint.shape == (0, 0)
