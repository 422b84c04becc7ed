"""Arguments of a wrong type: an error names the argument, what it must be, and what it was given."""

import numpy as np
import pytest
from example_scenes import two_bodies

from unc_physics import (
    AtRest,
    Belief,
    BodyBelief,
    Box,
    Plane,
    Scene,
    UncPhysicsError,
    assess,
    load_model,
    load_scene,
    make_propagator,
    predict,
)
from unc_physics.scene.scene_file import scene_from_dict

SCENE, BELIEF, _ = scene_from_dict(two_bodies())
ARRAY = np.zeros((2, 13))
PREDICTION = predict(SCENE, BELIEF, "sigma_points", 0.1)


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: predict(BELIEF, SCENE, "sigma_points", 1.0), "scene must be a Scene, not a Belief"),
        (lambda: predict(SCENE, ARRAY, "sigma_points", 1.0), "belief must be a Belief, not a ndarray"),
        (lambda: predict(SCENE, BELIEF, 1.0), "propagator must be a str or a Propagator, not a float"),
        (
            lambda: predict(SCENE, BELIEF, "sigma_points", [0.1, 0.2]),
            "horizon must be one time; several are given as times=[...] (got [0.1, 0.2])",
        ),
        (
            lambda: predict(SCENE, BELIEF, "linearisation", 0.1),
            (
                "propagator must be one of linearization, surrogate, sigma_points, local_sampling,"
                " monte_carlo, cloud, auto; did you mean 'linearization'? (got 'linearisation')"
            ),
        ),
        (
            lambda: make_propagator("cloud", run=64),
            "run is no option of cloud; its options are runs, samples, seed; did you mean 'runs'? (got 64)",
        ),
        (lambda: Box((1, 1, 1), mu=0.4), "mu is no argument of Box; did you mean 'friction'? (got 0.4)"),
        (lambda: BodyBelief(position_std="0.01"), "position_std must be an array of numbers (got '0.01')"),
        (
            lambda: BodyBelief(position=(0, 0, "0.1")),
            "position must be an array of numbers (got (0, 0, '0.1'))",
        ),
        (
            lambda: PREDICTION.at(0.1)["x"],
            "key is no entry of a Snapshot; a body at a time is prediction.body(name, time=0.1) (got 'x')",
        ),
        (lambda: make_propagator(["surrogate"]), "name must be a str, not a list"),
        (lambda: load_scene(3), "path must be a str or a PathLike, not an int"),
        (lambda: load_model(3), "name_or_path must be a str or a PathLike, not an int"),
        (lambda: Belief.of(SCENE, ARRAY), "bodies must be a Mapping, not a ndarray"),
        (lambda: assess(SCENE), "prediction must be a Prediction, not a Scene"),
        (lambda: PREDICTION.contact_time(AtRest("left")), "event must be a Touches, not an AtRest"),
        (
            lambda: Scene.everyday(SCENE.bodies, environment=Plane()),
            (
                "environment must be a list of elements, such as Plane and Box, not a single Plane;"
                " write [Plane(...)]"
            ),
        ),
        (
            lambda: Scene.everyday(SCENE.bodies[0]),
            "bodies must be a list of RigidBody, not a single RigidBody; write [body]",
        ),
    ],
)
def test_a_wrong_argument_is_named(call, words):
    with pytest.raises(UncPhysicsError) as caught:
        call()
    assert str(caught.value) == words


@pytest.mark.parametrize(
    "call",
    [
        lambda: Scene(SCENE.bodies, islands=True),
        lambda: Scene.everyday(SCENE.bodies, islands=False),
        lambda: make_propagator("sigma_points", reduce=True),
        lambda: make_propagator("monte_carlo", reduce=False),
    ],
)
def test_an_argument_of_an_earlier_version_is_refused(call):
    with pytest.raises(UncPhysicsError, match=r"^(islands|reduce) was removed in version 0\.3: leave it out"):
        call()
