"""A client's connection to a node: it spins, calls services and actions, and waits for their answers."""

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

_LOOK = 1.0  # s, between looks whether the node is still there
_LOOK_FOR_CANCEL = 0.05  # s
_DONE = object()


class Connection:
    """Calls what a node offers; several threads may.

    Parameters
    ----------
    node : rclpy Node, optional
        Whose executor spins in another thread; by default one of its own, with a context and a thread.
    server : str
        Name of the node that is called.
    timeout : float
        How long to wait for it to appear [s].
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
        """Let nobody wait any longer; whether anybody could until now."""
        with self._lock:
            first = not self._closed.is_set()
            self._closed.set()
            return first

    def close(self) -> None:
        """Take everything back; a node that was given stays as it was."""
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
        """The answer to a request of the service ``~/name``.

        Raises
        ------
        NotActiveError
            If nobody offers it, or goes away before answering.
        InvalidRequestError
            If the node that was given is in no executor.
        """
        name = f"{self._server}/{name}"
        client = self._client(name, lambda: self.node.create_client(service_type, name))
        if not client.wait_for_service(self._timeout):
            raise self._nobody(name)
        self._executor()
        return self._wait(client.call_async(request), name, client.service_is_ready)

    def run(
        self,
        action_type: Any,
        name: str,
        goal: Any,
        look: Callable[[Any], object],
        cancel: threading.Event | None,
    ) -> tuple[Any, UncPhysicsError | None]:
        """Have the action ``~/name`` reach a goal.

        Parameters
        ----------
        action_type : type
        name : str
        goal : message
        look : callable
            Takes feedback, in the calling thread. What it raises cancels the goal.
        cancel : threading.Event or None
            Cancels the goal, too, when it is set.

        Returns
        -------
        result : message
        stopped : UncPhysicsError or None
            What ``look`` raised, of the library's errors; others are raised at once.

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
            lambda: action.send_goal_async(goal, feedback_callback=lambda told: events.put(told.feedback)),
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
            stopped = self._follow(events, name, action.server_is_ready, look, cancel, end)
        except BaseException:
            _done(end()).wait(_LOOK)  # it must be sent before the connection is closed
            raise
        answer = result.result()
        if answer.status == GoalStatus.STATUS_UNKNOWN:
            raise self._gone(name)
        return answer.result, stopped

    def _follow(self, events, name, ready, look, cancel, end):
        """Show feedback until the action is done; the error that ended it, if any of the library's did."""
        stopped, canceled, looked = None, False, time.monotonic()
        while True:
            if cancel is not None and cancel.is_set() and not canceled:
                canceled = True
                end()
            try:
                event = events.get(timeout=_LOOK if cancel is None or canceled else _LOOK_FOR_CANCEL)
            except queue.Empty:
                event = None
            if event is _DONE:
                return stopped
            if event is not None and stopped is None:
                try:
                    look(event)
                except UncPhysicsError as error:
                    stopped, canceled = error, True
                    end()
            if time.monotonic() - looked > _LOOK:
                looked = time.monotonic()
                self._check(name, ready)

    def _begin(self, start, name, ready):
        """The rclpy future that a call to an action's client gives.

        The thread that spins makes the call: rclpy drops an answer that comes before the call has returned.
        """
        return self._wait(self._executor().create_task(start), name, ready)

    def _wait(self, future, name, ready):
        """The result of an rclpy future that the spinning thread completes."""
        done = _done(future)
        while not done.wait(_LOOK):
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
        """Raise `NotActiveError` if no answer is to be waited for any more."""
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
    """An event that is set when an rclpy future is done."""
    event = threading.Event()
    future.add_done_callback(lambda _: event.set())
    return event


def spin(executor: Executor) -> None:
    """Run an executor until it or its context is shut down, whatever other threads destroy meanwhile.

    rclpy passes over a subscription or a client that is gone, but stops at the events of one.
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
