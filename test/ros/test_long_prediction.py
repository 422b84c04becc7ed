"""The action `~/predict_long`."""

import time

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from running import READY_TIMEOUT, result_of
from scenes import assert_answered, good_request, numbers_of

from unc_physics.errors import ErrorCode
from unc_physics_msgs.action import PredictLong


@pytest.fixture(scope="module")
def action(node, client):
    made = ActionClient(client.node, PredictLong, "/unc_physics/predict_long")
    assert made.wait_for_server(READY_TIMEOUT)
    yield made
    made.destroy()


def goal(**others):
    request = good_request(**others)
    fields = {name: getattr(request, name) for name in PredictLong.Goal.get_fields_and_field_types()}
    return PredictLong.Goal(**fields)


def endless():
    return goal(propagator="monte_carlo", samples=20_000, horizon=60.0)


def send(action, message, feedback=None):
    callback = None if feedback is None else (lambda told: feedback.append(told.feedback))
    handle = result_of(action.send_goal_async(message, callback))
    assert handle.accepted
    return handle


def test_a_short_goal_answers_as_the_service_does(action, client):
    answer = result_of(send(action, goal(seed=4, horizon=0.4)).get_result_async())
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert_answered(answer.result)
    expected = client.predict(good_request(seed=4, horizon=0.4))
    for got, want in zip(answer.result.objects, expected.objects, strict=True):
        assert np.array_equal(numbers_of(got.states[-1]), numbers_of(want.states[-1]))


def test_cancel_keeps_what_was_done_and_the_service_answers_meanwhile(action, client):
    feedback = []
    handle = send(action, endless(), feedback)
    time.sleep(0.5)
    assert_answered(client.predict(good_request()))
    time.sleep(0.5)
    started = time.monotonic()
    result_of(handle.cancel_goal_async())
    answered = time.monotonic() - started
    answer = result_of(handle.get_result_async())
    assert answered < 2.0  # the figure is measured in benchmarks/ros_latency.py
    assert (answer.status, answer.result.error_code) == (GoalStatus.STATUS_CANCELED, ErrorCode.CANCELED)
    assert 0.0 < answer.result.time_reached < 60.0
    assert np.isfinite(numbers_of(answer.result.objects[0].states[-1])).all()
    shares = [told.fraction_done for told in feedback]
    assert len(shares) > 2 and shares == sorted(shares) and 0.0 < shares[-1] < 1.0
    assert feedback[-1].time_reached == pytest.approx(60.0 * shares[-1])
    assert feedback[-1].elapsed > 0.0


def test_bad_goals_and_too_many_are_aborted_with_a_reason(action):
    bad = result_of(send(action, goal(propagator="none")).get_result_async())
    assert (bad.status, bad.result.error_code) == (GoalStatus.STATUS_ABORTED, ErrorCode.UNKNOWN_PROPAGATOR)
    running = [send(action, endless()) for _ in range(2)]
    third = result_of(send(action, goal()).get_result_async())
    assert (third.status, third.result.error_code) == (GoalStatus.STATUS_ABORTED, ErrorCode.LIMIT_EXCEEDED)
    for handle in running:
        result_of(handle.cancel_goal_async())
        result_of(handle.get_result_async())
    assert result_of(send(action, goal()).get_result_async()).status == GoalStatus.STATUS_SUCCEEDED
