"""Order of accuracy: answers that obey the laws, cases that begin right, and orders that are fitted right."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics.shapes import signed_distance
from unc_physics.spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION
from unc_physics_evaluation import order_references as exact
from unc_physics_evaluation.experiments import orders as experiment
from unc_physics_evaluation.order_cases import CASES, end_states
from unc_physics_evaluation.order_references import BALL_INERTIA, GRAVITY
from unc_physics_evaluation.rollouts import available

STEPS = 1.0 / np.array(experiment.RATES)


def rate_of(function, time, step=1e-4):
    return (function(time + step) - function(time - step)) / (2.0 * step)


def test_a_tumbling_body_keeps_its_angular_momentum():
    """The momentum at 0 gives the angular velocity later, which is the orientation's rate."""
    inertia, start = np.array([3.0, 2.0, 1.2]), np.array([0.5, 4.0, -1.0])
    before, now, after = (
        Rotation.from_quat(exact.tumbling_orientation(inertia, start, time)) for time in (0.6999, 0.7, 0.7001)
    )
    spin = (after * before.inv()).as_rotvec() / 2e-4
    momentum = now.apply(inertia * now.inv().apply(spin))
    np.testing.assert_allclose(momentum, inertia * start, rtol=1e-6)
    assert now.magnitude() > 1.0


def test_rolling_keeps_the_energy():
    radius, angle = 0.5, 0.1
    turn = rate_of(lambda time: exact.dome_angle(radius, angle, time), 0.4)
    fallen = radius * (math.cos(angle) - math.cos(exact.dome_angle(radius, angle, 0.4)))
    assert 0.5 * (1.0 + BALL_INERTIA) * (radius * turn) ** 2 == pytest.approx(GRAVITY * fallen, rel=1e-6)
    speed = rate_of(lambda time: exact.incline_distance(0.2, 0.5, time), 0.4)
    fallen = exact.incline_distance(0.2, 0.5, 0.4) * math.sin(0.2)
    assert 0.75 * speed**2 == pytest.approx(GRAVITY * fallen, rel=1e-6)


def test_a_rocking_block_has_housners_impact():
    """Before the impact the energy is kept; after it the block rises to the height that is left."""
    width, height, tilt = 0.04, 0.2, 0.1
    times = np.arange(0.0, 0.5, 0.002)
    tilts = np.array([exact.rocking_tilt(width, height, tilt, time) for time in times])
    falling = tilts[: np.argmax(tilts < 0.0)]
    assert falling[0] == tilt and np.all(np.diff(falling) < 0.0)
    across, up = 0.5 * width, 0.5 * height
    standing, gyration = 0.25 * height**2, (width**2 + height**2) / 12.0
    kept = (gyration + standing - across**2) / (gyration + standing + across**2)

    def rise(angle):
        return up * (math.cos(angle) - 1.0) + across * math.sin(angle)

    assert rise(-tilts.min()) == pytest.approx(kept**2 * rise(tilt), rel=1e-3)


@pytest.mark.parametrize("engine", available())
@pytest.mark.parametrize("name", CASES)
def test_the_error_is_that_of_the_end(name, engine):
    """Each case moves farther than its floor, and a rollout's error is finite."""
    case = CASES[name](1.0 / 240.0)
    for rate in experiment.RATES:
        assert case.horizon * rate == pytest.approx(round(case.horizon * rate), abs=1e-9)
    moved = case.error(case.start)
    assert moved == 0.0 if name == "standing_stack" else moved > 20.0 * case.floor
    assert 0.0 <= case.error(end_states(case, engine)) < 1.0


@pytest.mark.parametrize("name", sorted(set(CASES) - {"flight_path", "flight_tumbling"}))
def test_bodies_begin_in_touch(name):
    """The lowest body touches the floor or the dome, or is to fall from 0.2 m."""
    case = CASES[name](0.01)
    (element,) = case.scene.environment
    gaps = [
        signed_distance(body.model, (state[POSITION], state[QUATERNION]), element, None).distance
        for body, state in zip(case.scene.bodies, case.start, strict=True)
    ]
    assert min(gaps) == pytest.approx(0.2 if name == "bouncing_ball" else 0.0, abs=1e-7)


def test_the_start_is_what_the_answer_begins_with():
    case = CASES["flight_tumbling"](0.01)
    later = case.start.copy()
    later[0, 6:10] = exact.tumbling_orientation(
        np.diag(case.scene.bodies[0].model.inertia), case.start[0, ANGULAR_VELOCITY], case.horizon
    )
    assert case.error(later) < 1e-12
    case = CASES["rocking_block"](0.01)
    assert case.measure(case.start) == pytest.approx(exact.rocking_tilt(0.04, 0.2, 0.1, 0.0))


@pytest.mark.parametrize("order", [1, 2])
def test_the_order_is_the_slope_above_the_floor(order):
    errors = 3.0 * STEPS**order
    floor = errors[4]
    found, count = experiment.observed_order(np.stack([STEPS, np.maximum(errors, floor)], axis=1), floor)
    assert found == pytest.approx(order) and count == 4


def test_an_error_that_stays_has_no_order():
    curve = np.stack([STEPS, np.full(len(STEPS), 0.1)], axis=1)
    assert experiment.observed_order(curve, 0.01) == (pytest.approx(0.0), len(STEPS))
    assert experiment.observed_order(curve, 0.2) == (math.inf, 0)
    curve[0, 1] = math.nan
    assert math.isnan(experiment.observed_order(curve, 0.01)[0])
