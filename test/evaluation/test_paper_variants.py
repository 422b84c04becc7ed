"""The switches of the paper's methods: with the package's own choices they are its methods."""

import numpy as np
import pytest

from unc_physics import make_propagator, predict
from unc_physics_evaluation.paper_variants import (
    JointLocalSampling,
    NumericalLinearization,
    RegeneratedSigmaPoints,
    TunedSurrogate,
)
from unc_physics_evaluation.scenarios import collision, collision_free

DIFFERENCES = 1e-6  # relative: of central differences, over a rollout with contacts


@pytest.fixture(scope="module")
def scene():
    """Two bunnies, until they part."""
    scene, belief, _ = collision("bunny", 100, 0.02)
    return scene, belief, 2.0


def covariance(scene, propagator):
    return predict(scene[0], scene[1], propagator, scene[2]).belief.joint


@pytest.mark.parametrize(
    ("ours", "switched"),
    [
        (("linearization", {}), NumericalLinearization()),
        (("surrogate", {"k_sigma": 3.0}), TunedSurrogate(k_sigma=3.0)),
    ],
)
def test_the_package_s_own_choices(scene, ours, switched):
    expected = covariance(scene, make_propagator(ours[0], **ours[1]))
    found = covariance(scene, switched)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=DIFFERENCES * np.abs(expected).max())


def test_joint_local_sampling_correlates_the_bodies(scene):
    """Forces are opposite, so the velocities of two bodies of one mass are, too."""
    P = covariance(scene, JointLocalSampling(samples=200))
    together = P[3:6, 15:18]
    assert np.trace(together) < -0.5 * np.trace(P[3:6, 3:6])


def test_the_factors_of_the_surrogate_scale_its_increments():
    """After one step with contacts; spreads of velocities are zero before."""
    scene, belief, _ = collision("bunny", 100, 0.02)
    mean = belief.mean.copy()
    mean[:, 0] *= 0.2  # into each other
    belief = type(belief)(mean, belief.covariance)
    spreads = [
        np.sqrt(covariance((scene, belief, scene.dt), propagator).diagonal())
        for propagator in (TunedSurrogate(), TunedSurrogate(velocity_share=1.0, spin_share=2.0 / 3.0))
    ]
    assert spreads[0][3] > 0.0 and spreads[0][9] > 0.0
    np.testing.assert_allclose(spreads[1][3:6], 3.0 * spreads[0][3:6], rtol=1e-9)
    np.testing.assert_allclose(spreads[1][9:12], 6.0 * spreads[0][9:12], rtol=1e-9)


def test_the_derivative_of_the_whole_law_is_that_of_the_step(scene):
    """With all contacts, plain normals and a varying force, F_t is the derivative of the simulator."""
    start = scene[1]
    tight = type(start)(start.mean, 1e-14 * np.tile(np.eye(12), (2, 1, 1)))
    whole = NumericalLinearization(contacts="all", regularisation=0.0, force="whole")
    found = covariance((scene[0], tight, 0.7), whole)
    points = covariance((scene[0], tight, 0.7), make_propagator("sigma_points", points="full"))
    np.testing.assert_allclose(found, points, rtol=0.0, atol=1e-3 * np.abs(points).max())


def test_regenerated_points_are_the_persistent_ones_without_contact():
    scene, belief, _ = collision_free("linear_velocity")
    found = covariance((scene, belief, 0.5), RegeneratedSigmaPoints(points="full"))
    expected = covariance((scene, belief, 0.5), make_propagator("sigma_points", points="full"))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9)
