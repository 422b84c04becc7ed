"""Work on any executor, in chunks whose size adapts; a chunk whose worker is lost is repeated.

An item's result depends on the item alone, not on the executor, the number of workers or the chunks.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from concurrent.futures import ProcessPoolExecutor as Pool
from itertools import count, islice
from typing import Any, NamedTuple

import numba

from ..checks.errors import InternalError, InvalidOptionError, NotSupportedError

#: What does the work: this process (None), an executor, a function that makes one, or a text: ``processes:N``
#: for processes of this machine, ``dask://HOST:PORT`` for the scheduler of a Dask cluster.
AnyExecutor = Executor | Callable[[], Executor] | str | None

CHUNK_TIME = 1.0  # s, of a chunk: hundreds of times what sending it takes, and short to repeat
ROUND_CHUNK_TIME = 0.05  # s, of a chunk where rounds have few items, and the next one waits for all
_GROWTH = 4  # largest factor between the sizes of consecutive chunks
_FIRST_CHUNKS = 4  # chunks under way before anything is known of the workers
_LOSSES = 3  # lost workers, the last one while nothing else ran, after which an item counts as their cause
_LOOK = 1.0  # s, between calls of `look`


class _Part(NamedTuple):
    """Item with its number, and how many workers were lost with it."""

    number: int
    item: Any
    losses: int = 0


class _Chunk(NamedTuple):
    """Parts that are under way, on which executor, and since when [s]."""

    parts: list[_Part]
    executor: Executor
    since: float


class Workers:
    """An executor, with what is known of its speed; `close` ends it if it was made here.

    Parameters
    ----------
    executor : AnyExecutor
        That of a text or a function is made anew when it breaks, as a pool does that loses a process.
    chunk_time : float
        Target duration of a chunk [s].

    Raises
    ------
    InvalidOptionError
        If it is no executor, or names a scheduler that cannot be reached.
    NotSupportedError
        If Dask is missing.
    """

    def __init__(self, executor: AnyExecutor = None, chunk_time: float = CHUNK_TIME):
        self._make = _maker(executor) if isinstance(executor, str) or callable(executor) else None
        self._executor: Any = _InProcess() if executor is None else self._make() if self._make else executor
        if not isinstance(self._executor, Executor):
            raise InvalidOptionError(
                "must be an executor, a function that makes one, or a text", field="executor", value=executor
            )
        if type(self._executor).__module__.startswith("distributed."):
            self._executor = _OfDask(self._executor)
        self.here = executor is None
        self._chunk_time, self._size, self._most = chunk_time, 1, _FIRST_CHUNKS
        self._again: deque[_Part] = deque()

    def close(self) -> None:
        """End the executor without waiting, unless it was given."""
        if self._make is not None:
            self._executor.shutdown(wait=False)

    def repeat(self, number: int, item: Any) -> None:
        """Do an item again, or another one of that number, within the loop over `results`."""
        self._again.append(_Part(number, item))

    def results(
        self, function: Callable[[Any], Any], items: Iterable[Any], look: Callable[[], object] = lambda: None
    ) -> Iterator[tuple[int, Any, Any]]:
        """Yield number, item and result of each item as they come.

        The result is an `InternalError` if one worker after another is lost with the item.

        Parameters
        ----------
        function : callable
            Of one item; picklable like the items, unless this process does the work. What it raises ends the
            work.
        items : iterable
            Taken as workers become free.
        look : callable
            Called at least every second.

        Raises
        ------
        BrokenExecutor
            If a given executor broke, which nobody here can make anew.
        """
        waiting, pending = map(_Part, count(), items), dict[Future, _Chunk]()
        try:
            while True:
                while len(pending) < self._most and (parts := self._next(waiting, not pending)):
                    future, chunk = self._submitted(function, parts)
                    pending[future] = chunk
                    if future.done() or parts[0].losses == _LOSSES - 1:
                        break  # by this process, or an item that runs alone
                if not pending:
                    return
                done = wait(pending, _LOOK, FIRST_COMPLETED).done
                look()
                for future in done:
                    yield from self._of_chunk(future, pending.pop(future))
        finally:
            for future in pending if self._make is None else ():  # else `close` ends them with their executor
                future.cancel()

    def _next(self, waiting, idle):
        """Return the parts of the next chunk: repeated ones first, and one by one after a loss."""
        if self._again and self._again[0].losses:
            return [self._again.popleft()] if idle or self._again[0].losses < _LOSSES - 1 else []
        again = [self._again.popleft() for _ in range(min(self._size, len(self._again)))]
        return again or list(islice(waiting, self._size))

    def _submitted(self, function, parts):
        arguments = function, [part.item for part in parts], not self.here
        try:
            future = self._executor.submit(_run_chunk, *arguments)
        except BrokenExecutor as error:
            self._replace(self._executor, error)
            future = self._executor.submit(_run_chunk, *arguments)
        return future, _Chunk(parts, self._executor, time.monotonic())

    def _of_chunk(self, future, chunk):
        """Yield what `results` does of a chunk that ended, or plan to repeat it."""
        try:
            found, took = future.result()
        except _Failed as failed:
            raise failed.args[0] from None
        except Exception as lost:
            if not _is_loss(lost):
                raise
            if isinstance(lost, BrokenExecutor):
                self._replace(chunk.executor, lost)
            for number, item, losses in reversed(chunk.parts):
                if losses + 1 < _LOSSES:
                    self._again.appendleft(_Part(number, item, losses + 1))
                else:
                    why = f"lost its worker {_LOSSES} times, perhaps for want of memory"
                    yield number, item, InternalError(why, value=str(lost) or type(lost).__name__)
            return
        size = len(chunk.parts)
        self._size = max(1, min(round(self._chunk_time * size / max(took, 1e-9)), _GROWTH * size))
        if time.monotonic() - chunk.since < 2.0 * took:  # it waited less than it ran: workers may be idle
            self._most += 1
        for part, result in zip(chunk.parts, found, strict=True):
            yield part.number, part.item, result

    def _replace(self, broken, error):
        """Make a new executor in place of a broken one, unless that was done."""
        if self._make is None:
            raise error
        if broken is self._executor:
            broken.shutdown(wait=False)
            self._executor = self._make()


def in_order(numbered: Iterable[tuple[int, Any, Any]]) -> Iterator[Any]:
    """Yield the results of `Workers.results` in the order of the items; an `InternalError` is raised."""
    early: dict[int, Any] = {}
    number = 0
    for k, _, value in numbered:
        if isinstance(value, InternalError):
            raise value
        early[k] = value
        while number in early:
            yield early.pop(number)
            number += 1


class _Failed(Exception):
    """What the work raised, as opposed to the loss of its worker."""


def _run_chunk(function, items, one_thread):
    """Return the results of items, and the wall time [s]."""
    started, threads = time.perf_counter(), numba.get_num_threads()
    if one_thread:
        numba.set_num_threads(1)  # other workers use the other processor cores
    try:
        return list(map(function, items)), time.perf_counter() - started
    except Exception as error:
        raise _Failed(error) from error
    finally:
        numba.set_num_threads(threads)


def _is_loss(error):
    """Return whether a chunk ended because its worker did; Dask's own class for it is not imported here."""
    return (
        isinstance(error, (BrokenExecutor, CancelledError, OSError)) or type(error).__name__ == "KilledWorker"
    )


