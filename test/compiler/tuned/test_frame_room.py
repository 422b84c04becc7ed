"""Room for frames: calls at any depth take no memory from the system."""

import resource

import pytest

from unc_physics.compiler.tuned.frame_room import with_room


def nothing():
    pass


def most_faults(depth, calls):
    """Most pages that ``calls`` calls touch for the first time, at any depth of frames up to ``depth``."""
    before = resource.getrusage(resource.RUSAGE_THREAD).ru_minflt
    for _ in range(calls):
        nothing()
    here = resource.getrusage(resource.RUSAGE_THREAD).ru_minflt - before
    return here if depth == 0 else max(here, most_faults(depth - 1, calls))


def test_calls_at_any_depth_touch_no_new_pages():
    depth, calls = 300, 500
    if most_faults(depth, calls) < calls:
        pytest.skip("this Python keeps frames in another way")
    assert with_room(most_faults, depth, calls) < calls / 5


def test_a_function_gets_its_arguments_and_its_errors_come_through():
    assert with_room(divmod, 7, 2) == (3, 1)
    with pytest.raises(ZeroDivisionError):
        with_room(divmod, 1, 0)
