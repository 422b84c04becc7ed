"""Diagnostics on ``/diagnostics``, and the library's messages in the node's log.

The messages are made here and not by diagnostic_updater, which declares parameters on the node. That works
only once, and the node may have declared them itself.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType

LIBRARY = logging.getLogger("unc_physics")
_PERIOD = 1.0  # s
_WINDOW = 10.0  # s
_REPORT_PERIOD = 5.0  # s, between warnings of one kind in the log


class Counts:
    """Values of one status, and its newest warning; safe for threads.

    Parameters
    ----------
    *names : str
        Names of the values, in their order in the message.
    """

    def __init__(self, *names: str):
        self._lock = threading.Lock()
        self._values: dict[str, Any] = dict.fromkeys(names, 0)
        # urgent and other ones, with their times
        self._warned: dict[bool, tuple[str, float]] = dict.fromkeys((True, False), ("", -_WINDOW))

    def add(self, name: str, count: int = 1) -> None:
        """Add to a counter."""
        with self._lock:
            self._values[name] += count

    def set(self, name: str, value: float | str) -> None:
        """Set a value."""
        with self._lock:
            self._values[name] = value

    def warn(self, text: str, urgent: bool = False) -> None:
        """Publish a warning for a while; an urgent one hides others."""
        with self._lock:
            self._warned[urgent] = text, time.monotonic()

    def status(self, name: str, fine: str) -> DiagnosticStatus:
        """Return the message, which is a warning while there is one; otherwise it says that all is fine."""
        now = time.monotonic()
        with self._lock:
            values = dict(self._values)
            warning = next((text for text, when in self._warned.values() if now - when < _WINDOW), "")
        return DiagnosticStatus(
            name=name,
            hardware_id="none",
            level=DiagnosticStatus.WARN if warning else DiagnosticStatus.OK,
            message=warning or fine,
            values=[
                KeyValue(key=key, value=f"{value:.6g}" if isinstance(value, float) else str(value))
                for key, value in values.items()
            ],
        )


class Diagnostics:
    """Status of predictions and of the tracker, published every second of real time.

    Attributes
    ----------
    predictions : Counts
    tracking : Counts or None
        None if the node does not track.
    """

    def __init__(self, server):
        self._node = node = server.node
        self._finished = deque()  # times of the predictions of the last seconds
        self._lock = threading.Lock()
        self.predictions = Counts(
            "predictions",
            "rate [Hz]",
            "last computation time [s]",
            "last delay of the stream [s]",
            "late predictions",
            "expired predictions",
            "dropped inputs",
            "replaced inputs",
            "skipped objects",
            "changed covariances",
            "errors",
            "last error",
        )
        self.predictions.set("last error", "")
        self.tracking: Counts | None = None
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 1)
        self._timer = node.create_timer(_PERIOD, self._publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def close(self):
        """Stop publishing."""
        self._node.destroy_timer(self._timer)
        self._node.destroy_publisher(self._publisher)

    def track(self) -> Counts:
        """Publish the status of the tracker, too; return its counters."""
        self.tracking = Counts(
            "objects",
            "new objects",
            "observations",
            "rejected observations",
            "late observations",
            "observations beyond the window",
            "duplicate observations",
            "skipped observations",
            "dropped messages",
            "last delay [s]",
        )
        return self.tracking

    def predicted(self, prediction) -> None:
        """Count a prediction."""
        self.predictions.add("predictions")
        self.predictions.set("last computation time [s]", prediction.wall_time)
        with self._lock:
            self._finished.append(time.monotonic())

    def failed(self, reason: str) -> None:
        """Count a request or input that ended in an error."""
        self.predictions.add("errors")
        self.predictions.set("last error", reason)
        self.predictions.warn(f"error: {reason}", urgent=True)

    def _publish(self):
        """Publish the status of predictions and of the tracker."""
        node, now = self._node, time.monotonic()
        with self._lock:
            while self._finished and now - self._finished[0] > _WINDOW:
                self._finished.popleft()
            self.predictions.set("rate [Hz]", len(self._finished) / _WINDOW)
        # the name alone, as in diagnostic_updater, except in a namespace
        name = node.get_name() if node.get_namespace() == "/" else node.get_fully_qualified_name()
        message = DiagnosticArray(status=[self.predictions.status(f"{name}: predictions", "predicting")])
        if self.tracking is not None:
            message.status = [*message.status, self.tracking.status(f"{name}: tracking", "tracking")]
        message.header.stamp = node.get_clock().now().to_msg()
        self._publisher.publish(message)


class ThrottledWarnings:
    """Warnings in a node's log, of each kind at most one in five seconds; safe for threads.

    rclpy throttles each line of code instead, so that one kind would hide others.

    Parameters
    ----------
    log : rclpy logger
    """

    def __init__(self, log):
        self._log, self._lock = log, threading.Lock()
        self._last: dict[str, float] = {}  # times by kind

    def __call__(self, kind: str, text: str) -> None:
        """Log a warning, unless one of its kind was logged shortly before."""
        now = time.monotonic()
        with self._lock:
            if now - self._last.get(kind, -_REPORT_PERIOD) < _REPORT_PERIOD:
                return
            self._last[kind] = now
        self._log.warning(text)


class LibraryLog(logging.Handler):
    """Log handler that forwards the library's messages to a node's logger until closed.

    Parameters
    ----------
    log : rclpy logger
    """

    def __init__(self, log):
        super().__init__()
        self._log = log
        LIBRARY.addHandler(self)

    def emit(self, record):
        """Log one message; rclpy binds a severity to each call site, so all messages have the same."""
        self._log.info(record.getMessage())

    def close(self):
        """Detach from the library's log."""
        LIBRARY.removeHandler(self)
        super().close()
