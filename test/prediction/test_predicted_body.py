"""A prediction's bodies by name: where they are, how surely, and what they touch."""

import numpy as np
import pytest

from unc_physics import (
    AtRest,
    Belief,
    BodyBelief,
    BoxRegion,
    InRegion,
    Plane,
    RigidBody,
    Scene,
    Touches,
    UncPhysicsError,
    assess,
    load_model,
    make_propagator,
    predict,
)
from unc_physics.spatial.rotation import rotation_matrix

ROUND_OFF = 1e-12
REGION = BoxRegion("here", (1.0, 1.0, 1.0))


@pytest.fixture(scope="module")
def tumbling():
    """A mug in free flight, and a fixed one; its model's own origin is off the centre of mass."""
    mug = load_model("mug").prefix(20)
    assert np.abs(mug.origin).max() > 1e-3, "the case must tell the origins apart"
    scene = Scene(
        [RigidBody("mug", mug), RigidBody("post", mug, fixed=True)],
        gravity=(0.0, 0.0, 0.0),
        environment=[Plane(offset=-9.0)],
    )
    rng = np.random.default_rng(3)
    A = 0.01 * rng.standard_normal((12, 12))
    belief = Belief.of(
        scene,
        {
            "mug": BodyBelief(
                position=(0, 0, 2),
                orientation=(0.5, 0.5, 0.5, 0.5),
                linear_velocity=(0.1, 0.2, 0.3),
                angular_velocity=(0.4, -0.5, 0.6),
                covariance=A @ A.T,
            ),
            "post": BodyBelief(position=(0, 0, -5)),
        },
    )
    return predict(scene, belief, make_propagator("monte_carlo", samples=4000, seed=2), 0.2, times=[0.1])


def test_a_body_s_numbers_are_those_of_the_belief(tumbling):
    mug, belief = tumbling["mug"], tumbling.belief
    x, P = belief.mean[0], belief.marginal(0)
    assert (mug.name, mug.time, mug.fixed) == ("mug", tumbling.time, False)
    together = [mug.position, mug.linear_velocity, mug.orientation, mug.angular_velocity]
    np.testing.assert_array_equal(np.concatenate(together), x)
    np.testing.assert_array_equal(mug.covariance("error_state"), P)
    R = rotation_matrix(x[6:10])
    np.testing.assert_allclose(mug.rotation_std, np.sqrt((R @ P[6:9, 6:9] @ R.T).diagonal()), rtol=1e-12)
    np.testing.assert_allclose(mug.position_std, np.sqrt(P.diagonal()[:3]), rtol=1e-12)
    np.testing.assert_allclose(mug.linear_velocity_std, np.sqrt(P.diagonal()[3:6]), rtol=1e-12)
    np.testing.assert_allclose(mug.angular_velocity_std, np.sqrt(P.diagonal()[9:]), rtol=1e-12)
    T = np.zeros((6, 12))
    T[:3, :3], T[3:, 6:9] = np.eye(3), R
    np.testing.assert_allclose(mug.covariance("ros"), T @ P @ T.T, atol=ROUND_OFF)
    np.testing.assert_array_equal(mug.samples(5), tumbling.samples(5)[:, 0])
    mug.position[:] = 7.0  # a copy
    np.testing.assert_array_equal(mug.position, x[:3])


def test_at_the_model_s_origin_samples_and_moments_agree(tumbling):
    """Positions and velocities of the origin in samples; its mean by the mean rotation to second order."""
    mug = tumbling.body("mug", origin="model")
    samples = mug.samples()
    np.testing.assert_allclose(samples[:, :3].mean(axis=0), mug.position, atol=ROUND_OFF)
    np.testing.assert_allclose(samples[:, 3:6].mean(axis=0), mug.linear_velocity, atol=ROUND_OFF)
    np.testing.assert_allclose(samples[:, :3].std(axis=0), mug.position_std, rtol=2e-3)
    np.testing.assert_allclose(samples[:, 3:6].std(axis=0), mug.linear_velocity_std, rtol=2e-3)
    P = mug.covariance("error_state")
    np.testing.assert_allclose(np.cov(samples[:, :6].T, bias=True), P[:6, :6], atol=2e-3 * P.diagonal().max())
    centre = tumbling["mug"]
    np.testing.assert_allclose(P[6:, 6:], centre.covariance("error_state")[6:, 6:], atol=ROUND_OFF)
    S = centre.covariance("error_state")[6:9, 6:9]
    mean_rotation = rotation_matrix(centre.orientation) @ (np.eye(3) + 0.5 * (S - np.trace(S) * np.eye(3)))
    offset = mean_rotation @ tumbling.scene.bodies[0].model.origin
    np.testing.assert_allclose(mug.position, centre.position + offset, atol=2e-6)
    np.testing.assert_array_equal(mug.samples(3), samples[:3])


