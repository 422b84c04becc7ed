"""Connection of a client to a node: spins, calls services and actions, and waits for answers."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from typing import Any

import rclpy
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from ..checks.errors import InvalidRequestError, NotActiveError, UncPhysicsError

_POLL_PERIOD = 1.0  # s, between checks whether the node is still there
_CANCEL_POLL_PERIOD = 0.05  # s
_DONE = object()


class Connection:
    """Connection that calls the services and actions of a node, from any number of threads.

    Parameters
    ----------
    node : rclpy Node, optional
        Its executor must spin in another thread; by default the connection has its own node and thread.
    server : str
        Name of the called node.
    timeout : float
        Time to wait for it to appear [s].
    """

    def __init__(self, node: Node | None, server: str, timeout: float):
        self._server, self._timeout = server, timeout
        self._lock, self._closed = threading.Lock(), threading.Event()
        self._clients: dict[str, Any] = {}
        self._own = None
        if node is None:
            context = rclpy.Context()
            rclpy.init(context=context)
            node = rclpy.create_node("unc_physics_client", context=context)
            executor = SingleThreadedExecutor(context=context)
            executor.add_node(node)
            thread = threading.Thread(target=spin, args=[executor], name="unc_physics client", daemon=True)
            thread.start()
            self._own = context, executor, thread
        self.node = node

    def end(self) -> bool:
        """End all waits; return whether the connection was open."""
        with self._lock:
            first = not self._closed.is_set()
            self._closed.set()
            return first

    def close(self) -> None:
        """Release all resources; a given node is kept."""
        self.end()
        if self._own is not None:
            _, executor, thread = self._own
            executor.shutdown()
            thread.join(5.0)
        for client in self._clients.values():
            client.destroy()
        if self._own is not None:
            self.node.destroy_node()
            self._own[0].try_shutdown()

    def call(self, service_type: Any, name: str, request: Any) -> Any:
        """Return the answer to a request of the service ``~/name``.

        Raises
        ------
        NotActiveError
            If no node offers it, or the node exits before it answers.
        InvalidRequestError
            If the given node is not in an executor.
        """
        name = f"{self._server}/{name}"
        client = self._client(name, lambda: self.node.create_client(service_type, name))
        if not client.wait_for_service(self._timeout):
            raise self._nobody(name)
        self._executor()
        return self._wait(client.call_async(request), name, client.service_is_ready)

    def offers(self, service_type: Any, name: str) -> bool:
        """Return whether the node offers the service ``~/name``, as far as is known now."""
        name = f"{self._server}/{name}"
        return self._client(name, lambda: self.node.create_client(service_type, name)).service_is_ready()

    def run(
        self,
        action_type: Any,
        name: str,
        goal: Any,
        on_feedback: Callable[[Any], object],
        cancel: threading.Event | None,
    ) -> tuple[Any, UncPhysicsError | None]:
        """Send a goal to the action ``~/name`` and wait for the result.

        Parameters
        ----------
        action_type : type
        name : str
        goal : message
        on_feedback : callable
            Takes feedback, in the calling thread. An exception from it cancels the goal.
        cancel : threading.Event or None
            Cancels the goal when it is set.

        Returns
        -------
        result : message
        stopped : UncPhysicsError or None
            The library's error from ``on_feedback``; other exceptions are raised at once.

        Raises
        ------
        NotActiveError, InvalidRequestError
            As `call`.
        """
        name = f"{self._server}/{name}"
        action = self._client(name, lambda: ActionClient(self.node, action_type, name))
        if not action.wait_for_server(self._timeout):
            raise self._nobody(name)
        events: queue.SimpleQueue = queue.SimpleQueue()
        sent = self._begin(
            lambda: action.send_goal_async(
                goal, feedback_callback=lambda message: events.put(message.feedback)
            ),
            name,
            action.server_is_ready,
        )
        handle = self._wait(sent, name, action.server_is_ready)
        if not handle.accepted:
            raise NotActiveError("refused the goal", field=name)
        result = self._begin(handle.get_result_async, name, action.server_is_ready)
        result.add_done_callback(lambda _: events.put(_DONE))

        def end():
            return self._executor().create_task(handle.cancel_goal_async)

        try:
            stopped = self._follow(events, name, action.server_is_ready, on_feedback, cancel, end)
        except BaseException:
            _done(end()).wait(_POLL_PERIOD)  # must be sent before the connection is closed
            raise
        answer = result.result()
        if answer.status == GoalStatus.STATUS_UNKNOWN:
            raise self._gone(name)
        return answer.result, stopped

    def _follow(self, events, name, ready, on_feedback, cancel, end):
        """Pass on feedback until the action is done; return the library's error that ended it, or None."""
        stopped, canceled, checked = None, False, time.monotonic()
        while True:
            if cancel is not None and cancel.is_set() and not canceled:
                canceled = True
                end()
            try:
                event = events.get(
                    timeout=_POLL_PERIOD if cancel is None or canceled else _CANCEL_POLL_PERIOD
                )
            except queue.Empty:
                event = None
            if event is _DONE:
                return stopped
            if event is not None and stopped is None:
                try:
                    on_feedback(event)
                except UncPhysicsError as error:
                    stopped, canceled = error, True
                    end()
            if time.monotonic() - checked > _POLL_PERIOD:
                checked = time.monotonic()
                self._check(name, ready)

    def _begin(self, start, name, ready):
        """Return the rclpy future of a call to an action's client.

        The spinning thread makes the call: rclpy drops an answer that comes before the call has returned.
        """
        return self._wait(self._executor().create_task(start), name, ready)

    def _wait(self, future, name, ready):
        """Wait for an rclpy future, which the spinning thread completes."""
        done = _done(future)
        while not done.wait(_POLL_PERIOD):
            self._check(name, ready)
        return future.result()

    def _client(self, name, make):
        with self._lock:
            self._check_open()
            if name not in self._clients:
                self._clients[name] = make()
            return self._clients[name]

    def _executor(self) -> Any:
        if self.node.executor is None:
            raise InvalidRequestError(
                "is not spun; add it to an executor that spins in another thread", field="node"
            )
        return self.node.executor

    def _check(self, name, ready):
        """Raise `NotActiveError` if no answer can arrive any more."""
        self._check_open()
        if not ready():
            raise self._gone(name)

    def _check_open(self):
        if self._closed.is_set():
            raise NotActiveError("is closed", field="the client")

    def _nobody(self, name):
        return NotActiveError(
            f"is not offered by any node within {self._timeout:g} s; start one (`ros2 run unc_physics"
            " unc_physics_node`), or name another with server=, and see that ROS_DOMAIN_ID is the same",
            field=name,
        )

    def _gone(self, name):
        return NotActiveError("went away before it answered", field=name)


def _done(future):
    """Return an event that is set when an rclpy future is done."""
    event = threading.Event()
    future.add_done_callback(lambda _: event.set())
    return event


def spin(executor: Executor) -> None:
    """Run an executor until it or its context is shut down, even if other threads destroy entities.

    rclpy skips a destroyed subscription or client, but raises at its events.
    """
    ended = False
    while not ended:
        try:
            executor.spin()
            ended = True
        except ExternalShutdownException:
            ended = True
        except InvalidHandle:
            pass