class _InProcess(Executor):
    """Does the work in this thread, at once."""

    def submit(self, fn, /, *args, **kwargs):
        future: Future = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except _Failed as failed:
            future.set_exception(failed)
        return future


def _maker(executor) -> Callable[[], Executor]:
    """Return the function that makes an executor."""
    if not isinstance(executor, str):
        return executor
    kind, _, rest = executor.partition(":")
    if kind == "processes" and rest.isdecimal() and int(rest) > 0:
        return lambda: _Processes(int(rest), multiprocessing.get_context("spawn"), _begin_process)
    if kind == "dask" and rest.startswith("//"):
        return lambda: _dask_executor(rest)
    raise InvalidOptionError(
        "must be processes:N, or dask://HOST:PORT for a scheduler", field="executor", value=executor
    )


class _Processes(Pool):
    """Processes that end at once if nobody waits for them."""

    def shutdown(self, wait=True, *, cancel_futures=False):
        calls = self._call_queue  # pyright: ignore[reportAttributeAccessIssue]
        processes = list((self._processes or {}).values())
        super().shutdown(wait, cancel_futures=cancel_futures)
        if not wait and calls is not None:
            calls.cancel_join_thread()  # it would write to processes that are no more
            for process in processes:
                process.terminate()


def _begin_process():
    """Ignore interrupts, and end with the parent process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent: Any = multiprocessing.parent_process()

    def watch():
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class _OfDask(Executor):
    """Executor of a Dask client, which gets chunks as bytes: it looks into all parts of other arguments."""

    def __init__(self, executor, client=None):
        self._executor, self._client = executor, client

    def submit(self, fn, /, *args, **kwargs):
        from cloudpickle import dumps  # pyright: ignore[reportMissingImports]  # which Dask needs

        # it takes pure calls with equal arguments for one, and would not repeat them
        return self._executor.submit(_call_pickled, dumps((fn, args)), pure=False)

    def shutdown(self, wait=True, *, cancel_futures=False):
        self._executor.shutdown(wait)
        if self._client is not None:
            self._client.close()


def _call_pickled(function_and_arguments):
    function, arguments = pickle.loads(function_and_arguments)
    return function(*arguments)


def _dask_executor(address):
    try:
        from distributed import Client  # pyright: ignore[reportMissingImports]  # optional
    except ImportError:
        raise NotSupportedError("needs Dask: pip install 'unc_physics[many]'", field="executor") from None
    try:
        client = Client(f"tcp:{address}", set_as_default=False)
    except (OSError, ValueError) as error:
        raise InvalidOptionError(
            f"cannot be reached: {error}", field="executor", value=f"dask:{address}"
        ) from None
    return _OfDask(client.get_executor(), client)
