"""The service ``~/predict``."""

from __future__ import annotations

from unc_physics_msgs.srv import Predict

from .background import BackgroundService


def prediction_service(server) -> BackgroundService:
    """Answers each request on its own; requests do not wait for each other."""

    def answer(request, response):
        return server.answer(response, request.request, time_limit=server.settings.max_computation_time)

    return BackgroundService(server, Predict, "~/predict", answer)
