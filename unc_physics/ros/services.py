"""Services of the node, computed outside the executor's thread."""

from __future__ import annotations

import os
import platform
import time
import traceback
from importlib.util import find_spec

import numba
import numpy as np
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import KeyValue
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_services_default
from rclpy.service_introspection import ServiceIntrospectionState
from rclpy.utilities import get_rmw_implementation_identifier

from unc_physics_msgs.msg import PropagatorInfo, Result
from unc_physics_msgs.srv import GetCapabilities

from .. import __version__
from ..checks.errors import CanceledError, NotActiveError
from ..propagators.registry import PROPAGATORS
from ..scene.scene import UNCERTAIN_PARAMETERS
from .messages.fields import duration, write_error
from .messages.physics import physics_message

_NOT_DEFERRED = NotActiveError(
    "runs with an rclpy that does not defer answers; take that of Jazzy", field="the node"
)
#: Quality of service of latched topics.
LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
_QUEUE = QoSProfile(depth=100)  # ROS's default of 10 loses more concurrent requests or answers
_FEATURES = [
    "environment",
    "friction",
    "restitution",
    "gyroscopic",
    "parameter_uncertainty",
    "events",
    "stability",
    "status",
    "joint_covariance",
    "modes",
    "pose_samples",
    "candidates",
    "candidate_scores",
    "mesh_packing",
    "primitives_and_meshes",
]
_MEAN = {"nominal": PropagatorInfo.MEAN_NOMINAL, "estimated": PropagatorInfo.MEAN_ESTIMATED}


class BackgroundService:
    """Service that computes and sends answers in a thread pool.

    Parameters
    ----------
    server : PredictionServer
    service_type : type
    name : str
    answer : callable
        Takes request and response, and fills the response. Returns a function that runs after the response is
        sent, or None.

    Notes
    -----
    rclpy defers answers only of coroutines. The events executor of Jazzy does not accept coroutines for
    services, and other executors poll them in each turn. But all executors pass the callback's return value
    and the request's header to the service's ``send_response``. This class overrides it and submits the work
    there, so that a single-threaded executor is enough. A multi-threaded executor wakes up two or three times
    in each request, which delays the computing thread.

    An rclpy that did not do so would send an error as each answer.
    """

    def __init__(self, server, service_type, name, answer):
        self._server, self._answer = server, answer
        self._asked = {}  # requests by the ids of their responses, until rclpy returns the responses
        self._service = server.node.create_service(
            service_type, name, self._called, qos_profile=_QUEUE, callback_group=ReentrantCallbackGroup()
        )
        if (content := server.settings.service_introspection) != "disabled":
            # otherwise rclpy would create the publisher of events all the same
            state = getattr(ServiceIntrospectionState, content.upper())
            self._service.configure_introspection(
                server.node.get_clock(), qos_profile_services_default, state
            )
        self._send = self._service.send_response
        self._service.send_response = self._returned

    def close(self):
        """Withdraw the service."""
        self._server.node.destroy_service(self._service)

    def _called(self, request, response):
        """Take a request; return the response that `_returned` completes."""
        if hasattr(response, "result"):
            write_error(response.result, _NOT_DEFERRED)
        self._asked[id(response)] = request
        return response

    def _returned(self, response, header):
        """Submit the work when rclpy returns the callback's response."""
        if (request := self._asked.pop(id(response), None)) is None:
            self._send(response, header)
            return
        if hasattr(response, "result"):
            response.result = Result()
        try:
            self._server.pool.submit(self._work, request, response, header)
        except RuntimeError:  # the pool is shut down: the node is closing
            if hasattr(response, "result"):
                write_error(response.result, CanceledError(self._server.ending, field="the node"))
            self._send(response, header)

    def _work(self, request, response, header):
        try:
            afterwards = self._answer(request, response)
            self._send(response, header)
            self._server.answered = time.monotonic()
            if afterwards is not None:
                afterwards()
        except Exception:  # noqa: BLE001  (the client may be gone)
            if self._server.node.context.ok():
                self._server.log.error(f"an answer was not sent:\n{traceback.format_exc()}")


class CapabilitiesService(BackgroundService):
    """The service ``~/get_capabilities``: propagators, options, limits and versions."""

    def __init__(self, server):
        self._server = server
        super().__init__(server, GetCapabilities, "~/get_capabilities", self._capabilities)

    def _capabilities(self, _, response):
        settings = self._server.settings
        response.propagators = [propagator_info(cls) for cls in PROPAGATORS.values()]
        response.default_propagator = settings.default_propagator
        response.world_frame = settings.world_frame
        optional = {
            "transforms": self._server.frames.available,
            "tracking": settings.track,
            "mesh_decomposition": find_spec("coacd") is not None,
        }
        response.features = [*_FEATURES, *(name for name, is_there in optional.items() if is_there)]
        for name in response.get_fields_and_field_types():
            if name.startswith("max_"):
                limit = getattr(settings, name)
                is_time = isinstance(getattr(response, name), Duration)
                setattr(response, name, duration(limit) if is_time else limit)
        response.physics = physics_message(settings.physics)
        versions = {
            "unc_physics": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "numba": numba.__version__,
            "ros_distro": os.environ.get("ROS_DISTRO", "jazzy"),
            "rmw": get_rmw_implementation_identifier(),
        }
        response.versions = [KeyValue(key=key, value=value) for key, value in versions.items()]


def propagator_info(cls) -> PropagatorInfo:
    """Return a propagator's traits and options as a message."""
    traits, options = cls.traits, cls.options()
    return PropagatorInfo(
        name=cls.name,
        description=cls.description(),
        mean_update=_MEAN[traits.mean_update],
        uncertainty=traits.uncertainty,
        cross_body_correlations=traits.cross_body,
        separate_collision_handling=traits.separate_collisions,
        collision_treatment=traits.collisions,
        sampled="samples" in options,
        default_samples=options.get("samples", 0),
        integrators=list(cls.integrators),
        parameter_uncertainty=set(UNCERTAIN_PARAMETERS) <= set(cls.supports.parameters),
        rejects_overlap=cls.supports.overlap_rejection,
        options=[
            KeyValue(
                key=option.name,
                value=f"{_option_type(option)}, default {option.default}: {option.description}",
            )
            for option in cls.described_options()
        ],
    )


def _option_type(option):
    """Return the type of an option's value, or its choices."""
    return f"one of {', '.join(option.choices)}" if option.choices else option.kind.__name__
