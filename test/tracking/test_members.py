"""Members of a tracker between corrections: contact noise, new draws, and answers from them."""

from dataclasses import replace

import numpy as np
import pytest
from plain_scenes import run, state
from scipy.spatial.transform import Rotation
from tracked_scenes import NOISE, SIDE, begun, box, free_scene, pose, table_scene

from unc_physics import Belief, ContactNoise, PoseMeasurement, RigidBody, Scene, TrackStatus, UncPhysicsError
from unc_physics.physics.everyday.columns import SLEEP_AFTER
from unc_physics.propagators.overlap_depths import overlaps
from unc_physics.propagators.start import move_out_of_overlap
from unc_physics.tracking.answers import belief_at, members_at, statuses_at
from unc_physics.tracking.correction import CorrectedState, Start, correct_state
from unc_physics.tracking.hypotheses import Filter, TrackMode
from unc_physics.tracking.members import advanced, drawn_again
from unc_physics.tracking.noise import disturb_contacts
from unc_physics.tracking.symmetry import NONE

TURN = Rotation.from_euler("xyz", [0.3, -0.8, 0.5])


#: Of position, velocity, rotation and angular velocity.
STD = np.repeat([1e-3, 0.2, 1e-3, 0.4], 3)


def correlated(std):
    """A covariance in which all errors have a correlation of 0.4."""
    return np.outer(std, std) * (0.6 * np.eye(len(std)) + 0.4)


def with_track(state, place, **changes):
    tracks = list(state.tracks)
    tracks[place] = tracks[place]._replace(**changes)
    return state._replace(tracks=tuple(tracks))


# -- contact noise -----------------------------------------------------------------------------------


GRAVITY = np.array([1.0, -2.0, -9.0])


def pushed(impulses, resting=False, **options):
    """States before and after contact noise of bodies that are pushed in flight, and shares in contact.

    Impulses (N, 2, 3) are those of the first and the last of three bodies; the one between them is fixed.
    """
    bodies = [
        RigidBody("a", box(), 0.3, drag=0.02),
        RigidBody("wall", box(), fixed=True),
        RigidBody("b", replace(box(), name="b"), 2.0),
    ]
    scene = Scene(bodies, integrator="implicit", gravity=GRAVITY, dt=1.0 / 240.0, damping=0.4)
    x = np.array(
        [
            state((0, 0, 5), (1, 2, 3), (0.2, 0.0, -0.1)),
            state((9, 9, 9)),
            state((4, 0, 5), spin=(1, 0, 0), orientation=TURN.as_quat()),
        ]
    )
    end = run(scene, x, 8 * scene.dt)
    count = len(impulses)
    before, after = np.tile(x, (count, 1, 1)), np.tile(end, (count, 1, 1))
    after[:, [0, 2], 3:6] += impulses
    noisy = after.copy()
    asleep = np.zeros((count, 3), bool)
    asleep[:, 0] = resting
    rng = np.random.default_rng(5)
    share = disturb_contacts(before, noisy, asleep, scene, 8, ContactNoise(**options), rng)
    return after, noisy, share


def test_contact_noise_grows_with_the_impulse():
    """Its variance is that of an impulse per mass, of which a lasting contact's part has a smaller error."""
    h, weight = 8.0 / 240.0, np.linalg.norm(GRAVITY) * 8.0 / 240.0
    impulses = np.zeros((9000, 2, 3))
    impulses[:6000, 0], impulses[6000:, 0] = (0.0, 1.2, 0.5), 0.0
    impulses[:3000, 1], impulses[3000:, 1] = (0.0, 0.052 * weight, 0.0), (0.0, 0.048 * weight, 0.0)
    after, noisy, share = pushed(impulses, velocity=0.03, lasting=0.4, rotation=1.5, slow=4.0)
    np.testing.assert_allclose(share, [2.0 / 3.0, 0.0, 1.0 / 3.0])
    np.testing.assert_allclose(noisy[6000:, 0], after[6000:, 0], atol=1e-15)
    np.testing.assert_allclose(noisy[3000:, 2], after[3000:, 2], atol=1e-15)
    np.testing.assert_array_equal(noisy[:, 1], after[:, 1])
    radius = box().bounding_radius
    for body, count, counted in ((0, 6000, 1.3 - 0.6 * weight), (2, 3000, 0.4 * 0.052 * weight)):
        x, changed = after[0, body], noisy[:count, body]
        speed = np.linalg.norm(x[3:6]) + radius * np.linalg.norm(x[10:])
        kick, spin = changed[:, 3:6] - x[3:6], changed[:, 10:] - x[10:]
        std = 0.03 * np.sqrt(counted) * min(1.0, speed / 4.0)
        np.testing.assert_allclose(kick.std(axis=0), std, rtol=0.05)
        np.testing.assert_allclose(spin.std(axis=0), std * 1.5 / (0.55 * radius), rtol=0.05)
        # half of the step with the changed velocities
        np.testing.assert_allclose(changed[:, :3] - x[:3], 0.5 * h * kick, atol=1e-12)
        turned = Rotation.from_rotvec(0.5 * h * spin) * Rotation.from_quat(x[6:10])
        assert (turned.inv() * Rotation.from_quat(changed[:, 6:10])).magnitude().max() < 1e-7


