"""Bad input about what a robot does: a sentence each, from Python and from scene files."""

import numpy as np
import pytest
from example_scenes import two_bodies

from unc_physics import (
    Belief,
    BodyBelief,
    Box,
    PosePath,
    RigidBody,
    Scene,
    UncPhysicsError,
    Wrench,
    load_model,
    predict,
)
from unc_physics.scene.physics_keys import INTEGRATORS
from unc_physics.scene.scene_file import scene_from_dict

CAN = load_model("can").prefix(20)
LINE = PosePath(times=[0, 1], positions=[[0, 0, 0], [1, 0, 0]])


def said(function, *arguments, **options):
    """What the error says that a call raises."""
    with pytest.raises(UncPhysicsError) as error:
        function(*arguments, **options)
    return str(error.value)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"times": [0]}, "times must be at least two; what stands still is fixed"),
        ({"times": [0, 2, 1]}, "times[2] must be later than the time before it, 2 s (got 1.0)"),
        ({"times": [0, 1, 1]}, "times[2] must be later than the time before it, 1 s"),
        ({"times": [0, 1e-3, 1]}, "times[1] jumps: from 0 s to 0.001 s it moves at 2997 m/s, faster"),
        ({"positions": [[0, 0], [1, 0], [2, 0]]}, "positions must have shape (3, 3), not (3, 2)"),
        ({"positions": [[0, 0, np.nan]] * 3}, "positions must be finite"),
        ({"orientations": [[0, 0, 0, 2]] * 3}, "orientations[0] must have unit length, not 2"),
        (
            {"orientations": [[0, 0, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]]},
            "orientations[1] turns by 3.142 rad from the pose before it, so that it is not known which way",
        ),
        ({"linear_velocities": [1, 2, 3]}, "linear_velocities must have shape (3, 3)"),
        ({"times": np.arange(100_001)}, "times must be at most 100000 (got 100001)"),
        ({"positions": [[0, 0, 0], [0, 0, -1.1e12], [0, 0, 0]]}, "positions must be within 1e+12 m of the"),
    ],
)
def test_a_path_that_cannot_be(given, sentence):
    path = {"times": [0, 1, 2], "positions": [[0, 0, 0], [1, 0, 0], [2, 0, 0]]} | given
    assert sentence in said(PosePath, **path)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"trajectory": LINE, "fixed": True}, "trajectory of body 'a' must be absent: the body is fixed"),
        ({"trajectory_std": [0.1] * 6}, "trajectory_std of body 'a' needs a trajectory beside it"),
        ({"trajectory": LINE, "trajectory_std": [-1, 0, 0, 0, 0, 0]}, "trajectory_std of body 'a'[0] must"),
        ({"trajectory": LINE, "at_rest": True}, "at_rest of body 'a' must be false for a prescribed body"),
        ({"trajectory": LINE, "attached_to": "b"}, "attached_to of body 'a' must be absent: the body"),
        ({"trajectory": LINE, "wrenches": [Wrench()]}, "wrenches of body 'a' must be absent: no force moves"),
        (
            {"trajectory": LINE, "mass_std": 0.1},
            "mass_std of body 'a' must be zero or absent: the body is pre",
        ),
        (
            {"trajectory": LINE, "center_of_mass_std": [0, 0, 0.1]},
            "must be zero or absent: the body is prescr",
        ),
        ({"fixed": True, "drag": 0.1}, "drag of body 'a' must be absent: no force moves this body"),
        ({"drag": -0.1}, "drag of body 'a' must not be negative (got -0.1)"),
        ({"trajectory": 1.0}, "trajectory of body 'a' must be a PosePath, not a float"),
        ({"attached_to": "a"}, "attached_to of body 'a' must be another body than itself"),
        ({"attached_to": "b", "attached_at": 2.0, "released_at": 1.0}, "must be later than attached_at, 2 s"),
        ({"attached_to": "b", "released_at_std": 0.1}, "released_at_std of body 'a' needs released_at"),
        ({"released_at": 1.0}, "released_at of body 'a' needs attached_to beside it"),
        ({"attached_to": "b", "at_rest": True}, "at_rest of body 'a' must be false, as the body is held"),
        ({"torsional_friction": -1.0}, "torsional_friction of body 'a' must not be negative"),
    ],
)
def test_a_body_that_cannot_be(given, sentence):
    assert sentence in said(RigidBody, "a", CAN, 1.0, **given)


