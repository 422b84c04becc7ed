"""The node as a process: it ends cleanly, also while it works."""

import signal
import subprocess
import time

import pytest
from running import Client, NodeProcess, result_of
from scenes import assert_answered, good_request

from unc_physics_msgs.srv import Predict


@pytest.mark.parametrize(("with_signal", "busy"), [(signal.SIGINT, False), (signal.SIGTERM, True)])
def test_a_signal_ends_the_node_cleanly(with_signal, busy):
    with NodeProcess(name="ending") as process, Client() as client:
        assert_answered(client.predict(good_request(), node="ending"))
        if busy:
            endless = good_request(propagator="monte_carlo", samples=20_000, horizon=50.0)
            client.start(Predict, "/ending/predict", Predict.Request(request=endless))
            time.sleep(0.5)
        started = time.monotonic()
        assert process.end(with_signal) == 0
        assert time.monotonic() - started < 5.0
        assert "Traceback" not in process.output


@pytest.mark.parametrize(("with_signal", "delay"), [(signal.SIGTERM, 0.8), (signal.SIGINT, 2.0)])
def test_a_signal_while_it_starts_ends_the_node_cleanly(with_signal, delay):
    starting = NodeProcess(name="starting")
    process = subprocess.Popen(starting.command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    time.sleep(delay)
    process.send_signal(with_signal)
    output, _ = process.communicate(timeout=200.0)
    if process.returncode not in (
        -with_signal,
        0,
    ):  # before rclpy has its own handlers, Python's default ends it
        assert "KeyboardInterrupt" in output and delay < 1.0, output


def test_two_clients_do_not_wait_for_each_other(node, client):
    long = good_request(propagator="monte_carlo", samples=5000, horizon=50.0, max_computation_time=2.0)
    with Client() as other:
        assert_answered(other.predict(good_request()))
        slow = client.start(Predict, "/unc_physics/predict", Predict.Request(request=long))
        time.sleep(0.3)
        started = time.monotonic()
        assert_answered(other.predict(good_request()))
        assert time.monotonic() - started < 1.5
        assert not slow.done()
        result_of(slow)


def test_a_wrong_parameter_ends_the_node_with_a_sentence():
    wrong = NodeProcess("-p", "gravity:=[1.0, 2.0]", name="wrong")
    with pytest.raises(RuntimeError, match="gravity must have 3 numbers"), wrong:
        pass
