"""The start that the first poses give: unbiased, and as sure as it says."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from throws import NOISE, scene, throws

from unc_physics import Motion, Plane
from unc_physics.calibration.flight import fit_start, flight_frames, flight_gravity, pose_noise

SCENE = scene()
INERTIA = np.diag([1.0, 2.0, 2.5]) * 1e-3
UNEQUAL = replace(SCENE, bodies=[replace(SCENE.bodies[0], inertia=INERTIA)])


def flights(count, noise, seed=0, spin=6.0, inertia=INERTIA):
    """Free flights of a body, and their true states at time 0."""
    rng, found, truth, dt = np.random.default_rng(seed), [], [], 0.01
    for k in range(count):
        q, omega = Rotation.random(random_state=seed + k), spin * rng.standard_normal(3)
        v, p = rng.standard_normal(3), np.array([0.0, 0.0, 5.0])
        truth.append(np.concatenate([p, v, q.as_quat(), omega]))
        rows, turn, momentum = [], q, None
        for j in range(8):
            t = j * dt
            position = p + v * t + 0.5 * t**2 * SCENE.gravity + noise[0] * rng.standard_normal(3)
            seen = turn * Rotation.from_rotvec(noise[1] * rng.standard_normal(3))
            rows.append(np.concatenate([position, seen.as_quat()]))
            for _ in range(10):  # the spin's change, by small steps that keep the angular momentum
                world = turn.as_matrix() @ inertia @ turn.as_matrix().T
                momentum = world @ omega if momentum is None else momentum
                half = Rotation.from_rotvec(np.linalg.solve(world, momentum) * dt / 20) * turn
                world = half.as_matrix() @ inertia @ half.as_matrix().T
                turn = Rotation.from_rotvec(np.linalg.solve(world, momentum) * dt / 10) * turn
        found.append(Motion(str(k), dt * np.arange(8), np.array(rows)))
    return found, np.array(truth)


@pytest.mark.parametrize(
    ("inertia", "gyroscopic"), [(INERTIA, True), (2e-3 * np.eye(3), True), (np.eye(3), False)]
)
def test_a_flight_without_noise_is_found_again(inertia, gyroscopic):
    """Without the gyroscopic term a body turns as one whose moments are equal."""
    motions, truth = flights(5, (0.0, 0.0), inertia=inertia)
    body = replace(SCENE.bodies[0], inertia=inertia if gyroscopic else INERTIA)
    of = replace(SCENE, bodies=[body], gyroscopic=gyroscopic)
    for motion, state in zip(motions, truth, strict=True):
        start = fit_start(motion, of)
        np.testing.assert_allclose(start.state[:6], state[:6], atol=1e-9)
        turn = Rotation.from_quat(start.state[6:10]) * Rotation.from_quat(state[6:10]).inv()
        assert turn.magnitude() < 1e-4
        np.testing.assert_allclose(start.state[10:], state[10:], atol=0.01)


def test_it_is_as_sure_as_it_says():
    motions, truth = flights(100, NOISE, spin=2.0)
    starts = [fit_start(motion, UNEQUAL) for motion in motions]
    assert pose_noise(starts) == pytest.approx(NOISE, rel=0.1)
    squares = np.zeros(12)
    for start, state in zip(starts, truth, strict=True):
        P = start.belief(*NOISE).marginal(0)
        turn = (Rotation.from_quat(state[6:10]).inv() * Rotation.from_quat(start.state[6:10])).as_rotvec()
        error = np.concatenate([start.state[:6] - state[:6], turn, start.state[10:] - state[10:]])
        squares += np.linalg.solve(np.linalg.cholesky(P), error) ** 2
    assert squares / 100 == pytest.approx(np.ones(12), abs=0.55)


def test_flight_ends_where_it_touches():
    motions = throws(SCENE, 6, noise=(0.0, 0.0))
    for motion in motions:
        count = flight_frames(motion, SCENE)
        assert 3 < count < 30
        higher = replace(SCENE, environment=[Plane(offset=0.03)])
        assert flight_frames(motion, higher) < count
    assert fit_start(motions[0], replace(SCENE, environment=[Plane(offset=0.2)])) is None


def test_flights_tell_gravity():
    motions, _ = flights(12, NOISE)
    longer = [Motion(m.name, np.arange(16) * 0.01, np.vstack([m.poses, m.poses])) for m in motions]
    for motion in longer:
        motion.poses[:, :3] = motion.poses[0, :3] + 0.5 * motion.times[:, None] ** 2 * [0.1, -0.2, -9.5]
    assert flight_gravity(longer, SCENE).acceleration == pytest.approx([0.1, -0.2, -9.5], rel=1e-6)
    assert flight_gravity(motions, SCENE) is None, "too short"
    assert flight_gravity(longer, replace(SCENE, gravity=(0.0, 0.0, 0.0))) is None


@pytest.mark.parametrize("rate", [60, 90])
def test_a_bounce_between_two_frames_is_no_part_of_a_flight(rate):
    motions = throws(SCENE, 20, dt=1.0 / rate, poses=rate // 2, noise=(5e-4, 3e-3), height=0.4)
    for motion in motions:
        count = flight_frames(motion, SCENE)
        fit = np.polyfit(motion.times[:count], motion.poses[:count, 2], 2)
        assert np.std(motion.poses[:count, 2] - np.polyval(fit, motion.times[:count])) < 1e-3
    found = flight_gravity(motions, SCENE)
    error = np.abs(found.acceleration - SCENE.gravity)
    assert error.max() < 0.098 and (error < 4.0 * found.std).all()


def test_a_flight_unlike_the_others_is_left_out_of_gravity():
    poses, rng = np.tile([0, 0, 5.0, 0, 0, 0, 1], (16, 1)), np.random.default_rng(0)
    motions = [Motion(str(k), np.arange(16) * 0.01, poses) for k in range(5)]
    for motion in motions:
        motion.poses[:, 2] -= 0.5 * 9.81 * motion.times**2
        motion.poses[:, :3] += 1e-4 * rng.standard_normal((16, 3))
    before = flight_gravity(motions[:4], SCENE)
    motions[4].poses[10:, 2] += 2.0 * (motions[4].times[10:] - 0.1)  # hits something that the scene lacks
    after = flight_gravity(motions, SCENE)
    np.testing.assert_array_equal(after.acceleration, before.acceleration)
    np.testing.assert_array_equal(after.std, before.std)
