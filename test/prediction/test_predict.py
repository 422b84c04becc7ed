"""The driver: horizon, times, progress, limits of time; a belief given by the library, without a file."""

import numpy as np
import pytest

from unc_physics import (
    PROPAGATORS,
    Belief,
    ErrorCode,
    Prediction,
    RigidBody,
    Scene,
    load_model,
    make_propagator,
    predict,
)
from unc_physics.checks.errors import (
    DivergedError,
    InvalidCovarianceError,
    InvalidHorizonError,
    InvalidOptionError,
    InvalidOrientationError,
    InvalidRequestError,
    LimitExceededError,
    NotFiniteError,
    PredictionTimeoutError,
    UncPhysicsError,
    UnknownPropagatorError,
)
from unc_physics.propagators.base import Anytime, Samples


@pytest.fixture(scope="module")
def scene_and_belief(loaded):
    scene, belief, _ = loaded("two_bodies")
    return scene, belief


def same(a, b):
    np.testing.assert_array_equal(a.mean, b.mean)
    np.testing.assert_array_equal(a.covariance, b.covariance)


@pytest.mark.parametrize("name", PROPAGATORS)
def test_library_use_without_a_file(name):
    model = load_model("pin").prefix(10)
    scene = Scene([RigidBody("pin", model, 1.5), RigidBody("other", model, 1.0)], dt=0.01, stiffness=1e4)
    mean = np.zeros((2, 13))
    mean[:, 9] = 1.0
    mean[1, 0], mean[1, 3] = 1.0, -1.0
    P = np.zeros((2, 12, 12))
    P[1, :3, :3] = 1e-4 * np.eye(3)
    prediction = predict(scene, Belief(mean, P), name, 0.5)
    assert isinstance(prediction, Prediction)
    assert prediction.time == pytest.approx(0.5)
    assert prediction.belief.mean.shape == (2, 13)
    assert prediction.belief.joint.shape == (24, 24)
    assert prediction.belief.mean[1, 0] == pytest.approx(0.5, abs=0.01)
    assert prediction.wall_time > 0.0


def test_round_off_makes_no_other_step(scene_and_belief):
    scene, belief = scene_and_belief
    assert predict(scene, belief, horizon=0.3).time == pytest.approx(0.3)  # 0.3 / 0.01 is below 30 in floats


@pytest.mark.parametrize(
    "name", [name for name, kind in PROPAGATORS.items() if not issubclass(kind, Anytime)]
)
def test_a_trajectory_holds_what_shorter_predictions_give(scene_and_belief, name):
    scene, belief = scene_and_belief
    propagator = make_propagator(
        name, **({"samples": 10} if "samples" in PROPAGATORS[name].options() else {})
    )
    prediction = predict(scene, belief, propagator, 0.9, times=[0.01, 0.3, 0.6])
    np.testing.assert_allclose(prediction.times, [0.01, 0.3, 0.6, 0.9])
    shares = isinstance(propagator, Samples) and propagator.resamples  # a surface of several times
    for time, now in zip(prediction.times, prediction.beliefs, strict=True):
        alone = predict(scene, belief, propagator, time)
        if shares:
            np.testing.assert_array_equal(prediction.at(time).rollout_states, alone.at().rollout_states)
            np.testing.assert_allclose(now.mean, alone.belief.mean, atol=0.05)
        else:
            same(now, alone.belief)
    assert prediction.belief is prediction.beliefs[-1]


def test_times_alone_need_no_horizon(scene_and_belief):
    assert predict(*scene_and_belief, times=[0.1, 0.2]).times == pytest.approx((0.1, 0.2))


def test_one_time_counts_once(scene_and_belief):
    assert predict(*scene_and_belief, horizon=0.1, times=[0.1 - 1e-12, 0.1]).times == pytest.approx((0.1,))


def test_progress_ascends_to_the_end_and_changes_nothing(scene_and_belief):
    calls = []
    prediction = predict(
        *scene_and_belief, "sigma_points", 0.9, times=[0.33], progress=lambda *call: calls.append(call)
    )
    done = [done for done, _ in calls]
    assert done == sorted(done) and done[-1] == 90 and {total for _, total in calls} == {90}
    assert len(calls) >= 2
    same(prediction.belief, predict(*scene_and_belief, "sigma_points", 0.9).belief)


def test_progress_may_end_the_prediction(scene_and_belief):
    class Stop(Exception):
        pass

    def stop(done, total):
        raise Stop

    with pytest.raises(Stop):
        predict(*scene_and_belief, horizon=1.0, progress=stop)


def test_a_generous_computation_time_changes_nothing(scene_and_belief):
    allowed = predict(*scene_and_belief, horizon=0.9, max_computation_time=1000.0)
    same(allowed.belief, predict(*scene_and_belief, horizon=0.9).belief)


def test_the_computation_time_that_ran_out_leaves_what_was_reached(scene_and_belief):
    with pytest.raises(PredictionTimeoutError, match="max_computation_time .* of 10 s simulated") as caught:
        predict(*scene_and_belief, horizon=10.0, max_computation_time=1e-9)
    reached = caught.value.prediction
    assert 0.0 < reached.time < 10.0
    same(reached.belief, predict(*scene_and_belief, horizon=reached.time).belief)
    assert caught.value.code == ErrorCode.TIMEOUT