def test_a_sleeping_body_wanders_across_gravity_and_turns_about_it():
    impulses = np.tile([[0.0, 0.0, 0.3], [0.0, 0.0, 0.0]], (6000, 1, 1))
    after, noisy, _ = pushed(impulses, resting=True, drift=1e-3, turn=4e-3)
    np.testing.assert_array_equal(noisy[:, 0, 3:6], after[:, 0, 3:6])
    down = GRAVITY / np.linalg.norm(GRAVITY)
    flat = np.eye(3) - np.outer(down, down)
    moved = noisy[:, 0, :3] - after[:, 0, :3]
    start = Rotation.from_quat(after[:, 0, 6:10])
    turned = (Rotation.from_quat(noisy[:, 0, 6:10]) * start.inv()).as_rotvec()
    h = 8.0 / 240.0
    assert np.cov(moved.T) == pytest.approx(1e-6 * h * flat, abs=0.06 * 1e-6 * h)
    assert np.cov(turned.T) == pytest.approx(1.6e-5 * h * np.outer(down, down), abs=0.06 * 1.6e-5 * h)


# -- draws -------------------------------------------------------------------------------------------


def test_one_body_is_moved_out_of_overlap_and_no_other_one():
    """Two boxes that are 6 mm deep in each other, in states in which both are turned alike."""
    scene = free_scene(3)
    q = TURN.as_quat()
    centers = TURN.apply([[0.0, 0.0, 0.0], [SIDE - 0.006, 0.01, 0.0], [0.0, 0.5, 0.0]])
    states = np.array([[state(p + [0.0, 0.0, 0.1 * n], orientation=q) for p in centers] for n in range(4)])
    P = np.zeros((3, 12, 12))
    P[:, :3, :3] = 1e-4 * np.eye(3)
    moved, kept = move_out_of_overlap(scene, Belief(states[0], P), states, [1])
    np.testing.assert_array_equal(moved[:, [0, 2]], states[:, [0, 2]])
    assert kept.max() < 5e-5 and overlaps(scene, moved)[0].max() < 1e-4
    shift = TURN.inv().apply(moved[:, 1, :3] - states[:, 1, :3])
    np.testing.assert_allclose(shift, np.tile([0.006, 0.0, 0.0], (4, 1)), atol=3e-4)


@pytest.mark.parametrize(("mode", "known"), [(TrackMode.PHYSICS, 1.0), (TrackMode.STARTING, 0.0)])
def test_a_new_draw_of_a_body_has_the_moments_of_its_filter(mode, known):
    """Without velocities, which a body that starts has with certainty; another body stays as it was."""
    tracked, before = begun(table_scene(2), box0={"position": (0, 0, 0.2)}, box1={"position": (0.5, 0, 0.2)})
    free = Filter(state((0.3, 0.1, 0.2), (0.1, 0.2, 0.3)), correlated(STD), 0.0)
    found = drawn_again(tracked, with_track(before, 1, mode=mode), 1, free).carry.states
    np.testing.assert_array_equal(found[:, 0], before.carry.states[:, 0])
    expected = free.covariance[:6, :6].copy()
    expected[3:], expected[:, 3:] = known * expected[3:], known * expected[:, 3:]
    assert found[:, 1, :6].mean(axis=0) == pytest.approx([0.3, 0.1, 0.2, 0.1, 0.2, 0.3], abs=1e-12)
    assert np.cov(found[:, 1, :6].T) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("mode", [TrackMode.PHYSICS, TrackMode.CARRIED])
def test_a_new_draw_of_a_body_that_may_meet_others_has_no_overlap(mode):
    known = {"position": (0, 0, 0.0402), "position_std": 1e-5, "orientation_std": 1e-4}
    tracked, before = begun(table_scene(2), box0=known, box1={"position": (0.5, 0, 0.2)})
    inside = Filter(state((0.078, 0.0, 0.039)), correlated(STD), 0.0)
    found = drawn_again(tracked, with_track(before, 1, mode=mode), 1, inside).carry
    np.testing.assert_array_equal(found.states[:, 0], before.carry.states[:, 0])
    assert overlaps(tracked.scene, found.states)[0][:, 1].max() < 1e-4
    assert not found.contact_history.start.kept.any() and not found.contact_history.start.overlap[:, 1].any()


# -- answers -----------------------------------------------------------------------------------------


