"""Proper scores: the truth scores best; ranks are uniform where predictions are right."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics.calibration.scores import (
    angle,
    energy_score,
    fair_brier_score,
    gaussian_scores,
    lies_alike,
    pose_errors,
    rotation_energy_score,
)
from unc_physics.spatial import quaternions


def plain_energy_score(distance, samples, observed):
    """Both means, pair by pair."""
    first = np.mean([distance(x, observed) for x in samples])
    return first - 0.5 * np.mean([distance(x, y) for x in samples for y in samples])


def test_energy_scores_are_what_their_definition_says():
    rng = np.random.default_rng(0)
    x, y = rng.standard_normal((9, 3)), rng.standard_normal(3)
    assert energy_score(x, y) == pytest.approx(
        plain_energy_score(lambda a, b: np.linalg.norm(a - b), x, y), rel=1e-9
    )
    q, p = Rotation.random(9, random_state=1).as_quat(), Rotation.random(random_state=2).as_quat()

    def matrices(a, b):
        a, b = (Rotation.from_quat(one).as_matrix() for one in (a, b))
        return np.linalg.norm(a - b) / np.sqrt(2.0)

    assert rotation_energy_score(q, p) == pytest.approx(plain_energy_score(matrices, q, p), rel=1e-6)

    def turn(a, b):
        return (Rotation.from_quat(a) * Rotation.from_quat(b).inv()).magnitude()

    assert rotation_energy_score(q, p, angle) == pytest.approx(plain_energy_score(turn, q, p), rel=1e-6)


def test_few_samples_are_scored_as_many_on_average():
    """Where they were not, a search with few samples would make predictions too narrow, or too wide."""
    rng = np.random.default_rng(0)

    def means(count, rounds):
        own = []
        for _ in range(rounds):
            x, y = rng.standard_normal((count, 3)), rng.standard_normal(3)
            plain, fair = energy_score(x, y), energy_score(x, y, fair=True)
            own.append((plain, fair, gaussian_scores(x - x.mean(axis=0), y - x.mean(axis=0), 50.0)[0]))
        return np.mean(own, axis=0), np.std(own, axis=0) / np.sqrt(rounds)

    (few, error), (many, _) = means(8, 1500), means(150, 1500)
    assert np.all(np.abs(few - many)[1:] < 5.0 * error[1:])
    assert few[0] - many[0] > 7.0 * error[0]
    q, p = Rotation.random(5, random_state=1).as_quat(), Rotation.random(random_state=2).as_quat()
    first = rotation_energy_score(q, p) - rotation_energy_score(q, p, fair=True)
    between = np.mean([2.0 * np.sqrt(max(1.0 - (a @ b) ** 2, 0.0)) for a in q for b in q])
    assert first == pytest.approx(0.5 * between / 4.0)


def test_the_logarithmic_score_of_a_gaussian():
    rng = np.random.default_rng(0)
    observed = rng.standard_normal((300, 3))
    means = [
        np.mean([gaussian_scores(s * rng.standard_normal((50, 3)), y, 30.0)[0] for y in observed])
        for s in (0.3, 1.0, 3.0)
    ]
    assert min(means) == means[1]
    # of one that nothing foresaw: the wide Gaussian's, of a share of 5 %
    x = 1e-3 * rng.standard_normal((50, 1))
    assert gaussian_scores(x, np.array([2.0]), 1.0)[0] == pytest.approx(2.0 - np.log(0.05))


def test_the_brier_score_of_few_samples_is_that_of_many_on_average():
    assert fair_brier_score(np.ones(50, bool)) == 0.0 and fair_brier_score(np.zeros(50, bool)) == 1.0
    rng = np.random.default_rng(0)
    found = [fair_brier_score(rng.random(4) < 0.3) for _ in range(4000)]
    assert np.mean(found) == pytest.approx(0.49, abs=4.0 * np.std(found) / 63.0)


def test_ranks_are_uniform_where_predictions_are_right():
    rng, root = np.random.default_rng(0), np.array([[1.0, 0, 0], [2.0, 0.1, 0], [0, 0.3, 5.0]])
    ranks = np.sort([gaussian_scores(*_drawn(rng, root), 1.0)[1] for _ in range(400)])
    assert np.abs(ranks - (np.arange(400) + 0.5) / 400).max() < 0.08
    narrow = [gaussian_scores(*_drawn(rng, root, 0.3), 1.0)[1] for _ in range(100)]
    assert np.mean(np.array(narrow) <= 0.9) < 0.4


def _drawn(rng, root, spread=1.0):
    return spread * rng.standard_normal((200, 3)) @ root.T, root @ rng.standard_normal(3)


def test_errors_of_poses_are_from_the_mean_rotation():
    middle, turns = Rotation.random(random_state=3), 0.3 * np.random.default_rng(4).standard_normal((40, 3))
    turns -= turns.mean(axis=0)
    states = np.zeros((40, 13))
    states[:, 6:10] = (middle * Rotation.from_rotvec(turns)).as_quat()
    seen = np.concatenate([[1.0, 2.0, 3.0], -middle.as_quat()])
    errors = pose_errors(states, seen)
    np.testing.assert_allclose(errors.rotation.mean(axis=0), 0.0, atol=1e-8)
    np.testing.assert_allclose(errors.rotation - errors.seen_rotation, turns, atol=0.02)
    np.testing.assert_allclose(errors.seen_position, [1.0, 2.0, 3.0])


def test_what_lies_alike_has_the_same_side_up():
    first = Rotation.from_euler("x", 1.0)
    others = [
        Rotation.from_euler("z", 2.0) * first,
        Rotation.from_euler("x", 1.3),
        Rotation.from_euler("x", 2.5),
    ]
    alike = lies_alike(np.array([one.as_quat() for one in others]), first.as_quat())
    assert alike.tolist() == [True, True, False]


def test_quaternions():
    a, b = Rotation.random(5, random_state=0), Rotation.random(5, random_state=1)
    np.testing.assert_allclose(
        Rotation.from_quat(quaternions.product(a.as_quat(), b.as_quat())).as_matrix(), (a * b).as_matrix()
    )
    np.testing.assert_allclose(quaternions.rotation_vectors(a.as_quat()), a.as_rotvec())
    np.testing.assert_array_equal(quaternions.rotation_vectors(np.array([0.0, 0.0, 0.0, 1.0])), 0.0)
