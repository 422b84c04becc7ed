"""Filters, modes and symmetries of tracked bodies by themselves."""

import numpy as np
import pytest
from plain_scenes import state
from scipy.spatial.transform import Rotation
from tracked_scenes import NOISE, bodies, pose

from unc_physics import (
    AxialSymmetry,
    PoseMeasurement,
    PositionMeasurement,
    RelativePoseMeasurement,
    UncPhysicsError,
)
from unc_physics.tracking.ensemble import Gates, Innovation
from unc_physics.tracking.hypotheses import Filter, Track, TrackMode, new_track
from unc_physics.tracking.observation import POSE
from unc_physics.tracking.symmetry import NONE, checked_symmetry, folded

BODY = bodies(1)[0]
TURN = Rotation.from_euler("xyz", [0.4, -1.1, 0.7])
FINE, FAR = Innovation(1.0, 5.0, True), Innovation(500.0, -99.0, False)
NARROW = np.diag(np.repeat([1e-3, 0.01, 1e-2, 0.1], 3) ** 2)


def track(mode=TrackMode.PHYSICS, mean=None, **fields):
    return Track(mode, Filter(state() if mean is None else mean, NARROW, 0.0), **fields)


def seen(own, time, measurement, physics=FAR, reference=None):
    """The track after a measurement, with another body at a given state."""
    other = state() if reference is None else reference
    return own.seen(time, measurement.observation(BODY), other, physics, Gates())


OTHER = state((1.0, 2.0, 0.0), orientation=Rotation.from_euler("z", 0.5).as_quat())
THERE = (1.0, 0.5, 0.0)
RELATIVE = RelativePoseMeasurement("other", pose(THERE, TURN.as_quat()), NOISE)


@pytest.mark.parametrize(
    ("measurement", "place", "turn", "rotation_std"),
    [
        (PoseMeasurement(pose((5, 6, 7), TURN.as_quat()), NOISE), (5, 6, 7), TURN, 0.02),
        (PositionMeasurement((5, 6, 7), NOISE[:3]), (5, 6, 7), Rotation.identity(), 0.3),
        (
            RELATIVE,
            Rotation.from_euler("z", 0.5).apply(THERE) + [1, 2, 0],
            Rotation.from_euler("z", 0.5) * TURN,
            0.02,
        ),
    ],
)
def test_a_track_starts_again_at_three_rejected_measurements_that_agree(
    measurement, place, turn, rotation_std
):
    """With what they measure: a position does not change the rotation."""
    own = track(mean=state((0, 0, 0), (9, 9, 9), (1, 1, 1)))
    for k in (1, 2):
        own = seen(own, 1e-3 * k, measurement, reference=OTHER)
        assert (own.mode, own.rejected, own.agreeing) == (TrackMode.PHYSICS, k, k)
    again = seen(own, 3e-3, measurement, reference=OTHER)
    assert again.mode is TrackMode.CARRIED and again.last_seen == 3e-3
    assert (again.rejected, again.agreeing, again.candidate, again.evidence) == (0, 0, None, 0.0)
    found = again.free
    np.testing.assert_allclose(found.mean[:3], place, atol=2e-3)
    error = (Rotation.from_quat(found.mean[6:10]).inv() * turn).magnitude()
    assert error < (0.03 if rotation_std < 0.1 else 2e-3)
    std = np.sqrt(own.candidate.covariance.diagonal())
    np.testing.assert_allclose(std[:3], 2e-3 / 2**0.5, rtol=0.2)
    np.testing.assert_allclose(std[6:9], rotation_std / (2**0.5 if rotation_std < 0.1 else 1.0), rtol=0.3)
    np.testing.assert_allclose(std[3:6], 2.0, rtol=0.6)
    elsewhere = PositionMeasurement((-9, 0, 0), NOISE[:3])
    other = seen(own, 3e-3, elsewhere)
    assert (other.mode, other.rejected, other.agreeing) == (TrackMode.PHYSICS, 3, 1)


def test_an_accepted_measurement_ends_a_row_of_rejected_ones():
    near = PoseMeasurement(pose((1e-3, 0, 0)), NOISE)
    own = track(rejected=2, agreeing=2, candidate=track().free)
    for found in (seen(own, 0.01, near, FINE), seen(own, 0.01, near, FAR)):  # the filter alone may accept it
        assert (found.rejected, found.agreeing, found.candidate, found.last_seen) == (0, 0, None, 0.01)
    assert seen(own, 0.01, near, FINE).distance == 1.0
    carried = seen(own._replace(mode=TrackMode.CARRIED), 0.01, near, FINE)
    assert carried.distance == pytest.approx(0.5, rel=0.2)  # of 1 mm, in the filter
    far = seen(own._replace(mode=TrackMode.CARRIED), 0.01, PoseMeasurement(pose((9, 0, 0)), NOISE), FINE)
    assert far.rejected == 3  # physics is not asked


