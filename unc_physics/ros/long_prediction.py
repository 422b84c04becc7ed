"""The action ``~/predict_long``: long predictions with feedback, ended at any time with what was done until then."""

from __future__ import annotations

import threading
import time

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup

from unc_physics_msgs.action import PredictLong

from ..errors import CanceledError, ErrorCode, LimitExceededError

_FEEDBACK_PERIOD = 0.1  # s


class LongPrediction:
    """Runs goals side by side, up to a limit, and leaves threads for everything else."""

    def __init__(self, server):
        self._server = server
        self._running = threading.Semaphore(server.settings.max_long_predictions)
        self._action = ActionServer(
            server.node, PredictLong, "~/predict_long", self._execute, callback_group=ReentrantCallbackGroup(),
            goal_callback=lambda _: GoalResponse.ACCEPT,
            cancel_callback=lambda _: CancelResponse.ACCEPT,  # rclpy would reject
        )

    def close(self):
        """Take the action back."""
        self._action.destroy()

    def _execute(self, goal):
        result = PredictLong.Result()
        with self._server.errors_into(result):
            if not self._running.acquire(blocking=False):
                raise LimitExceededError(
                    f"must be at most {self._server.settings.max_long_predictions} at a time",
                    field="the number of long predictions",
                )
            try:
                self._server.answer(result, goal.request, progress=_Reporter(goal))
            finally:
                self._running.release()
        if result.error_code == ErrorCode.NONE:
            goal.succeed()
        elif result.error_code == ErrorCode.CANCELED and goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.abort()
        return result


class _Reporter:
    """Publishes feedback now and then, and ends the prediction when the client has canceled."""

    def __init__(self, goal):
        self._goal = goal
        self._started = time.perf_counter()
        self._next = self._started

    def __call__(self, job, done, steps):
        if self._goal.is_cancel_requested:
            raise CanceledError("canceled", field="the client")
        now = time.perf_counter()
        if now >= self._next:
            self._next = now + _FEEDBACK_PERIOD
            self._goal.publish_feedback(PredictLong.Feedback(
                time_reached=done * job.scene.dt, fraction_done=done / steps, elapsed=now - self._started))
