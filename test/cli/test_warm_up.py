"""The command ``warm-up``: afterwards a first prediction finds all that it needs."""

import numpy as np
import pytest

from unc_physics import Belief, Plane, RigidBody, Scene, load_model, predict
from unc_physics.__main__ import main
from unc_physics.checks.errors import ErrorCode
from unc_physics.compiler.refusal import refused_compilation


def test_after_it_nothing_is_compiled(capsys):
    """Two processes load or compile, and this one loads."""
    assert main(["warm-up", "sigma_points", "monte_carlo"]) == 0
    ready = {line.partition(": ready after ")[0] for line in capsys.readouterr().out.splitlines()}
    assert ready == {"sigma_points", "monte_carlo"}
    can = load_model("can").prefix(50)
    scene = Scene.everyday([RigidBody("can", can)], exact=True, environment=(Plane(),))
    belief = Belief([[0.0, 0.0, 0.06, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0]], 1e-4 * np.eye(12)[None])
    with refused_compilation():
        predict(scene, belief, "sigma_points", 0.02)


def test_a_name_that_is_none(capsys):
    assert main(["warm-up", "crystal_ball"]) == ErrorCode.UNKNOWN_PROPAGATOR
    assert "crystal_ball" in capsys.readouterr().err


@pytest.mark.parametrize("physics", ["none", ""])
def test_physics_that_is_none(physics, capsys):
    with pytest.raises(SystemExit):
        main(["warm-up", "--physics", physics])
    assert "--physics" in capsys.readouterr().err