@pytest.mark.parametrize(
    ("mode", "before", "gained", "after", "evidence"),
    [
        (TrackMode.PHYSICS, 1.0, 3.0, TrackMode.PHYSICS, 4.0),
        (TrackMode.PHYSICS, 1.0, -3.0, TrackMode.PHYSICS, 0.0),
        (TrackMode.PHYSICS, 20.0, 5.0, TrackMode.PHYSICS, 25.0),
        (TrackMode.PHYSICS, 20.0, 5.01, TrackMode.CARRIED, 0.0),
        (TrackMode.PHYSICS, 1.0, 101.0, TrackMode.PHYSICS, 15.0),  # no measurement counts for more than 14
        (TrackMode.PHYSICS, 20.0, -101.0, TrackMode.PHYSICS, 6.0),
        (TrackMode.CARRIED, 1.0, -3.0, TrackMode.CARRIED, 4.0),
        (TrackMode.CARRIED, 1.0, 3.0, TrackMode.CARRIED, 0.0),
        (TrackMode.CARRIED, 25.0, -5.0, TrackMode.CARRIED, 30.0),
        (TrackMode.CARRIED, 25.0, -5.01, TrackMode.PHYSICS, 0.0),
    ],
)
def test_evidence_is_a_cumulative_sum_that_changes_the_mode(mode, before, gained, after, evidence):
    found = track(mode, evidence=before)._weighed(1.0, gained, 6)
    assert found.mode is after and found.evidence == pytest.approx(evidence)


def test_three_dimensions_count_up_to_half():
    assert track()._weighed(1.0, 99.0, 3).evidence == pytest.approx(7.0)


def test_a_carried_body_in_contact_is_free_once_its_release_explains_half_a_second():
    own, free = track(TrackMode.CARRIED, evidence=9.0), {}
    own = own._weighed(1.0, 14.0, 6)  # against physics: the members begin here
    assert (own.evidence, own.released) == (0.0, 1.0)
    for time in (1.1, 1.2, 1.3, 1.4, 1.49, 1.51):
        free[time] = [own._weighed(time, -14.0, 6, touching).mode for touching in (False, True)]
        own = own._weighed(time, -14.0, 6, touching=True)
    carried, physics = TrackMode.CARRIED, TrackMode.PHYSICS
    assert list(free.values()) == [[carried] * 2] * 2 + [[physics, carried]] * 3 + [[physics] * 2]


def test_a_carried_body_that_is_not_seen_stops_after_a_quarter_of_a_second():
    own = track(TrackMode.CARRIED, state(velocity=(1, 0, 0), spin=(0, 0, 1)), last_seen=0.1)
    moving, stopped = own.answer(0.34), own.answer(0.5)
    np.testing.assert_allclose(moving.mean[:6], [0.34, 0, 0, 1, 0, 0])
    np.testing.assert_allclose(stopped.mean[:6], [0.35, 0, 0, 0, 0, 0])
    assert stopped.mean[8] == pytest.approx(np.sin(0.5 * 0.35)) and not stopped.mean[10:].any()
    np.testing.assert_array_equal(stopped.covariance, own.free.at(0.5).covariance)
    assert own._replace(mode=TrackMode.PHYSICS).answer(0.5).mean[0] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("velocity", "spin", "axis", "known"),
    [
        ((0.1, 0.49, 0.1), (7.9, 1, 1), None, True),
        ((0.1, 0.51, 0.1), (1, 1, 1), None, False),
        ((0.1, 0.1, 0.1), (1, 8.1, 1), None, False),
        ((0.1, 0.1, 0.1), (1, 20.0, 1), (0, 0, 2), True),  # about the axis, which points along y
        ((0.1, 0.1, 0.1), (1, 20.0, 8.1), (0, 0, 2), False),
    ],
)
def test_velocities_are_known_if_no_direction_is_too_uncertain(velocity, spin, axis, known):
    mean = state(orientation=Rotation.from_rotvec([-0.5 * np.pi, 0, 0]).as_quat())
    P = np.diag(np.r_[np.zeros(3), velocity, np.zeros(3), spin] ** 2)
    symmetry = NONE if axis is None else checked_symmetry(AxialSymmetry(axis), "symmetry")
    expected = TrackMode.PHYSICS if known else TrackMode.STARTING
    assert new_track(Filter(mean, P, 0.0), symmetry).mode is expected


# -- measurements ------------------------------------------------------------------------------------


