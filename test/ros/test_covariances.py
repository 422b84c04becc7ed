"""The rule for covariances of messages: repaired, not measured, exact, and refused."""

import numpy as np
import pytest
from scenes import floor, moving_object, request_of, with_physics

from unc_physics.checks.errors import ErrorCode, InvalidCovarianceError
from unc_physics.ros.messages.covariances import ANY_ANGLE_VARIANCE, EXACT

FIELD = "pose_covariance"
STDS = np.repeat([0.01, 0.05], 3)
HEIGHT_AND_TILT = (2, 3, 4)


def with_lever(rng, kind):
    """A covariance at a point 1 m from where it was measured, by an adjoint in a type of number."""
    A = np.eye(6)
    lever = rng.normal(size=3)
    A[:3, 3:] = np.cross(np.eye(3), lever / np.linalg.norm(lever))
    root = (A * STDS * rng.uniform(0.5, 1.0, 6)).astype(kind)
    return ((root @ root.T) @ np.eye(6, dtype=kind)).astype(float)


@pytest.mark.parametrize("form", ["single precision", "six decimals", "asymmetric", "rank one"])
def test_covariances_as_the_world_computes_them_are_taken(form):
    for seed in range(100):
        rng = np.random.default_rng(seed)
        P = with_lever(rng, np.float32 if form == "single precision" else float)
        if form == "six decimals":
            P = np.round(P, 6)
        elif form == "asymmetric":
            P += 1e-5 * P.max() * np.triu(rng.uniform(-1.0, 1.0, (6, 6)), 1)
        elif form == "rank one":
            P = np.round(np.outer(P[0], P[0]) / P[0, 0], 6)
        read = EXACT.known_pose(P.ravel(), FIELD).P
        assert np.array_equal(read, read.T)
        assert np.linalg.eigvalsh(read)[0] >= -1e-12 * read.max()
        assert np.abs(read - P).max() <= 1e-4 * P.max() + 3e-6


@pytest.mark.parametrize("share", [1e-3, 0.1])
@pytest.mark.parametrize("fault", ["asymmetric", "negative"])
def test_wrong_covariances_are_refused(fault, share):
    P = np.diag(np.square(STDS))
    P[0, 1] = share * P[0, 0]
    if fault == "negative":
        P[1, 0], P[0, 0] = P[0, 1], -P[0, 1]
    with pytest.raises(InvalidCovarianceError, match=FIELD):
        EXACT.known_pose(P.ravel(), FIELD)


@pytest.mark.parametrize("variance", [1e308, 1e10, 9999.0])
def test_what_was_not_measured_has_no_spread_of_its_own(variance):
    P = np.diag(np.square(STDS))
    P[HEIGHT_AND_TILT, HEIGHT_AND_TILT] = variance
    read = EXACT.known_pose(P.ravel(), FIELD)
    assert read.unmeasured == HEIGHT_AND_TILT and read.is_supported
    assert np.allclose(read.P.diagonal(), [STDS[0] ** 2, STDS[1] ** 2, 0.0, 0.0, 0.0, STDS[5] ** 2])
    assert "the support decides" in read.changes[0]


@pytest.mark.parametrize("row", [0, 1])
def test_a_place_that_was_not_measured_is_refused_by_its_field(row):
    P = np.diag(np.square(STDS))
    P[row, row] = 1e6
    with pytest.raises(InvalidCovarianceError) as raised:
        EXACT.known_pose(P.ravel(), FIELD)
    assert raised.value.field == f"{FIELD}[{7 * row}]"


def test_one_zero_row_is_exact_with_one_note():
    P = np.diag(np.square(STDS))
    P[5, 5] = 0.0
    read = EXACT.known_pose(P.ravel(), FIELD)
    assert np.array_equal(read.P, P)
    assert read.changes == ("yaw of the pose have zero variance: exactly known",)


def on_a_table(stds, unmeasured):
    """A can 1 mm above a table, of whose pose some directions were not measured."""
    can = moving_object("can", "can", (0.0, 0.0, 0.001), (0.0, 0.0, 0.0), spheres=0)
    P = np.diag(np.square(stds))
    P[unmeasured, unmeasured] = 9999.0
    can.pose.covariance = P.ravel()
    request = request_of(can, horizon=0.2, propagator="monte_carlo", samples=64, seed=1)
    request.scene.environment.elements = [floor(name="table")]
    return with_physics(request, gravity=(0.0, 0.0, -9.81))


def test_the_support_decides_height_and_tilt_over_dds(predict):
    answer = predict(on_a_table(STDS, HEIGHT_AND_TILT))
    assert answer.result.error_code == ErrorCode.NONE, answer.result.error_msg
    (can,) = answer.prediction.objects
    last = np.sqrt(np.reshape(can.states[-1].pose.covariance, (6, 6)).diagonal())
    assert last[:2] == pytest.approx(STDS[:2], rel=0.4)  # 64 samples
    assert last[2] < 1e-3 and last[3:5].max() < 1e-2
    assert "note: z, roll, pitch of the pose were not measured" in can.status_msg


def test_an_unmeasured_yaw_spreads_angles_only_over_dds(predict):
    answer = predict(on_a_table(np.repeat([0.01, 0.0], 3), (5,)))
    assert answer.result.error_code == ErrorCode.NONE, answer.result.error_msg
    start = np.reshape(answer.prediction.objects[0].start.covariance, (6, 6)).diagonal()
    assert start[5] == pytest.approx(ANY_ANGLE_VARIANCE, rel=0.4)
    assert start[:2] == pytest.approx(STDS[0] ** 2, rel=0.8)


@pytest.mark.parametrize(("z", "noted"), [(0.001, False), (0.055, True), (0.2, False)])
def test_a_pose_of_the_middle_gives_a_hint_over_dds(predict, z, noted):
    """The can is 11 cm high, and its model's origin is at its base."""
    request = on_a_table(np.repeat([0.002, 0.02], 3), ())
    request.scene.objects[0].pose.pose.position.z = z
    (can,) = predict(request).prediction.objects
    assert ("note: begins 0.055 m above 'table': is its pose that of its middle" in can.status_msg) == noted


def test_a_scene_without_anything_below_is_flagged_over_dds(predict):
    request = on_a_table(STDS, ())
    request.scene.environment.elements, request.scene.environment.complete = [], True
    (can,) = predict(request).prediction.objects
    assert can.status and can.status_msg.count("for ever") == 1
