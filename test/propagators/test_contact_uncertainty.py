"""Linearization, surrogate and local sampling in contact equal twins written from their equations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from twins import propagators as twin
from twins.states import symmetric_root
from twins.step import bodies_of, physics_of

from unc_physics import Belief, RigidBody, Scene, SpherePacking, make_propagator

FINITE_DIFFERENCE = 1e-7
ROUND_OFF = 1e-10


@pytest.fixture(scope="module", params=["two bodies", "a fixed third", "one sphere inside another"])
def overlapping(request, loaded):
    """A scene whose bodies overlap, spin and fall, and a belief with a full covariance."""
    rng = np.random.default_rng(2)
    left, right = loaded("two_bodies").scene.bodies
    if request.param == "one sphere inside another":

        def ball(radius, arm):
            return SpherePacking(
                "ball", np.array([arm]), np.array([radius]), np.diag([0.3, 0.4, 0.5]), 1.0, np.zeros(3), 2.0
            )

        left, right = (
            RigidBody("big", ball(0.8, [0.3, 0.1, 0.0]), 1.5),
            RigidBody("small", ball(0.2, [-0.1, 0.2, 0.1]), 0.7),
        )
    bodies = [left, right]
    if request.param == "a fixed third":
        bodies.insert(1, RigidBody("floor", loaded("three_bodies").scene.bodies[1].model, fixed=True))
    scene = Scene(bodies, 0.01, 3e3, 0.7, [0.0, 0.3, -2.0])
    mean = np.zeros((len(bodies), 13))
    mean[:, 6:10] = Rotation.random(len(bodies), rng=rng).as_quat()
    mean[scene.moving, 3:6] = rng.standard_normal((2, 3))
    mean[scene.moving, 10:13] = 3.0 * rng.standard_normal((2, 3))
    mean[0, 0], mean[-1, 0] = -0.15, 0.2
    if request.param == "a fixed third":
        mean[1, :3] = [0.0, 0.2, -0.9]
    root = 0.05 * rng.standard_normal((24, 24))
    return scene, mean, root @ root.T


def blocks(P):
    return np.stack([P[:12, :12], P[12:, 12:]])


def test_linearization(overlapping):
    scene, mean, P = overlapping
    propagator = make_propagator("linearization")
    carry, belief = propagator.init(scene, Belief(mean, P, scene.moving)), None
    for _ in range(5):
        carry = propagator.advance(carry, scene, 1)
        mean, P = twin.linearization_step(mean, P, bodies_of(scene), physics_of(scene))
        belief = propagator.belief(carry, scene)
        np.testing.assert_allclose(belief.joint, P, atol=FINITE_DIFFERENCE * np.abs(P).max())
    np.testing.assert_allclose(
        np.abs(np.sum(belief.mean[:, 6:10] * mean[:, 6:10], axis=1)), 1.0, atol=ROUND_OFF
    )
    np.testing.assert_allclose(
        np.delete(belief.mean, range(6, 10), 1), np.delete(mean, range(6, 10), 1), atol=1e-9
    )


def test_linearization_over_a_collision(loaded):
    """Thirty steps, in which contacts begin and end, beside the central differences of each step."""
    scene, belief, _ = loaded("three_bodies")
    propagator = make_propagator("linearization")
    carry = propagator.init(scene, belief)
    carry = propagator.advance(carry, scene, 60)  # four steps before the bodies meet
    mean, P = propagator.belief(carry, scene).mean.copy(), propagator.belief(carry, scene).joint
    for _ in range(30):
        mean, P = twin.linearization_step(mean, P, bodies_of(scene), physics_of(scene))
    after = propagator.belief(propagator.advance(carry, scene, 30), scene)
    assert np.abs(P[:12, 12:]).max() > 1e-6, "they must have met"
    np.testing.assert_allclose(after.joint, P, atol=30 * FINITE_DIFFERENCE * np.abs(P).max())


@pytest.mark.parametrize("k_sigma", [3.0, 1.0])
def test_surrogate(overlapping, k_sigma):
    scene, mean, P = overlapping
    propagator = make_propagator("surrogate", k_sigma=k_sigma)
    carry = propagator.init(scene, Belief(mean, blocks(P), scene.moving))
    roots = np.array([symmetric_root(block) for block in blocks(P)])
    np.testing.assert_allclose(carry.blocks, roots, atol=1e-9)
    for _ in range(5):
        carry = propagator.advance(carry, scene, 1)
        mean, roots = twin.surrogate_step(mean, roots, bodies_of(scene), physics_of(scene), k_sigma)
        np.testing.assert_allclose(carry.blocks, roots, atol=1e-9 * np.abs(roots).max())
    P = np.einsum("kac,kbc->kab", roots, roots)
    np.testing.assert_allclose(propagator.belief(carry, scene).blocks, P, atol=1e-9 * np.abs(P).max())


def test_local_sampling(overlapping):
    scene, mean, P = overlapping
    samples = 40_000
    propagator = make_propagator("local_sampling", samples=samples)
    ours = propagator.belief(
        propagator.advance(propagator.init(scene, Belief(mean, blocks(P), scene.moving)), scene, 1), scene
    )
    rng = np.random.default_rng(11)
    _, theirs = twin.local_sampling_step(mean, blocks(P), bodies_of(scene), physics_of(scene), samples, rng)
    _, certain = twin.local_sampling_step(mean, 0.0 * blocks(P), bodies_of(scene), physics_of(scene), 2, rng)
    np.testing.assert_allclose(certain, 0.0, atol=1e-20)
    # what the contacts added: about 1 / sqrt(samples) apart, with room for heavy tails of torques
    STATISTICS = 8.0 / np.sqrt(samples)
    for block in (slice(3, 6), slice(9, 12)):
        for k, b in enumerate(scene.moving):
            A = twin.printed_transition(mean, b, physics_of(scene))
            free = (A @ blocks(P)[k] @ A.T)[block, block]
            added, expected = ours.blocks[k][block, block] - free, theirs[k][block, block] - free
            assert np.abs(expected).max() > 1e-7, "the contacts added nothing"
            np.testing.assert_allclose(added, expected, atol=STATISTICS * np.abs(expected).max())
            theirs[k][block, block] = ours.blocks[k][block, block]
    np.testing.assert_allclose(ours.blocks, theirs, atol=ROUND_OFF * np.abs(theirs).max())
