"""The node as a process: it ends cleanly, also while it works."""

import importlib
import re
import signal
import subprocess
import sys
import threading

import pytest
from rcl_interfaces.srv import ListParameters
from rclpy.action import ActionClient
from running import ANSWER_TIMEOUT, READY_TIMEOUT, NodeProcess, result_of
from scenes import assert_answered, good_request

from unc_physics.checks.errors import ErrorCode
from unc_physics.ros import UncPhysicsNode
from unc_physics.ros.node import run
from unc_physics_msgs.action import PredictLong
from unc_physics_msgs.srv import Predict


def test_a_signal_ends_a_busy_node_cleanly(client):
    with NodeProcess(name="ending", max_computation_time=1e6) as process:
        endless = good_request(propagator="monte_carlo", samples=20_000, horizon=50.0)
        client.start(Predict, "/ending/predict", Predict.Request(request=endless))
        assert_answered(client.predict(good_request(), node="ending"))  # which it takes up after the first
        assert process.end(signal.SIGTERM) == 0
        assert "Traceback" not in process.output


def test_a_signal_as_soon_as_it_is_ready_ends_the_node_cleanly():
    with NodeProcess("-p", "frction:=0.3", "-p", "warm_up:=['']", name="hasty") as process:
        assert process.end() == 0  # its executor takes up services while they are taken back
        assert "ends, after SIGINT" in process.output
        assert "Traceback" not in process.output and "abort" not in process.output
        assert "'frction' is unknown and has no effect; did you mean 'friction'?" in process.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-p", "dt:=0.0"], ".*range"),  # refused by rclpy, as is the next
        (["-p", "dt:=1"], ".*write whole numbers with a point"),
        (["--params-file", "/nonexistent.yaml"], "the command line cannot be read: Couldn't parse params"),
        (["-p", "horizons:=[]"], r"horizons must be above 0 .*got \[\]"),
        (["-p", "islands:=true"], r"islands was removed in version 0\.3: leave it out"),
        (["-p", "planning_scene_topic:='no topic!'"], "planning_scene_topic is no name"),
    ],
)
def test_arguments_that_make_no_sense_end_the_node_with_a_sentence(arguments, words, capfd, monkeypatch):
    monkeypatch.setattr(signal, "signal", lambda *_: None)  # pytest's handlers stay
    monkeypatch.setattr(sys, "setswitchinterval", lambda _: None)
    assert run(UncPhysicsNode, ["--ros-args", *arguments]) == ErrorCode.INVALID_OPTION
    said = capfd.readouterr().err
    assert re.search(f"^unc_physics_node: {words}", said, re.MULTILINE), said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("module", "program"), [("node", "unc_physics_node"), ("lifecycle_node", "unc_physics_lifecycle_node")]
)
@pytest.mark.parametrize("flag", ["-h", "--help"])
def test_help_is_printed_in_place_of_a_node(module, program, flag, capsys, monkeypatch):
    started = importlib.import_module(f"unc_physics.ros.{module}")
    monkeypatch.setattr(started, "leave", sys.exit)  # which ends pytest otherwise
    monkeypatch.setattr(sys, "argv", [program, flag])
    monkeypatch.setattr("unc_physics.ros.node._init", lambda _: pytest.fail("a node was started"))
    with pytest.raises(SystemExit) as ended:
        started.main()
    said = capsys.readouterr().out
    assert ended.value.code == 0
    assert said.startswith(f"usage: {program} [--ros-args") and "unc_physics.ros.parameters" in said


def test_with_an_empty_cache_it_says_what_it_does_and_answers(client, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    first = NodeProcess(name="first")
    process = subprocess.Popen(first.command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    said = next(line for line in process.stdout if "[first]: " in line)
    names = client.call(ListParameters, "/first/list_parameters", ListParameters.Request()).result.names
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=READY_TIMEOUT)
    assert "dt" in names
    assert process.returncode == 0
    assert "warming up auto" in said and "ready" not in output
    assert "Traceback" not in output


def test_a_goal_that_runs_when_the_node_ends_is_answered(client):
    with NodeProcess("-p", "warm_up:=['monte_carlo']", name="ending") as process:
        action = ActionClient(client.node, PredictLong, "/ending/predict_long")
        assert action.wait_for_server(READY_TIMEOUT)
        goal = PredictLong.Goal(request=good_request(propagator="monte_carlo", samples=2000, horizon=60.0))
        running = threading.Event()
        handle = client.of_action(
            lambda: action.send_goal_async(goal, feedback_callback=lambda _: running.set())
        )
        answer = result_of(client.executor.create_task(handle.get_result_async))
        assert running.wait(ANSWER_TIMEOUT)
        assert process.end() == 0
        assert result_of(answer).result.result.error_code == ErrorCode.CANCELED
        assert "Traceback" not in process.output
        action.destroy()