def test_measurements_are_checked_and_have_a_least_variance():
    """1e-12 of the largest of position or rotation; quaternions have length 1."""
    P = np.diag([1e-4, 0.0, 0.0, 4e-2, 0.0, 0.0])
    least = np.repeat([1e-16, 4e-14], 3)
    q = 1.0005 * TURN.as_quat()
    for one in (
        PoseMeasurement(pose((1, 2, 3), q), P, axes="body"),
        RelativePoseMeasurement("a", pose((1, 2, 3), q), P),
    ):
        found = one.observation(BODY)
        np.testing.assert_allclose(found.noise, P + np.diag(least), rtol=1e-12)
        np.testing.assert_allclose(found.value, pose((1, 2, 3), TURN.as_quat()))
        with pytest.raises(ValueError, match="read-only"):
            one.covariance[0, 0] = 1.0
    with pytest.raises(UncPhysicsError, match="orientation of pose"):
        RelativePoseMeasurement("a", pose((1, 2, 3), 1.1 * q), P)
    with pytest.raises(UncPhysicsError, match="reference must be the name of a body"):
        RelativePoseMeasurement("", pose((1, 2, 3)), P)
    for P in (np.zeros((6, 6)), np.diag([1, 1, 1, 0, 0, 0.0])):
        with pytest.raises(UncPhysicsError, match="must be positive for position and rotation"):
            PoseMeasurement(pose((1, 2, 3)), P, axes="body")


# -- symmetries --------------------------------------------------------------------------------------


def test_a_measured_rotation_is_replaced_by_the_equivalent_one_that_is_nearest():
    """About an axis that is none of the body's own, and after half turns; beside a search over all angles."""
    rng, axis = np.random.default_rng(0), np.array([1.0, -2.0, 2.0]) / 3.0
    symmetry = checked_symmetry(AxialSymmetry(axis, reversible=True), "symmetry")
    over = Rotation.from_quat(symmetry.rotations[1])
    angles = Rotation.from_rotvec(np.linspace(-np.pi, np.pi, 2001)[:, None] * axis)
    equivalents = Rotation.concatenate([angles, over * angles])
    P = np.diag(np.r_[NOISE[:3], 0.01, 0.02, 0.03] ** 2)
    P[0, 4] = P[4, 0] = 1e-5
    for seed in range(6):
        measured, expected = Rotation.random(2, random_state=seed)
        body = state(orientation=expected.as_quat())
        observation = PoseMeasurement(pose((0, 0, 0), measured.as_quat()), P, axes="body").observation(BODY)
        found = folded(symmetry, observation, body, state())
        turned = Rotation.from_quat(found.value[3:])
        best = (expected.inv() * measured * equivalents).magnitude().min()
        assert (expected.inv() * turned).magnitude() == pytest.approx(best, abs=1e-3)
        # the errors are about the axes of the body, which turn as well; the angle about the axis is unknown
        change = (turned.inv() * measured).as_matrix()
        both = np.block([[np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), change]])
        noise = both @ P @ both.T
        noise[3:, 3:] += 100.0 * np.outer(axis, axis)
        np.testing.assert_allclose(found.noise, noise, atol=1e-12)
    relative = observation._replace(kind=2)
    reference = state(orientation=Rotation.random(random_state=rng.integers(9)).as_quat())
    moved = folded(symmetry, relative, body, reference)
    here = Rotation.from_quat(reference[6:10]).inv() * expected
    best = (here.inv() * measured * equivalents).magnitude().min()
    assert (here.inv() * Rotation.from_quat(moved.value[3:])).magnitude() == pytest.approx(best, abs=1e-3)
    assert observation.kind == POSE and folded(NONE, observation, body, reference) is observation


def test_members_have_one_angle_about_an_axis_of_symmetry():
    """The axis itself stays; the other bodies and the given states do not change."""
    axis = np.array([2.0, 1.0, -2.0]) / 3.0
    symmetry = checked_symmetry(AxialSymmetry(axis), "symmetry")
    rng = np.random.default_rng(1)
    tilts = Rotation.from_rotvec(0.05 * rng.standard_normal((40, 3)))
    spins = Rotation.from_rotvec(rng.uniform(-3, 3, (40, 1)) * axis)
    states = np.tile([state((1, 2, 3)), state((4, 5, 6))], (40, 1, 1))
    states[:, 1, 6:10] = (TURN * tilts * spins).as_quat()
    before = states.copy()
    found = symmetry.aligned(states, 1)
    np.testing.assert_array_equal(states, before)
    np.testing.assert_array_equal(found[:, 0], states[:, 0])
    turns = Rotation.from_quat(found[:, 1, 6:10])
    np.testing.assert_allclose(turns.apply(axis), (TURN * tilts).apply(axis), atol=1e-9)
    apart = (turns.mean().inv() * turns).as_rotvec()
    assert np.abs(apart @ axis).max() < 1e-3 and np.abs(apart).max() < 0.3
    assert NONE.aligned(states, 1) is states
    across = symmetry.without_angle(np.eye(12))
    np.testing.assert_allclose(across[6:9, 6:9], np.eye(3) - np.outer(axis, axis), atol=1e-12)
    assert (np.delete(across, np.r_[6:9], axis=0).sum(axis=1) == 1.0).all()
