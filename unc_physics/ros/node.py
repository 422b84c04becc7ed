"""The executable ``unc_physics_node``: a node that predicts, up until SIGINT or SIGTERM."""

from __future__ import annotations

import gc
import os
import sys
import traceback

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

try:  # takes less than half the time from message to callback
    from rclpy.experimental.events_executor import EventsExecutor
except ImportError:  # an older rclpy
    EventsExecutor = SingleThreadedExecutor

from ..checks.errors import UncPhysicsError
from .server import PredictionServer

# Python's 5 ms would let other threads' bookkeeping hold up a prediction that is nearly done
_SWITCH_INTERVAL = 5e-4  # s


class UncPhysicsNode(Node):
    """The prediction server on a plain node, ready once made."""

    def __init__(self):
        super().__init__("unc_physics")
        self.server = PredictionServer(self)
        self.server.prepare()
        self.server.open()


def run(make_node, arguments=None) -> int:
    """Spin a node until SIGINT, SIGTERM or the end of its context; returns the exit status.

    Parameters
    ----------
    make_node : callable
        Makes the node, which has a `PredictionServer` as ``server``.
    arguments : list of str, optional
        Command line with ROS arguments.
    """
    node = None
    try:
        rclpy.init(args=arguments)
        sys.setswitchinterval(_SWITCH_INTERVAL)
        node = make_node()
        spin_node(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except UncPhysicsError as error:
        print(f"unc_physics_node: {error}", file=sys.stderr)
        return int(error.code)
    except Exception:
        if rclpy.ok():
            raise
        # a signal during the start: nothing can be made any more, which is no fault
    finally:
        if node is not None:
            node.server.close()
            node.server.discard()
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def spin_node(node) -> None:
    """Spin a node until its context ends, whatever callbacks raise."""
    executor = EventsExecutor()
    executor.add_node(node)
    gc.collect()
    gc.freeze()  # what is there by now stays: collections need not look at it again
    try:
        while rclpy.ok():
            try:
                executor.spin_once(timeout_sec=1.0)  # spin() of the events executor is never idle
            except Exception:  # noqa: BLE001  (rclpy's own: a client that goes away while an action answers it, say)
                if rclpy.ok():
                    node.get_logger().error(f"a callback failed:\n{traceback.format_exc()}")
    finally:
        executor.shutdown()


def leave(status: int) -> None:
    """End the process at once: all is closed by now, and the middleware's own clean-up at exit crashes now
    and then.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def main(arguments=None) -> None:
    """Run the plain node, and end the process."""
    leave(run(UncPhysicsNode, arguments))


if __name__ == "__main__":
    main()
