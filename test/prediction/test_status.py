"""What a prediction says against itself: flags where something is wrong, none where all is well."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from example_scenes import two_bodies
from plain_scenes import BALL, independent, lowest, state
from twins.states import boxminus

from unc_physics import (
    Belief,
    BodyBelief,
    RigidBody,
    Scene,
    load_model,
    load_scene,
    make_propagator,
    predict,
    primitive_model,
)
from unc_physics.__main__ import main
from unc_physics.prediction.body_status import Status
from unc_physics.prediction.diagnostics import RULES
from unc_physics.prediction.evidence import Evidence, initial_diagnostics
from unc_physics.prediction.status import assess, assess_all
from unc_physics.propagators.balanced_monte_carlo import BalancedMonteCarlo
from unc_physics.scene.environment import Box, Plane
from unc_physics.scene.scene_file import scene_from_dict
from unc_physics.shapes.packing_file import HULL

NAMES = ("linearization", "surrogate", "sigma_points", "local_sampling", "monte_carlo")
NOMINAL = ("linearization", "surrogate", "local_sampling")


def balls(*positions, velocity=(0, 0, 0), std=0.001):
    first, *others = positions
    return independent(state(first, velocity), *map(state, others), position=std)


def brick_on_a_floor(height, velocity, position_std, rotation_std, velocity_std, **physics):
    """A brick with its lowest point at a height above the floor."""
    brick = load_model("brick").prefix(500)
    scene = Scene.everyday([RigidBody("brick", brick, 0.4)], exact=True, environment=[Plane()], **physics)
    start = state((0, 0, height - lowest(brick)), velocity)
    stds = {"position": position_std, "velocity": velocity_std, "rotation": rotation_std}
    return scene, independent(start, **stds)


def statuses(scene, belief, name, horizon):
    propagator = make_propagator(name, **({"samples": 50} if name == "monte_carlo" else {}))
    return assess(predict(scene, belief, propagator, horizon))


def test_flags_are_printed_by_name():
    assert str(Status.NOT_CONVERGED | Status.MEAN_NOT_POSSIBLE) == "NOT_CONVERGED MEAN_NOT_POSSIBLE"
    assert f"{Status.FINE}" == "FINE"


def test_one_sample_of_a_scene_with_one_outcome_is_enough():
    """Nothing is uncertain, so that the sample is the answer; with a law that draws it is none."""
    exact = Scene.everyday([RigidBody("a", BALL, 1.0)], exact=True, environment=[Plane()])
    belief = independent(state((0, 0, 0.2), velocity=(0.3, 0, 0)))
    propagator = make_propagator("monte_carlo", samples=1)
    for scene, sure in (
        (exact, True),
        (replace(exact, friction_std=0.1), False),
        (replace(exact, impact_direction_std=0.03), False),
    ):
        (status,) = assess(predict(scene, belief, propagator, 0.4))
        assert (status.flags == Status.FINE) == sure
        assert status.measures.get("spread_error") == (None if sure else 1.0)


def test_a_mean_inside_a_wall_is_flagged_unless_half_of_the_states_are_as_deep():
    """A ball that falls to either side of a wall's top is in the wall on average."""
    wall = Box((0.02, 1.0, 1.0), (0.0, 0.0, -0.5), name="wall")
    scene = Scene.everyday([RigidBody("a", BALL, 1.0)], exact=True, environment=[wall], restitution=0.0)
    belief = independent(state((0, 0, 0.055)), position=(0.02, 0, 0))
    prediction = predict(scene, belief, "sigma_points", 0.5)
    (status,) = assess(prediction)
    assert status.measures["mean_penetration"] > 5.0 and status.flags & Status.MEAN_NOT_POSSIBLE
    evidence = Evidence.of(prediction, initial_diagnostics(prediction), prediction.at())
    inside = np.tile(prediction.belief.mean, (64, 1, 1))
    beside = inside + np.eye(13)[0]
    for states in (np.concatenate([inside, beside]), np.concatenate([beside, inside])):
        assert RULES["mean_penetration"].compute(replace(evidence, states=states))[0] == 0.0


@pytest.mark.parametrize("name", ["linearization", "sigma_points"])
def test_a_face_that_lands_by_one_of_its_edges_is_compared_with_rollouts(name):
    """By which, decides how it tips; points far out all tip alike, and the nominal one does not at all."""
    scene, belief = brick_on_a_floor(0.1, (0, 0, 0), 1e-3, 1e-2, 1e-2, restitution=0.5)
    (status,) = statuses(scene, belief, name, 0.25)
    assert Status.OUTSIDE_VALIDITY in status.flags and "differs from that of rollouts: " in status.message
    words = (
        r"rollouts: (position [\d.e-]+ m|rotation [\d.e-]+ rad) predicted, [\d.e-]+ (m|rad) in rollouts"
        r"( \(less [^)]*\))?; "
    )
    assert re.search(words + r".*\(spread_disagreement [\d.]+ above 1.5\)", status.message)
    scene, belief = brick_on_a_floor(0.0, (0.3, 0, 0), 1e-3, 1e-2, 1e-2)
    (status,) = statuses(scene, belief, name, 0.5)
    assert status.flags == Status.FINE


