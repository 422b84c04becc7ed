"""The command ``warm-up``: afterwards a first prediction finds all that it needs."""

import numpy as np
import pytest

from unc_physics import Belief, Plane, RigidBody, Scene, load_model, predict
from unc_physics.__main__ import main
from unc_physics.checks.errors import ErrorCode
from unc_physics.compiler.compile_time import seconds_compiling


def test_after_it_nothing_is_compiled(capsys):
    assert main(["warm-up", "sigma_points"]) == 0
    assert capsys.readouterr().out.startswith("sigma_points: ready after ")
    can = load_model("can").prefix(50)
    scene = Scene.everyday([RigidBody("can", can)], exact=True, environment=(Plane(),))
    belief = Belief([[0.0, 0.0, 0.06, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0]], 1e-4 * np.eye(12)[None])
    before = seconds_compiling()
    predict(scene, belief, "sigma_points", 0.02)
    assert seconds_compiling() == before


def test_a_name_that_is_none(capsys):
    assert main(["warm-up", "crystal_ball"]) == ErrorCode.UNKNOWN_PROPAGATOR
    assert "crystal_ball" in capsys.readouterr().err


@pytest.mark.parametrize("physics", ["none", ""])
def test_physics_that_is_none(physics, capsys):
    with pytest.raises(SystemExit):
        main(["warm-up", "--physics", physics])
    assert "--physics" in capsys.readouterr().err