def test_beliefs_have_the_moments_of_members_and_the_errors_of_shapes():
    """Between two steps, of a turning body; where a filter is in charge, it answers alone."""
    tracked, now = begun(
        free_scene(3),
        samples=100,
        box0={"linear_velocity": (1.0, 2.0, 3.0), "angular_velocity": (0.0, 0.0, 5.0)},
        box1={"position": (1.0, 0.0, 0.0)},
        box2={"position": (3.0, 0.0, 0.0)},
    )
    tracked, late = replace(tracked, origin=5.0), 0.4 / 240.0  # by a clock that was 5 s at the first step
    free = Filter(state((9, 9, 9), (1, 0, 0)), correlated(STD), 5.0)
    now = with_track(now, 1, mode=TrackMode.CARRIED, free=free, last_seen=5.0)._replace(
        contact_share=np.array([0.5, 0.7, 1.0])
    )
    states = now.carry.states
    belief = belief_at(tracked, now, 5.0 + late)
    assert belief.mean[0, :6] == pytest.approx(
        np.r_[states[:, 0, :3].mean(0) + late * np.r_[1, 2, 3], 1, 2, 3]
    )
    assert 2.0 * belief.mean[0, 8] == pytest.approx(5.0 * late, rel=1e-3)
    assert belief.mean[1, :3] == pytest.approx([9.0 + late, 9.0, 9.0])
    both = np.cov(np.hstack([states[:, 0, :6], states[:, 2, :6]]).T)
    places = np.r_[:6, 24:30]
    shape = np.r_[np.full(3, 0.5), np.zeros(3), np.full(3, 1.0), np.zeros(3)] * 3.5e-4**2
    assert belief.covariance[np.ix_(places, places)] == pytest.approx(both + np.diag(shape), rel=1e-9)
    own = free.at(5.0 + late).covariance
    assert belief.covariance[12:24, 12:24] == pytest.approx(own)
    assert not belief.covariance[12:24, 24:].any() and not belief.covariance[:12, 12:24].any()
    drawn = members_at(tracked, now, 5.0 + late)
    np.testing.assert_array_equal(drawn[:, [0, 2]], states[:, [0, 2]])
    assert np.cov(drawn[:, 1, :6].T) == pytest.approx(own[:6, :6], abs=1e-12)


def test_statuses_change_at_their_limits():
    """Each of the second of two bodies, and none of the other one."""
    scene = replace(table_scene(2), sleep=True)
    tracked, now = begun(scene, samples=50, box0={"position": (0, 0, 1)}, box1={"position": (0.5, 0, 1)})
    now = with_track(with_track(now, 0, last_seen=1.0), 1, last_seen=1.0)
    wide = np.diag(np.r_[0.1, 0.6, 0.1, np.zeros(9)] ** 2)
    for expected, changes in (
        (TrackStatus.TRACKED, {}),
        (TrackStatus.TRACKED, {"rejected": 2, "last_seen": 0.76}),
        (TrackStatus.LOST, {"rejected": 3}),
        (TrackStatus.COASTING, {"last_seen": 0.74}),
        (TrackStatus.TRACKED, {"spread": 0.499}),
        (TrackStatus.LOST, {"spread": 0.501}),
        (TrackStatus.TRACKED, {"resting": 44}),
        (TrackStatus.RESTING, {"resting": 45, "last_seen": 0.0}),
        (
            TrackStatus.CARRIED,
            {"mode": TrackMode.CARRIED, "resting": 50, "free": Filter(state(), 0.01 * wide, 1.0)},
        ),
        (TrackStatus.LOST, {"mode": TrackMode.CARRIED, "free": Filter(state(), wide, 1.0)}),
        (TrackStatus.STARTING, {"mode": TrackMode.STARTING, "rejected": 3}),
    ):
        carry = now.carry._replace(states=now.carry.states.copy())
        if "spread" in changes:
            carry.states[:, 1, 1] = np.tile([1.0, -1.0], 25) * changes.pop("spread")
        history = carry.contact_history
        quiet = np.zeros_like(history.solver.quiet)
        quiet[: changes.pop("resting", 0), 1] = 1.01 * SLEEP_AFTER
        carry = carry._replace(contact_history=history._replace(solver=history.solver._replace(quiet=quiet)))
        found = statuses_at(tracked, with_track(now._replace(carry=carry), 1, **changes), 1.0)
        assert found == {"box0": TrackStatus.TRACKED, "box1": expected}, changes


# -- corrections -------------------------------------------------------------------------------------


