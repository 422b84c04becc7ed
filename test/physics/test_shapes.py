"""Shapes of the environment: distance, normal and bounds of each, and what bodies feel of them."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plain_scenes import BALL
from scipy.spatial.transform import Rotation
from twins import shapes as twin

from unc_physics import RigidBody, Scene
from unc_physics.checks.errors import InvalidEnvironmentError, InvalidOrientationError, NotFiniteError
from unc_physics.physics.paper import solids
from unc_physics.physics.paper.element_contacts import cap
from unc_physics.physics.paper.rollout import simulate
from unc_physics.plots.scene_picture import outline
from unc_physics.scene.environment import ELEMENTS, Box, Capsule, Cylinder, Element, Plane, Sphere

ROUND_OFF = 1e-12
HALF = np.array([0.3, 0.2, 0.5])
#: One element of each kind about the origin, its twin, and points all over its surface.
KNOWN = {
    "plane": (Plane(), twin.plane, None),
    "box": (Box(2.0 * HALF), lambda p: twin.box(p, HALF), lambda spacing: twin.box_surface(HALF, spacing)),
    "sphere": (
        Sphere(0.4),
        lambda p: twin.sphere(p, 0.4),
        lambda spacing: twin.capsule_surface(0.4, 0.0, spacing),
    ),
    "cylinder": (
        Cylinder(0.3, 1.0),
        lambda p: twin.cylinder(p, 0.3, 0.5),
        lambda spacing: twin.cylinder_surface(0.3, 0.5, spacing),
    ),
    "capsule": (
        Capsule(0.3, 0.8),
        lambda p: twin.capsule(p, 0.3, 0.4),
        lambda spacing: twin.capsule_surface(0.3, 0.4, spacing),
    ),
}
FINITE = [name for name in KNOWN if name != "plane"]
coordinates = st.one_of(
    st.floats(-1.0, 1.0).filter(lambda c: abs(c) > 1e-9),
    st.sampled_from((0.0, -0.0, 0.2, 0.3, 0.4, 0.5, -0.3, 0.7, 1e-9)),
)
points = st.tuples(coordinates, coordinates, coordinates)


def surface(element, point):
    """Distance and normal (3,) at a point of an element's frame."""
    kind, size = np.array([element.kind]), np.array([element.size_row])
    distance, normal = solids.surface(kind, size, 0, *map(float, point))
    return distance, np.array(normal)


def random_points(count=400, seed=0):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 3))


def test_every_shape_is_an_element_and_is_tested_here():
    assert list(KNOWN) == list(solids.KINDS) == list(ELEMENTS)
    assert [element.kind for element, *_ in KNOWN.values()] == list(range(len(KNOWN)))


@pytest.mark.parametrize("name", KNOWN)
@given(point=points)
def test_distance_and_normal_are_the_twins(name, point):
    element, expected, _ = KNOWN[name]
    distance, normal = surface(element, point)
    known, direction = expected(np.array(point))
    assert distance == pytest.approx(known, abs=ROUND_OFF)
    # where round-off decides between two faces, either is right
    shifts = ROUND_OFF * np.concatenate([np.eye(3), -np.eye(3)])
    allowed = [direction, *(expected(np.array(point) + shift)[1] for shift in shifts)]
    assert min(np.abs(normal - other).max() for other in allowed) < 1e-6


@pytest.mark.parametrize("name", KNOWN)
@given(point=st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 3))
def test_distance_and_normal_are_numbers_everywhere(name, point):
    """Also where squares underflow or overflow."""
    distance, normal = surface(KNOWN[name][0], point)
    assert not math.isnan(distance) and not np.isnan(normal).any()
    if max(map(abs, point)) < 1e100:
        assert np.linalg.norm(normal) == pytest.approx(1.0, abs=ROUND_OFF)


@pytest.mark.parametrize("name", FINITE)
def test_distance_is_that_from_the_nearest_point_of_the_surface(name):
    element, _, surface_points = KNOWN[name]
    spacing = 0.02
    everywhere = surface_points(spacing)
    for point in random_points():
        nearest = np.linalg.norm(everywhere - point, axis=1).min()
        distance, _ = surface(element, point)
        assert abs(distance) <= nearest + ROUND_OFF
        assert nearest <= abs(distance) + spacing


@pytest.mark.parametrize("name", FINITE)
def test_bounds_fit(name):
    element, _, surface_points = KNOWN[name]
    low, high = element.bounds
    everywhere = surface_points(0.02)
    np.testing.assert_allclose(everywhere.min(axis=0), low, atol=2e-3)
    np.testing.assert_allclose(everywhere.max(axis=0), high, atol=2e-3)
    assert element.finite


def test_a_half_space_has_an_end_at_its_surface_only():
    low, high = Plane().bounds
    assert high.tolist() == [np.inf, np.inf, 0.0] and np.all(low == -np.inf) and not Plane().finite


@pytest.mark.parametrize("name", KNOWN)
def test_an_element_answers_in_the_world(name):
    q = Rotation.from_rotvec([0.4, -0.3, 0.8])
    element = placed(name, q, (0.5, -1.0, 2.0))
    local = random_points(50)
    distance, normal = element.surface(local @ element.rotation.T + element.position)
    for k, point in enumerate(local):
        d, n = surface(element, point)
        assert distance[k] == pytest.approx(d, abs=ROUND_OFF)
        np.testing.assert_allclose(normal[k], element.rotation @ n, atol=1e-9)


