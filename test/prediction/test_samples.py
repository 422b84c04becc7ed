"""States drawn from a prediction: Monte Carlo's own, or from the Gaussian."""

import dataclasses
import json
import re

import numpy as np
import pytest
import yaml
from example_scenes import CONTENTS

from unc_physics import ErrorCode, make_propagator, predict
from unc_physics.__main__ import main
from unc_physics.checks.errors import InvalidRequestError, LimitExceededError

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


@pytest.mark.parametrize(
    "propagator, options", [("sigma_points", {}), ("linearization", {}), ("local_sampling", {"seed": 5})]
)
def test_others_are_drawn_from_the_gaussian(loaded, propagator, options):
    prediction = predicted(loaded, propagator=propagator, **options)
    assert prediction.at().samples is None
    states = prediction.samples(4000)
    assert states.shape == (4000, 3, 13)
    np.testing.assert_array_equal(states[:10], prediction.samples(10))
    np.testing.assert_array_equal(
        states, prediction.belief.sample(4000, np.random.default_rng(options.get("seed", 0)))
    )
    np.testing.assert_array_equal(
        states[:, 1], np.broadcast_to(prediction.belief.mean[1], (4000, 13))
    )  # the fixed one
    for body in (0, 2):
        P = prediction.belief.marginal(body)
        spread = np.cov(states[:, body, :3].T)
        assert np.allclose(spread, P[:3, :3], atol=5.0 * np.sqrt(2.0 / 4000) * P[:3, :3].diagonal().max())


def test_too_many_or_too_few_name_the_count(loaded):
    own, gaussian = predicted(loaded, propagator="monte_carlo", samples=5), predicted(loaded)
    with pytest.raises(LimitExceededError, match="count must be at most the 5 samples .*6"):
        own.samples(6)
    for prediction in (own, gaussian):
        for count in (0, -1, 2.5, True, "all"):
            with pytest.raises(InvalidRequestError, match="count"):
                prediction.samples(count)
    with pytest.raises(InvalidRequestError, match="count must be given: sigma_points"):
        gaussian.samples()


# -- the command -------------------------------------------------------------------------------------


POINTS = "--propagator", "sigma_points"


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(CONTENTS["three_bodies"]()))
    return str(path)


def test_the_command_adds_samples_to_each_body(file, capsys, loaded):
    assert main(["predict", file, "--horizon", str(HORIZON), "--json", "--samples-out", "3", *POINTS]) == 0
    answer = json.loads(capsys.readouterr().out)
    expected = predicted(loaded).samples(3)
    for k, body in enumerate(answer["bodies"]):
        np.testing.assert_array_equal(body["samples"], expected[:, k])
    assert answer["physics"]["integrator"] == "explicit" and answer["physics"]["gravity"] == [0.3, 0.0, -5.0]


@pytest.mark.parametrize(
    "arguments, code, words",
    [
        (["--samples-out", "3"], "INVALID_OPTION", "--samples-out needs --json"),
        (["--json", "--samples-out", "0"], "INVALID_REQUEST", "--samples-out must be at least 1"),
        (
            ["--json", "--samples-out", "9", "--propagator", "monte_carlo", "--samples", "4"],
            "LIMIT_EXCEEDED",
            "--samples-out .* 4 samples",
        ),
    ],
)
def test_bad_counts_are_one_sentence(file, capsys, arguments, code, words):
    assert main(["predict", file, "--horizon", str(HORIZON), *arguments]) == ErrorCode[code]
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and re.search(words, err), err