def test_a_limit_ends_a_step_of_many_samples(scene_and_belief):
    many = make_propagator("monte_carlo", samples=2000)
    with pytest.raises(PredictionTimeoutError, match="before the first step") as caught:
        predict(*scene_and_belief, many, 10.0, max_computation_time=1e-6)
    assert caught.value.prediction is None


@pytest.mark.parametrize("seconds", [0.0, -1.0, np.nan, np.inf, "soon"])
def test_a_computation_time_that_is_none(scene_and_belief, seconds):
    with pytest.raises(UncPhysicsError, match="max_computation_time"):
        predict(*scene_and_belief, horizon=1.0, max_computation_time=seconds)


@pytest.mark.parametrize(
    "horizon, error",
    [(horizon, InvalidHorizonError) for horizon in (0.0, -1.0, 0.004, "abc", True, [1.0])]
    + [(horizon, NotFiniteError) for horizon in (np.nan, -np.inf)]
    + [(1e300, LimitExceededError)],
)
def test_a_horizon_that_is_none(scene_and_belief, horizon, error):
    with pytest.raises(error, match="horizon"):
        predict(*scene_and_belief, horizon=horizon)


def test_no_horizon_at_all(scene_and_belief):
    for arguments in ({}, {"times": []}):
        with pytest.raises(InvalidHorizonError, match="horizon"):
            predict(*scene_and_belief, **arguments)


@pytest.mark.parametrize("times", [[0.2, 0.1], [0.5], [0.0], [-0.1], [np.nan], ["x"]])
def test_times_that_make_no_trajectory(scene_and_belief, times):
    with pytest.raises(UncPhysicsError, match="times|horizon"):
        predict(*scene_and_belief, horizon=0.3, times=times)


def test_an_unknown_propagator(scene_and_belief):
    with pytest.raises(UnknownPropagatorError, match="kalman.*|.*kalman"):
        predict(*scene_and_belief, "kalman", 1.0)


@pytest.mark.parametrize(
    "name, options",
    [
        ("monte_carlo", {"samples": 0}),
        ("monte_carlo", {"samples": True}),
        ("monte_carlo", {"seed": "abc"}),
        ("sigma_points", {"points": "many"}),
        ("sigma_points", {"samples": 3}),
        ("surrogate", {"k_sigma": 0.0}),
        ("local_sampling", {"seed": 1.5}),
    ],
)
def test_an_option_that_no_propagator_takes(name, options):
    ((field, _),) = options.items()
    with pytest.raises(InvalidOptionError, match=field):
        make_propagator(name, **options)


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
    scene, belief = scene_and_belief
    three = loaded("three_bodies").scene
    with pytest.raises(InvalidRequestError, match="as many bodies as the scene has, 3, not 2"):
        predict(three, belief, horizon=1.0)
    with pytest.raises(InvalidRequestError, match="moving"):
        predict(scene, Belief(belief.mean, belief.blocks[:1], [0]), horizon=1.0)


def broken(belief, place, value):
    mean = belief.mean.copy()
    mean[place] = value
    return mean


def test_a_mean_that_is_no_state(scene_and_belief):
    _, belief = scene_and_belief
    P = belief.covariance
    for value in (np.nan, np.inf):
        for c in range(13):
            with pytest.raises(NotFiniteError):
                Belief(broken(belief, (1, c), value), P)
    with pytest.raises(InvalidOrientationError, match="body 1"):
        Belief(broken(belief, (1, slice(6, 10)), [0, 0, 0, 1.1]), P)
    with pytest.raises(InvalidOrientationError):
        Belief(broken(belief, (1, slice(6, 10)), 0.0), P)
    with pytest.raises(InvalidRequestError, match="mean"):
        Belief(belief.mean[:, :12], P)


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


def test_moving_must_name_bodies(scene_and_belief):
    belief = scene_and_belief[1]
    for moving in ([0, 7], [0, 0], [1, 0], [-1, 0], [0.5, 1], "ab"):
        with pytest.raises(UncPhysicsError, match="moving"):
            Belief(belief.mean, belief.covariance, moving)


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


def test_quaternions_near_unit_length_are_normalized(scene_and_belief):
    mean = scene_and_belief[1].mean.copy()
    mean[:, 6:10] *= 1.0005
    np.testing.assert_allclose(
        np.linalg.norm(Belief(mean, scene_and_belief[1].covariance).mean[:, 6:10], axis=1), 1.0
    )


def test_joint_blocks_and_marginals_agree(scene_and_belief):
    belief = scene_and_belief[1]
    again = Belief(belief.mean, belief.joint)
    assert belief.independent and not again.independent
    np.testing.assert_array_equal(again.blocks, belief.blocks)
    np.testing.assert_array_equal(again.marginal(1), belief.blocks[1])


@pytest.mark.parametrize("bodies", [["a"], RigidBody("a", load_model("pin").prefix(1), 1.0)])
def test_bodies_that_are_none(bodies):
    with pytest.raises(UncPhysicsError, match="bodies"):
        Scene(bodies)


@pytest.mark.parametrize("field, value", [("model", "pin"), ("fixed", "no"), ("name", 3)])
def test_a_field_of_a_body_that_cannot_be(field, value):
    with pytest.raises(UncPhysicsError, match=field):
        RigidBody(**({"name": "a", "model": load_model("pin").prefix(1)} | {field: value}))
