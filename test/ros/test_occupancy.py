"""Boxes of predicted occupancy, against drawn poses."""

import types

import numpy as np
import pytest
from geometry_msgs.msg import Pose
from scenes import diagonal, orientation_of, position_of
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from std_msgs.msg import Header

from unc_physics import load_model
from unc_physics.ros.markers import OccupancyTopics, ellipsoid_radius, occupied_box

DRAWS = 4000


@pytest.mark.parametrize("probability", [0.0, 0.5, 0.95, 0.999])
def test_the_ellipsoid_has_its_probability(probability):
    assert ellipsoid_radius(probability) == pytest.approx(np.sqrt(chi2.ppf(probability, 6)), abs=1e-9)


@pytest.mark.parametrize("probability", [0.5, 0.9])
@pytest.mark.parametrize("stds", [(0.01,) * 3 + (0.05,) * 3, (0.03, 0.0, 0.0, 0.0, 0.0, 0.0)])
def test_the_whole_object_is_inside_as_often_as_it_should(probability, stds):
    model, pose = load_model("salt_box"), Pose()
    pose.position.x, pose.position.z = 0.3, 0.2
    turned = Rotation.from_rotvec([0.3, -0.4, 1.0])
    q = pose.orientation
    q.x, q.y, q.z, q.w = turned.as_quat()
    P = np.reshape(diagonal(*stds), (6, 6))
    place, size = occupied_box(model, pose, P, probability)
    rng, inside = np.random.default_rng(1), 0
    into, half = Rotation.from_quat(orientation_of(place)).inv(), 0.5 * size + 1e-9
    for error in rng.multivariate_normal(np.zeros(6), P, DRAWS):
        rotation = Rotation.from_rotvec(error[3:]) * turned
        points = position_of(pose) + error[:3] + rotation.apply(model.centers[:300] - model.origin)
        local = into.apply(points - position_of(place))
        inside += bool((np.abs(local) + model.radii[:300, None] <= half).all())
    assert inside / DRAWS > probability - 3.0 * np.sqrt(probability * (1.0 - probability) / DRAWS)
    exact = np.ptp(model.bounds, axis=0)
    assert (size >= exact).all() and (size <= exact + 2.0 * 8.0 * (0.03 + 0.05 * 0.15)).all()


class FakeMoveIt:
    """What the node uses of moveit_msgs, which is not on PyPI."""

    @staticmethod
    def CollisionObject(**fields):
        return types.SimpleNamespace(primitives=[], primitive_poses=[], **fields)

    @staticmethod
    def PlanningScene(is_diff):
        return types.SimpleNamespace(
            is_diff=is_diff,
            robot_state=types.SimpleNamespace(),
            world=types.SimpleNamespace(collision_objects=[]),
        )


def test_a_difference_adds_boxes_and_removes_old_ones():
    topics = OccupancyTopics.__new__(OccupancyTopics)
    topics._moveit, topics._published = FakeMoveIt, set()
    box = ("can", 0, Pose(), np.ones(3))
    first = topics._difference([box, ("mug", 0, Pose(), np.ones(3))], Header())
    assert first.is_diff and first.robot_state.is_diff
    assert [own.operation for own in first.world.collision_objects] == [b"\x00", b"\x00"]
    second = topics._difference([box], Header())
    assert [(own.id, own.operation) for own in second.world.collision_objects] == [
        ("predicted/can/0", b"\x00"),
        ("predicted/mug/0", b"\x01"),
    ]
