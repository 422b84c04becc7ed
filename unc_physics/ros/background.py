"""Work beside the executor's thread, which so stays free for everything else that comes in."""

from __future__ import annotations

import threading
import traceback

from rclpy.callback_groups import ReentrantCallbackGroup


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
    rclpy's executors hand what a service's callback returns, with the request's header, to the service's
    ``send_response``. Here that is where the work is handed over, and an executor of one thread is enough:
    one of several wakes up two or three times in each request, and each time holds up the thread that works
    on it.
    """

    def __init__(self, server, service_type, name, answer):
        self._server, self._answer = server, answer
        self._service = server.node.create_service(
            service_type,
            name,
            lambda request, response: (request, response),
            callback_group=ReentrantCallbackGroup(),
        )
        self._send = self._service.send_response
        self._service.send_response = self._hand_over

    def close(self):
        """Take the service back."""
        self._server.node.destroy_service(self._service)

    def _hand_over(self, messages, header):
        self._server.pool.submit(self._work, *messages, header)

    def _work(self, request, response, header):
        try:
            afterwards = self._answer(request, response)
            self._send(response, header)
            if afterwards is not None:
                afterwards()
        except Exception:  # noqa: BLE001  (a client that has gone, say: the node lives on)
            if self._server.node.context.ok():
                self._server.log.error(f"an answer was not sent:\n{traceback.format_exc()}")


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
        self._items = {}
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def put(self, item, source=None) -> None:
        """Give it an item, which takes the place of one that waits and is of the same source."""
        with self._changed:
            late = source in self._items
            self._items[source] = item
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
                item = self._items.pop(next(iter(self._items)))
            self._work(item)
