"""The service that assesses the stability of an object of a scene."""

import math
from statistics import NormalDist

import pytest

from unc_physics import load_model
from unc_physics.checks.errors import InvalidRequestError
from unc_physics.ros import Client, environment, make_message, object_state
from unc_physics.ros.messages.fields import seconds
from unc_physics_msgs.msg import Physics, Scene

INSIDE, STD = 0.005, 0.005  # m
SHELF = environment(boxes={"shelf": ((0.6, 0.6, 0.04), (-0.3, 0.0, -0.02))})  # its edge is at x = 0


@pytest.fixture(scope="module")
def asked(node):
    with Client() as client:
        yield client


def carton(inside=INSIDE, **fields):
    """A carton whose middle is so far inside of the shelf's edge, and surely known but for that."""
    center = -load_model("salt_box").origin
    pose = (-inside - center[0], -center[1], 0.0)
    return object_state("carton", "salt_box", pose, [STD**2, 0, 1e-6, 0, 0, 0], **fields)


def test_a_carton_near_an_edge_stays_as_statics_says(asked):
    scene = make_message(Scene, objects=[carton()], environment=SHELF)
    physics = make_message(Physics, friction=0.8)
    found = asked.assess_stability("carton", scene=scene, physics=physics, confidence=0.999)
    assert found.low <= NormalDist().cdf(INSIDE / STD) <= found.high and found.supports == ["shelf"]
    assert found.has_margin and found.distance_margin == pytest.approx(INSIDE, abs=1e-3)
    assert 0.0 < found.angle_margin < math.atan(0.8) and seconds(found.computation_time) > 0.0


def test_what_is_asked_counts(asked):
    scene = make_message(
        Scene, objects=[carton(0.2, twist=(0.3, 0.0, 0.0, 0.0, 0.0, 0.0))], environment=SHELF
    )
    near, far = (
        asked.assess_stability("carton", scene=scene, duration=0.1, distance=distance)
        for distance in (0.01, 0.1)
    )
    assert near.probability < 0.5 and far.probability == 1.0
    sure = asked.assess_stability("carton", scene=scene, duration=0.1, distance=0.1, confidence=0.5)
    assert sure.low > far.low


def test_bad_requests_name_their_field(asked):
    scene = make_message(Scene, objects=[carton()], environment=SHELF)
    for fields, words in (
        ({"scene": scene, "confidence": 1.5}, "^confidence must be between"),
        ({"scene": scene, "distance": -1.0}, "^distance must"),
        ({}, r"^scene must have objects, as the node tracks none \(parameter track\)"),
    ):
        with pytest.raises(InvalidRequestError, match=words):
            asked.assess_stability("carton", **fields)
    with pytest.raises(InvalidRequestError, match="^object is no body of the scene; did you mean 'carton'"):
        asked.assess_stability("carto", scene=scene)
