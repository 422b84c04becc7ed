"""Work beside the executor's thread, which so stays free for everything else that comes in."""

from __future__ import annotations

import threading
import traceback
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.qos import QoSProfile

from unc_physics_msgs.msg import Result

from ..checks.errors import CanceledError, NotActiveError
from .requests import write_error

_DISCOVERY = 0.02  # s, between looks whether a service is discovered
_MANY = QoSProfile(depth=100)  # ROS keeps 10 requests that wait, and 10 answers, and loses the others


class BackgroundService:
    """A service whose answers are made by a pool of threads and sent from there.

    Parameters
    ----------
    server : PredictionServer
    service_type : type
    name : str
    answer : callable
        Takes request and response, and fills the response. Returns what is left to be done when that is on
        its way: a callable without arguments, or None.

    Notes
    -----
    rclpy knows no answers that come later but those of coroutines, which the events executor of Jazzy does
    not take for services, and which the others look at once more in each turn. But its executors hand what a
    callback returns, with the request's header, to the service's ``send_response``: there the work is handed
    over, and an executor of one thread is enough. One of several wakes up two or three times in each request,
    and each time holds up the thread that works on it.

    Nothing relies on that: the node finds out by a call of its own (`HandOver`), and in an rclpy that does it
    otherwise the callback itself answers, in the executor's thread.
    """

    def __init__(self, server, service_type, name, answer):
        self._server, self._answer = server, answer
        self._asked = {}  # requests by the ids of their responses, while rclpy has those
        self._service = server.node.create_service(
            service_type, name, self._called, qos_profile=_MANY, callback_group=ReentrantCallbackGroup()
        )
        self._send = self._service.send_response
        self._service.send_response = self._returned

    def close(self):
        """Take the service back."""
        self._server.node.destroy_service(self._service)

    def _called(self, request, response):
        """What rclpy calls with a request; it gets the answer, or what that is to be made of."""
        works = self._server.hand_over.works
        if works is False:
            if (afterwards := self._answer(request, response)) is not None:
                afterwards()
            return response
        if works is None and hasattr(response, "result"):  # for the case that this is sent as it is
            write_error(response.result, NotActiveError("is just getting ready; ask again", field="the node"))
        self._asked[id(response)] = request
        return response

    def _returned(self, response, header):
        """What rclpy calls with what was returned."""
        if (request := self._asked.pop(id(response), None)) is None:
            self._send(response, header)
            return
        self._server.hand_over.works = True
        if hasattr(response, "result"):
            response.result = Result()
        try:
            self._server.pool.submit(self._work, request, response, header)
        except RuntimeError:  # the pool takes no more: the node is closing
            if hasattr(response, "result"):
                write_error(response.result, CanceledError(self._server.ending, field="the node"))
            self._send(response, header)

    def _work(self, request, response, header):
        try:
            afterwards = self._answer(request, response)
            self._send(response, header)
            if afterwards is not None:
                afterwards()
        except Exception:  # noqa: BLE001  (a client that has gone, say: the node lives on)
            if self._server.node.context.ok():
                self._server.log.error(f"an answer was not sent:\n{traceback.format_exc()}")


class HandOver:
    """Finds out by a call of the node's own whether requests can be handed over to other threads.

    Parameters
    ----------
    server : PredictionServer
    service_type : type
    name : str
        Of a `BackgroundService` that answers soon.

    Attributes
    ----------
    works : bool or None
        None until that is known.
    """

    def __init__(self, server, service_type, name):
        self.works: bool | None = None
        self._log, self._node, self._type = server.log, server.node, service_type
        self._client: Any = self._node.create_client(service_type, name)
        # of real time: simulated time may stand still
        self._timer: Any = self._node.create_timer(
            _DISCOVERY, self._call, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def _call(self):
        if self._timer is not None and self._client.service_is_ready():
            self._end_timer()
            self._client.call_async(self._type.Request()).add_done_callback(self._answered)

    def _answered(self, _):
        if self.works is None:
            self.works = False
            self._log.warning(
                "this version of rclpy keeps answers to itself: requests are answered one by one, in the"
                " executor's thread"
            )
        self._end_client()

    def _end_timer(self):
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
            self._timer = None

    def _end_client(self):
        if self._client is not None:
            self._node.destroy_client(self._client)
            self._client = None

    def close(self):
        """Call nobody any more."""
        self._end_timer()
        self._end_client()


class Newest:
    """A thread that works on the newest of what it is given; what comes meanwhile replaces what still waits.

    Parameters
    ----------
    work : callable
        Takes one item; raises nothing.
    replaced : callable
        Called, without arguments, for each item that was replaced before its turn.
    """

    def __init__(self, work, replaced):
        self._work, self._replaced = work, replaced
        self._items = []
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def put(self, item) -> None:
        """Give it an item, which takes the place of one that waits."""
        with self._changed:
            late = bool(self._items)
            self._items = [item]
            self._changed.notify()
        if late:
            self._replaced()

    def close(self) -> None:
        """Wait for the item that is being worked on; the others are left."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join()

    def _run(self):
        while True:
            with self._changed:
                while not (self._items or self._closed):
                    self._changed.wait()
                if self._closed:
                    return
                item = self._items.pop()
            self._work(item)
