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


def test_blocks_of_points_show_evenness_that_neighbours_do_not_predict():
    """Two of 60 directions have opposite signs in half of the outcomes: a regression on 60 finds nothing."""
    shares, ratios = [], []
    for seed in range(20):
        z = normal_points(128, 60, seed)
        happened = (z[:, 0] * z[:, 1] < 0.0)[None]
        ratios.append(effective_counts(residual_maps(z), happened)[0] / 128)
        shares.append(happened.mean())
    error = np.sqrt(np.mean((np.array(shares) - 0.5) ** 2))
    assert np.median(ratios) > 1.5 and 1.5 * 128 * error**2 < 0.25


def test_intervals_miss_as_rarely_as_they_say_without_a_pattern():
    """Of 4000 events each, a normal quantile of 1.96 leaves out 5 %: the ratio is estimated from 8 blocks."""
    z, rng = normal_points(64, 12, 0), np.random.default_rng(0)
    happened = rng.random((4000, 64)) < 0.4
    counts = effective_counts(residual_maps(z), happened)
    bounds = [interval(float(s), float(n), 1.96) for s, n in zip(happened.mean(axis=1), counts, strict=True)]
    assert np.mean([not low <= 0.4 <= high for low, high in bounds]) < 0.06


def test_events_without_relation_to_the_points_count_as_independent():
    z, rng = normal_points(128, 4, 0), np.random.default_rng(0)
    happened = np.vstack([rng.random((50, 128)) < 0.5, np.zeros((1, 128)), np.ones((1, 128))]).astype(bool)
    ratios = effective_counts(residual_maps(z), happened) / 128
    assert ratios[:-2].mean() < 1.12 and (ratios[-2:] == 1.0).all()


def test_auto_needs_fewer_rollouts_where_neighbours_predict_the_event():
    """A ball ends left of its mean with probability 1/2: 278 independent rollouts have an error of .03."""
    scene = Scene.everyday([RigidBody("ball", BALL, 0.2)], exact=True, environment=[Plane(offset=-9.0)])
    belief = independent(state((0, 0, 1)), position=0.02, velocity=0.1)
    left = InRegion("ball", BoxRegion("left", (2.0, 20.0, 20.0), (-1.0, 0.0, 0.0)))
    found = predict(scene, belief, make_propagator("auto"), 0.2, events=[left]).probability(left)
    assert 32 < found.rollouts < 200 and found.low <= 0.5 <= found.high < found.low + 0.21
