"""What the command line prints equals a plain NumPy simulation of the same scene."""

import json

import numpy as np
import pytest
import yaml
from twins.states import moments, sigma_points
from twins.step import bodies_of, physics_of, rollout

from unc_physics import load_scene, make_propagator
from unc_physics.__main__ import main

ROUND_OFF = 1e-9
ROUND_OFF_GROWN_BY_COLLISIONS = 1e-6  # 120 steps of a chaotic system: errors grow, though far less than this


def predicted(capsys, path, *arguments):
    """The JSON object that ``predict`` prints."""
    assert main(["predict", str(path), "--json", *arguments]) == 0
    return json.loads(capsys.readouterr().out)


def initial_states(scene, belief, name, options):
    """The twin's own sigma points; for Monte Carlo, the draws that the implementation made."""
    if name == "sigma_points":
        return sigma_points(belief.mean, belief.joint, scene.moving, options["points"])
    return make_propagator(name, **options).init(scene, belief).states


@pytest.mark.parametrize("steps, tolerance", [(1, ROUND_OFF), (120, ROUND_OFF_GROWN_BY_COLLISIONS)])
@pytest.mark.parametrize(
    "name, arguments, options",
    [
        ("sigma_points", [], {"points": "minimal"}),
        ("sigma_points", ["--option", "points=full"], {"points": "full"}),
        ("monte_carlo", ["--samples", "20", "--seed", "7"], {"samples": 20, "seed": 7}),
    ],
    ids=["minimal", "full", "monte_carlo"],
)
def test_json_equals_the_twin(tmp_path, capsys, content, name, arguments, options, steps, tolerance):
    content["horizon"] = steps * content["dt"]
    if steps == 1:  # begin where the bodies overlap, so that the one step has contacts
        content["bodies"][0]["position"] = [-0.3, 0.1, 0.0]
        content["bodies"][-1]["position"] = [0.3, 0.0, 0.1]
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(content))

    result = predicted(capsys, path, "--propagator", name, *arguments)

    scene, belief, _ = load_scene(path)
    states = initial_states(scene, belief, name, options)
    bodies, physics = bodies_of(scene), physics_of(scene)
    ended = rollout(states, bodies, physics, steps)
    mean, P = moments(ended, scene.moving)
    free = rollout(states, bodies, physics._replace(stiffness=0.0), steps)
    assert np.abs(ended - free).max() > 1e-3, "the scene must have contacts for this test to mean anything"

    assert result["propagator"] == name
    assert result["time"] == pytest.approx(steps * scene.dt)
    assert [body["name"] for body in result["bodies"]] == [body.name for body in scene.bodies]
    moving = list(scene.moving)
    for b, body in enumerate(result["bodies"]):
        sign = np.sign(np.dot(body["orientation"], mean[b, 6:10]))
        state = np.concatenate(
            [
                body["position"],
                body["linear_velocity"],
                sign * np.array(body["orientation"]),
                body["angular_velocity"],
            ]
        )
        np.testing.assert_allclose(state, mean[b], rtol=0, atol=tolerance)
        if b in moving:
            k = 12 * moving.index(b)
            np.testing.assert_allclose(body["covariance"], P[k : k + 12, k : k + 12], rtol=0, atol=tolerance)
        else:
            assert body["covariance"] is None
            np.testing.assert_array_equal(state, belief.mean[b])


def test_joint_covariance_equals_the_twin(loaded):
    """Correlations between bodies are not in the JSON, but in the belief."""
    scene, belief, _ = loaded("three_bodies")
    propagator = make_propagator("sigma_points")
    carry = propagator.advance(propagator.init(scene, belief), scene, 60)
    states = sigma_points(belief.mean, belief.joint, scene.moving, "minimal")
    _, P = moments(rollout(states, bodies_of(scene), physics_of(scene), 60), scene.moving)
    assert np.abs(P[:12, 12:]).max() > 1e-6, "no correlation arose"
    np.testing.assert_allclose(
        propagator.belief(carry, scene).joint, P, rtol=0, atol=ROUND_OFF_GROWN_BY_COLLISIONS
    )
