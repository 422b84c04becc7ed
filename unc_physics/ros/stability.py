"""The service ``~/assess_stability``: does an object stay where it is?"""

from __future__ import annotations

import time

from unc_physics_msgs.msg import PredictionRequest
from unc_physics_msgs.srv import AssessStability

from ..checks.errors import InvalidRequestError, UncPhysicsError
from ..prediction.stability import assess_stability
from ..propagators.names import REFERENCE
from .messages.fields import duration, read_duration
from .services import BackgroundService

_HORIZON = 1.0  # s, of the request that the scene is read as


class StabilityService(BackgroundService):
    """Service that assesses an object of a scene, or of the node's tracker."""

    def __init__(self, server):
        self._server = server
        super().__init__(server, AssessStability, "~/assess_stability", self._assess)

    def _assess(self, request, response):
        started = time.perf_counter()
        with self._server.errors_into(response.result):
            given = {
                "duration": read_duration(request.duration, "duration"),
                "distance": request.distance,
                "angle": request.angle,
                "confidence": request.confidence,
            }
            given = {name: value for name, value in given.items() if value}
            try:
                found, *others = (
                    assess_stability(scene, belief, request.object, **given)
                    for scene, belief in self._motions(request)
                )
            except UncPhysicsError as error:
                raise error.at("object" if error.field == "body" else error.field or "scene") from None
            response.probability = found.probability
            response.low = min(one.low for one in (found, *others))
            response.high = max(one.high for one in (found, *others))
            response.supports = list(found.supports)
            if found.distance_margin is not None and found.angle_margin is not None:
                response.has_margin = True
                response.distance_margin, response.angle_margin = found.distance_margin, found.angle_margin
        response.computation_time = duration(time.perf_counter() - started)

    def _motions(self, request):
        """Return the scene and the belief of a request, or those of the tracker for each possible motion."""
        if request.scene.objects:
            asked = PredictionRequest(
                scene=request.scene,
                physics=request.physics,
                horizon=duration(_HORIZON),
                propagator=REFERENCE,
                samples=1,
            )
            job = self._server.read(asked)
            return [(job.scene, job.belief)]
        if self._server.tracking is None:
            raise InvalidRequestError(
                "must have objects, as the node tracks none (parameter track)", field="scene"
            )
        return self._server.tracking.motions(request.object)
