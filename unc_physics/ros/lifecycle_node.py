"""The same node with a lifecycle: configure finds models and warms up, activate advertises."""

from __future__ import annotations

import signal
import traceback

if __name__ == "__main__":  # until rclpy takes over, a signal just ends the process
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

from ..checks.errors import UncPhysicsError
from .node import leave, run
from .server import PredictionServer


class UncPhysicsLifecycleNode(LifecycleNode):
    """The prediction server on a lifecycle node, for any executor; what goes wrong in a transition is logged,
    and the transition fails.

    Parameters
    ----------
    node_name : str
    **others
        As for rclpy's `Node`.

    Attributes
    ----------
    server : PredictionServer
    """

    failed = None  # what is wrong, a transition says

    def __init__(self, node_name: str = "unc_physics", **others):
        super().__init__(node_name, **others)
        self.server = PredictionServer(self)

    def on_configure(self, state):
        """Find the models and warm up."""
        return self._attempt(self.server.prepare)

    def on_activate(self, state):
        """Advertise."""
        return self._attempt(self.server.open)

    def on_deactivate(self, state):
        """Take everything back; running predictions end."""
        return self._attempt(lambda: self.server.close("is being deactivated"))

    def on_cleanup(self, state):
        """Nothing is kept open."""
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state):
        """Take everything back."""
        return self._attempt(self.server.close)

    def destroy_node(self):
        """End what is computed, answer it, and destroy the node."""
        self.server.close()
        self.server.discard()
        super().destroy_node()

    def _attempt(self, step):
        try:
            step()
        except UncPhysicsError as error:
            self.get_logger().error(f"the transition failed: {error}")
            return TransitionCallbackReturn.FAILURE
        except Exception:  # noqa: BLE001  (rclpy would end the node)
            self.get_logger().error(f"the transition failed:\n{traceback.format_exc()}")
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS


def main(arguments=None) -> None:
    """Run the lifecycle node, and end the process."""
    leave(run(UncPhysicsLifecycleNode, arguments))


if __name__ == "__main__":
    main()
