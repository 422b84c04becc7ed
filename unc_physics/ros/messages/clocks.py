"""Stamps and clocks: the age of inputs, and what to tell users whose clocks disagree."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.clock import JumpThreshold
from rclpy.duration import Duration

from .fields import nanoseconds


def on_clock_jump(node, callback: Callable):
    """Have a function called after jumps of a node's clock back, as of a bag that starts again."""
    threshold = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=True)
    return node.get_clock().create_jump_callback(threshold, post_callback=callback)


def stamp_age(node, stamp) -> float | None:
    """Return the time since a stamp [s] by the node's clock; None for a zero stamp."""
    if stamp.sec == 0 and stamp.nanosec == 0:
        return None
    now = node.get_clock().now().nanoseconds
    return 1e-9 * (now - nanoseconds(stamp))  # rclpy's Time has no negative values


def both_clocks(node, stamp) -> str:
    """Return a stamp and the node's clock in words, and where the latter comes from."""
    now = node.get_clock().now().nanoseconds
    if not node.get_parameter("use_sim_time").value:
        source = "the system's, as use_sim_time is false"
    elif node.get_clock().ros_time_is_active and now:
        source = "that of /clock, as use_sim_time is true"
    else:
        source = "0, as use_sim_time is true and no /clock has come"
    return f"the stamp is {1e-9 * nanoseconds(stamp):.3f} s, the node's clock {1e-9 * now:.3f} s ({source})"


def stamp_problem(node, stamp, settings) -> str | None:
    """Return why an input is dropped because of its stamp, by which parameter; None if it is valid."""
    if (old := stamp_age(node, stamp)) is None:
        return None
    if settings.max_input_age and old > settings.max_input_age:
        what = f"{old:.3g} s old, and the parameter max_input_age allows {settings.max_input_age:g} s"
    elif settings.max_input_lead and -old > settings.max_input_lead:
        lead = settings.max_input_lead
        what = f"{-old:.3g} s in the future, and the parameter max_input_lead allows {lead:g} s"
    else:
        return None
    return f"its stamp is {what}; {both_clocks(node, stamp)}"
