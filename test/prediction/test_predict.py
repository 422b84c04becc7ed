"""The driver: horizon, times, progress, limits of time; what is a belief."""

import numpy as np
import pytest

from unc_physics import PROPAGATORS, Belief, ErrorCode, make_propagator, predict
from unc_physics.checks.errors import (
    DivergedError,
    InvalidCovarianceError,
    InvalidHorizonError,
    InvalidOrientationError,
    InvalidRequestError,
    LimitExceededError,
    NotFiniteError,
    PredictionTimeoutError,
    UncPhysicsError,
)


@pytest.fixture(scope="module")
def scene_and_belief(loaded):
    scene, belief, _ = loaded("two_bodies")
    return scene, belief


def same(a, b):
    np.testing.assert_array_equal(a.mean, b.mean)
    np.testing.assert_array_equal(a.covariance, b.covariance)


@pytest.mark.parametrize(
    ("arguments", "times"),
    [
        ({"horizon": 0.3}, [0.3]),  # 0.3 / 0.01 is below 30 in floats
        ({"times": [0.1, 0.2]}, [0.1, 0.2]),
        ({"horizon": 0.1, "times": [0.1 - 1e-12, 0.1]}, [0.1]),
    ],
)
def test_times_of_an_answer(scene_and_belief, arguments, times):
    assert predict(*scene_and_belief, **arguments).times == pytest.approx(times)


def test_progress_ascends_to_the_end_and_changes_nothing(scene_and_belief):
    calls = []
    prediction = predict(
        *scene_and_belief, "sigma_points", 0.9, times=[0.33], progress=lambda *call: calls.append(call)
    )
    done = [done for done, _ in calls]
    assert done == sorted(done) and done[-1] == 90 and {total for _, total in calls} == {90}
    assert len(calls) >= 2
    same(prediction.belief, predict(*scene_and_belief, "sigma_points", 0.9).belief)


def test_the_computation_time_that_ran_out_leaves_what_was_reached(scene_and_belief):
    with pytest.raises(PredictionTimeoutError, match="max_computation_time .* of 10 s simulated") as caught:
        predict(*scene_and_belief, horizon=10.0, max_computation_time=1e-9)
    reached = caught.value.prediction
    assert 0.0 < reached.time < 10.0
    same(reached.belief, predict(*scene_and_belief, horizon=reached.time).belief)
    assert caught.value.code == ErrorCode.TIMEOUT


@pytest.mark.parametrize(
    "arguments, error, words",
    [
        *(({"horizon": h}, InvalidHorizonError, "horizon") for h in (0.0, -1.0, 0.004, "abc", True, [1.0])),
        *(({"horizon": h}, NotFiniteError, "horizon") for h in (np.nan, -np.inf)),
        ({"horizon": 1e300}, LimitExceededError, "horizon"),
        *((given, InvalidHorizonError, "horizon") for given in ({}, {"times": []})),
        *(
            ({"horizon": 0.3, "times": times}, UncPhysicsError, "times|horizon")
            for times in ([0.2, 0.1], [0.5], [0.0], [-0.1], [np.nan], ["x"])
        ),
        *(
            ({"horizon": 1.0, "max_computation_time": seconds}, UncPhysicsError, "max_computation_time")
            for seconds in (0.0, -1.0, np.nan, np.inf, "soon")
        ),
    ],
)
def test_times_that_are_none(scene_and_belief, arguments, error, words):
    with pytest.raises(error, match=words):
        predict(*scene_and_belief, **arguments)


@pytest.mark.parametrize("name", ["monte_carlo", "local_sampling"])
@pytest.mark.parametrize("seed", [2**63 - 1, 2**63, 2**64, 10**30])
def test_a_large_seed_works_or_is_refused(scene_and_belief, name, seed):
    """Seeds come from clocks and hashes; one that does not fit must say so."""
    try:
        propagator = make_propagator(name, samples=4, seed=seed)
    except UncPhysicsError as error:
        assert error.field == "seed"
    else:
        assert predict(*scene_and_belief, propagator, 0.5).seed == seed


def test_a_simulation_that_diverges_says_so(scene_and_belief):
    scene, belief = scene_and_belief
    mean = belief.mean.copy()
    mean[:, 3:6] = 1e308
    for name in PROPAGATORS:
        with pytest.raises(DivergedError, match="diverged"):
            predict(scene, Belief(mean, belief.covariance), name, 5.0)


# -- beliefs ---------------------------------------------------------------------------------------