@pytest.mark.parametrize(
    ("to", "sentence"),
    [
        ("nobody", "bodies[0].attached_to is no body of the scene"),
        ("free", "bodies[0].attached_to must name a body with a trajectory, or a fixed one; this one"),
        ("other", "bodies[0].attached_to goes in a circle: a to other to a"),
    ],
)
def test_what_holds_a_body_must_be_there(to, sentence):
    other = RigidBody("other", CAN, 1.0, attached_to="a")
    bodies = [RigidBody("a", CAN, 1.0, attached_to=to), RigidBody("free", CAN, 1.0), other]
    assert sentence in said(Scene.everyday, bodies)


def test_a_wrench_that_cannot_be():
    assert "duration must be positive" in said(Wrench, duration=0.0)
    assert "force must have shape (3,)" in said(Wrench, force=[1, 2])


@pytest.mark.parametrize(
    ("body", "element", "place"),
    [
        ({"attached_to": "hand"}, {}, "bodies[1].attached_to"),
        ({"torsional_friction": 0.01}, {}, "bodies[1].torsional_friction"),
        ({}, {"surface_velocity": (1, 0, 0)}, "environment[0].surface_velocity"),
    ],
)
def test_the_explicit_step_says_what_it_cannot_do(body, element, place):
    bodies = [RigidBody("hand", CAN, trajectory=LINE), RigidBody("a", CAN, 1.0, **body)]
    sentence = said(Scene, bodies, gravity=(0, 0, 0), environment=[Box((1, 1, 1), **element)])
    assert sentence.startswith(f"{place} needs 'integrator: implicit'")


@pytest.mark.parametrize(
    "name, integrator",
    [
        ("linearization", "explicit"),
        *((name, integrator) for name in ("surrogate", "local_sampling") for integrator in INTEGRATORS),
    ],
)
def test_propagators_that_cannot_say_so(name, integrator):
    bodies = [RigidBody("a", CAN, 1.0), RigidBody("hand", CAN, trajectory=LINE)]
    scene = Scene(bodies, integrator=integrator)
    belief = Belief.of(scene, {"a": BodyBelief(position=(0, 0, 3))})
    sentence = said(predict, scene, belief, name, 0.1)
    assert sentence.startswith("propagator does not take prescribed, held or pushed bodies, nor surfaces")
    assert "monte_carlo" in sentence
    if name == "linearization":
        assert "surfaces that move, but on the implicit integrator; sigma_points" in sentence


def test_linearization_takes_uncertain_parameters_on_the_implicit_integrator_alone():
    scene = Scene.everyday([RigidBody("a", CAN, 1.0, mass_std=0.1)], exact=True)
    belief = Belief.of(scene, {"a": BodyBelief(position=(0, 0, 3))})
    predict(scene, belief, "linearization", 0.1)
    scene = Scene([RigidBody("a", CAN, 1.0, mass_std=0.1)])
    sentence = said(predict, scene, belief, "linearization", 0.1)
    assert sentence.startswith("mass_std of body 'a' is not supported by linearization")


def test_a_prescribed_body_has_no_belief_of_its_own():
    scene = Scene.everyday([RigidBody("a", CAN, 1.0), RigidBody("hand", CAN, trajectory=LINE)], exact=True)
    beliefs = {"a": BodyBelief(), "hand": BodyBelief()}
    assert "bodies['hand'] must be absent: its trajectory says where it is" in said(Belief.of, scene, beliefs)


POSES = [{"time": 0, "position": [0, 0, 1]}, {"time": 1, "position": [0.1, 0, 1]}]


