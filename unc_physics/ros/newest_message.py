"""Subscription of a client that waits for the next message."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Any

from ..checks.errors import NotActiveError

_QUEUED = 20  # messages that wait in the middleware


class NewestMessage:
    """Subscription whose next message a thread can wait for."""

    def __init__(self, node, kind, topic):
        self._node, self._topic = node, topic
        self._changed, self._message, self._count = threading.Condition(), None, 0
        self._fresh: int | None = None  # count after which a message is next, even if it is there
        self._is_first: Callable[[Any], bool] | None = None
        self._subscription = node.create_subscription(kind, topic, self.set, _QUEUED)

    def set(self, message: Any) -> None:
        """Take a message."""
        with self._changed:
            if self._is_first is not None:
                if not self._is_first(message):
                    return
                self._is_first = None
            self._message, self._count = message, self._count + 1
            self._changed.notify_all()

    @contextlib.contextmanager
    def from_first(self, is_first: Callable[[Any], bool]) -> Iterator[Callable[[float], bool]]:
        """Ignore messages until the first one that a function is true for, which `next` may return later.

        Gives a function that waits for that message for a time [s], and returns whether it came.
        """
        with self._changed:
            count, self._is_first = self._count, is_first

        def wait(timeout):
            with self._changed:
                came = self._changed.wait_for(lambda: self._count > count, timeout)
                self._fresh, self._is_first = count, None
                return came

        try:
            yield wait
        finally:
            with self._changed:
                self._is_first = None

    def skip_old(self) -> None:
        """Let `next` return none of the messages that are there."""
        with self._changed:
            self._fresh = None

    def next(self, timeout: float) -> Any:
        """Return the next message."""
        with self._changed:
            count = self._count if self._fresh is None else self._fresh
            self._fresh = None
            if not self._changed.wait_for(lambda: self._count > count, timeout):
                raise NotActiveError(
                    f"has no message within {timeout:g} s; start the node with track:=true, and publish"
                    " observations",
                    field=self._topic,
                )
            return self._message

    def close(self):
        """Unsubscribe."""
        self._node.destroy_subscription(self._subscription)
