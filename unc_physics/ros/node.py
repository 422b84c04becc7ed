"""The executable ``unc_physics_node``: run a prediction node until SIGINT or SIGTERM."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import signal
import sys
import threading
import traceback

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

try:  # halves the time from message to callback
    from rclpy.experimental.events_executor import EventsExecutor
except ImportError:  # an older rclpy
    EventsExecutor = SingleThreadedExecutor

from ..checks.errors import ErrorCode, InvalidOptionError, UncPhysicsError
from .server import PredictionServer

# with Python's default of 5 ms, other threads would delay a prediction
_SWITCH_INTERVAL = 5e-4  # s
_POLL_PERIOD = 0.5  # s, between checks whether the node is ready or failed
_SETTLING_TIMEOUT = 0.5  # s
_LONGEST_END = 1.8  # s from a signal to the end of the process, whatever still computes
_MOST_ARENAS = -8  # number of the option M_ARENA_MAX of glibc's mallopt
_USAGE = """\
usage: {program} [--ros-args [-p NAME:=VALUE]... [--params-file FILE] [-r OLD:=NEW]...]

  -p NAME:=VALUE      set a parameter
  --params-file FILE  set the parameters in a YAML file
  -r OLD:=NEW         rename a topic, a service, or the node (__node:=NAME, __ns:=/NAMESPACE)

