"""Diagnostics on ``/diagnostics``, and the library's messages in the node's log.

The messages are made here and not by diagnostic_updater, which declares parameters on the node. That works
only once, and the node may have declared them itself.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from enum import IntEnum
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType

from ..checks.errors import ErrorCode

LIBRARY = logging.getLogger("unc_physics")
_PERIOD = 1.0  # s
_WINDOW = 10.0  # s
_REPORT_PERIOD = 5.0  # s, between warnings of one kind in the log


class Problem(IntEnum):
    """Kind of a problem, by how severe it is.

    Attributes
    ----------
    LATE
        A prediction was late: a warning.
    LEFT_OUT
        An input was dropped, or a part of it skipped: a warning.
    REFUSED
        A request or input ended in an error, whose cause is what was sent: a warning.
    FAULT
        The node failed: an error.
    """

    LATE = 0
    LEFT_OUT = 1
    REFUSED = 2
    FAULT = 3


class Counts:
    """Values of one status, its newest problem, and when an input came last; safe for threads.

    Parameters
    ----------
    *names : str
        Names of the values, in their order in the message.
    """

    def __init__(self, *names: str):
        self._lock = threading.Lock()
        self._values: dict[str, Any] = dict.fromkeys(names, 0)
        self._problems: dict[Problem, tuple[str, float]] = {}  # the newest of each kind, with their times
        self._heard: deque[float] = deque(maxlen=2)  # times of the last inputs

    def add(self, name: str, count: int = 1) -> None:
        """Add to a counter."""
        with self._lock:
            self._values[name] += count

    def set(self, name: str, value: float | str) -> None:
        """Set a value."""
        with self._lock:
            self._values[name] = value

    def warn(self, text: str, problem: Problem = Problem.LEFT_OUT) -> None:
        """Publish a problem for a while; a more severe one hides others."""
        with self._lock:
            self._problems[problem] = text, time.monotonic()

    def heard(self) -> None:
        """Note that an input came; once inputs follow each other, the status is stale without them."""
        with self._lock:
            self._heard.append(time.monotonic())

    def status(self, name: str, fine: str) -> DiagnosticStatus:
        """Return the message: the worst problem if there is one, or that no input comes, or ``fine``."""
        now = time.monotonic()
        with self._lock:
            values, heard = dict(self._values), list(self._heard)
            problems = {kind: text for kind, (text, when) in self._problems.items() if now - when < _WINDOW}
        level, message = DiagnosticStatus.OK, fine
        if problems:
            worst = max(problems)
            level = DiagnosticStatus.ERROR if worst is Problem.FAULT else DiagnosticStatus.WARN
            message = problems[worst]
        elif len(heard) == 2 and heard[1] - heard[0] < _WINDOW < now - heard[1]:
            level, message = DiagnosticStatus.STALE, f"no input for {now - heard[1]:.0f} s"
        return DiagnosticStatus(
            name=name,
            hardware_id="none",
            level=level,
            message=message,
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

    def failed(self, code: int, reason: str) -> None:
        """Count a request or input that ended in an error with a code."""
        self.predictions.add("errors")
        self.predictions.set("last error", reason)
        problem = Problem.FAULT if code == ErrorCode.INTERNAL else Problem.REFUSED
        self.predictions.warn(f"error: {reason}", problem)

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
