"""Arguments of a wrong type: an error names the argument, what it must be, and what it was given."""

import numpy as np
import pytest
from example_scenes import two_bodies

from unc_physics import (
    Belief,
    BoxRegion,
    UncPhysicsError,
    assess,
    contact_probabilities,
    load_model,
    load_scene,
    make_propagator,
    physics_of,
    predict,
    region_probabilities,
    rest_probabilities,
    start_belief,
)
from unc_physics.scene.scene_file import scene_from_dict

SCENE, BELIEF, _ = scene_from_dict(two_bodies())
ARRAY = np.zeros((2, 13))
REGION = BoxRegion("bin", (1.0, 1.0, 1.0))


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: predict(BELIEF, SCENE, "sigma_points", 1.0), "scene must be a Scene, not a Belief"),
        (lambda: predict(SCENE, ARRAY, "sigma_points", 1.0), "belief must be a Belief, not a ndarray"),
        (lambda: predict(SCENE, None, "sigma_points", 1.0), "belief must be a Belief, not None"),
        (lambda: predict(SCENE, BELIEF, 1.0), "propagator must be a str or a Propagator, not a float"),
        (lambda: start_belief(BELIEF, SCENE), "scene must be a Scene, not a Belief"),
        (lambda: start_belief(SCENE, ARRAY), "belief must be a Belief, not a ndarray"),
        (lambda: make_propagator(["surrogate"]), "name must be a str, not a list"),
        (lambda: load_scene(3), "path must be a str or a PathLike, not an int"),
        (lambda: load_model(3), "name_or_path must be a str or a PathLike, not an int"),
        (lambda: physics_of(BELIEF), "scene must be a Scene, not a Belief"),
        (lambda: Belief.of(BELIEF, {}), "scene must be a Scene, not a Belief"),
        (lambda: Belief.of(SCENE, ARRAY), "bodies must be a Mapping, not a ndarray"),
        (lambda: assess(SCENE), "prediction must be a Prediction, not a Scene"),
        (lambda: contact_probabilities(SCENE), "prediction must be a Prediction, not a Scene"),
        (lambda: rest_probabilities(BELIEF), "prediction must be a Prediction, not a Belief"),
        (lambda: region_probabilities([REGION], SCENE), "prediction must be a Prediction, not a list"),
    ],
)
def test_a_wrong_argument_is_named(call, words):
    with pytest.raises(UncPhysicsError) as caught:
        call()
    assert str(caught.value) == words


def test_wrong_regions_are_named():
    prediction = predict(SCENE, BELIEF, "sigma_points", 0.1)
    with pytest.raises(UncPhysicsError, match=r"^regions\[1\] must be a BoxRegion, not a tuple$"):
        region_probabilities(prediction, [REGION, (1, 1, 1)])
    with pytest.raises(UncPhysicsError, match=r"^regions must be a sequence of BoxRegion"):
        region_probabilities(prediction, 3)
