"""Diagnostics on ``/diagnostics``, and the library's messages in the node's log.

The messages are made here and not by diagnostic_updater, which declares parameters on the node. That works
only once, and the node may have declared them itself.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType

LIBRARY = logging.getLogger("unc_physics")
_PERIOD = 1.0  # s
_WINDOW = 10.0  # s


class TrackingCounts:
    """Counters of the tracker."""

    def __init__(self):
        self._lock = threading.Lock()
        self._warned = "", -_WINDOW
        self._values: dict[str, float] = {
            "objects": 0,
            "new objects": 0,
            "observations": 0,
            "rejected observations": 0,
            "late observations": 0,
            "observations beyond the window": 0,
            "duplicate observations": 0,
            "skipped observations": 0,
            "dropped messages": 0,
            "last delay [s]": 0.0,
        }

    def add(self, name: str, count: int = 1, warning: str = "") -> None:
        """Add to a counter; a warning is published for a while."""
        with self._lock:
            self._values[name] += count
            if warning and count:
                self._warned = f"{name}: {warning}", time.monotonic()

    def set(self, name: str, value: float) -> None:
        """Set a value."""
        with self._lock:
            self._values[name] = value

    def values(self) -> tuple[dict[str, float], str]:
        """Return all values, and a recent warning."""
        with self._lock:
            text, when = self._warned
            return dict(self._values), text if time.monotonic() - when < _WINDOW else ""


class Diagnostics:
    """Counters of predictions and errors, published every second of real time."""

    def __init__(self, server):
        self._node = node = server.node
        self._lock = threading.Lock()
        self._finished = deque()
        self._predictions = self._errors = self._dropped = self._replaced = self._skipped = 0
        self._late = self._expired = 0
        self._warned = "", -_WINDOW
        self._computation_time = self._delay = 0.0
        self._tracking: TrackingCounts | None = None
        self._last_error = ""
        self._error_time = -_WINDOW
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 1)
        self._timer = node.create_timer(_PERIOD, self._publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def close(self):
        """Stop publishing."""
        self._node.destroy_timer(self._timer)
        self._node.destroy_publisher(self._publisher)

    def track(self) -> TrackingCounts:
        """Publish the status of the tracker, too; return its counters."""
        self._tracking = TrackingCounts()
        return self._tracking

    def predicted(self, prediction) -> None:
        """Count a prediction."""
        with self._lock:
            self._predictions += 1
            self._computation_time = prediction.wall_time
            self._finished.append(time.monotonic())

    def delayed(self, seconds: float) -> None:
        """Record the time from a streamed input's stamp to its prediction [s]."""
        self._delay = seconds

    def late(self, took: float, limit: float) -> None:
        """Record a prediction of a stream that took longer than its limit [s]."""
        with self._lock:
            self._late += 1
            self._warned = (
                f"late: a prediction took {took:.3g} s, and the stream's limit is {limit:.3g} s",
                time.monotonic(),
            )

    def expired(self) -> None:
        """Count a prediction that was dropped, as its last horizon had passed."""
        with self._lock:
            self._expired += 1
            self._warned = "late: the last horizon of a prediction had passed", time.monotonic()

    def dropped(self) -> None:
        """Count a streamed input with a stamp that is too old or in the future."""
        with self._lock:
            self._dropped += 1

    def replaced(self) -> None:
        """Count a streamed input that a newer one replaced before its prediction."""
        with self._lock:
            self._replaced += 1

    def skipped(self, count: int) -> None:
        """Count streamed objects that were left out."""
        with self._lock:
            self._skipped += count

    def failed(self, reason: str) -> None:
        """Count a request or input that ended in an error."""
        with self._lock:
            self._errors += 1
            self._last_error, self._error_time = reason, time.monotonic()

    def _values(self):
        now = time.monotonic()
        with self._lock:
            while self._finished and now - self._finished[0] > _WINDOW:
                self._finished.popleft()
            values = {
                "predictions": self._predictions,
                "rate [Hz]": len(self._finished) / _WINDOW,
                "last computation time [s]": self._computation_time,
                "last delay of the stream [s]": self._delay,
                "late predictions": self._late,
                "expired predictions": self._expired,
                "dropped inputs": self._dropped,
                "replaced inputs": self._replaced,
                "skipped objects": self._skipped,
                "errors": self._errors,
                "last error": self._last_error,
            }
            warning = ""
            if now - self._error_time < _WINDOW:
                warning = f"error: {self._last_error}"
            elif now - self._warned[1] < _WINDOW:
                warning = self._warned[0]
            return values, warning

    def _publish(self):
        """Publish a status; it is a warning while the last error or delay is recent."""
        node = self._node
        # the name alone, as in diagnostic_updater, except in a namespace
        name = node.get_name() if node.get_namespace() == "/" else node.get_fully_qualified_name()
        statuses = [_status(f"{name}: predictions", *self._values(), "predicting")]
        if self._tracking is not None:
            statuses.append(_status(f"{name}: tracking", *self._tracking.values(), "tracking"))
        message = DiagnosticArray(status=statuses)
        message.header.stamp = node.get_clock().now().to_msg()
        self._publisher.publish(message)


def _status(name, values, warning, fine):
    """Return a status, which is a warning if there is one."""
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
