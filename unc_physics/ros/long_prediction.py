"""The action ``~/predict_long``: predictions with feedback and cancellation, which end with their clients."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import gc
import threading
import time
from concurrent.futures import ThreadPoolExecutor

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup

from unc_physics_msgs.action import PredictLong

from ..checks.errors import CanceledError, ErrorCode
from .client_process import ClientProcess, participant_of
from .messages.fields import duration

_MOST_GOALS = 2  # that are computed at a time
_FEEDBACK_PERIOD = 0.1  # s
_CLIENTS_PERIOD = 1.0  # s, between checks whether a goal's client is still there
_SENDING_TIMEOUT = 1.0  # s; an executor that does not spin sends nothing
_RESULT_TIMEOUT = 10  # s, for which a result can be fetched; rclpy would keep it for 15 minutes


class LongPrediction:
    """The action ``~/predict_long``: predictions with feedback and cancellation."""

    def __init__(self, server):
        self._server = server
        self._running = threading.Semaphore(_MOST_GOALS)
        self._action = _ThreadedActionServer(
            _MOST_GOALS,
            server.node,
            PredictLong,
            "~/predict_long",
            self._execute,
            callback_group=ReentrantCallbackGroup(),
            goal_callback=self._admit,
            cancel_callback=lambda _: CancelResponse.ACCEPT,  # rclpy would reject
            result_timeout=_RESULT_TIMEOUT,
        )

    def close(self):
        """Withdraw the action."""
        self._action.destroy()

    def _admit(self, _):
        """Reject goals above the limit."""
        if self._running.acquire(blocking=False):
            return GoalResponse.ACCEPT
        self._server.log.warning(f"a goal was rejected: {_MOST_GOALS} are computed already")
        return GoalResponse.REJECT

    def _execute(self, goal):
        result = PredictLong.Result()
        participant = self._action.participants.pop(bytes(goal.goal_id.uuid), b"")
        with self._server.errors_into(result.result):
            try:
                with contextlib.closing(ClientProcess(participant, self._own_id())) as process:
                    reporter = _Reporter(goal, participant, self._clients, process)
                    afterwards = self._server.answer(
                        result, goal.request.request, progress=reporter.progress, check=reporter.check
                    )
                if afterwards is not None:
                    afterwards()
            finally:
                self._running.release()
                return_memory()
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
        """Return the ids of subscriptions to the action's feedback, one for each client."""
        node = self._server.node
        topic = f"{node.get_fully_qualified_name()}/predict_long/_action/feedback"
        return {bytes(info.endpoint_gid) for info in node.get_subscriptions_info_by_topic(topic)}

    def _own_id(self):
        """Return the id of an endpoint of this process; empty if discovery does not show it."""
        node = self._server.node
        topic = f"{node.get_fully_qualified_name()}/predict_long/_action/status"
        return next((bytes(info.endpoint_gid) for info in node.get_publishers_info_by_topic(topic)), b"")


class _Reporter:
    """Callbacks that publish feedback, and end the prediction if the client cancels it or disappears.

    Parameters
    ----------
    goal : ServerGoalHandle
    participant : bytes
        Beginning of the ids of all endpoints of the client's process; empty if it is unknown. The goal then
        ends when all subscribers from its beginning are gone.
    clients : callable
        Returns the ids of subscribers to the feedback.
    process : ClientProcess
    """

    def __init__(self, goal, participant, clients, process):
        self._goal, self._process = goal, process
        self._clients = lambda: {one for one in clients() if one.startswith(participant)}
        self._started = time.perf_counter()
        self._next = self._started
        self._first, self._next_check = clients(), self._started + _CLIENTS_PERIOD

    def check(self):
        """Raise `CanceledError` if the client cancels the goal, or is gone."""
        if self._goal.is_cancel_requested:
            raise CanceledError("canceled", field="the client")
        now = time.perf_counter()
        if now >= self._next_check:
            self._next_check = now + _CLIENTS_PERIOD
            now_there = self._clients()
            self._first = self._first or now_there  # discovery takes a while
            if self._process.has_ended or (self._first and not self._first & now_there):
                raise CanceledError("is gone", field="the client")

    def progress(self, job, done, steps):
        """Check the client, and publish feedback."""
        self.check()
        now = time.perf_counter()
        if now >= self._next:
            self._next = now + _FEEDBACK_PERIOD
            self._goal.publish_feedback(
                PredictLong.Feedback(
                    time_reached=duration(min(done * job.scene.dt, job.horizon)),
                    fraction_done=done / steps,
                    elapsed=duration(now - self._started),
                )
            )


def return_memory() -> None:
    """Return freed memory to the system, as glibc keeps that of large messages."""
    with contextlib.suppress(AttributeError, OSError):  # another C library
        ctypes.CDLL(None).malloc_trim(0)


class _ThreadedActionServer(ActionServer):
    """Action server that executes goals in its own threads instead of the executor's."""

    def __init__(self, threads, *args, **others):
        super().__init__(*args, **others)
        self._pool = ThreadPoolExecutor(threads)
        self._goals = []  # futures of goals, those that run among them
        self.participants = {}  # of the clients of goals that are not yet executed, by the goals' ids

    async def _execute_goal_request(self, request_header_and_message):
        header, message = request_header_and_message
        self.participants[bytes(message.goal_id.uuid)] = participant_of(header)
        await super()._execute_goal_request(request_header_and_message)

    async def _execute_expire_goals(self, expired_goals):
        await super()._execute_expire_goals(expired_goals)
        gc.collect()  # futures and tasks of goals refer to each other
        return_memory()

    def notify_execute(self, goal_handle, execute_callback):
        """Execute an accepted goal."""
        execution = self._execute_goal(execute_callback or self._execute_callback, goal_handle)
        self._goals = [goal for goal in self._goals if not goal.done()]
        self._goals.append(self._pool.submit(asyncio.run, execution))

    def destroy(self):
        """Wait for running goals and until their results are sent, and withdraw the action."""
        running = not all(goal.done() for goal in self._goals)
        self._pool.shutdown()
        if running and self._node.executor is not None:
            sent = threading.Event()
            self._node.executor.create_task(sent.set)  # after the tasks that send the results
            sent.wait(_SENDING_TIMEOUT)
        super().destroy()
