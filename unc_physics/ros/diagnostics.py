"""Diagnostics on ``/diagnostics``: how often, how late and how long predictions are, and what went wrong
last.
"""

from __future__ import annotations

import importlib.util
import threading
import time
from collections import deque
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

_PERIOD = 1.0  # s
_WINDOW = 10.0  # s


class Diagnostics:
    """Counts, and publishes once a second: by diagnostic_updater where there is one, else by itself."""

    def __init__(self, server):
        self._server = server
        self._lock = threading.Lock()
        self._finished = deque()
        self._predictions = self._errors = self._dropped = self._replaced = 0
        self._computation_time = self._delay = 0.0
        self._last_error = ""
        self._error_time = -_WINDOW
        node = server.node
        self._publisher: Any = None
        self._timer: Any = None
        self._updater: Any = None
        if importlib.util.find_spec("diagnostic_updater"):
            from diagnostic_updater import Updater  # pyright: ignore[reportMissingImports]  (optional)

            self._updater = Updater(node)
            self._updater.setHardwareID("none")
            self._updater.add("predictions", self._fill)
        else:
            self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 1)
            self._timer = node.create_timer(_PERIOD, self._publish)

    def close(self):
        """Stop publishing."""
        if self._timer is not None:
            self._server.node.destroy_timer(self._timer)
            self._server.node.destroy_publisher(self._publisher)
        else:
            self._server.node.destroy_timer(self._updater.timer)

    def predicted(self, prediction) -> None:
        """Count a prediction."""
        with self._lock:
            self._predictions += 1
            self._computation_time = prediction.wall_time
            self._finished.append(time.monotonic())

    def delayed(self, seconds: float) -> None:
        """Note the time from a streamed input's stamp to its prediction [s]."""
        self._delay = seconds

    def dropped(self) -> None:
        """Count a streamed input that was too old."""
        with self._lock:
            self._dropped += 1

    def replaced(self) -> None:
        """Count a streamed input in whose place a newer one was predicted."""
        with self._lock:
            self._replaced += 1

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
                "dropped inputs": self._dropped,
                "replaced inputs": self._replaced,
                "errors": self._errors,
                "last error": self._last_error,
            }
            return values, now - self._error_time < _WINDOW

    def _fill(self, status):
        """Fill a status; a warning while the last error is recent."""
        values, recent_error = self._values()
        status.level = DiagnosticStatus.WARN if recent_error else DiagnosticStatus.OK
        status.message = f"error: {values['last error']}" if recent_error else "predicting"
        status.values = [
            KeyValue(key=key, value=f"{value:.6g}" if isinstance(value, float) else str(value))
            for key, value in values.items()
        ]
        return status

    def _publish(self):
        status = self._fill(
            DiagnosticStatus(name=f"{self._server.node.get_name()}: predictions", hardware_id="none")
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self._server.node.get_clock().now().to_msg()
        self._publisher.publish(message)
