"""States drawn from a prediction: Monte Carlo's own, or from the Gaussian."""

import dataclasses
import json

import numpy as np
import yaml
from example_scenes import CONTENTS

from unc_physics import ErrorCode, make_propagator, predict
from unc_physics.__main__ import main

HORIZON = 0.3  # s


def predicted(loaded, name="three_bodies", propagator="sigma_points", **options):
    scene, belief, _ = loaded(name)
    return predict(scene, belief, make_propagator(propagator, **options), HORIZON)


def test_monte_carlo_gives_its_own(loaded):
    prediction = predicted(loaded, propagator="monte_carlo", samples=20, seed=4)
    states = prediction.samples(20)
    assert states.shape == (20, 3, 13)
    np.testing.assert_array_equal(states, prediction.carry.states)
    np.testing.assert_array_equal(prediction.samples(), states)
    np.testing.assert_array_equal(prediction.samples(7), states[:7])
    states[:] = 0.0
    assert prediction.carry.states.any()  # what is given is the caller's


def test_monte_carlo_s_are_of_the_model_s_centre_of_mass(loaded):
    scene, belief, _ = loaded("two_bodies")
    bodies = [dataclasses.replace(body, center_of_mass_std=0.05) for body in scene.bodies]
    scene = dataclasses.replace(scene, bodies=bodies)
    prediction = predict(scene, belief, make_propagator("monte_carlo", samples=50), HORIZON)
    assert not np.allclose(prediction.samples(), prediction.carry.states, atol=1e-3)
    np.testing.assert_allclose(
        prediction.samples().mean(axis=0)[:, :3], prediction.belief.mean[:, :3], atol=1e-12
    )


def test_others_are_drawn_from_the_gaussian_with_the_seed(loaded):
    prediction = predicted(loaded, propagator="local_sampling", seed=5)
    drawn = prediction.belief.sample(10, np.random.default_rng(5))
    np.testing.assert_array_equal(prediction.samples(10), drawn)


def test_the_command_adds_samples(tmp_path, capsys, loaded):
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(CONTENTS["three_bodies"]()))
    command = ["predict", str(path), "--horizon", str(HORIZON), "--propagator", "sigma_points"]
    assert main([*command, "--json", "--samples-out", "3"]) == 0
    expected = predicted(loaded).samples(3)
    for k, body in enumerate(json.loads(capsys.readouterr().out)["bodies"]):
        np.testing.assert_array_equal(body["samples"], expected[:, k])
    assert main([*command, "--samples-out", "3"]) == ErrorCode.INVALID_OPTION
    assert "--samples-out needs --json" in capsys.readouterr().err
