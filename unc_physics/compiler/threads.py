"""Parallel work in threads; kernels run without the GIL."""

import contextlib
import threading
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache

import numba

from .compile_time import count_compiling, seconds_compiling
from .refusal import refusing_as_here
from .time_limit import limit_here

# costs vary between samples; starting a part costs as much as a short rollout
_MOST_PARTS_PER_THREAD, _FEWEST_IN_A_PART = 8, 4
_FEW_STEPS = 400  # body steps, over all samples, that take less time than starting another thread
_FIRST_PART = 64  # samples, of watched work that may be slow
_PART_TIME = 0.01  # s, target duration of a part
_LOOK_AFTER = 0.02  # s, between checks while parts take longer


class _Watch(threading.local):
    """Watcher of this thread's work."""

    look = None


_watch = _Watch()


@contextlib.contextmanager
def watched(look):
    """Call ``look()`` between and during parts of `in_threads` within the ``with`` block.

    An exception from it ends the work, whose results are then incomplete. Otherwise results do not depend on
    it.
    """
    before, _watch.look = _watch.look, look
    try:
        yield
    finally:
        _watch.look = before


def in_threads(count, run, first=_FIRST_PART, steps=_FEW_STEPS):
    """Call ``run(slice)`` for parts of ``range(count)``, with the number of threads set in numba.

    Watched work (`watched`) begins with parts of ``first`` samples, unless a thread gets no more. ``steps``
    are the body steps of a sample: what takes few of them is one part, and other parts take no fewer.
    """
    if count * steps <= _FEW_STEPS:
        run(slice(0, count))
        return
    run = refusing_as_here(run)
    threads = numba.get_num_threads() if count > 1 else 1
    fewest = max(_FEW_STEPS // steps, _FEWEST_IN_A_PART)
    parts = threads * min(max(count // (fewest * threads), 1), _MOST_PARTS_PER_THREAD)
    size = -(-count // parts)
    if _watch.look is not None and size > first:
        _in_watched_parts(count, run, threads, first, size, _watch.look)
    elif threads == 1:
        run(slice(0, count))
    else:
        ends = [count * part // parts for part in range(parts + 1)]
        _share(deque(map(slice, ends[:-1], ends[1:])), run, threads)


def _share(parts, run, threads):
    """Let each thread process parts in sequence, so that it wakes up only once."""

    def work():
        compiled = 0.0
        try:
            while (some := _next(parts)) is not None:
                compiled += _timed(run, some)[1]
        finally:
            parts.clear()  # after a failure, all threads stop
        return compiled

    workers = [_pool(threads).submit(work) for _ in range(threads)]
    try:
        wait(workers)
    finally:
        parts.clear()
        wait(workers)  # they still write to shared arrays
    count_compiling(max(worker.result() for worker in workers))


def _next(parts):
    """Return the next part, or None if no part remains."""
    try:
        return parts.popleft()
    except IndexError:
        return None


def _in_watched_parts(count, run, threads, first, most, look):
    """Run `in_threads` in parts of a few milliseconds, one per thread at a time.

    Other work is then not delayed for long.
    """
    waiting, begun, size = set(), 0, first
    compiling, patience = 0.0, None  # the first parts may compile, which a check would count as computation
    try:
        while begun < count or waiting:
            while begun < count and len(waiting) < threads:
                some = slice(begun, min(begun + size, count))
                begun = some.stop
                waiting.add(_pool(threads).submit(_timed, run, some))
            done, waiting = wait(waiting, patience, "FIRST_COMPLETED")
            patience = _LOOK_AFTER
            for part in done:
                samples, compiled, took = part.result()
                count_compiling(max(compiled - compiling, 0.0))  # before anyone reads the clock
                compiling = max(compiling, compiled)
                size = max(1, min(most, 4 * samples, round(samples * _PART_TIME / max(took, 1e-9))))
            look()
    finally:
        if waiting and (limit := limit_here()) is not None:
            limit.stop()
        wait(waiting)  # they still write to shared arrays


def _timed(run, some):
    """Run a part; return its number of samples, its compilation time [s], and its remaining time [s]."""
    before, started = seconds_compiling(), time.perf_counter()
    run(some)
    compiled = seconds_compiling() - before
    return some.stop - some.start, compiled, time.perf_counter() - started - compiled


@cache
def _pool(threads):
    return ThreadPoolExecutor(threads, thread_name_prefix="rollouts")
