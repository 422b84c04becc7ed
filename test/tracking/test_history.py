"""Parts of the tracker by themselves: corrections, and the history of late measurements."""

import numpy as np
import pytest
from tracked_scenes import NOISE, belief_of, free_scene, pose

from unc_physics import ContactNoise, PoseMeasurement, UncPhysicsError, make_propagator, with_stiffness
from unc_physics.checks.errors import DivergedError
from unc_physics.tracking.correction import CorrectedState, Start, correct_state
from unc_physics.tracking.ensemble import Gates
from unc_physics.tracking.history import History
from unc_physics.tracking.hypotheses import Filter, TrackMode, new_track
from unc_physics.tracking.members import advanced, first_members
from unc_physics.tracking.state import State, TrackedScene
from unc_physics.tracking.symmetry import NONE

PERIOD, SPEED = 1.0 / 30.0, 1.2  # s, m/s


def begun(**known):
    """A body's scene and state at time 0; it has ``known`` velocities or others."""
    belief = belief_of(free_scene(), box0=known)
    scene = with_stiffness(free_scene(), belief.mean)
    tracked = TrackedScene(
        scene, {}, make_propagator("monte_carlo", samples=16), ContactNoise(), Gates(), 0.0
    )
    tracks = (new_track(Filter(np.array(belief.mean[0]), np.array(belief.marginal(0)), 0.0), NONE),)
    carry = first_members(tracked, belief, tracks)
    return tracked, State(carry, np.zeros(1), tracks, np.eye(1, dtype=bool))


def seen_at(time):
    """The body flies along x without gravity."""
    return {"box0": PoseMeasurement(pose([SPEED * time, 0.0, 0.0]), NOISE)}


UNKNOWN = {"linear_velocity_std": 2.0, "angular_velocity_std": 15.0}


def test_two_poses_start_a_body_at_the_first_of_them():
    tracked, state = begun(**UNKNOWN)
    assert state.tracks[0].mode is TrackMode.STARTING
    first = correct_state(tracked, state, 0.0, seen_at(0.0), [])
    assert isinstance(first, CorrectedState) and first.state.tracks[0].mode is TrackMode.STARTING
    state = advanced(tracked, first.state, tracked.step(PERIOD))
    start = correct_state(tracked, state, PERIOD, seen_at(PERIOD), [0.0])
    assert isinstance(start, Start) and start.free.time == 0.0
    assert start.free.mean[:6] == pytest.approx([0.0, 0.0, 0.0, SPEED, 0.0, 0.0], abs=0.02)
    forgotten = correct_state(tracked, state, PERIOD, seen_at(PERIOD), [])
    assert isinstance(forgotten, CorrectedState) and forgotten.state.tracks[0].mode is TrackMode.PHYSICS


def test_a_history_forgets_what_no_later_time_needs():
    tracked, state = begun(linear_velocity=(SPEED, 0.0, 0.0))
    history = History(0.0, state)
    for k in range(1, 5):
        history.add(tracked, k * PERIOD, seen_at(k * PERIOD))
    before = history.state_at(tracked, 2.5 * PERIOD)
    other = history.copy()
    history.forget(2.5 * PERIOD)
    assert history.begin == pytest.approx(2.0 * PERIOD) and other.begin == 0.0
    after = history.state_at(tracked, 2.5 * PERIOD)
    np.testing.assert_array_equal(before.carry.states, after.carry.states)
    assert history.is_before(1.9 * PERIOD) and not history.is_before(2.1 * PERIOD)
    with pytest.raises(UncPhysicsError, match="window, which begins at 0.0666"):
        history.state_at(tracked, PERIOD)


def test_a_late_measurement_is_applied_before_the_later_ones():
    tracked, state = begun(linear_velocity=(SPEED, 0.0, 0.0))
    in_order, late = History(0.0, state), History(0.0, state)
    times = [k * PERIOD for k in (1, 2, 3)]
    for time in times:
        in_order.add(tracked, time, seen_at(time))
    for place in (0, 2):
        late.add(tracked, times[place], seen_at(times[place]))
    entry, replayed = late.add(tracked, times[1], seen_at(times[1]))
    assert replayed == 1 and entry.rejected == ()
    np.testing.assert_array_equal(late.last.state.carry.states, in_order.last.state.carry.states)


def test_a_correction_that_fails_leaves_the_history_as_it_was(monkeypatch):
    tracked, state = begun(**UNKNOWN)
    history, untouched = History(0.0, state), History(0.0, state)
    for one in (history, untouched):
        one.add(tracked, 0.0, seen_at(0.0))
        one.advance(tracked, 2.5 * PERIOD)
    applied = []

    def second_fails(*arguments):
        applied.append(arguments)
        if len(applied) == 2:  # after the start at the first pose, which changes its state
            raise DivergedError("left the range of numbers", field="tracker")
        return correct_state(*arguments)

    monkeypatch.setattr("unc_physics.tracking.history.correct_state", second_fails)
    with pytest.raises(DivergedError):
        history.add(tracked, PERIOD, seen_at(PERIOD))
    monkeypatch.undo()
    assert len(applied) == 2
    for time in (0.0, PERIOD, 3.0 * PERIOD):
        found, expected = (one.state_at(tracked, time) for one in (history, untouched))
        np.testing.assert_array_equal(found.carry.states, expected.carry.states)
        assert found.tracks[0].mode is TrackMode.STARTING
    for one in (history, untouched):
        one.add(tracked, 2.0 * PERIOD, seen_at(2.0 * PERIOD))
    np.testing.assert_array_equal(history.last.state.carry.states, untouched.last.state.carry.states)
