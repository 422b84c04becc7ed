"""The number of threads changes nothing."""

import concurrent.futures
import threading
from collections import deque

import numba
import numpy as np
import pytest
from example_scenes import parts_of

from unc_physics import make_propagator, predict
from unc_physics.compiler import threads

PATIENCE = 200.0  # s, on a busy machine
needs_two_threads = pytest.mark.skipif(
    numba.config.NUMBA_NUM_THREADS < 2, reason="this machine has one thread"
)


@needs_two_threads
@pytest.mark.parametrize("scene_name", ["three_bodies", "everyday"])
@pytest.mark.parametrize(
    "name, options", [("monte_carlo", {"samples": 33}), ("sigma_points", {"points": "full"})]
)
def test_one_thread_and_two_give_the_same_bits(loaded, scene_name, name, options):
    scene, belief, _ = loaded(scene_name)
    propagator = make_propagator(name, **options)
    ends, before = [], numba.get_num_threads()
    try:
        for count in (1, 2):
            numba.set_num_threads(count)
            ends.append(predict(scene, belief, propagator, 0.9))
    finally:
        numba.set_num_threads(before)
    np.testing.assert_array_equal(ends[0].carry.states, ends[1].carry.states)
    np.testing.assert_array_equal(ends[0].belief.joint, ends[1].belief.joint)
    remembered = [list(parts_of(end.carry.contact_history)) for end in ends]
    for one, other in zip(*remembered, strict=True):
        np.testing.assert_array_equal(one, other)


@needs_two_threads
def test_what_a_part_raises_ends_the_work_when_nobody_is_at_it_any_more(monkeypatch):
    """The other threads end the parts that they have, and begin no more."""
    begun, ended, cleared, second = [], [], threading.Event(), threading.Event()

    class Parts(deque):
        def clear(self):
            super().clear()
            cleared.set()

    def run(some):
        begun.append(some)
        if some.start == 0:
            assert second.wait(PATIENCE)
            raise ValueError("the first part")
        second.set()
        assert cleared.wait(PATIENCE)
        ended.append(some)

    monkeypatch.setattr(threads, "deque", Parts)
    with pytest.raises(ValueError, match="first"):
        threads.in_threads(64 * numba.get_num_threads(), run)
    assert len(ended) == len(begun) - 1 < numba.get_num_threads()


def test_predictions_at_once_in_several_threads(loaded):
    """Callers of a node's service may come together."""
    scene, belief, _ = loaded("two_bodies")
    propagator = make_propagator("monte_carlo", samples=16)
    alone = predict(scene, belief, propagator, 0.8).carry.states
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        for prediction in pool.map(lambda _: predict(scene, belief, propagator, 0.8), range(8)):
            np.testing.assert_array_equal(prediction.carry.states, alone)
