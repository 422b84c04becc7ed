"""Scores of a model, and doubts about a fit, of made-up simulations with known values."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from throws import scene

from unc_physics import Motion
from unc_physics.calibration.adjustable import Model
from unc_physics.calibration.calibrate import Calibration, Fitted
from unc_physics.calibration.objective import Objective, Recorded, Scores, as_recorded, scored
from unc_physics.checks.errors import DivergedError

MODEL = Model(scene(), 2e-3, 3e-2)


def flown(times, offset=0.0):
    """A recorded motion along x that is scored at some times."""
    poses = np.array([[time, offset, 0.0, 0.0, 0.0, 0.0, 1.0] for time in (0.0, *times)])
    state = np.concatenate([poses[0, :3], np.zeros(3), poses[0, 3:], np.zeros(3)])
    start = SimpleNamespace(state=state, belief=lambda *noise: noise)
    return Recorded(Motion("m", (0.0, *times), poses), start, times, tuple(poses[1:]))


def made_up(spread):
    """A simulator of samples about a motion along x, with other draws for each motion."""

    def simulate(_, belief, times, samples, seed):
        assert belief == (2e-3, 3e-2)
        rng, found = np.random.default_rng(seed), []
        for time in times:
            x = np.zeros((samples, 13))
            x[:, :3] = [time, 0.0, 0.0] + spread * rng.standard_normal((samples, 3))
            x[:, 6:10] = Rotation.from_rotvec(spread * rng.standard_normal((samples, 3))).as_quat()
            found.append(x)
        return found

    return simulate


def test_an_objective_is_the_weighted_sum_of_scores_over_those_of_the_first_model():
    """Of two motions; the shorter one is scored at the last of the times of the longer one."""
    motions = [flown((0.2, 0.4, 1.0)), flown((0.3, 0.9), 0.1)]
    objective = Objective(motions, 20, 5, made_up(0.05), weights=(0.3, 0.7))
    units = None
    for spread in (0.05, 0.2):
        objective.simulate = made_up(spread)
        found = objective.scores(MODEL)
        if units is None:
            a, b = ([one.position, one.rotation] for one in found)
            units = [np.r_[x[0], 0.5 * (x[1] + y[0]), 0.5 * (x[2] + y[1])] for x, y in zip(a, b, strict=True)]
        expected = [
            0.5 * ((one.position / units[0][-k:]).mean() + (one.rotation / units[1][-k:]).mean())
            + 0.3 * one.density
            + 0.7 * one.lies
            for one, k in zip(found, (3, 2), strict=True)
        ]
        assert objective.per_motion(MODEL) == pytest.approx(expected)
    assert not np.array_equal(found[0].position[-1], found[1].position[-1])
    again = Objective(motions, 20, 5, made_up(0.2)).scores(MODEL)
    np.testing.assert_array_equal(again[1].position, found[1].position)


@pytest.mark.parametrize(("place", "lost"), [(999.0, False), (1001.0, True)])
def test_a_sample_that_flies_away_ends_the_simulation(place, lost):
    def simulate(*arguments):
        states = made_up(0.1)(*arguments)
        states[-1][3, 1] = place
        return states

    objective = Objective([flown((0.2, 0.4))], 8, 0, simulate)
    if lost:
        with pytest.raises(DivergedError, match="motion 'm' threw a sample away"):
            objective.scores(MODEL)
    else:
        assert len(objective.scores(MODEL)) == 1


def test_simulated_poses_are_compared_with_the_errors_of_recorded_ones():
    """Of position along the world's axes, and of rotation about the body's."""
    turn = Rotation.from_euler("xyz", [0.3, -0.9, 1.2])
    states = np.zeros((2, 20_000, 13))
    states[..., 0], states[..., 6:10] = 1.0, turn.as_quat()
    for shown in as_recorded(states, MODEL, 3):
        assert (shown[:, :3] - [1.0, 0.0, 0.0]).std(axis=0) == pytest.approx(np.full(3, 2e-3), rel=0.03)
        errors = (turn.inv() * Rotation.from_quat(shown[:, 6:10])).as_rotvec()
        assert errors.std(axis=0) == pytest.approx(np.full(3, 3e-2), rel=0.03)
        assert errors.mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-3)
    one, other = as_recorded(states, MODEL, 3)
    assert not np.array_equal(one, other) and not states[..., 1].any()


def test_scores_at_each_time_are_those_of_its_samples():
    states = made_up(0.1)(None, (2e-3, 3e-2), (0.2, 0.4), 30, 1)
    poses = [np.r_[0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], np.r_[0.4, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]]
    both = scored(states, poses)
    for k in range(2):
        (alone,) = (scored(states[k : k + 1], poses[k : k + 1]),)
        for name in ("position", "rotation", "position_rank", "rotation_rank"):
            assert getattr(both, name)[k] == pytest.approx(getattr(alone, name)[0])
    assert both.density == pytest.approx(
        np.mean([scored([x], [p]).density for x, p in zip(states, poses, strict=True)])
    )


# -- doubts ------------------------------------------------------------------------------------------


FRICTION = Fitted("friction", "", "", 0.5, 0.3, 0.05, True)


def calibration(fitted=(FRICTION,), bounds=((0.005, 3.0),), ranks=(0.5, 0.5, 0.5, 0.5), outside=0):
    """A result of 36 motions; so many of them are outside of the regions of 90 %, in one of four checks."""
    scores = [
        Scores(None, None, 0.0, 0.0, *(np.where(k < outside, ranks, 0.5).reshape(2, 2))) for k in range(36)
    ]
    return Calibration(None, None, fitted, (), tuple(scores), (None,) * 36, None, (1.0, 0.9), 30, bounds)


@pytest.mark.parametrize("check", range(4))
def test_a_region_that_holds_too_few_is_doubted(check):
    """Four standard errors below 90 % are 70 % of 36 motions."""
    words = f"{('positions', 'rotations')[check // 2]} at the {('first time', 'end')[check % 2]}"
    ranks = np.full(4, 0.9)
    ranks[check] = 0.91
    assert calibration(ranks=ranks, outside=10).doubts == ()
    (doubt,) = calibration(ranks=ranks, outside=11).doubts
    assert doubt.startswith(f"the region of 90% holds only 69% of {words}")


def test_values_at_bounds_or_near_zero_or_near_their_priors_are_doubted():
    spread = Fitted("friction_std", "", "", 0.12, 0.1, 0.03, True)
    two = (0.005, 3.0), (1e-4, 0.5)
    for changes, doubts in (
        ({}, []),
        ({"value": 0.005}, ["friction ends at the bound of what is sought, 0.005"]),
        ({"value": 3.0}, ["friction ends at the bound of what is sought, 3"]),
        ({"value": 3.0, "determined": False}, ["the motions do not determine friction: "]),
    ):
        one = Fitted(**{**vars(FRICTION), **changes})
        found = calibration((one, spread), two).doubts
        assert len(found) == len(doubts) and all(a.startswith(b) for a, b in zip(found, doubts, strict=True))
    for std, zero in ((0.0333, False), (0.0334, True)):  # three standard deviations
        found = calibration((FRICTION, Fitted(**{**vars(spread), "std": std})), two).doubts
        assert bool(found) == zero
        assert not zero or found[0].endswith("upper bounds of 95 %: friction_std (at most 0.17)")
