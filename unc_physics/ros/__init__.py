"""ROS 2 node with predictions as services, streams and actions, and a `Client`.

Only this part of the package imports rclpy.

- Node: `node` and `lifecycle_node` hold a `server`, which reads requests, predicts, and opens the interfaces
  of `services`, `candidates`, `long_prediction`, `environment`, `models`, `streams` and `tracking`.
  `parameters` are its settings.
- Streams: `scene_topics` and `detected` (input), `stream_pace`, `markers` (output).
- Tracking: `tracks` keeps objects and their beliefs, `association` matches observations with them.
- Messages: `messages` has a module for each message, for both directions.
- Client: `client` with `connection` and `newest_message`.
- Programs: `demo`, `replay`, `view_node`.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .client import Client as Client
    from .lifecycle_node import UncPhysicsLifecycleNode as UncPhysicsLifecycleNode
    from .messages.planning_scene import request_of_planning_scene as request_of_planning_scene
    from .messages.tracking import TrackedBody as TrackedBody
    from .messages.tracking import TrackedPrediction as TrackedPrediction
    from .node import UncPhysicsNode as UncPhysicsNode

_MODULES = {
    "Client": "client",
    "TrackedBody": "messages.tracking",
    "TrackedPrediction": "messages.tracking",
    "UncPhysicsLifecycleNode": "lifecycle_node",
    "UncPhysicsNode": "node",
    "request_of_planning_scene": "messages.planning_scene",
}
__all__ = [
    "Client",
    "TrackedBody",
    "TrackedPrediction",
    "UncPhysicsLifecycleNode",
    "UncPhysicsNode",
    "request_of_planning_scene",
]


def __getattr__(name):
    """Import a name on its first use: rclpy is optional."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_MODULES[name]}", __name__), name)