def test_a_belief_for_other_bodies_is_refused(scene_and_belief, loaded):
    three = loaded("three_bodies").scene
    with pytest.raises(InvalidRequestError, match="as many bodies as the scene has, 3, not 2"):
        predict(three, scene_and_belief[1], horizon=1.0)


@pytest.mark.parametrize(
    "place, value, error",
    [((1, c), value, NotFiniteError) for value in (np.nan, np.inf) for c in range(13)]
    + [((1, slice(6, 10)), value, InvalidOrientationError) for value in ([0, 0, 0, 1.1], 0.0)],
)
def test_a_mean_that_is_no_state(scene_and_belief, place, value, error):
    _, belief = scene_and_belief
    mean = belief.mean.copy()
    mean[place] = value
    with pytest.raises(error, match="body 1|mean"):
        Belief(mean, belief.covariance)


def with_entry(size, place, value, base=1e-2):
    P = base * np.eye(size)
    P[place] = value
    return P


@pytest.mark.parametrize(
    "P, error, words",
    [
        (with_entry(24, (3, 3), np.nan), NotFiniteError, "covariance"),
        (with_entry(24, (3, 3), np.inf), NotFiniteError, "covariance"),
        (with_entry(24, (3, 3), -1e-2), InvalidCovarianceError, "negative variance at .3..3."),
        (with_entry(24, (3, 17), 1e-3), InvalidCovarianceError, "symmetric.*3..17"),
        (with_entry(24, ([3, 17], [17, 3]), 2e-2), InvalidCovarianceError, "negative eigenvalue"),
        (
            with_entry(24, ([0, 1], [1, 0]), 1e-9, base=0.0),
            InvalidCovarianceError,
            "diagonal of zeros.*1e-09",
        ),
        (np.eye(12), InvalidCovarianceError, "shape"),
        (np.zeros((3, 12, 12)), InvalidCovarianceError, "2 blocks, not 3"),
        (np.stack([np.eye(12), with_entry(12, (0, 1), 0.5)]), InvalidCovarianceError, "body 1.*symmetric"),
        ([[1.0, 2.0], [3.0]], InvalidCovarianceError, "covariance"),
        ("none", InvalidCovarianceError, "covariance"),
    ],
)
def test_a_matrix_that_is_no_covariance(scene_and_belief, P, error, words):
    with pytest.raises(error, match=words):
        Belief(scene_and_belief[1].mean, P)


@pytest.mark.parametrize("scale", [1e-12, 1e-6, 1.0, 1e6])
def test_round_off_in_a_covariance_is_forgiven(scene_and_belief, scale):
    """A rank-deficient covariance that another program rotated and summed, of any size."""
    rng = np.random.default_rng(0)
    root = np.sqrt(scale) * rng.standard_normal((24, 3))
    P = root @ root.T
    P += 1e-12 * scale * rng.standard_normal((24, 24))
    belief = Belief(scene_and_belief[1].mean, P)
    np.testing.assert_array_equal(belief.joint, belief.joint.T)
    assert np.isfinite(
        make_propagator("sigma_points", points="full").init(scene_and_belief[0], belief).states
    ).all()


def test_small_blocks_are_judged_by_their_own_size(scene_and_belief):
    """A rotation's covariance of 1e-10 rad^2 beside 1 m^2 must still be one."""
    P = np.diag([1.0] * 6 + [1e-10] * 6 + [1.0] * 12)
    P[6, 7] = P[7, 6] = 2e-10
    with pytest.raises(InvalidCovarianceError, match="eigenvalue"):
        Belief(scene_and_belief[1].mean, P)


def test_a_mean_has_all_columns(scene_and_belief):
    belief = scene_and_belief[1]
    with pytest.raises(InvalidRequestError, match="mean"):
        Belief(belief.mean[:, :12], belief.covariance)


def test_a_belief_is_frozen_and_keeps_its_own_copy(scene_and_belief):
    mean, P = scene_and_belief[1].mean.copy(), scene_and_belief[1].covariance.copy()
    belief = Belief(mean, P)
    mean[:], P[:] = 0.0, 0.0
    same(belief, scene_and_belief[1])
    for array in (belief.mean, belief.covariance):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    with pytest.raises(AttributeError):
        belief.mean = mean
    near = Belief(
        belief.mean * np.where(np.isin(np.arange(13), range(6, 10)), 1.0005, 1.0), belief.covariance
    )
    np.testing.assert_allclose(near.mean, belief.mean, atol=1e-12)  # quaternions are normalized
