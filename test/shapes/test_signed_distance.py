"""Signed distances of models and elements at poses."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics import Box, Capsule, Cylinder, Plane, Sphere, SpherePacking, load_model, primitive_model
from unc_physics.checks.errors import UncPhysicsError
from unc_physics.shapes import signed_distance

UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def test_two_balls_are_their_radii_apart():
    a, b = primitive_model("sphere", radius=0.03), primitive_model("sphere", radius=0.05)
    found = signed_distance(a, ((1.0, 0.0, 0.0), UPRIGHT), b, ((1.0, 0.3, 0.4), UPRIGHT))
    assert found.distance == pytest.approx(0.42, abs=1e-12)
    assert found.normal == pytest.approx([0.0, 0.6, 0.8], abs=1e-12)
    assert found.point_a == pytest.approx([1.0, 0.018, 0.024], abs=1e-12)
    assert found.point_b == pytest.approx([1.0, 0.27, 0.36], abs=1e-12)
    overlapping = signed_distance(a, ((0.0, 0.0, 0.0), UPRIGHT), b, ((0.0, 0.0, 0.07), UPRIGHT))
    assert overlapping.distance == pytest.approx(-0.01, abs=1e-9)


def test_a_pose_is_of_the_centre_of_mass():
    """The can stands on the floor when its centre of mass is as high as the model says."""
    can = load_model("can")
    height, floor = -can.origin[2], Plane((0.0, 0.0, 1.0), 0.2)
    found = signed_distance(floor, None, can, ((4.0, 5.0, height + 0.21), UPRIGHT))
    assert found.distance == pytest.approx(0.01, abs=1e-12)
    assert found.normal == pytest.approx([0.0, 0.0, 1.0])
    lying = Rotation.from_euler("y", 90, degrees=True).as_quat()
    assert signed_distance(can, ((0, 0, 0.3), lying), floor, None).distance == pytest.approx(0.1 - 0.038)
    lid = height * 2.0
    for element in (
        Box((0.1, 0.1, 0.02), position=(0.0, 0.0, lid + 0.03)),
        Sphere(0.01, position=(0.0, 0.0, lid + 0.03)),
        Cylinder(0.03, 0.02, position=(0.0, 0.0, lid + 0.03)),
        Capsule(0.01, 0.05, position=(0.0, 0.0, lid + 0.03), orientation=lying),
    ):
        above = signed_distance(can, ((0.0, 0.0, height), UPRIGHT), element, None)
        assert above.distance == pytest.approx(0.02, abs=1e-3)
        assert above.normal == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)


def test_a_ball_lies_on_the_ground_of_a_mug_and_not_on_its_hull():
    mug, ball = load_model("mug"), primitive_model("sphere", radius=0.01)
    inside = mug.origin + [0.0, 0.0, 0.006 + 0.01]
    found = signed_distance(mug, (np.zeros(3), UPRIGHT), ball, (inside, UPRIGHT))
    assert found.distance == pytest.approx(0.0, abs=1e-6)
    assert found.normal == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)
    high = inside + [0.0, 0.0, 0.03]
    wall = signed_distance(mug, (np.zeros(3), UPRIGHT), ball, (high, UPRIGHT))
    assert wall.distance == pytest.approx(0.037 - 0.01, abs=7e-4)  # chords of sectors


def test_without_pieces_each_sphere_is_one():
    spheres = SpherePacking(
        "pair", [[0, 0, -1.0], [0, 0, 1.0]], [0.5, 0.25], np.eye(3), 1.0, np.zeros(3), 2.0
    )
    assert spheres.has_only_spheres and len(spheres.pieces) == 2
    ball = primitive_model("sphere", radius=0.5)
    assert signed_distance(spheres, None, ball, ((0, 0, 3.0), UPRIGHT)).distance == pytest.approx(1.25)
    first = spheres.prefix(1)
    assert signed_distance(first, None, ball, ((0, 0, 3.0), UPRIGHT)).distance == pytest.approx(3.0)
    assert signed_distance(spheres.scaled(2.0), None, ball, ((0, 0, 6.0), UPRIGHT)).distance == pytest.approx(
        3.0
    )


def test_scale_and_order_and_motion_of_the_world():
    rng = np.random.default_rng(3)
    bin_, pin = load_model("bin"), load_model("pin")
    for _ in range(5):
        p, q = rng.normal(0.0, 0.3, 3), Rotation.random(random_state=rng).as_quat()
        found = signed_distance(bin_, (np.zeros(3), UPRIGHT), pin, (p, q))
        swapped = signed_distance(pin, (p, q), bin_, (np.zeros(3), UPRIGHT))
        assert swapped.distance == pytest.approx(found.distance, abs=1e-9 if found.distance > 0.0 else 1e-4)
        large = signed_distance(bin_.scaled(3.0), (np.zeros(3), UPRIGHT), pin.scaled(3.0), (3.0 * p, q))
        assert large.distance == pytest.approx(3.0 * found.distance, abs=1e-6)
        assert found.point_b - found.point_a == pytest.approx(found.distance * found.normal, abs=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("mug", None, Plane(), None), "model_a must be a model"),
        ((load_model("mug"), ((0, 0, 0), (0, 0, 0, 0)), Plane(), None), r"pose_a\[1\]"),
        ((load_model("mug"), (0, 0, 0), Plane(), None), "pose_a must be a position"),
        ((load_model("mug"), None, Plane(), ((0, 0, np.nan), UPRIGHT)), r"pose_b\[0\]"),
        ((Plane(), None, Plane(), None), "half-spaces"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(UncPhysicsError, match=message):
        signed_distance(*arguments)
