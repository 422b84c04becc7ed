"""Errors of shares of quasi-random rollouts, for events of known probability."""

import numpy as np
import pytest
from plain_scenes import BALL, independent, state
from scipy.stats import norm

from unc_physics import BoxRegion, InRegion, Plane, RigidBody, Scene, make_propagator, predict
from unc_physics.prediction.probability import interval
from unc_physics.propagators.share_errors import effective_counts, residual_maps
from unc_physics.propagators.sobol import normal_points


@pytest.mark.parametrize("dimensions", [2, 6, 24])
@pytest.mark.parametrize("count", [32, 128])
def test_intervals_contain_probabilities_of_half_spaces(count, dimensions):
    """And are narrower than binomial ones where few directions are uncertain."""
    rng, borders = np.random.default_rng(0), np.linspace(-2.0, 2.0, 9)
    ratios = []
    for seed in range(20):
        z = normal_points(count, dimensions, seed)
        along = z @ (direction := rng.standard_normal(dimensions)) / np.linalg.norm(direction)
        happened = along < borders[:, None]
        counts = effective_counts(residual_maps(z), happened)
        for share, effective, truth in zip(happened.mean(axis=1), counts, norm.cdf(borders), strict=True):
            low, high = interval(float(share), float(effective))
            assert low <= truth <= high
        ratios.append(counts[4] / count)
    assert np.median(ratios) > {2: 3.0, 6: 1.5, 24: 0.99}[dimensions]


def test_events_without_relation_to_the_points_count_as_independent():
    z, rng = normal_points(128, 4, 0), np.random.default_rng(0)
    happened = np.vstack([rng.random((50, 128)) < 0.5, np.zeros((1, 128)), np.ones((1, 128))]).astype(bool)
    ratios = effective_counts(residual_maps(z), happened) / 128
    assert ratios[:-2].mean() < 1.05 and (ratios[-2:] == 1.0).all()


def test_auto_needs_fewer_rollouts_where_neighbours_predict_the_event():
    """A ball ends left of its mean with probability 1/2: 278 independent rollouts have an error of .03."""
    scene = Scene.everyday([RigidBody("ball", BALL, 0.2)], exact=True, environment=[Plane(offset=-9.0)])
    belief = independent(state((0, 0, 1)), position=0.02, velocity=0.1)
    left = InRegion("ball", BoxRegion("left", (2.0, 20.0, 20.0), (-1.0, 0.0, 0.0)))
    found = predict(scene, belief, make_propagator("auto"), 0.2, events=[left]).probability(left)
    assert 32 < found.rollouts < 200 and found.low <= 0.5 <= found.high < found.low + 0.21
