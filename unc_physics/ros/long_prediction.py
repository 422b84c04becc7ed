"""The action ``~/predict_long``: long predictions with feedback, ended at any time with what was done until
then.
"""

from __future__ import annotations

import asyncio
import threading
import time
from concurrent.futures import ThreadPoolExecutor

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup

from unc_physics_msgs.action import PredictLong

from ..checks.errors import CanceledError, ErrorCode, LimitExceededError
from .durations import duration

_FEEDBACK_PERIOD = 0.1  # s
_CLIENTS_PERIOD = 1.0  # s, between looks whether a goal's client is still there


class _ThreadedActionServer(ActionServer):
    """An action server that executes goals in threads of its own instead of the executor's."""

    def __init__(self, threads, *args, **others):
        super().__init__(*args, **others)
        self._pool = ThreadPoolExecutor(threads)

    def notify_execute(self, goal_handle, execute_callback):
        """Execute a goal that was accepted."""
        self._pool.submit(
            asyncio.run, self._execute_goal(execute_callback or self._execute_callback, goal_handle)
        )

    def destroy(self):
        """Wait for the goals that are being executed, and take the action back."""
        self._pool.shutdown()
        super().destroy()


class LongPrediction:
    """Runs goals side by side, up to a limit."""

    def __init__(self, server):
        self._server = server
        limit = server.settings.max_long_predictions
        self._running = threading.Semaphore(limit)
        self._action = _ThreadedActionServer(
            limit + 1,  # one to refuse what is too much
            server.node,
            PredictLong,
            "~/predict_long",
            self._execute,
            callback_group=ReentrantCallbackGroup(),
            goal_callback=lambda _: GoalResponse.ACCEPT,
            cancel_callback=lambda _: CancelResponse.ACCEPT,  # rclpy would reject
        )

    def close(self):
        """Take the action back."""
        self._action.destroy()

    def _execute(self, goal):
        result = PredictLong.Result()
        with self._server.errors_into(result.result):
            if not self._running.acquire(blocking=False):
                raise LimitExceededError(
                    f"must be at most {self._server.settings.max_long_predictions} at a time",
                    field="the number of long predictions",
                )
            try:
                afterwards = self._server.answer(
                    result,
                    goal.request.request,
                    progress=_Reporter(goal, self._clients),
                    time_limit=self._server.settings.max_long_computation_time,
                )
                if afterwards is not None:
                    afterwards()
            finally:
                self._running.release()
        code = result.result.error_code
        if code == ErrorCode.NONE:
            goal.succeed()
        elif code == ErrorCode.CANCELED and goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.abort()
        if code == ErrorCode.CANCELED and not goal.is_cancel_requested:
            self._server.log.info(f"a long prediction was ended: {result.result.error_msg}")
        return result

    def _clients(self):
        """Who listens to the action's feedback, as every client of an action does: the ids of their ends."""
        node = self._server.node
        topic = f"{node.get_fully_qualified_name()}/predict_long/_action/feedback"
        return {bytes(info.endpoint_gid) for info in node.get_subscriptions_info_by_topic(topic)}


class _Reporter:
    """Publishes feedback now and then, and ends the prediction when the client has canceled, or is gone.

    A goal does not say whose it is: it ends when all are gone who listened when it began.
    """

    def __init__(self, goal, clients):
        self._goal, self._clients = goal, clients
        self._started = time.perf_counter()
        self._next = self._started
        self._first, self._next_look = clients(), self._started + _CLIENTS_PERIOD

    def __call__(self, job, done, steps):
        if self._goal.is_cancel_requested:
            raise CanceledError("canceled", field="the client")
        now = time.perf_counter()
        if now >= self._next_look:
            self._next_look = now + _CLIENTS_PERIOD
            if self._first and not self._first & self._clients():
                raise CanceledError("is gone", field="the client")
        if now >= self._next:
            self._next = now + _FEEDBACK_PERIOD
            self._goal.publish_feedback(
                PredictLong.Feedback(
                    time_reached=duration(done * job.scene.dt),
                    fraction_done=done / steps,
                    elapsed=duration(now - self._started),
                )
            )
