"""Work on several threads at once: kernels run without the interpreter's lock."""

from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numba

from .compile_time import count_compiling, seconds_compiling

# samples differ in what they cost, and each part costs as much as a short rollout of its own
_MOST_PARTS_PER_THREAD, _FEWEST_IN_A_PART = 8, 4


def in_threads(count, run):
    """Call ``run(slice)`` for parts of ``range(count)``, on as many threads as numba is set to."""
    threads = numba.get_num_threads() if count > 1 else 1
    if threads == 1:
        run(slice(0, count))
        return
    parts = threads * min(max(count // (_FEWEST_IN_A_PART * threads), 1), _MOST_PARTS_PER_THREAD)
    ends = [count * part // parts for part in range(parts + 1)]

    def timed(part):
        before = seconds_compiling()
        run(part)
        return seconds_compiling() - before

    count_compiling(max(_pool(threads).map(timed, map(slice, ends[:-1], ends[1:]))))


@cache
def _pool(threads):
    return ThreadPoolExecutor(threads, thread_name_prefix="rollouts")
