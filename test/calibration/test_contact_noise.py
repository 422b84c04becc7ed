"""Contact noise fitted to simulated throws, whose impacts err by a known amount."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from throws import scene, throws

from unc_physics import ContactNoise, Motion, UncPhysicsError, calibrate_contact_noise
from unc_physics.calibration.contact_noise import _shown, _started
from unc_physics.spatial.layout import ERR_POSITION, POSITION
from unc_physics.tracking.measurements import PoseMeasurement

STD = np.repeat([2e-3, 0.02], 3)
KNOWN = {"friction": 0.3, "restitution": 0.3}
MODEL, ERRING = scene(**KNOWN), scene(**KNOWN, impact_direction_std=0.15, impact_point_std=6e-3)
QUIET = ContactNoise(velocity=0.01, rotation=1.0)


def nees(motions, noise):
    """Mean squared error of positions after contact over its variance; 1 is right."""
    found = []
    for k, motion in enumerate(motions):
        one = _shown(motion, MODEL, STD, 30.0, 1, k)
        tracker = _started(one, MODEL, noise, 32, 0)
        for n, (time, pose) in enumerate(zip(one.times.tolist(), one.measured, strict=True)):
            tracker.correct(time, {"box": PoseMeasurement(pose, STD)})
            if n >= one.contact:
                belief = tracker.belief(time)
                e = belief.mean[0, POSITION] - one.recorded[n, :3]
                found.append(e @ np.linalg.solve(belief.marginal(0)[ERR_POSITION, ERR_POSITION], e) / 3.0)
    return float(np.mean(found))


def fitted(motions):
    return calibrate_contact_noise(motions, MODEL, STD, noise=QUIET, members=32, evaluations=14)


@pytest.fixture(scope="module")
def of_erring_impacts():
    return fitted(throws(ERRING, 8, seed=3))


def test_noise_makes_up_for_errors_of_impacts(of_erring_impacts):
    assert of_erring_impacts.scores[1] > of_erring_impacts.scores[0] + 0.3
    assert of_erring_impacts.motions == 8
    others = throws(ERRING, 8, seed=4)
    before, after = nees(others, QUIET), nees(others, of_erring_impacts.noise)
    assert before > 1.4
    assert abs(after - 1.0) < 0.35


def test_exact_impacts_need_less(of_erring_impacts):
    exact = fitted(throws(MODEL, 4, seed=5)).noise
    assert exact.velocity < 0.5 * of_erring_impacts.noise.velocity


def test_an_executor_changes_no_bit():
    motions, options = throws(MODEL, 2, seed=5), {"members": 8, "evaluations": 10}
    with ThreadPoolExecutor(2) as threads:
        one, other = (
            calibrate_contact_noise(motions, MODEL, STD, executor=executor, **options)
            for executor in (None, threads)
        )
    assert one == other


def test_motions_without_contact_are_refused():
    times = np.arange(20) / 120.0
    falls = Motion(
        "high", times, np.c_[np.zeros((20, 2)), 3.0 - 4.9 * times**2, np.zeros((20, 3)), np.ones(20)]
    )
    with pytest.raises(UncPhysicsError, match="after the first contact"):
        calibrate_contact_noise([falls], MODEL, STD)
    with pytest.raises(UncPhysicsError, match="std"):
        calibrate_contact_noise([falls], MODEL, np.zeros(6))
