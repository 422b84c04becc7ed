"""Processes of nodes, and a client."""

import contextlib
import queue
import signal
import subprocess
import sys
import threading
import time

import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.parameter import Parameter

from unc_physics.ros import UncPhysicsNode
from unc_physics_msgs.srv import Predict

READY_TIMEOUT = 600.0  # s; a cold cache compiles everything
ANSWER_TIMEOUT = 200.0  # s, on a busy machine


def spin(executor):
    """Run an executor until it or its context is shut down, even if other threads destroy entities.

    rclpy skips a destroyed subscription or client, but raises at its events.
    """
    ended = False
    while not ended:
        with contextlib.suppress(InvalidHandle):
            with contextlib.suppress(ExternalShutdownException):
                executor.spin()
            ended = True


class NodeProcess:
    """``python -m unc_physics.ros.node`` with ROS arguments and parameters, until the context ends."""

    def __init__(self, *ros_arguments, module="unc_physics.ros.node", name="unc_physics", **parameters):
        remap = ["-r", f"__node:={name}"]
        given = [part for one in parameters.items() for part in ("-p", "{}:={}".format(*map(as_yaml, one)))]
        self.command = [sys.executable, "-m", module, "--ros-args", *remap, *ros_arguments, *given]
        self.name = name

    def __enter__(self):
        self.process = subprocess.Popen(
            self.command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, bufsize=1
        )
        self.lines = []
        self._ready = threading.Event()
        threading.Thread(target=self._read, daemon=True).start()
        deadline = time.monotonic() + READY_TIMEOUT
        while not self._ready.wait(0.05):
            if self.process.poll() is not None or time.monotonic() > deadline:
                self.process.kill()
                raise RuntimeError("the node did not get ready:\n" + "".join(self.lines))
        return self

    def _read(self):
        for line in self.process.stdout:
            self.lines.append(line)
            if "]: ready" in line:  # the log's "[INFO] [time] [name]: ready", and no message that mentions it
                self._ready.set()

    @property
    def output(self):
        """What it has printed so far."""
        return "".join(self.lines)

    def end(self, with_signal=signal.SIGINT, timeout=ANSWER_TIMEOUT):
        """Ask it to end; returns its exit status."""
        self.process.send_signal(with_signal)
        return self.process.wait(timeout)

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.end()


def as_yaml(value):
    """A parameter's value as the command line takes it."""
    return str(value).lower() if isinstance(value, bool) else str(value).replace("'", '"')


@contextlib.contextmanager
def node_in_this_process(
    name="unc_physics", executor=SingleThreadedExecutor, others=(), namespace="", **values
):
    """The node with parameters, spinning in a thread beside nodes that ``others`` make of its context."""
    context = rclpy.Context()
    rclpy.init(context=context)
    start = [Parameter(key, value=value) for key, value in values.items()]
    node = UncPhysicsNode(
        name, context=context, namespace=namespace, parameter_overrides=start, use_global_arguments=False
    )
    running = executor(context=context)
    for each in (node, *(make(context) for make in others)):
        running.add_node(each)
    thread = threading.Thread(target=spin, args=[running], daemon=True)
    thread.start()
    try:
        wait_until(lambda: node.server.is_open, READY_TIMEOUT)
        yield node
    finally:
        node.destroy_node()
        running.shutdown()
        context.try_shutdown()
        thread.join(5.0)


class Client:
    """A node of this process that calls services, spinning in a thread."""

    def __enter__(self):
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node("test_client", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._thread = threading.Thread(target=spin, args=[self.executor], daemon=True)
        self._thread.start()
        self._clients = {}
        return self

    def __exit__(self, *_):
        self.executor.shutdown()
        self.context.try_shutdown()
        self._thread.join(5.0)
        self.node.destroy_node()

    def start(self, service_type, name, request):
        """Send a request; returns the future of its answer."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(service_type, name)
        client = self._clients[name]
        assert client.wait_for_service(READY_TIMEOUT), f"no service {name}"
        return client.call_async(request)

    def call(self, service_type, name, request, timeout=ANSWER_TIMEOUT):
        """Send a request and wait for its answer."""
        return result_of(self.start(service_type, name, request), timeout)

    def of_action(self, start, timeout=ANSWER_TIMEOUT):
        """The result of what a call to an action's client starts.

        The call is made by the thread that spins: rclpy drops an answer that comes before the call has
        returned.
        """
        return result_of(result_of(self.executor.create_task(start)), timeout)

    def set_parameter(self, node, name, value):
        """Set a parameter of a node; the result says whether it was accepted."""
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        (result,) = self.call(SetParameters, f"/{node}/set_parameters", request).results
        return result

    def predict(self, request, node="unc_physics", **others):
        """Call `~/predict` with a PredictionRequest."""
        return self.call(Predict, f"/{node}/predict", Predict.Request(request=request), **others)


class Inbox:
    """Messages of a topic, as they come."""

    def __init__(self, client, message_type, topic, qos=10):
        self._queue = queue.Queue()
        self._node = client.node
        self._subscription = client.node.create_subscription(message_type, topic, self._queue.put, qos)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._node.destroy_subscription(self._subscription)

    def next(self, timeout=ANSWER_TIMEOUT):
        """The next message."""
        return self._queue.get(timeout=timeout)

    def answer(self, send, is_wanted=lambda message: True):
        """The first wanted message; ``send`` causes it, and is repeated until it comes.

        The middleware loses messages of either side until the other one has discovered it.
        """
        deadline, patience = time.monotonic() + ANSWER_TIMEOUT, 0.25
        while True:
            send()
            resend = time.monotonic() + patience
            with contextlib.suppress(queue.Empty):
                while True:
                    message = self.next(max(0.0, resend - time.monotonic()))
                    if is_wanted(message):
                        return message
            assert time.monotonic() < deadline, "nothing came"
            patience *= 2.0

    def all(self):
        """All that have come and were not taken."""
        messages = []
        while not self._queue.empty():
            messages.append(self._queue.get())
        return messages

    def status(self, name, is_wanted=lambda values: True, send=lambda: None):
        """The next wanted status of a name on ``/diagnostics``, and its values; ``send`` causes it."""

        def wanted(message):
            """Statuses among a message's, as other nodes tell theirs, too."""
            found = [(own, {pair.key: pair.value for pair in own.values}) for own in message.status]
            return [(own, values) for own, values in found if own.name == name and is_wanted(values)]

        return wanted(self.answer(send, wanted))[0]


def wait_until(condition, timeout=ANSWER_TIMEOUT):
    """Wait for a condition that other threads make true."""
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, "it did not come true"
        time.sleep(0.02)


def result_of(future, timeout=ANSWER_TIMEOUT):
    """Wait for a future that another thread's executor completes."""
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    assert done.wait(timeout), "no answer"
    return future.result()