def test_points_that_turn_by_half_a_turn_are_compared_with_rollouts():
    """Opposite ones still turn oppositely; what they turn by beyond half a turn nobody sees."""
    scene = Scene(
        [RigidBody("ball", BALL, 0.5)],
        dt=0.01,
        gravity=(0, 0, -9.81),
        friction=0.5,
        gyroscopic=False,
        integrator="implicit",
        environment=[Plane()],
    )
    rolling = state((0, 0, 0.05), (1, 0, 0), (0, 20, 0))
    belief = independent(rolling, position=(0.01, 0.01, 0), velocity=(0.05, 0.05, 0))
    for horizon, wrong in ((0.5, False), (3.0, True)):
        (status,) = statuses(scene, belief, "sigma_points", horizon)
        assert ("spread_disagreement" in status.measures) == wrong
        assert status.flags == (Status.OUTSIDE_VALIDITY if wrong else Status.FINE)


@pytest.mark.parametrize("directions", [1, 6, 11])
def test_few_rollouts_have_the_spread_of_the_belief(directions):
    mean = np.zeros((1, 13))
    mean[0, 9] = 1.0
    root = np.random.default_rng(1).normal(0.0, 0.01, (12, directions))
    belief = Belief(mean, (root @ root.T)[None])
    start = BalancedMonteCarlo(samples=12).drawn(Scene([RigidBody("a", BALL, 1.0)]), belief, 12)
    errors = np.array([boxminus(x, mean) for x in start])[:, 0]
    np.testing.assert_allclose(errors.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(errors.T @ errors / 12.0, root @ root.T, atol=1e-12)


def test_overlap_of_a_share_of_the_belief_is_named():
    scene = Scene([RigidBody("a", BALL, 1.0), RigidBody("b", BALL, 1.0)], dt=1e-3, stiffness=1e4)
    apart = balls((0, 0, 0), (0.1005, 0, 0))
    assert all(
        status.flags & Status.INITIAL_OVERLAP for status in statuses(scene, apart, "sigma_points", 0.01)
    )
    certain = Belief(apart.mean, 0.0 * apart.covariance)
    assert not any(
        status.flags & Status.INITIAL_OVERLAP for status in statuses(scene, certain, "sigma_points", 0.01)
    )


@pytest.mark.parametrize("name", NAMES)
def test_a_contact_that_the_nominal_rollout_misses_is_not_missed(name):
    scene = Scene([RigidBody("a", BALL, 1.0), RigidBody("b", BALL, 1.0)], dt=1e-3, stiffness=1e6)
    found = statuses(scene, balls((0, 0, 0), (0.3, 0.11, 0), velocity=(1, 0, 0), std=0.02), name, 1.0)
    assert [bool(status.flags & Status.OUTSIDE_VALIDITY) for status in found] == [name in NOMINAL] * 2
    assert ("spread_disagreement" in found[0].measures) == (name != "monte_carlo")


@pytest.mark.parametrize("name", NOMINAL)
def test_without_rollouts_a_spread_after_contact_is_unchecked(name):
    scene, belief, _ = scene_from_dict(two_bodies())
    prediction = predict(scene, belief, name, 2.0, times=[0.1, 1.0])
    for status in assess(prediction, rollouts=0):
        assert "spread_disagreement" not in status.measures and status.measures["unchecked"] == 1.0
        assert status.flags == Status.OUTSIDE_VALIDITY
    before = predict(scene, belief, name, 0.1)
    assert all(status.flags == Status.FINE for status in assess(before, rollouts=0))
    along = assess_all(prediction)
    assert [status.flags for status in along[0]] == [Status.FINE, Status.FINE]  # before the bodies meet
    assert "energy_error" not in along[0][0].measures and "energy_error" in along[2][0].measures
    assert along[2] == assess(prediction)


def test_samples_made_of_rollouts_gain_no_energy_that_these_do_not():
    small = replace(BALL, radii=0.1 * BALL.radii, inertia=0.01 * BALL.inertia, bounding_radius=0.005)
    bodies = [RigidBody("small", small, 0.004), RigidBody("large", BALL, 1.0)]
    scene = Scene(bodies, dt=0.01, restitution=1.0, integrator="implicit")
    belief = balls((-1, 0.01, 0), (0, 0, 0), velocity=(20, 0, 0))
    P = np.zeros((2, 12, 12))
    P[0, range(6), range(6)] = np.repeat([0.01, 0.2], 3) ** 2
    belief = Belief(belief.mean, P)
    prediction = predict(scene, belief, make_propagator("cloud", runs=16, seed=1), 0.2, times=[0.1])
    for found in assess_all(prediction):
        assert all(status.measures.get("energy_error", 0.0) <= 0.0 for status in found)
    masses = np.array([body.mass for body in scene.bodies])
    emitted, simulated = (
        masses @ (states[..., 3:6] ** 2).sum(axis=2).mean(axis=0)
        for states in (prediction.samples(), prediction.carry.states)
    )
    assert emitted > 1.1 * simulated, "what the samples have by themselves"


def test_the_command_prints_flags_notes_and_reasons(tmp_path, capsys):
    """Two cans in one place, beside a toy whose mesh was in millimetres."""
    toy = {"name": "toy", "model": "bunny", "spheres": 100, "scale": 100.0, "mass": 0.4}
    toy["position"] = [200, 0, 0]
    cans = [{"name": name, "model": "can", "spheres": 60} for name in ("a", "b")]
    path = tmp_path / "scene.yaml"
    command = ["predict", str(path), "--propagator", "sigma_points", "--status-rollouts", "0"]
    for laws, noted in (
        ({"physics": "everyday", "exact": True}, True),
        ({"physics": "paper", "dt": 0.01}, False),
    ):
        path.write_text(yaml.safe_dump({"horizon": 0.02, "bodies": [toy, *cans]} | laws))
        assert main([*command, "--json"]) == 0
        shown = capsys.readouterr()
        scene, belief, horizon = load_scene(path)
        found = assess(predict(scene, belief, "sigma_points", horizon), rollouts=0)
        for told, status in zip(json.loads(shown.out)["statuses"], found, strict=True):
            assert (told["body"], told["notes"]) == (status.body, list(status.notes))
            assert ("INITIAL_OVERLAP" in told["flags"]) == (status.body != "toy")
            assert told["measures"] == pytest.approx(status.measures)
        assert main(command) == 0
        printed = capsys.readouterr()
        lines = printed.out.splitlines()
        assert bool(found[0].notes) == noted == ("toy has a mass that" in printed.err)
        (at,) = (k for k, line in enumerate(lines) if line.startswith("a: "))
        assert "INITIAL_OVERLAP" in lines[at] and lines[at + 1].startswith("  - ")


def test_a_body_whose_pieces_are_coarse_has_a_note():
    """Above 2 % of the extent, which is 122 mm."""
    box = load_model("salt_box")
    given = {
        "hull": (HULL, 2e-3),
        "fine": ("cut", 2.4e-3),
        "coarse": ("cut", 2.5e-3),
        "box": ("recipe", 0.01),
    }
    bodies = [
        RigidBody(name, replace(box, pieces_kind=kind, pieces_error=np.array([1e-3, high, 3e-3, 0.0123])))
        for name, (kind, high) in given.items()
    ]
    scene = Scene.everyday(bodies, exact=True, gravity=(0, 0, 0))
    apart = {name: BodyBelief(position=(float(k), 0.0, 0.0)) for k, name in enumerate(given)}
    found = assess(predict(scene, Belief.of(scene, apart), "sigma_points", 0.02), rollouts=0)
    assert [" ".join(status.notes) for status in found] == [
        "has the convex hull of its mesh as its piece, up to 12.3 mm off",
        "",
        (
            "has pieces that are 2.5 mm or more off 1 % of its mesh's surface, and up to 12.3 mm;"
            " pack it with a smaller tolerance"
        ),
        "",
    ]


@pytest.mark.parametrize("name", ["sigma_points", "cloud", "linearization", "auto"])
def test_a_carton_that_falls_or_stays_is_flagged(name):
    """The scene of the README: three in ten slide off the table."""
    table = Box((1.0, 0.6, 0.04), (0.0, 0.0, -0.02), name="table")
    scene = Scene.everyday([RigidBody("carton", load_model("salt_box"))], environment=[table], friction=0.4)
    own = BodyBelief(
        position=(0.40, 0, 0.0612),
        position_std=(0.005, 0.005, 0),
        linear_velocity=(0.8, 0, 0),
        linear_velocity_std=(0.08, 0.02, 0),
    )
    (status,) = assess(predict(scene, Belief.of(scene, {"carton": own}), name, 1.0))
    assert status.flags & Status.MEAN_NOT_POSSIBLE and status.measures["outcomes"] >= 2.0


@pytest.mark.parametrize(
    "radius, fields, words",
    [
        (0.1, {}, "falls for ever"),
        (0.1, {"environment": [Plane()]}, None),
        (0.1, {"gravity": (0, 0, 0)}, "meets nothing"),
        (0.1, {"gravity": (0, 0, 0), "environment": [Plane()]}, None),
        (4.0, {"environment": [Plane()]}, None),
        (6.0, {"environment": [Plane()]}, "has a size of 12 m"),
        (4e-4, {"environment": [Plane()]}, "has a size of 0.0008 m"),
        (6e-4, {"environment": [Plane()]}, None),
    ],
)
def test_notes_on_unlikely_sizes_and_falls_without_end(radius, fields, words):
    ball = primitive_model("sphere", radius=radius)
    scene = Scene.everyday([RigidBody("ball", ball, 1e3 * ball.volume)], exact=True, **fields)
    belief = independent(state((0, 0, radius + 0.01)), position=1e-4 * radius)
    (status,) = assess(predict(scene, belief, "sigma_points", 0.01), rollouts=0)
    assert [note for note in status.notes if words is None or words in note] == list(status.notes)
    assert bool(status.notes) == (words is not None)
