"""Moments at the models' own origins, against states mapped one by one."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics import Belief, BodyBelief, Plane, RigidBody, Scene, load_model, make_propagator, predict
from unc_physics.scene import origins
from unc_physics.scene.origins import gaussian_at_origins
from unc_physics.scene.parameters import moved_along

BOX, MUG = load_model("salt_box"), load_model("mug")
DRAWS = 100_000
STDS = (0.05, 0.3, 0.8, 1.5)  # rad


def correlated_belief(rotation_std, bodies=2, seed=3):
    """Two turning bodies, all of whose errors are correlated."""
    rng = np.random.default_rng(seed)
    mean = np.zeros((bodies, 13))
    mean[:, :6], mean[:, 10:] = rng.normal(size=(bodies, 6)), rng.normal(size=(bodies, 3))
    mean[:, 6:10] = Rotation.from_quat(rng.normal(size=(bodies, 4))).as_quat()
    stds = np.tile([0.02] * 3 + [0.1] * 3 + [rotation_std] * 3 + [0.3] * 3, bodies)
    factor = rng.normal(size=(12 * bodies, 24 * bodies))
    C = factor @ factor.T
    C /= np.sqrt(np.outer(np.diag(C), np.diag(C)))
    return Belief(mean, C * np.outer(stds, stds))


@pytest.mark.parametrize("rotation_std", STDS)
def test_a_gaussian_at_origins_against_drawn_states(rotation_std):
    """Rotations beyond half a turn have shorter rotation vectors, so their own errors are not compared."""
    belief = correlated_belief(rotation_std)
    origins = np.array([[0.1, -0.2, 0.05], [0.0, 0.3, 0.1]])
    found = gaussian_at_origins(belief, origins)
    rng = np.random.default_rng(4)
    errors = rng.multivariate_normal(np.zeros(24), belief.joint, DRAWS).reshape(DRAWS, 2, 12)
    R = Rotation.from_quat(np.array(belief.mean[:, 6:10]))
    there = errors.copy()
    for b in range(2):
        arms = (R[b] * Rotation.from_rotvec(errors[:, b, 6:9])).apply(origins[b])
        omega = belief.mean[b, 10:] + errors[:, b, 9:]
        there[:, b, :3] += belief.mean[b, :3] + arms
        there[:, b, 3:6] += belief.mean[b, 3:6] + np.cross(omega, arms)
    mean = there.mean(axis=0)
    P = np.cov(there.reshape(DRAWS, -1).T)
    error = 5.0 * np.sqrt(np.diag(P).reshape(2, 12) / DRAWS)
    assert np.all(np.abs(found.mean[:, :6] - mean[:, :6]) < error[:, :6])
    own = np.sqrt(np.diag(P))
    blocks = [np.s_[:12, :12], np.s_[12:, 12:]]
    for block in blocks:
        scale = np.outer(own, own)[block]
        assert np.abs((found.joint - P)[block] / scale).max() < 0.03
    # between bodies the mean derivative is exact for Gaussians, up to products of two nonlinear parts
    assert np.abs((found.joint - P)[:12, 12:] / np.outer(own, own)[:12, 12:]).max() < 0.06
    assert np.linalg.eigvalsh(found.joint)[0] > -1e-9


@pytest.mark.parametrize("name", ["monte_carlo", "cloud", "auto", "sigma_points"])
def test_a_box_that_lands_keeps_its_origin_out_of_the_table(name):
    """Its origin is the middle of its bottom. The linear map of the mean puts it into the table."""
    scene = Scene.everyday([RigidBody("box", BOX)], environment=[Plane(name="table")])
    start = BodyBelief(
        position=(0, 0, 0.12), linear_velocity=(0.5, 0, 0), position_std=0.01, orientation_std=0.2
    )
    belief = Belief.of(scene, {"box": start})
    prediction = predict(scene, belief, name, 0.8)
    reference = make_propagator("monte_carlo", samples=1000, seed=9)
    drawn = predict(scene, belief, reference, 0.8).samples()
    there = moved_along(drawn, np.array(BOX.origin)[None, None])[:, 0, :3]
    found = prediction.body("box", origin="model")
    linear = moved_along(prediction.belief.mean[None], np.array(BOX.origin)[None, None])[0, 0, :3]
    assert linear[2] < -0.002 < 0.005 < found.position[2]
    if name != "sigma_points":  # which miss the outcomes in which it topples
        spread = there.std(axis=0)
        assert np.all(np.abs(found.position - there.mean(axis=0)) < 0.2 * spread)
        np.testing.assert_allclose(found.position_std, spread, rtol=0.2)


@pytest.mark.parametrize("name", ["monte_carlo", "cloud", "sigma_points"])
def test_marginals_and_joint_moments_agree(name, monkeypatch):
    """Apart from what makes the joint covariance positive, where a difference of moments is not.

    The repair of a sum with the least eigenvalue -d changes a variance by 0 to d, and that of a diagonal
    block, whose least eigenvalue is not below -d, as well. A repair moves no two matrices (12, 12) farther
    apart in the Frobenius norm, in which their changes differ by at most sqrt(12) d.
    """
    lacking, added = [], origins._added

    def observed(moment, difference):
        least = np.linalg.eigvalsh(moment + 0.5 * (difference + np.swapaxes(difference, -1, -2))).min()
        lacking.append(max(-least, 0.0))
        return added(moment, difference)

    scene = Scene.everyday(
        [RigidBody("box", BOX), RigidBody("mug", MUG)], environment=[Plane(name="table")], friction_std=0.1
    )
    starts = {
        body: BodyBelief(position=(x, 0, 0.1), position_std=0.01, orientation_std=0.1)
        for body, x in (("box", 0.0), ("mug", 0.3))
    }
    belief = Belief.of(scene, starts)
    prediction = predict(scene, belief, name, 0.3)
    own = prediction.at().at_model_origins(prediction.scene)
    monkeypatch.setattr(origins, "_added", observed)
    joint = prediction.at().at_model_origins(prediction.scene, joint=True)
    assert own.independent and not joint.independent
    np.testing.assert_array_equal(own.mean, joint.mean)
    variances, expected = (np.einsum("mii->mi", belief.blocks) for belief in (joint, own))
    within = 12**0.5 * sum(lacking) + 1e-12 * expected.max()
    np.testing.assert_allclose(variances, expected, rtol=1e-9, atol=within)