def test_a_fixed_body_is_certain(tumbling):
    post = tumbling["post"]
    assert post.fixed and not post.covariance().any() and not post.position_std.any()
    low = BoxRegion("low", (1, 1, 1), (0, 0, -5))
    for event, expected in (
        (AtRest("post"), 1.0),
        (InRegion("post", low), 1.0),
        (InRegion("post", REGION), 0.0),
    ):
        found = tumbling.probability(event)
        assert found.low == found.estimate == found.high == expected and found.method == "certain"
    assert [mode.weight for mode in post.modes] == [1.0]


def test_trajectories_hold_each_time(tumbling):
    way = tumbling.trajectory("mug")
    np.testing.assert_array_equal(way.times, tumbling.times)
    for k, (time, belief) in enumerate(zip(tumbling.times, tumbling.beliefs, strict=True)):
        np.testing.assert_array_equal(way.positions[k], belief.mean[0, :3])
        np.testing.assert_array_equal(way.orientations[k], belief.mean[0, 6:10])
        np.testing.assert_array_equal(way.covariances[k], belief.marginal(0))
        body = tumbling.body("mug", time=time)
        np.testing.assert_array_equal(way.position_stds[k], body.position_std)
        np.testing.assert_array_equal(way.rotation_stds[k], body.rotation_std)
    assert way.covariances.shape == (2, 12, 12)


@pytest.mark.parametrize(
    "ask, words",
    [
        (lambda p: p["mgu"], "is no body of the scene; did you mean 'mug'"),
        (lambda p: p["x"], "there are mug, post"),
        (lambda p: p[0], r"must be the name of a body; prediction.bodies has them all \(got 0\)"),
        (
            lambda p: p.body("mug", time=0.05),
            r"time is no time of the prediction, of which 0.1 s is the nearest; .* \(got 0.05\)",
        ),
        (lambda p: p.body("mug", origin="com"), "origin must be one of center_of_mass, model"),
        *((lambda p, n=n: p.samples(n), "count must be") for n in (0, -1, 2.5, True, "all")),
        (lambda p: p.samples(4001), r"count must be at most the 4000 samples .*4001"),
        (lambda p: p["mug"].covariance("body"), "convention must be one of ros, error_state"),
        (lambda p: p["mug"].status(rollouts=1), r"rollouts must be 0, or at least 2 \(got 1\)"),
        (lambda p: p["mug"].status(rollouts=-3), r"rollouts must be at least 0 \(got -3\)"),
        (lambda p: p["mug"].status(rollouts="x"), r"rollouts must be an integer \(got 'x'\)"),
        *[
            (ask, "prediction is an empty slice, without any time; take a slice that contains")
            for ask in (
                lambda p: p[:0].time,
                lambda p: p[:0].belief,
                lambda p: p[:0].carry,
                lambda p: p[:0].at(0.1),
                lambda p: p[:0]["mug"],
                lambda p: p[:0].to_dict(),
                lambda p: assess(p[:0]),
            )
        ],
        (lambda p: p.probability(Touches("mug", "pots")), "event.other is neither .* did you mean 'post'"),
        (lambda p: p.contact_time(Touches("mug", "pots")), "event.other is neither .* did you mean 'post'"),
        (lambda p: p.probability(Touches("post", "plane_0")), "'post' can touch, as neither moves freely"),
    ],
)
def test_what_cannot_be_answered_is_named(tumbling, ask, words):
    with pytest.raises(UncPhysicsError, match=words):
        ask(tumbling)


def test_an_empty_slice_prints_the_physics_alone(tumbling):
    assert str(tumbling[:0]) == str(tumbling).splitlines()[0]


def test_a_prediction_says_what_to_iterate_over(tumbling):
    with pytest.raises(TypeError, match=r"prediction\.bodies.*prediction\.snapshots"):
        list(tumbling)
    with pytest.raises(TypeError, match="not iterable"):
        "post" in tumbling  # noqa: B015
    assert [body.name for body in tumbling.bodies] == [body.name for body in tumbling.scene.bodies]


def test_slices_are_predictions(tumbling):
    assert tumbling[1:].times == tumbling.times[1:] and tumbling[1:].time == tumbling.time
    assert tumbling[:1].belief is tumbling.beliefs[0] and tumbling[:1].start is tumbling.start
    assert tumbling.at(0.1) is tumbling.snapshots[0] and tumbling.at() is tumbling.snapshots[-1]
