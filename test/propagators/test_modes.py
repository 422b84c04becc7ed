"""Outcomes that split: as many modes as there are, one where one suffices."""

import math

import numpy as np
import pytest

from unc_physics.propagators.modes import contains, split


def states(count, centers, shares, std=0.02, seed=0):
    """(count, 13): poses about some centres (k, 3), of which each has a share."""
    rng = np.random.default_rng(seed)
    which = rng.choice(len(centers), count, p=shares)
    out = np.zeros((count, 13))
    out[:, :3] = np.asarray(centers)[which] + std * rng.standard_normal((count, 3))
    out[:, 3:6] = rng.standard_normal((count, 3))
    tilt = 0.1 * rng.standard_normal((count, 3))
    out[:, 6:9], out[:, 9] = np.sin(0.5 * tilt), 1.0
    out[:, 6:10] /= np.linalg.norm(out[:, 6:10], axis=1, keepdims=True)
    return out


@pytest.mark.parametrize("rollouts", [32, 1000])
def test_two_groups_are_two_modes(rollouts):
    found = split(states(rollouts, [[0, 0, 0.4], [0.2, 0, 0.05]], [0.7, 0.3]), 0.06)
    assert [mode[0] for mode in found] == pytest.approx([0.7, 0.3], abs=0.2 if rollouts < 100 else 0.05)
    assert sum(mode[0] for mode in found) == pytest.approx(1.0)
    np.testing.assert_allclose([mode[1][:3] for mode in found], [[0, 0, 0.4], [0.2, 0, 0.05]], atol=0.02)
    for _, _, P in found:
        np.testing.assert_allclose(np.diagonal(P)[:3], 0.02**2, rtol=2.0 if rollouts < 100 else 0.3)
        assert np.linalg.eigvalsh(P)[0] > -1e-15


@pytest.mark.parametrize("rollouts", [12, 32, 1000])
def test_one_group_is_one_mode(rollouts):
    """Also a skewed one, and one that is flat between its ends; a dozen often leave a gap by chance."""
    rng = np.random.default_rng(1)
    normal = states(rollouts, [[0.0, 0.0, 0.0]], [1.0])
    skewed, flat = normal.copy(), normal.copy()
    skewed[:, 0] = rng.exponential(0.05, rollouts)
    flat[:, 1] = rng.uniform(-0.1, 0.1, rollouts)
    for case in (normal, skewed, flat)[: 1 if rollouts == 12 else 3]:
        assert len(split(case, 0.06)) == 1
    others = [
        states(rollouts, [[0.0, 0.0, 0.0]], [1.0], seed=seed) for seed in range(2, 2 + 1000 // rollouts)
    ]
    assert sum(len(split(case, 0.06)) > 1 for case in others) <= 1


def test_the_mean_of_two_groups_is_in_a_group_of_nearly_all():
    """Of shares p and 1 - p, it is p times their distance from the second group's mean."""
    for share, distance, inside in ((0.1, 0.15, True), (0.1, 0.3, False), (0.5, 0.15, False)):
        case = states(4000, [[0.0, 0.0, 0.0], [distance, 0.0, 0.0]], [1.0 - share, share])
        mean = case.mean(axis=0)
        mean[6:10] = 0.0, 0.0, 0.0, 1.0
        modes = split(case, 0.06)
        assert len(modes) == 2
        assert any(contains(mode, mean, 0.06) for mode in modes) == inside


def test_a_small_group_is_not_cut_in_two():
    """Of poses that are turned by half a turn or not at all."""
    for count, share in ((64, 0.5), (64, 0.2), (200, 0.3)):
        rng, turned = np.random.default_rng(3), states(count, [[0.0, 0.0, 0.0]], [1.0])
        angle = np.where(rng.random(count) < share, math.pi, 0.0) + 0.1 * rng.standard_normal(count)
        turned[:, 6:10] = 0.0
        turned[:, 8], turned[:, 9] = np.sin(0.5 * angle), np.cos(0.5 * angle)
        found = split(turned, 0.06)
        assert len(found) == 2
        assert sorted(round(2.0 * math.acos(min(abs(mode.mean[9]), 1.0))) for mode in found) == [0, 3]


def test_a_small_group_far_away_is_a_mode():
    """Of 2 % of the rollouts, on the floor; and not what three of a thousand of one group happen to be."""
    found = split(states(300, [[0, 0, 0.4], [0.1, 0.3, 0.4], [0.2, 0, 0.0]], [0.58, 0.4, 0.02]), 0.06)
    assert [round(mode.mean[2], 1) for mode in found] == [0.4, 0.4, 0.0]
    assert found[-1].weight == pytest.approx(0.02, abs=0.015)
    for seed in range(20):
        assert len(split(states(1000, [[0.0, 0.0, 0.0]], [1.0], seed=seed), 0.06)) == 1


def test_groups_as_close_as_what_is_ignored_are_one_mode():
    """A body that rests in two ways a micrometre apart, beside a way far from both."""
    places = [[0.0, 0.0, 0.0], [1e-6, 0.0, 0.0], [0.3, 0.0, -0.6]]
    case = states(400, places, [0.6, 0.1, 0.3], std=1e-8)
    case[:, 6:10] = 0.0, 0.0, 0.0, 1.0
    far = (case[:, 2] < -0.3).mean()
    assert [mode.weight for mode in split(case, 0.06)] == pytest.approx([1.0 - far, far])
