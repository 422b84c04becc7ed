"""ROS 2 node with predictions as services, streams and actions, and a `Client`.

Only this part of the package imports rclpy.

- Node: `node` and `lifecycle_node` hold a `server`, which reads requests, predicts, and opens the interfaces
  of `services`, `candidates`, `stability`, `long_prediction`, `node_environment`, `models`, `streams` and
  `tracking`. `parameters` are its settings.
- Streams: `detected` (input), `stream_pace`, `markers` (output).
- Tracking: `tracks` keeps objects and their beliefs, `association` matches observations with them.
- Messages: `messages` has a module for each kind of message.
- Client: `client`.
- Programs: `demo`, `replay`.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .client import Client as Client
    from .client import environment as environment
    from .client import make_message as make_message
    from .client import object_state as object_state
    from .client import poses_of as poses_of
    from .client import prediction_request as prediction_request
    from .lifecycle_node import UncPhysicsLifecycleNode as UncPhysicsLifecycleNode
    from .messages.planning_scene import request_of_planning_scene as request_of_planning_scene
    from .node import UncPhysicsNode as UncPhysicsNode

_MODULES = {
    "Client": "client",
    "UncPhysicsLifecycleNode": "lifecycle_node",
    "UncPhysicsNode": "node",
    "environment": "client",
    "make_message": "client",
    "object_state": "client",
    "poses_of": "client",
    "prediction_request": "client",
    "request_of_planning_scene": "messages.planning_scene",
}
__all__ = [
    "Client",
    "UncPhysicsLifecycleNode",
    "UncPhysicsNode",
    "environment",
    "make_message",
    "object_state",
    "poses_of",
    "prediction_request",
    "request_of_planning_scene",
]


def __getattr__(name):
    """Import a name on its first use: rclpy is optional."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        return getattr(importlib.import_module(f".{_MODULES[name]}", __name__), name)
    except ModuleNotFoundError as error:
        if error.name not in ("rclpy", "unc_physics_msgs"):
            raise
        instead = "source ROS 2 and the workspace, or run `make demo` and take .venv/bin/python"
        raise ModuleNotFoundError(f"{name} needs {error.name}: {instead}", name=error.name) from error
