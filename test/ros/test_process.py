"""The node as a process: it ends cleanly, also while it works."""

import re
import signal
import subprocess
import threading
import time

import pytest
from rcl_interfaces.srv import ListParameters
from rclpy.action import ActionClient
from running import NodeProcess, result_of
from scenes import assert_answered, good_request

from unc_physics.checks.errors import ErrorCode
from unc_physics_msgs.action import PredictLong
from unc_physics_msgs.srv import Predict


def test_a_signal_ends_a_busy_node_cleanly(client):
    with NodeProcess(name="ending") as process:
        assert_answered(client.predict(good_request(), node="ending"))
        endless = good_request(propagator="monte_carlo", samples=20_000, horizon=50.0)
        client.start(Predict, "/ending/predict", Predict.Request(request=endless))
        time.sleep(0.5)
        started = time.monotonic()
        assert process.end(signal.SIGTERM) == 0
        assert time.monotonic() - started < 5.0
        assert "Traceback" not in process.output


@pytest.mark.parametrize(("with_signal", "delay"), [(signal.SIGTERM, 0.8), (signal.SIGINT, 2.0)])
def test_a_signal_while_it_starts_ends_the_node_cleanly(with_signal, delay):
    starting = NodeProcess(name="starting")
    # a shell's background job ignores SIGINT, and so would the node until it has a handler
    command = ["env", "--default-signal", *starting.command]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    time.sleep(delay)
    process.send_signal(with_signal)
    output, _ = process.communicate(timeout=200.0)
    if process.returncode not in (
        -with_signal,
        0,
    ):  # before rclpy has its own handlers, Python's default ends it
        assert "KeyboardInterrupt" in output and delay < 1.0, output


def test_a_signal_as_soon_as_it_is_ready_ends_the_node_cleanly():
    with NodeProcess("-p", "frction:=0.3", "-p", "warm_up:=['']", name="hasty") as process:
        assert process.end() == 0  # its executor takes up services while they are taken back
        assert "Traceback" not in process.output and "abort" not in process.output
        assert "'frction' is unknown and has no effect; is 'friction' meant?" in process.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-p", "dt:=0.0"], ".*range"),  # refused by rclpy, as is the next
        (["-p", "dt:=1"], ".*write whole numbers with a point"),
        (["--params-file", "/nonexistent.yaml"], "the command line cannot be read: Couldn't parse params"),
        (["-p", "horizons:=[]"], r"horizons must be above 0 .*got \[\]"),
        (["-p", "tracked_topics:=['no topic!']", "-p", "tracked_models:=[can]"], "tracked_topics is no name"),
    ],
)
def test_arguments_that_make_no_sense_end_the_node_with_a_sentence(arguments, words):
    wrong = NodeProcess(*arguments, name="wrong")
    ended = subprocess.run(wrong.command, check=False, capture_output=True, text=True, timeout=60.0)
    assert ended.returncode == ErrorCode.INVALID_OPTION
    assert re.search(f"^unc_physics_node: {words}", ended.stderr, re.MULTILINE), ended.stderr
    assert "Traceback" not in ended.stderr


def test_with_an_empty_cache_it_says_what_it_does_and_answers(client, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    first = NodeProcess(name="first")
    process = subprocess.Popen(first.command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    said = next(line for line in process.stdout if "[first]: " in line)
    names = client.call(ListParameters, "/first/list_parameters", ListParameters.Request()).result.names
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=60.0)
    assert "dt" in names
    assert process.returncode == 0
    assert "warming up auto" in said and "ready" not in output
    assert "Traceback" not in output


def test_a_goal_that_runs_when_the_node_ends_is_answered(client):
    with NodeProcess("-p", "warm_up:=['monte_carlo']", name="ending") as process:
        action = ActionClient(client.node, PredictLong, "/ending/predict_long")
        assert action.wait_for_server(10.0)
        goal = PredictLong.Goal(request=good_request(propagator="monte_carlo", samples=2000, horizon=60.0))
        running = threading.Event()
        handle = client.of_action(
            lambda: action.send_goal_async(goal, feedback_callback=lambda _: running.set())
        )
        answer = result_of(client.executor.create_task(handle.get_result_async))
        assert running.wait(30.0)
        time.sleep(0.3)
        assert process.end() == 0
        assert result_of(answer).result.result.error_code == ErrorCode.CANCELED
        assert "Traceback" not in process.output
        action.destroy()
