"""The number of threads changes nothing."""

import concurrent.futures
import os
import subprocess
import sys
import time

import numba
import numpy as np
import pytest
import yaml
from example_scenes import parts_of, two_bodies

from unc_physics import make_propagator, predict
from unc_physics.__main__ import main
from unc_physics.compiler.threads import in_threads

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
        for threads in (1, 2):
            numba.set_num_threads(threads)
            ends.append(predict(scene, belief, propagator, 0.9))
    finally:
        numba.set_num_threads(before)
    np.testing.assert_array_equal(ends[0].carry.states, ends[1].carry.states)
    np.testing.assert_array_equal(ends[0].belief.joint, ends[1].belief.joint)
    remembered = [list(parts_of(end.carry.contact_history)) for end in ends]
    for one, other in zip(*remembered, strict=True):
        np.testing.assert_array_equal(one, other)


@needs_two_threads
def test_the_command_prints_the_same_with_one_thread_and_with_two(tmp_path, capsys):
    """As a user would set it: NUMBA_NUM_THREADS of a process of its own."""
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(two_bodies()))
    options = ["--propagator", "monte_carlo", "--samples", "9", "--seed", "3", "--json", "--horizon", "0.8"]
    arguments = ["predict", str(path), *options]
    alone = subprocess.run(
        [sys.executable, "-m", "unc_physics", *arguments],
        env=os.environ | {"NUMBA_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert all(line.startswith("Compiling") for line in alone.stderr.splitlines())
    assert main(arguments) == 0
    printed = [yaml.safe_load(out) for out in (alone.stdout, capsys.readouterr().out)]
    for answer in printed:
        del answer["wall_time"]
    assert printed[0] == printed[1]


@needs_two_threads
def test_what_a_part_raises_ends_the_work_when_nobody_is_at_it_any_more():
    begun, ended = [], []

    def run(some):
        begun.append(some)
        time.sleep(0.01)
        ended.append(some)
        if len(ended) == 2:
            raise ValueError("the second part")

    with pytest.raises(ValueError, match="second"):
        in_threads(64, run)
    assert len(ended) == len(begun) < 64


def test_predictions_at_once_in_several_threads(loaded):
    """Callers of a node's service may come together."""
    scene, belief, _ = loaded("two_bodies")
    propagator = make_propagator("monte_carlo", samples=16)
    alone = predict(scene, belief, propagator, 0.8).carry.states
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        for prediction in pool.map(lambda _: predict(scene, belief, propagator, 0.8), range(8)):
            np.testing.assert_array_equal(prediction.carry.states, alone)
