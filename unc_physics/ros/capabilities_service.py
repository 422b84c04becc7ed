"""The service ``~/get_capabilities``."""

from __future__ import annotations

import os
import platform

import numba
import numpy as np
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import KeyValue
from rclpy.utilities import get_rmw_implementation_identifier

from unc_physics_msgs.msg import OptionInfo, PropagatorInfo
from unc_physics_msgs.srv import GetCapabilities

from .. import __version__
from ..propagators.registry import PROPAGATORS
from .durations import duration
from .physics_message import physics_message

_FEATURES = [
    "environment",
    "friction",
    "restitution",
    "gyroscopic",
    "islands",
    "parameter_uncertainty",
    "contact_probabilities",
    "region_probabilities",
    "rest_probability",
    "upright_probability",
    "fall_probability",
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


class CapabilitiesService:
    """Tells propagators, options, limits and versions."""

    def __init__(self, server):
        self._server = server
        self._service = server.node.create_service(GetCapabilities, "~/get_capabilities", self._answer)

    def close(self):
        """Take the service back."""
        self._server.node.destroy_service(self._service)

    def _answer(self, _, response):
        settings = self._server.settings
        response.propagators = [propagator_info(cls) for cls in PROPAGATORS.values()]
        response.default_propagator = settings.default_propagator
        response.world_frame = settings.world_frame
        response.features = [*_FEATURES, *(["transforms"] if self._server.frames.available else [])]
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
        return response


def propagator_info(cls) -> PropagatorInfo:
    """A propagator's traits and options as a message."""
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
        parameter_uncertainty=cls.varies_parameters,
        rejects_overlap=cls.rejects_overlap,
        options=[
            OptionInfo(
                name=option.name,
                type=_option_type(option),
                default_value=str(option.default),
                description=option.description,
            )
            for option in cls.described_options()
        ],
    )


def _option_type(option):
    """Type of an option's value, or all values where these are few."""
    return f"one of {', '.join(option.choices)}" if option.choices else option.kind.__name__
