"""Arguments of a wrong type: an error names the argument, what it must be, and what it was given."""

import numpy as np
import pytest
from example_scenes import two_bodies

from unc_physics import (
    AtRest,
    Belief,
    UncPhysicsError,
    assess,
    load_model,
    load_scene,
    make_propagator,
    physics_of,
    predict,
    start_belief,
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
        (lambda: predict(SCENE, None, "sigma_points", 1.0), "belief must be a Belief, not None"),
        (lambda: predict(SCENE, BELIEF, 1.0), "propagator must be a str or a Propagator, not a float"),
        (
            lambda: predict(SCENE, BELIEF, "sigma_points", [0.1, 0.2]),
            "horizon must be one time; several are given as times=[...] (got [0.1, 0.2])",
        ),
        (lambda: start_belief(BELIEF, SCENE), "scene must be a Scene, not a Belief"),
        (lambda: start_belief(SCENE, ARRAY), "belief must be a Belief, not a ndarray"),
        (lambda: make_propagator(["surrogate"]), "name must be a str, not a list"),
        (lambda: load_scene(3), "path must be a str or a PathLike, not an int"),
        (lambda: load_model(3), "name_or_path must be a str or a PathLike, not an int"),
        (lambda: physics_of(BELIEF), "scene must be a Scene, not a Belief"),
        (lambda: Belief.of(BELIEF, {}), "scene must be a Scene, not a Belief"),
        (lambda: Belief.of(SCENE, ARRAY), "bodies must be a Mapping, not a ndarray"),
        (lambda: assess(SCENE), "prediction must be a Prediction, not a Scene"),
        (lambda: PREDICTION.probability("touches"), "event must be an Event, not a str"),
        (lambda: PREDICTION.contact_time(AtRest("left")), "event must be a Touches, not an AtRest"),
        (
            lambda: predict(SCENE, BELIEF, horizon=0.1, events=[AtRest]),
            "events[0] must be an Event, not an ABCMeta",
        ),
    ],
)
def test_a_wrong_argument_is_named(call, words):
    with pytest.raises(UncPhysicsError) as caught:
        call()
    assert str(caught.value) == words