`python3 -m unc_physics.ros.parameters` prints a file of the prediction node's parameters with descriptions.
While the node runs, `ros2 param describe NODE NAME` describes one."""
# kept until the process ends: freeing an events executor with callbacks aborts the process
_ended_executors = []


class ServingNode(Node):
    """Node with a prediction server.

    Parameters
    ----------
    node_name : str
    **others
        Arguments of rclpy's node.

    Attributes
    ----------
    server : PredictionServer
    failed : Exception or None
        Error that prevented the node from getting ready.
    """

    def __init__(self, node_name: str = "unc_physics", **others):
        super().__init__(node_name, **others)
        self.server = PredictionServer(self)
        self.failed: Exception | None = None

    @property
    def is_ready(self) -> bool:
        """Whether all interfaces are advertised."""
        return self.server.is_open

    def close(self) -> None:
        """End running predictions and answer them."""
        self.server.close()

    def destroy_node(self):
        """End running predictions, answer them, and destroy the node."""
        self.close()
        self.server.discard()
        super().destroy_node()


class UncPhysicsNode(ServingNode):
    """Prediction server on a plain node, for any executor.

    It warms up in a separate thread, then advertises its services. Meanwhile its executor spins, and
    parameters can be read. `destroy_node` ends running predictions.
    """

    def __init__(self, node_name: str = "unc_physics", **others):
        super().__init__(node_name, **others)
        self._ended = threading.Event()
        threading.Thread(target=self._prepare, name="warm-up", daemon=True).start()

    def _prepare(self):
        try:
            self.server.prepare()
        except Exception as error:  # noqa: BLE001  (logged by the spinning thread)
            self.failed = error
        while not self._ended.wait(0.01):  # the node may not be in an executor yet
            if (executor := self.executor) is not None:
                executor.create_task(self._open)
                return

    def _open(self):
        if self._ended.is_set():
            return
        try:
            if self.failed is None:
                self.server.open()
                return
        except Exception as error:  # noqa: BLE001
            self.failed = error
        self.get_logger().fatal(f"the node does not get ready: {self.failed}")

    def destroy_node(self):
        """End running predictions, answer them, and destroy the node."""
        self._ended.set()
        super().destroy_node()


def run(make_node, arguments=None, program="unc_physics_node") -> int:
    """Spin a node until SIGINT, SIGTERM or the shutdown of its context; return the exit status.

    The node is closed while it still spins, so that all requests are answered. With ``-h`` or ``--help``, the
    usage is printed instead.

    Parameters
    ----------
    make_node : callable
        Creates the node, which has ``is_ready``, ``failed`` and ``close`` as a `ServingNode`.
    arguments : list of str, optional
        Command line with ROS arguments.
    program : str
        Name of the program in the usage and in error messages.
    """
    if {"-h", "--help"} & set(sys.argv[1:] if arguments is None else arguments):
        print(_USAGE.format(program=program))
        return 0
    stop, ended, node, spinning = threading.Event(), threading.Event(), None, None
    received: list[int] = []

    def end(number, _):
        received.append(number)
        stop.set()

    try:
        _init(arguments)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, end)
        threading.Thread(target=_end_soon, args=[stop, ended], daemon=True).start()
        share_memory()
        sys.setswitchinterval(_SWITCH_INTERVAL)
        node = make_node()
        spinning = Spinning(node)
        frozen = False
        while rclpy.ok() and node.failed is None and not stop.wait(_POLL_PERIOD):
            if node.is_ready and not frozen:
                frozen = True
                gc.collect()
                gc.freeze()  # garbage collection skips the objects that exist now
        for number in received[:1]:
            node.get_logger().info(f"ends, after {signal.Signals(number).name}")
        if node.failed is not None:
            raise node.failed
    except UncPhysicsError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return int(error.code)
    # rclpy's errors of a range, a type or a name
    except (ParameterException, NameValidationException) as error:
        whole = "of type 'INTEGER" in str(error) and "expecting type 'DOUBLE" in str(error)
        hint = "; write whole numbers with a point, as 1.0" if whole else ""
        print(f"{program}: {' '.join(str(error).split())}{hint}", file=sys.stderr)
        return int(ErrorCode.INVALID_OPTION)
    finally:
        if node is not None:
            if spinning is not None:
                spinning.settle()
            node.close()
            if spinning is not None:
                spinning.end()
            node.destroy_node()
        rclpy.try_shutdown()
        ended.set()
        stop.set()
    return 0


def share_memory() -> None:
    """Have threads share as many of glibc's memory arenas as there are processor cores.

    By default there are eight times as many, and each keeps freed memory that no other one can use.
    """
    with contextlib.suppress(AttributeError, OSError):  # another C library
        ctypes.CDLL(None).mallopt(_MOST_ARENAS, os.cpu_count() or 1)


def _end_soon(stop, ended):
    """End the process some time after a signal, even if a computation does not end."""
    stop.wait()
    if not ended.wait(_LONGEST_END):
        leave(0)


def _init(arguments):
    """Initialize rclpy; its exceptions for invalid arguments are not public."""
    try:
        # its signal handlers would shut down the middleware while predictions run
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # noqa: BLE001
        reason, *_ = str(error).removeprefix("failed to initialize rcl: ").partition(", at /")
        raise InvalidOptionError(f"cannot be read: {reason}", field="the command line") from None


class Spinning:
    """Thread that spins a node, and continues after exceptions in callbacks.

    Parameters
    ----------
    node : rclpy Node
    """

    def __init__(self, node):
        self._node, self._executor, self._ended = node, EventsExecutor(), threading.Event()
        self._executor.add_node(node)
        self._thread = threading.Thread(target=self._run, name="executor", daemon=True)
        self._thread.start()

    def _run(self):
        while rclpy.ok() and not self._ended.is_set():
            try:
                self._executor.spin_once(timeout_sec=1.0)  # spin() of the events executor never idles
            except Exception:  # noqa: BLE001  (rclpy's own, for example if the client of an action is gone)
                if self._ended.is_set() or not rclpy.ok():
                    return
                self._node.get_logger().error(f"a callback failed:\n{traceback.format_exc()}")

    def settle(self):
        """Wait until the executor has added the newest entities; destroying them earlier would fail."""
        done = threading.Event()
        self._executor.create_task(done.set)
        done.wait(_SETTLING_TIMEOUT)

    def end(self):
        """End the thread."""
        self._ended.set()
        _ended_executors.append(self._executor)
        self._executor.shutdown()
        self._thread.join(_SETTLING_TIMEOUT)  # a daemon: one that does not wake up ends with the process


def leave(status: int) -> None:
    """End the process without the middleware's exit handlers, which sometimes crash."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def main(arguments=None) -> None:
    """Run the plain node and end the process."""
    leave(run(UncPhysicsNode, arguments))


if __name__ == "__main__":
    main()