def in_file(body=None, element=None):
    """The content of a scene file, with entries of the second body and of an element."""
    content = {"exact": True, "bodies": two_bodies()["bodies"]}
    if body is not None:
        content["bodies"][1] = {"name": "hand", "model": content["bodies"][1]["model"]} | body
    if element is not None:
        content["environment"] = [{"plane": {"normal": [0, 0, 1], "offset": -9}} | element]
    return content


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        ({"trajectory": POSES[::-1]}, "bodies[1].trajectory.times[1] must be later than the time before it"),
        ({"trajectory": [{"time": 0}] * 2}, "bodies[1].trajectory[0].position must be given"),
        ({"trajectory": POSES, "position": [0, 0, 0]}, "bodies[1].position must be absent: the body's"),
        ({"mass": 1, "wrenches": [{"power": 1}]}, "bodies[1].wrenches[0] has no key 'power'"),
    ],
)
def test_a_file_s_body_that_cannot_be(body, sentence):
    assert sentence in said(scene_from_dict, in_file(body))


def test_a_file_says_what_python_says():
    body = {
        "trajectory": [
            *POSES,
            {
                "time": 1.5,
                "position": [0.1, 0, 1.2],
                "orientation": [0, 0, 1, 0],
                "linear_velocity": [0, 0, 0.3],
                "angular_velocity": None,
            },
        ],
        "trajectory_std": [0.01, 0, 0, 0, 0, 0.1],
    }
    body["trajectory"][2]["orientation"] = [0, 0, 0.6, 0.8]
    content = in_file(
        body,
        {"surface_velocity": [1, 0, 0], "surface_angular_velocity": [0, 0, 2], "torsional_friction": 0.003},
    )
    content["bodies"][0] |= {
        "attached_to": "hand",
        "released_at": 0.4,
        "released_at_std": 0.05,
        "wrenches": [{"force": [1, 0, 0], "start": 0.5, "duration": 1, "body_axes": True}],
        "drag": 0.02,
    }
    scene, belief, _ = scene_from_dict(content)
    held, hand = scene.bodies
    assert (held.attached_to, held.released_at, held.released_at_std) == ("hand", 0.4, 0.05)
    assert held.wrenches[0].end == 1.5 and held.wrenches[0].body_axes
    assert held.drag == 0.02
    np.testing.assert_allclose(
        hand.trajectory.linear_velocities, [[0, 0, 0], [0.03333, 0, 0.26667], [0, 0, 0.3]], atol=1e-4
    )
    np.testing.assert_array_equal(hand.trajectory.angular_velocities[[0, 2]], 0.0)
    np.testing.assert_array_equal(belief.mean[1], hand.trajectory.states[0])
    assert [(p.name, p.body, p.axis) for p in scene.uncertain] == [
        ("released_at", 0, 0),
        ("trajectory", 1, 0),
        ("trajectory", 1, 5),
    ]
    assert scene.moving.tolist() == [0] and scene.acts
    np.testing.assert_array_equal(scene.environment[0].moving_surface, [1 - 0, 0 - 0, 0, 0, 0, 2])
    assert scene.environment[0].torsional_friction == 0.003


@pytest.mark.parametrize("hold", [1.0, 3.0])
def test_a_hold_is_held_and_a_return_does_not_overshoot(hold):
    """50 mm in 1 s, then a hold; and there and back. Positions come from the cubic between two poses."""
    for far in (0.05, 0.0):
        path = PosePath(times=[0.0, 1.0, 1.0 + hold], positions=[[0, 0, 0], [0.05, 0, 0], [far, 0, 0]])
        assert not path.linear_velocities.any()
    ramp = PosePath(times=[0, 1, 2, 3], positions=[[0, 0, 0], [1, 0, 0], [2, 0, 0], [4, 0, 0]])
    assert ramp.linear_velocities[1:3, 0].tolist() == [1.0, 1.5]  # parabolas, as they do not overshoot
