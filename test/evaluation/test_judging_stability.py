"""The catalogue of hard cases, and how predictions of them are judged."""

import json

import jsonschema
import numpy as np
import pytest
import yaml

from unc_physics import PROPAGATORS, RigidBody, Scene
from unc_physics.__main__ import main
from unc_physics.cli.schema_command import schema_text
from unc_physics.scene.environment import Box, Capsule, Cylinder, Plane, Sphere
from unc_physics.scene.physics_keys import INTEGRATORS
from unc_physics.spatial.rotation import rotation_matrices
from unc_physics_evaluation.conservation import (
    CHANGE,
    DRIFT,
    FINITE,
    GAIN,
    MOMENTUM,
    PASSED,
    rollout_rows,
    trajectory,
)
from unc_physics_evaluation.experiments import stability
from unc_physics_evaluation.hard_cases import FOLDER, load, names
from unc_physics_evaluation.hard_cases.shapes import ball
from unc_physics_evaluation.passing import passed_through
from unc_physics_evaluation.results import Results
from unc_physics_evaluation.stability_document import AT_REST, DRIFT_LIMIT, Found

BALL = ball().scaled(0.1)
SCHEMA = jsonschema.Draft202012Validator(json.loads(schema_text("scene")))


def states(*positions):
    mean = np.zeros((len(positions), 13))
    mean[:, :3], mean[:, 9] = positions, 1.0
    return mean


@pytest.mark.parametrize("name", names())
def test_case_is_a_scene_of_moderate_size_that_says_what_is_hard(name):
    case = load(name)
    SCHEMA.validate(yaml.safe_load((FOLDER / f"{name}.yaml").read_text()))
    assert case.scene.integrator in INTEGRATORS and case.horizon > 0.0
    assert all(len(body.model) <= 100 for body in case.scene.bodies)
    assert 40 < len(case.about) < 300 and ":" in case.about
    if name.startswith(("rest_", "stack", "pile")):
        assert case.scene.friction > 0.0 and case.scene.gravity[2] < 0.0
    if case.scene.integrator == "implicit" and case.scene.friction is None:
        assert case.scene.restitution == 1.0, "what loses energy without friction loses it by plan"


#: Limits of the everyday step (`docs/explanation/limits.md`): twice the gain of energy that was measured,
#: where it is above 0.1 %; and where something passes through.
GAINS = {
    "coarse_step_collision": 0.023,  # at 20 steps a second
    "long_in_a_box": 0.11,  # in 60 s at 100 steps a second
    "mass_ratio_stack": 0.0024,
    "millimetres_collision": 0.0075,
    "sixty_four_pairs": 0.027,  # at 100 steps a second
}
PASSES = ("mass_ratio_squeezed", "pile_of_ten")


@pytest.mark.parametrize("name", [name for name in names() if load(name).scene.integrator == "implicit"])
def test_the_implicit_step_keeps_what_it_should(name):
    _, belief, horizon, _ = load(name)
    scene = stability.case(name).scene
    states = trajectory(scene, belief.mean, round(horizon / scene.dt))
    found = {row.quantity: row.value for row in rollout_rows("mean", scene, states)}
    assert found[FINITE] == 1.0
    assert found[PASSED] == 0.0 or name in PASSES
    assert found[GAIN] < GAINS.get(name, 1e-3)
    left = "what the solver's tolerance leaves in an impact of a row"
    assert found.get(CHANGE, 0.0) > -2e-3 or name in PASSES, left
    assert found.get(MOMENTUM, 0.0) < 1e-12
    if name in AT_REST:
        assert found[DRIFT] < DRIFT_LIMIT * min(
            2.0 * body.model.bounding_radius for body in scene.bodies if not body.fixed
        )


