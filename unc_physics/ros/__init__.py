"""The ROS 2 node: predictions as services, streams and actions; and a `Client` for it. Only this part of the
package imports rclpy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .client import Client as Client

__all__ = ["Client"]


def __getattr__(name):
    """Import the client when it is asked for: rclpy is not there everywhere."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from .client import Client

    return Client
