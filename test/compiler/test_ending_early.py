"""What ends kernels early."""

import gc
import threading
import time
import weakref

from unc_physics.compiler.time_limit import TimeLimit, limit_here, time_limit


def wait_for(limit, seconds=100.0):
    end = time.monotonic() + seconds
    while not limit.passed and time.monotonic() < end:
        time.sleep(0.005)
    return limit.passed


def test_flags_are_raised_when_their_times_are_up_in_any_order():
    late, soon = TimeLimit(), TimeLimit()
    late.within(1e6)
    started = time.monotonic()
    soon.within(0.05)
    assert wait_for(soon) and time.monotonic() - started > 0.04
    assert not late.passed
    late.within(0.0)  # a new time takes the place of the old one
    assert wait_for(late)


def test_a_time_that_was_set_anew_or_taken_back_raises_no_flag():
    limit, later = TimeLimit(), TimeLimit()
    limit.within(0.05)  # if it is up before the next line, the flag is taken back
    limit.within(1e6)
    later.within(0.1)
    assert wait_for(later) and not limit.passed


def test_a_computation_that_has_ended_is_not_kept_until_its_time():
    with time_limit() as limit:
        limit.within(1e6)
        kept = weakref.ref(limit)
    del limit
    gc.collect()
    assert kept() is None


def test_each_thread_has_its_own_limit_and_its_end_stops_what_still_runs():
    assert limit_here() is None
    with time_limit() as outer:
        with time_limit() as inner:
            assert limit_here() is inner
            seen = []
            thread = threading.Thread(target=lambda: seen.append(limit_here()))
            thread.start()
            thread.join()
            assert seen == [None]
        assert inner.passed and limit_here() is outer and not outer.passed
    assert outer.passed