def test_edges_stay_out_of_the_bin_in_steps_with_many_impacts():
    """Ten bodies land and collide within steps of 10 ms, in which edges move by up to 5 cm."""
    scene, belief, horizon = stability.case("pile_of_ten")
    steps, deepest = round(horizon / scene.dt), []
    for mean in belief.sample(60, np.random.default_rng(0)):
        states = trajectory(scene, mean, steps)
        deepest.append(0.0)
        for k, body in enumerate(scene.bodies):
            turned = np.einsum("tij,nj->tni", rotation_matrices(states[:, k, 6:10]), body.model.centers)
            for element in scene.environment:
                centers = states[:, None, k, :3] + turned
                depths = (body.model.radii - element.surface(centers)[0]).max(axis=1).clip(0.0)
                added = (depths - np.minimum.accumulate(depths)).max()  # less the start's
                deepest[-1] = max(deepest[-1], added)
    # of the deepest states of each rollout, as the deepest of all is that of one rollout in sixty
    assert np.median(deepest) < 2.5e-3, "a twentieth of the way of edges within a step"
    assert np.quantile(deepest, 0.9) < 5e-3, "a tenth of it"


def test_passing_through_is_told_from_bouncing():
    def path(*x):
        return np.array([states((0.0, 0.0, 0.0), (at, 0.01, 0.0)) for at in x])

    pair = Scene([RigidBody("a", BALL, 1.0), RigidBody("b", BALL, 1.0)])
    assert passed_through(pair, path(0.5, 0.21, -0.3)), "at once, from one step to the next"
    assert passed_through(pair, path(0.5, 0.19, 0.05))
    assert not passed_through(pair, path(0.5, 0.18, 0.5)) and not passed_through(pair, path(0.05, 0.3))
    for element in (
        Plane((1.0, 0.0, 0.0), 0.0),
        Box((0.01, 1.0, 1.0)),
        Sphere(0.02),
        Cylinder(0.012, 0.5),
        Capsule(0.012, 0.5, (0.0, 0.0, 0.1)),
    ):
        scene = Scene([RigidBody("b", BALL, 1.0)], gravity=(0.0, 0.0, 0.0), environment=(element,))
        assert passed_through(scene, path(0.5, -0.4)[:, 1:])
        assert not passed_through(scene, path(0.5, 0.09, 0.5)[:, 1:])
        if element.finite:
            assert not passed_through(scene, path(0.5, -0.4)[:, 1:] + np.eye(13)[1]), "beside it"


def test_command_judges_a_case(tmp_path, monkeypatch):
    monkeypatch.setattr(stability, "QUICK", ("fast_ball_too_soft", "overlap_coincident", "slow_approach"))
    monkeypatch.setattr(stability, "TRUTH", 100)
    assert main(["evaluate", "stability", "--quick", "--executor", "processes:1", "-o", str(tmp_path)]) == 0
    report = (tmp_path / "report.md").read_text()
    lines = {line.split(" | ")[0].strip("| "): line for line in report.splitlines() if line.startswith("| ")}
    assert "| 3 of 3 |" in lines["passes through nothing, or flagged"]
    assert "| 3 of 3 |" in lines["finite"]
    assert "| 1 of 1 |" in lines["implicit: loss below 0.02"]
    assert "| 2 of 2 |" in lines["explicit: gain below 0.01, or flagged"]
    rows = Results(tmp_path).rows("stability")
    slow = rows.where(case="slow_approach", quantity="finite")
    assert set(slow.unique("method")) == {"mean", *PROPAGATORS}, "all propagators"
    found = Found(rows)
    rows = rows.where(case="overlap_coincident")
    # a single trajectory stays where no direction is, and every sample flies off in its own
    spread = {
        method: rows.where(method=method, quantity="position_std").mean()
        for method in ("truth", "linearization", "monte_carlo")
    }
    assert spread["linearization"] < 0.5 * spread["truth"]
    assert spread["monte_carlo"] == pytest.approx(spread["truth"], rel=0.4), "statistics of 100 samples"
    # the spread of 100 samples is within a few per cent, their mean's error about a tenth of it
    wrong, right = (found.answers("overlap_coincident", name) for name in ("linearization", "monte_carlo"))
    assert all(one.wrong and one.flagged for one in wrong)
    assert not any(one.wrong for one in right)
