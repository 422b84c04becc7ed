"""A simulator of one's own under Monte Carlo, from the documentation's page."""

import subprocess
import sys

import numpy as np
import pytest
from example_extensions import code, environment


def test_it_answers_as_any_other(tmp_path):
    for name in ("bouncing_balls.py", "use_bouncing_balls.py"):
        (tmp_path / name).write_text(code()[name])
    done = subprocess.run(
        [sys.executable, "use_bouncing_balls.py"], cwd=tmp_path, env=environment(tmp_path), capture_output=True, text=True,
        check=False)
    assert done.returncode == 0, done.stderr
    belief, probability = done.stdout.splitlines()
    # after 0.45 s without bounce: x from the velocity, and about half of those that begin 1 m high have bounced
    assert float(belief.strip("[ ").split()[0]) == pytest.approx(0.225, abs=0.02)
    assert belief.endswith("(500, 1, 13)")
    assert 0.4 < float(probability) < 0.6


def test_a_bounce_keeps_its_share_of_the_speed():
    names = {"__name__": "bouncing_balls"}
    exec(code()["bouncing_balls.py"], names)
    g = 10.0
    height, speed, bounced = names["bounce"](np.array([0.05, 0.05]), np.array([0.0, 0.0]), g, np.array([0.1, 0.05]), 0.5)
    assert bounced.tolist() == [False, False] or bounced.tolist() == [True, False]
    assert height[1] == pytest.approx(0.05 - 0.5 * g * 0.05**2) and speed[1] == pytest.approx(-g * 0.05)
    landed = names["bounce"](np.array([0.05]), np.array([0.0]), g, 0.15, 0.5)
    assert landed[2].all() and landed[1] == pytest.approx(0.5 * 1.0 - g * 0.05)
    assert landed[0] == pytest.approx(0.5 * 0.05 - 0.5 * g * 0.05**2)
