"""A simulator of one's own under Monte Carlo, from the documentation's page."""

import runpy

import numpy as np
import pytest
from example_extensions import code, run


def test_it_answers_as_any_other(tmp_path):
    for name in ("bouncing_balls.py", "use_bouncing_balls.py"):
        (tmp_path / name).write_text(code()[name])
    status, output, errors = run("use_bouncing_balls.py", folders=[tmp_path], cwd=tmp_path)
    assert status == 0, errors
    belief, probability = output.splitlines()
    # after 0.45 s without bounce: x from the velocity, and about half of those that begin 1 m high have
    # bounced
    assert float(belief.strip("[ ").split()[0]) == pytest.approx(0.225, abs=0.02)
    assert belief.endswith("(500, 1, 13)")
    assert 0.4 < float(probability) < 0.6


def test_a_bounce_keeps_its_share_of_the_speed(tmp_path):
    path = tmp_path / "bouncing_balls.py"
    path.write_text(code()[path.name])
    bounce = runpy.run_path(str(path))["bounce"]
    g, height, speed = 10.0, np.array([0.05]), np.array([0.0])  # which lands after 0.1 s, at 1 m/s
    falling = bounce(height, speed, g, 0.05, 0.5)
    assert [float(part[0]) for part in falling] == pytest.approx([0.05 - 0.5 * g * 0.05**2, -g * 0.05, 0.0])
    rising = bounce(height, speed, g, 0.15, 0.5)
    assert [float(part[0]) for part in rising] == pytest.approx(
        [0.5 * 0.05 - 0.5 * g * 0.05**2, 0.5 - g * 0.05, 1.0]
    )
