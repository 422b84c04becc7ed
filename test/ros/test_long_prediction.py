"""The action `~/predict_long`."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from running import READY_TIMEOUT, Client, NodeProcess, wait_until
from scenes import assert_answered, assert_same, good_request, numbers_of
from soak import memory

from unc_physics.checks.errors import ErrorCode
from unc_physics.ros.messages.fields import duration, seconds
from unc_physics_msgs.action import PredictLong


@pytest.fixture(scope="module")
def action(node, client):
    made = ActionClient(client.node, PredictLong, "/unc_physics/predict_long")
    assert made.wait_for_server(READY_TIMEOUT)
    yield made
    made.destroy()


def goal(**others):
    return PredictLong.Goal(request=good_request(**others))


def endless():
    return goal(propagator="monte_carlo", samples=2000, horizon=60.0)


@pytest.fixture
def send(action, client):
    """Send a goal and return its handle."""

    def send_goal(message, feedback=None):
        callback = None if feedback is None else (lambda told: feedback.append(told.feedback))
        handle = client.of_action(lambda: action.send_goal_async(message, callback))
        assert handle.accepted
        return handle

    return send_goal


def test_a_short_goal_answers_as_the_service_does(send, client):
    answer = client.of_action(send(goal(seed=4, horizon=0.2)).get_result_async)
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert_same(answer.result, client.predict(good_request(seed=4, horizon=0.2)))


def test_cancel_keeps_what_was_done_and_the_service_answers_meanwhile(send, client):
    feedback = []
    handle = send(endless(), feedback)
    assert_answered(client.predict(good_request()))
    wait_until(lambda: len(feedback) > 2 and feedback[-1].fraction_done > 0.0)
    client.of_action(handle.cancel_goal_async)
    answer = client.of_action(handle.get_result_async)
    assert (answer.status, answer.result.result.error_code) == (
        GoalStatus.STATUS_CANCELED,
        ErrorCode.CANCELED,
    )
    assert 0.0 < seconds(answer.result.prediction.time_reached) < 60.0
    assert np.isfinite(numbers_of(answer.result.prediction.objects[0].states[-1])).all()
    shares = [told.fraction_done for told in feedback]
    assert shares == sorted(shares) and 0.0 < shares[-1] < 1.0
    assert seconds(feedback[-1].time_reached) == pytest.approx(60.0 * shares[-1])
    assert seconds(feedback[-1].elapsed) > 0.0


def test_a_goal_ends_at_its_own_limit_and_not_at_that_of_services():
    with NodeProcess(max_computation_time=0.1, name="limited"), Client() as client:
        action = ActionClient(client.node, PredictLong, "/limited/predict_long")
        assert action.wait_for_server(READY_TIMEOUT)
        goal = endless()
        goal.request.max_computation_time = duration(2.0)
        handle = client.of_action(lambda: action.send_goal_async(goal))
        answer = client.of_action(handle.get_result_async)
        action.destroy()
    assert seconds(answer.result.prediction.computation_time) > 0.5
    assert answer.result.result.error_code == ErrorCode.TIMEOUT
    assert seconds(answer.result.prediction.time_reached) < 60.0


_LEFT_ALONE = """
import sys
sys.path.insert(0, {folder!r})
from running import Client
from rclpy.action import ActionClient
from test_long_prediction import endless
from unc_physics_msgs.action import PredictLong
with Client() as client:
    action = ActionClient(client.node, PredictLong, "/unc_physics/predict_long")
    action.wait_for_server()
    client.of_action(lambda: action.send_goal_async(endless(), lambda _: print("running", flush=True)))
    sys.stdin.read()
"""


def test_a_goal_ends_after_its_client_was_killed(send, client, node):
    """Another client listens meanwhile."""
    handle = send(endless())
    code = _LEFT_ALONE.format(folder=str(Path(__file__).parent))
    other = subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert other.stdout is not None
    assert other.stdout.readline() == "running\n"
    before = node.output.count("the client is gone")
    other.kill()  # and is not waited for yet, as by a parent that is busy
    wait_until(lambda: node.output.count("the client is gone") > before)
    other.communicate()
    client.of_action(handle.cancel_goal_async)
    answer = client.of_action(handle.get_result_async)
    assert answer.status == GoalStatus.STATUS_CANCELED  # not ended with the other one


def test_bad_goals_are_aborted_with_a_reason_and_too_many_rejected(send, action, client):
    bad = client.of_action(send(goal(propagator="none")).get_result_async)
    assert (bad.status, bad.result.result.error_code) == (
        GoalStatus.STATUS_ABORTED,
        ErrorCode.UNKNOWN_PROPAGATOR,
    )
    feedback = [], []
    running = [send(endless(), told) for told in feedback]
    wait_until(lambda: all(feedback))
    assert not client.of_action(lambda: action.send_goal_async(goal())).accepted
    for handle in running:
        client.of_action(handle.cancel_goal_async)
        client.of_action(handle.get_result_async)
    assert client.of_action(send(goal()).get_result_async).status == GoalStatus.STATUS_SUCCEEDED


@pytest.mark.long
def test_memory_of_a_large_result_is_returned():
    """A result is kept for 10 s, for its client to fetch it."""

    def complete(message):
        handle = client.of_action(lambda: action.send_goal_async(message))
        answer = client.of_action(handle.get_result_async, 300.0)
        assert answer.status == GoalStatus.STATUS_SUCCEEDED
        return answer.result.prediction

    with NodeProcess(name="large") as node, Client() as client:
        action = ActionClient(client.node, PredictLong, "/large/predict_long")
        assert action.wait_for_server(READY_TIMEOUT)
        complete(goal(samples=100, propagator="monte_carlo"))
        before = memory(node.process)
        large = {"samples": 1000, "return_samples": 1000, "trajectory_period": 0.002}
        prediction = complete(goal(propagator="monte_carlo", **large))
        assert sum(len(state.pose_samples) for state in prediction.objects[0].states) == 100_000

        def is_returned():
            complete(goal(samples=100, propagator="monte_carlo"))
            return memory(node.process) < before + 50.0

        wait_until(is_returned)
        action.destroy()