@pytest.mark.parametrize("name", FINITE)
def test_an_outline_holds_the_solid_and_touches_it(name):
    element = placed(name, Rotation.from_rotvec([0.4, -0.3, 0.8]), (0.5, -1.0, 2.0))
    view = Rotation.from_rotvec([0.2, 0.1, -0.5]).as_matrix()
    solid = (KNOWN[name][2](0.02) @ element.rotation.T + element.position) @ view[:2].T
    seen = outline(element, view)
    for angle in np.linspace(0.0, 2.0 * np.pi, 37):
        u = np.array([math.cos(angle), math.sin(angle)])
        assert (seen @ u).max() == pytest.approx((solid @ u).max(), abs=1e-3)


@pytest.mark.parametrize("name", FINITE)
def test_outermost_points_are_exact(name):
    """Beside the solids' support functions in closed form."""
    element = placed(name, Rotation.from_rotvec([0.4, -0.3, 0.8]), (0.5, -1.0, 2.0))
    directions = random_points()
    directions = np.concatenate([directions, np.eye(3), element.rotation.T, -element.rotation.T])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    local = np.abs(directions @ element.rotation)
    across = np.hypot(local[:, 0], local[:, 1])
    reach = {
        "box": local @ HALF,
        "sphere": np.full(len(local), 0.4),
        "cylinder": 0.3 * across + 0.5 * local[:, 2],
        "capsule": 0.3 + 0.4 * local[:, 2],
    }[name]
    points = element.outermost(directions)
    np.testing.assert_allclose(np.einsum("nk,nk->n", points - element.position, directions), reach, atol=1e-6)
    np.testing.assert_allclose(element.surface(points)[0], 0.0, atol=1e-7)


def placed(name, rotation, position):
    """The element of that kind of `KNOWN`, turned and moved."""
    element = KNOWN[name][0]
    if name == "plane":
        normal = rotation.apply([0.0, 0.0, 1.0])
        return Plane(normal, normal @ position)
    pose = {"position": position, "orientation": rotation.as_quat(), "surface_center": None}
    return replace(
        element, **{field.name: pose[field.name] for field in fields(element) if field.name in pose}
    )


def thrown(element, position, velocity, time, dt=1e-3):
    """State (13,) of a ball that was thrown at an element."""
    scene = Scene(
        [RigidBody("ball", BALL, 0.5)], dt=dt, stiffness=1e7, gravity=(0.0, 0.0, 0.0), environment=(element,)
    )
    states = np.zeros((1, 1, 13))
    states[0, 0, :6], states[0, 0, 9] = (*position, *velocity), 1.0
    simulate(states, scene.world, round(time / dt))
    return states[0, 0]


@pytest.mark.parametrize("name", KNOWN)
def test_the_force_is_along_the_normal_and_of_the_caps_volume(name):
    element = placed(name, Rotation.from_rotvec([0.4, -0.3, 0.8]), (0.5, -1.0, 2.0))
    tried = 0
    for local in random_points(4000, seed=1):
        distance, normal = surface(element, local)
        if abs(distance) > 0.03:
            continue
        end = thrown(element, element.rotation @ local + element.position, np.zeros(3), 1e-3)
        kick = 1e-3 * 1e7 * cap(distance, 0.05)[0] / 0.5
        np.testing.assert_allclose(end[3:6], kick * element.rotation @ normal, rtol=1e-9, atol=1e-9 * kick)
        np.testing.assert_allclose(end[10:], 0.0, atol=1e-9)  # through the centre of the ball
        tried += 1
    assert tried > 20


LONG = [  # what lies along an axis
    ((0.0, 1.0), InvalidEnvironmentError, "radius"),
    ((math.inf, 1.0), NotFiniteError, "radius"),
    ((1.0, 0.0), InvalidEnvironmentError, "length"),
    ((1.0, -2.0), InvalidEnvironmentError, "length"),
    ((1.0, None), InvalidEnvironmentError, "length"),
    ((1.0, 1.0, "here"), InvalidEnvironmentError, "position"),
    ((1.0, 1.0, (0, 0, 0), (0.0, 0.0, 0.0, 2.0)), InvalidOrientationError, "orientation"),
]


@pytest.mark.parametrize(
    "kind, arguments, error, field",
    [
        (Sphere, (0.0,), InvalidEnvironmentError, "radius"),
        (Sphere, (-1.0,), InvalidEnvironmentError, "radius"),
        (Sphere, ("large",), InvalidEnvironmentError, "radius"),
        (Sphere, (math.nan,), NotFiniteError, "radius"),
        (Sphere, (1.0, (0.0, 0.0)), InvalidEnvironmentError, "position"),
        (Sphere, (1.0, (0.0, math.inf, 0.0)), NotFiniteError, "position"),
        (Box, ((1.0, 0.0, 1.0),), InvalidEnvironmentError, "size[1]"),
        (Plane, ((0.0, 0.0, 0.0),), InvalidEnvironmentError, "normal"),
        *((kind, *row) for kind in (Cylinder, Capsule) for row in LONG),
    ],
)
def test_bad_input_is_refused_by_its_field(kind, arguments, error, field):
    with pytest.raises(error) as raised:
        kind(*arguments)
    assert raised.value.field == field


def test_an_unknown_shape_is_refused():
    class Cone(Element):
        shape, name = "cone", ""
        position, orientation, size_row = np.zeros(3), (0.0, 0.0, 0.0, 1.0), np.ones(3)

    for stranger in (Cone(), Element(), "floor", None):
        with pytest.raises(
            InvalidEnvironmentError, match=r"environment\[1\] must be one of Plane, Box, Sphere, "
        ):
            Scene([RigidBody("ball", BALL, 1.0)], environment=(Plane(), stranger))


def test_a_kernel_finds_nothing_in_an_unknown_kind():
    for kind in (-1, len(KNOWN)):
        found = solids.surface(np.array([kind]), np.ones((1, 3)), 0, 0.0, 0.0, 0.0)
        assert found == (math.inf, (0.0, 0.0, 1.0))
