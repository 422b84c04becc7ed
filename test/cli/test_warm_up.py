"""The command ``warm-up``: afterwards a first prediction finds all that it needs."""

import subprocess
import sys

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


#: Prints the kernels that requests need after a warm-up which did not compile or load them.
_UNPREPARED = """
import sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from unc_physics import AtRest, assess, load_scene, predict
from unc_physics.prediction.warm_up import warm_up

def kernels():
    modules = [vars(module) for name, module in sys.modules.items() if name.startswith("unc_physics")]
    found = [value for module in list(modules) for value in list(module.values())]
    found = [one for one in found if isinstance(one, Dispatcher)]
    return {(one.py_func.__qualname__, str(own)) for one in found for own in one.signatures}

warm_up(("auto",))
ready = kernels()
for path in sorted(Path("examples/scenes").glob("*.yaml")):
    loaded = load_scene(path)
    if loaded.scene.integrator == "implicit":
        event = AtRest(loaded.scene.bodies[0].name)
        prediction = predict(loaded.scene, loaded.belief, "auto", min(loaded.horizon, 0.2), events=[event])
        assess(prediction)
        prediction.samples(2)
        prediction.at().at_model_origins(prediction.scene, joint=True)
        print(path.stem)
print("unprepared:", sorted(kernels() - ready))
"""


def test_requests_of_the_documentation_are_prepared():
    found = subprocess.run([sys.executable, "-c", _UNPREPARED], capture_output=True, text=True, check=True)
    *scenes, last = found.stdout.splitlines()
    assert len(scenes) > 5 and last == "unprepared: []"


def test_a_name_that_is_none(capsys):
    assert main(["warm-up", "crystal_ball"]) == ErrorCode.UNKNOWN_PROPAGATOR
    assert "crystal_ball" in capsys.readouterr().err


@pytest.mark.parametrize("physics", ["none", ""])
def test_physics_that_is_none(physics, capsys):
    with pytest.raises(SystemExit):
        main(["warm-up", "--physics", physics])
    assert "--physics" in capsys.readouterr().err
