"""Surroundings and contact laws of requests, and the probabilities that answers tell."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Pose
from scenes import (
    assert_answered,
    diagonal,
    explicit,
    moving_object,
    orientation_of,
    position_of,
    request_of,
    with_physics,
)
from scipy.spatial.transform import Rotation
from shape_msgs.msg import Plane, SolidPrimitive
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from unc_physics import load_model
from unc_physics.ros import make_message
from unc_physics.ros.markers import markers
from unc_physics.ros.messages.environment import read_environment
from unc_physics.ros.messages.fields import pose_message, seconds
from unc_physics.ros.models import ShapePacker
from unc_physics.ros.parameters import Settings
from unc_physics.scene.environment import Capsule, Cylinder, Sphere
from unc_physics_msgs.msg import BoxRegion, Environment, EnvironmentElement, Event

FLOOR = 0.2  # m, height
SAMPLES = 200


def floor_as(kind):
    """The same floor as a half-space, whose normal is not of unit length, or as a box."""
    if kind == "plane":
        plane = Plane(coef=[0.0, 0.0, 2.0, -2.0 * FLOOR])
        return Environment(elements=[EnvironmentElement(id="floor", plane=plane)])
    pose = Pose()
    pose.position.z = FLOOR - 0.5
    primitive = SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[4.0, 4.0, 1.0])
    return Environment(elements=[EnvironmentElement(id="floor", primitive=primitive, pose=pose)])


def falling_brick(name="brick", height=0.15, x=0.0):
    """A brick above the floor."""
    message = moving_object(name, "brick", (x, 0.0, FLOOR + height), (0.0, 0.0, 0.0), spheres=50)
    message.pose.covariance = diagonal(*[0.005] * 3, *[0.02] * 3)
    return message


def request_with(environment, *objects, horizon=0.6, physics=(), **others):
    request = request_of(*objects, horizon=horizon, seed=1, **others)
    request.scene.environment = environment
    with_physics(request, gravity=None)
    if others.get("propagator") == "surrogate":
        return with_physics(explicit(request), stiffness=1e6)
    return with_physics(request, **({"restitution": 0.3} | dict(physics)))


def test_probabilities_of_contact_region_and_rest(predict):
    """Of two bricks that fall to the floor, of which one lands in a region."""
    inside = make_message(BoxRegion, id="inside", size=(0.6, 0.6, 0.6), pose=(0, 0, FLOOR + 0.1))
    away = make_message(BoxRegion, id="away", size=(1, 1, 1), pose=(5, 0, 0))
    options = {"propagator": "monte_carlo", "samples": SAMPLES, "return_probabilities": True}
    response = predict(
        request_with(
            floor_as("plane"),
            falling_brick("near"),
            falling_brick("far", x=1.0),
            regions=[inside, away],
            **options,
        )
    )
    assert_answered(response)
    found = response.prediction
    contacts, regions = (
        {(answer.object, answer.other): answer for answer in found.events if answer.kind == kind}
        for kind in (Event.TOUCHES, Event.IN_REGION)
    )
    both, anything = ("near", "far"), Event.ENVIRONMENT
    for answers, expected in (
        (contacts, {("near", "far"): 0.0} | dict.fromkeys(product(both, ("floor", anything)), 1.0)),
        (regions, dict.fromkeys(product(both, ("inside", "away")), 0.0) | {("near", "inside"): 1.0}),
    ):
        assert {pair: answer.probability for pair, answer in answers.items()} == expected
        for own in answers.values():
            assert own.low <= own.probability <= own.high < own.low + 0.1
            assert seconds(own.time_from_start) == pytest.approx(0.6)
    brick = load_model("brick").prefix(50)
    lowest = (brick.centers[:, 2] - brick.radii).min() - brick.origin[2]
    for (_, other), answer in contacts.items():
        assert answer.has_first_contact_time == (other != "far")
        if other != "far":
            expected = np.sqrt(2.0 * (0.15 + lowest) / 9.81)
            assert seconds(answer.first_contact_time) == pytest.approx(expected, abs=0.01)
            assert 0.0 < seconds(answer.first_contact_time_std) < 0.02
    assert {(own.object, own.kind) for own in found.events if own.kind > Event.TOUCHES} == set(
        product(both, (Event.AT_REST, Event.UPRIGHT, Event.FELL_OFF))
    )
    assert all(own.probability == 1.0 for own in found.events if own.kind == Event.UPRIGHT)


def solids_of(*elements):
    """Markers of elements of the environment."""
    job = SimpleNamespace(scene=SimpleNamespace(bodies=(), environment=elements))
    return markers(Header(), job, SimpleNamespace(objects=[]), Settings()).markers[1:]


def test_round_solids_are_read_and_drawn_where_they_are():
    position, turn = np.array([0.5, -1.0, 2.0]), Rotation.from_rotvec([0.4, -0.3, 0.8])
    pose = pose_message(position, turn.as_quat())
    primitives = [
        SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[0.3]),
        SolidPrimitive(type=SolidPrimitive.CYLINDER, dimensions=[2.0, 0.1]),
    ]
    elements = [
        EnvironmentElement(id=name, primitive=primitive, pose=pose)
        for name, primitive in zip(("ball", ""), primitives, strict=True)
    ]
    read = read_environment(Environment(elements=elements), ShapePacker())[0]
    assert [type(element) for element in read] == [Sphere, Cylinder]
    ball, post, rail, *ends = solids_of(*read, Capsule(0.1, 2.0, position, turn.as_quat(), "rail"))
    assert (ball.type, post.type, rail.type) == (Marker.SPHERE, Marker.CYLINDER, Marker.CYLINDER)
    assert [(marker.ns, marker.id) for marker in (ball, post, rail, *ends)] == [
        ("environment ball", 0),
        ("environment element_1", 0),
        *(("environment rail", k) for k in range(3)),
    ]
    for marker, size in ((ball, (0.6, 0.6, 0.6)), (post, (0.2, 0.2, 2.0)), (rail, (0.2, 0.2, 2.0))):
        assert (marker.scale.x, marker.scale.y, marker.scale.z) == size
        assert np.allclose(position_of(marker.pose), position)
        assert marker.color.a == 0.5
    for marker in (post, rail):
        axis = Rotation.from_quat(orientation_of(marker.pose)).apply([0, 0, 1])
        assert np.allclose(axis, turn.apply([0, 0, 1]))
    for marker, z in zip(ends, (-1.0, 1.0), strict=True):
        assert (marker.type, marker.scale.x) == (Marker.SPHERE, 0.2)
        assert np.allclose(position_of(marker.pose), position + turn.apply([0.0, 0.0, z]))


def test_markers_of_planes_and_boxes():
    tilted = Plane(coef=[0.0, -0.6, 0.8, -1.0])
    environment = floor_as("box")
    environment.elements.insert(0, EnvironmentElement(id="ramp", plane=tilted))
    ramp, floor = solids_of(*read_environment(environment, ShapePacker())[0])
    assert (ramp.ns, floor.ns) == ("environment ramp", "environment floor")
    assert (floor.scale.x, floor.scale.z, floor.pose.position.z) == (4.0, 1.0, FLOOR - 0.5)
    turn = Rotation.from_quat(orientation_of(ramp.pose))
    assert np.allclose(turn.apply([0.0, 0.0, 1.0]), tilted.coef[:3])
    top = position_of(ramp.pose) + turn.apply([1.0, 1.5, 0.5 * ramp.scale.z])
    assert top @ tilted.coef[:3] == pytest.approx(1.0)
