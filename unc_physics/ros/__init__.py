"""The ROS 2 node: predictions as services, streams and actions; and a `Client` for it. Only this part of the
package imports rclpy.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .client import Client as Client
    from .lifecycle_node import UncPhysicsLifecycleNode as UncPhysicsLifecycleNode
    from .node import UncPhysicsNode as UncPhysicsNode

_MODULES = {"Client": "client", "UncPhysicsLifecycleNode": "lifecycle_node", "UncPhysicsNode": "node"}
__all__ = ["Client", "UncPhysicsLifecycleNode", "UncPhysicsNode"]


def __getattr__(name):
    """Import a class when it is asked for: rclpy is not there everywhere."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_MODULES[name]}", __name__), name)
