"""The scenes that users start from."""

from pathlib import Path

import numpy as np
import pytest

from unc_physics import load_scene, predict
from unc_physics.scene.environment import Plane

ROOT = Path(__file__).resolve().parents[2]
SCENES = sorted((ROOT / "examples" / "scenes").glob("*.yaml"))
HORIZON = 0.05  # s


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_an_example_scene_is_predicted(path):
    scene, belief, horizon = load_scene(path)
    assert horizon >= HORIZON
    prediction = predict(scene, belief, "sigma_points", HORIZON)
    start, end = belief.mean, prediction.belief.mean
    assert np.isfinite(end).all()
    assert not np.array_equal(start, end)
    assert np.abs(end[:, :3] - start[:, :3]).max() < 1.0  # m: nothing is thrown out
    for element in scene.environment:
        if isinstance(element, Plane):
            assert (end[:, :3] @ element.normal > element.offset).all()


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_an_example_scene_is_a_robot_s_world_or_the_paper_s(path):
    scene = load_scene(path).scene
    assert scene.integrator == ("explicit" if path.stem == "two_bunnies" else "implicit")
    assert "stiffness:" not in path.read_text() or scene.integrator == "explicit"


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_an_example_scene_tells_its_command(path):
    assert f"python -m unc_physics predict examples/scenes/{path.name}" in path.read_text()
