"""Work on several threads at once: kernels run without the interpreter's lock."""

import contextlib
import threading
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache

import numba

from .compile_time import count_compiling, seconds_compiling
from .time_limit import limit_here

# samples differ in what they cost, and each part costs as much as a short rollout of its own
_MOST_PARTS_PER_THREAD, _FEWEST_IN_A_PART = 8, 4
_FIRST_PART = 64  # samples, of work that is watched and may be slow
_PART_TIME = 0.01  # s, of one of its parts
_LOOK_AFTER = 0.02  # s, between looks while parts take longer


class _Watch(threading.local):
    """What looks after the work of this thread."""

    look = None


_watch = _Watch()


@contextlib.contextmanager
def watched(look):
    """Have ``look()`` called between parts of the work that this thread does with `in_threads` in here, and
    while these take long.

    What it raises ends the work, whose results are then incomplete. Results do not depend on it otherwise.
    """
    before, _watch.look = _watch.look, look
    try:
        yield
    finally:
        _watch.look = before


@contextlib.contextmanager
def single_thread():
    """Have `in_threads` do in this thread what is called in here."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    look, _watch.look = _watch.look, None
    try:
        yield
    finally:
        _watch.look = look
        numba.set_num_threads(before)


def in_threads(count, run, first=_FIRST_PART, fewest=_FEWEST_IN_A_PART):
    """Call ``run(slice)`` for parts of ``range(count)``, on as many threads as numba is set to.

    Work that is `watched` begins with parts of ``first`` samples, unless that is all that a thread gets.
    Parts have no less than ``fewest`` samples, as far as there is one for each thread.
    """
    threads = numba.get_num_threads() if count > 1 else 1
    fewest = max(fewest, _FEWEST_IN_A_PART)
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
    """Let each thread take parts one after the other, so that it is woken up once for all of them."""

    def work():
        compiled = 0.0
        try:
            while (some := _next(parts)) is not None:
                compiled += _timed(run, some)[1]
        finally:
            parts.clear()  # where it failed, nobody is to go on
        return compiled

    workers = [_pool(threads).submit(work) for _ in range(threads)]
    try:
        wait(workers)
    finally:
        parts.clear()
        wait(workers)  # they write where nobody would expect it any more
    count_compiling(max(worker.result() for worker in workers))


def _next(parts):
    """The next part, None where others took the last one."""
    try:
        return parts.popleft()
    except IndexError:
        return None


def _in_watched_parts(count, run, threads, first, most, look):
    """As `in_threads`, in parts of a few milliseconds, with only as many at a time as there are threads:
    whoever else works in the meantime gets a turn soon.
    """
    waiting, begun, size = set(), 0, first
    compiling, patience = 0.0, None  # the first parts may compile, which a look would take for computation
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
                count_compiling(max(compiled - compiling, 0.0))  # before anybody looks at the clock
                compiling = max(compiling, compiled)
                size = max(1, min(most, 4 * samples, round(samples * _PART_TIME / max(took, 1e-9))))
            look()
    finally:
        if waiting and (limit := limit_here()) is not None:
            limit.stop()
        wait(waiting)  # they write where nobody would expect it any more


def _timed(run, some):
    """Run a part: its number of samples, the seconds spent compiling, and those that it took besides."""
    before, started = seconds_compiling(), time.perf_counter()
    run(some)
    compiled = seconds_compiling() - before
    return some.stop - some.start, compiled, time.perf_counter() - started - compiled


@cache
def _pool(threads):
    return ThreadPoolExecutor(threads, thread_name_prefix="rollouts")
