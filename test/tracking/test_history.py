"""The history of late measurements by itself."""

import numpy as np
import pytest
from tracked_scenes import NOISE, begun, free_scene, pose

from unc_physics import PoseMeasurement
from unc_physics.checks.errors import DivergedError
from unc_physics.tracking.correction import correct_state
from unc_physics.tracking.history import History
from unc_physics.tracking.hypotheses import TrackMode

PERIOD, SPEED = 1.0 / 30.0, 1.2  # s, m/s


def seen_at(time):
    """The body flies along x without gravity."""
    return {"box0": PoseMeasurement(pose([SPEED * time, 0.0, 0.0]), NOISE)}


UNKNOWN = {"linear_velocity_std": 2.0, "angular_velocity_std": 15.0}


def test_a_correction_that_fails_leaves_the_history_as_it_was(monkeypatch):
    tracked, state = begun(free_scene(), 16, box0=UNKNOWN)
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
