"""Lifecycle node: configure finds models and warms up, activate advertises."""

from __future__ import annotations

import traceback

from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

from ..checks.errors import UncPhysicsError
from .node import ServingNode, leave, run


class UncPhysicsLifecycleNode(ServingNode, LifecycleNode):
    """Prediction server on a lifecycle node, for any executor.

    Errors in a transition are logged, and the transition fails.
    """

    def __init__(self, node_name: str = "unc_physics", **others):
        super().__init__(node_name, **others)
        # rclpy of Jazzy raises for a transition that the present state does not have, and sends no answer
        service = self._service_change_state
        change = service.callback

        def answer(request, response):
            try:
                return change(request, response)
            except Exception as error:  # noqa: BLE001  (rclpy's own is not public)
                self.get_logger().error(f"the transition failed: {error}")
                response.success = False
                return response

        service.callback = answer

    def on_configure(self, state):
        """Find the models and warm up."""
        return self._attempt(self.server.prepare)

    def on_activate(self, state):
        """Advertise all interfaces."""
        return self._attempt(self.server.open)

    def on_deactivate(self, state):
        """Withdraw all interfaces; running predictions end."""
        return self._attempt(lambda: self.server.close("is being deactivated"))

    def on_cleanup(self, state):
        """Do nothing, as nothing is open."""
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state):
        """Withdraw all interfaces."""
        return self._attempt(self.server.close)

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
    """Run the lifecycle node and end the process."""
    leave(run(UncPhysicsLifecycleNode, arguments, "unc_physics_lifecycle_node"))


if __name__ == "__main__":
    main()
