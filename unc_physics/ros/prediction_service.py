"""The service ``~/predict``."""

from __future__ import annotations

from rclpy.callback_groups import ReentrantCallbackGroup

from unc_physics_msgs.srv import Predict


class PredictionService:
    """Answers each request on its own; requests do not wait for each other."""

    def __init__(self, server):
        self._server = server
        self._service = server.node.create_service(
            Predict, "~/predict", self._predict, callback_group=ReentrantCallbackGroup())

    def _predict(self, request, response):
        self._server.answer(response, request, time_limit=self._server.settings.max_computation_time)
        return response

    def close(self):
        """Take the service back."""
        self._server.node.destroy_service(self._service)
