"""A robot's day for a few seconds; `make soak` takes five minutes."""

import pytest
from day_on_a_robot import GROWTH_LIMIT, day


@pytest.mark.slow
def test_a_robot_s_day():
    # time for a prediction, on a busy machine
    growth, robot = day(5.0, horizons=[2.0, 50.0], max_computation_time=600.0)
    assert growth < 2.0 * GROWTH_LIMIT  # memory is level after minutes only
    assert robot.predicted > 4