def test_a_measurement_corrects_the_bodies_that_met_its_body_directly_or_through_others():
    """Or were correlated at the start; of five in a row."""
    tracked, now = begun(free_scene(5), **{f"box{k}": {"position": (k, 0, 0)} for k in range(5)})
    first = now.carry.contact_history.first_time
    first[3, 0, 1] = first[5, 2, 3] = 0.1
    tied = now.tied.copy()
    tied[1, 3] = tied[3, 1] = True
    seen = {"box2": PoseMeasurement(pose((2.002, 0.0, 0.0)), NOISE)}
    found = correct_state(tracked, now._replace(tied=tied), 0.0, seen, [])
    assert isinstance(found, CorrectedState)
    changed = (found.state.carry.states != now.carry.states).any(axis=(0, 2))
    assert changed.tolist() == [True, True, True, True, False]


def test_a_body_starts_with_velocities_that_two_poses_show():
    """Their variances are those of the filter and of an unknown fall, without correlations."""
    scene, unknown = table_scene(), {"linear_velocity_std": 2.0, "angular_velocity_std": 15.0}
    tracked, now = begun(scene, box0=unknown | {"position": (0, 0, 1)})
    period = 8.0 / 240.0
    found = correct_state(tracked, now, 0.0, {"box0": PoseMeasurement(pose((0, 0, 1)), NOISE)}, [])
    assert isinstance(found, CorrectedState)
    later = advanced(tracked, found.state, 8)
    seen = {"box0": PoseMeasurement(pose((1.2 * period, 0, 1)), NOISE)}
    start = correct_state(tracked, later, period, seen, [0.0])
    assert isinstance(start, Start)
    observation = seen["box0"].observation(scene.bodies[0])
    after, _ = found.state.tracks[0].free.at(period).seen(observation, state(), np.inf, NONE)
    P = start.free.covariance
    assert start.free.mean[3:6] == pytest.approx(after.mean[3:6]) and start.free.time == 0.0
    fallen = (0.5 * period * 9.81) ** 2
    assert P[3:6, 3:6] == pytest.approx(after.covariance[3:6, 3:6] + (0.3**2 + fallen) * np.eye(3))
    assert P[9:, 9:] == pytest.approx(after.covariance[9:, 9:] + 9.0 * np.eye(3))
    others = np.r_[0:3, 6:9]
    assert not P[3:6, others].any() and not P[np.ix_(others, [9, 10, 11])].any() and not P[3:6, 9:].any()
    assert P[np.ix_(others, others)] == pytest.approx(
        found.state.tracks[0].first.covariance[np.ix_(others, others)]
    )
    forgotten = correct_state(tracked, later, period, seen, [])
    assert isinstance(forgotten, CorrectedState)
    assert forgotten.state.tracks[0].mode is TrackMode.PHYSICS


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_body_in_contact_is_seen_with_the_errors_of_its_shape(share):
    """They count in the distance of a measurement from what is expected."""
    tracked, now = begun(free_scene(), samples=64, box0={})
    tracked = replace(tracked, noise=ContactNoise(shape_position=0.01))
    seen = {"box0": PoseMeasurement(pose((0.004, 0.0, 0.0)), NOISE)}
    found = correct_state(tracked, now._replace(contact_share=np.array([share])), 0.0, seen, [])
    assert isinstance(found, CorrectedState)
    variance = 0.003**2 + NOISE[0] ** 2 + share * 0.01**2
    assert found.state.tracks[0].distance == pytest.approx(0.004 / np.sqrt(variance), rel=1e-3)


def test_members_of_a_carried_body_are_drawn_where_its_filter_is():
    """While there is no evidence that it is free; the measured pose alone tells where that is."""
    tracked, now = begun(free_scene(), samples=64, box0={})
    carried = with_track(now, 0, mode=TrackMode.CARRIED, free=Filter(state(), 1e-4 * np.eye(12), 0.0))
    seen = {"box0": PoseMeasurement(pose((0.004, 0.0, 0.0)), NOISE)}
    for evidence in (0.0, 10.0):
        found = correct_state(tracked, with_track(carried, 0, evidence=evidence), 0.0, seen, [])
        assert isinstance(found, CorrectedState) and found.rejected == ()
        own = found.state.tracks[0]
        assert own.mode is TrackMode.CARRIED
        moved = found.state.carry.states[:, 0, 3:6].std(axis=0, ddof=1)
        assert moved == pytest.approx(np.full(3, 0.05 if own.evidence else 0.01), rel=1e-6)


def test_steps_are_simulated_in_pieces_until_a_member_diverges():
    for dt, steps in ((1.0 / 240.0, 8), (1.0 / 30.0, 1), (0.02, 1), (0.05, 1)):
        tracked, now = begun(replace(free_scene(), dt=dt), samples=8, box0={})
        assert tracked.piece == steps and tracked.step(2.4 * dt) == 2
        assert advanced(tracked, now, 3).carry.step == 3
    now.carry.states[3, 0, 4] = np.nan
    with pytest.raises(UncPhysicsError, match="tracker left the range of numbers"):
        advanced(tracked, now, 4)
