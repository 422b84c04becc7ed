"""Classes of detections: their models, the points that poses are about, and boxes in place of both."""

from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Pose, PoseWithCovariance, Vector3
from scenes import orientation_of, position_of
from scipy.spatial.transform import Rotation
from std_msgs.msg import Header

from unc_physics.ros.detected import moved_pose, read_detections
from unc_physics.ros.messages.fields import pose_message
from unc_physics.ros.models import ModelLibrary
from unc_physics.ros.parameters import Settings

TURN = Rotation.from_euler("xyz", [0.4, -0.3, 0.9])
PLACE = np.array([0.3, -0.2, 0.5])  # m


@pytest.fixture(scope="module")
def library():
    made = ModelLibrary()
    yield made
    made.discard()


def detected(library, kind, pose=None, box=None, size=(0.0, 0.0, 0.0), score=0.9, more=(), **parameters):
    """The object of one detection, with poses of its hypothesis and of its box."""
    given = [(kind, score), *more]
    results = [
        SimpleNamespace(
            hypothesis=SimpleNamespace(class_id=name, score=own), pose=pose or PoseWithCovariance()
        )
        for name, own in given
    ]
    bbox = SimpleNamespace(center=box or Pose(), size=Vector3(x=size[0], y=size[1], z=size[2]))
    one = SimpleNamespace(header=Header(), results=results, id="one", bbox=bbox)
    message = SimpleNamespace(header=Header(frame_id="world"), detections=[one])
    (found,) = read_detections(message, library, Settings(**parameters)).objects
    return found


def turned():
    """The pose of a point, with its covariance."""
    return PoseWithCovariance(
        pose=pose_message(PLACE, TURN.as_quat()), covariance=np.diag([1e-4] * 3 + [1e-2] * 3).ravel()
    )


def point_of(found, library, at):
    """Where a point of the box of an object's model lies; ``at`` is its share of the height."""
    model = library.shape(found.model)
    low, high = model.corners - model.origin
    point = 0.5 * (low + high)
    point[2] = low[2] + at * (high[2] - low[2])
    return position_of(found.pose) + Rotation.from_quat(orientation_of(found.pose)).apply(point)


@pytest.mark.parametrize(("origin", "at"), [("base", 0.0), ("center", 0.5)])
def test_a_class_has_its_model_and_the_point_of_its_poses(library, origin, at):
    found = detected(library, "Dose", turned(), class_models=(f"Dose=can@{origin}",))
    assert found.model == "can"
    np.testing.assert_allclose(point_of(found, library, at), PLACE, atol=1e-12)
    plain = detected(library, "Dose", turned(), class_models=("Dose=can",))
    assert plain.model == "can" and plain.pose == turned()


def test_the_covariance_is_that_of_the_model_s_origin():
    """Against samples; errors of angles that were not measured move no point."""
    offset, given = np.array([0.1, 0.02, -0.2]), turned()
    P = np.reshape(moved_pose(given, offset).covariance, (6, 6))
    rng = np.random.default_rng(0)
    errors = rng.multivariate_normal(np.zeros(6), 1e-4 * np.reshape(given.covariance, (6, 6)), 20_000)
    moved = errors[:, :3] + (Rotation.from_rotvec(errors[:, 3:]) * TURN).apply(offset) - TURN.apply(offset)
    sampled = 1e4 * np.cov(np.hstack([moved, errors[:, 3:]]).T)
    np.testing.assert_allclose(P, sampled, atol=0.03 * P.diagonal().max())
    given.covariance[35] = 9999.0
    assert moved_pose(given, offset).covariance[0] < 1e-3
    given.covariance[0] = -1.0
    assert moved_pose(given, offset).covariance[0] == -1.0


def test_a_box_is_the_pose_where_the_hypothesis_has_only_defaults(library):
    box = turned().pose
    found = detected(library, "can", box=box)
    np.testing.assert_allclose(point_of(found, library, 0.5), PLACE, atol=1e-12)
    assert detected(library, "can", turned(), box=Pose()).pose == turned()


def test_a_box_is_the_shape_of_a_class_without_a_model(library):
    size = 0.2, 0.1, 0.3
    found = detected(library, "parcel", turned(), box=turned().pose, size=size, tracked_mass=0.7)
    assert (found.model, found.mass) == ("parcel", 0.7)
    model = library.shape("parcel")
    np.testing.assert_allclose(np.ptp(model.corners, axis=0), size, atol=1e-9)
    assert position_of(found.pose) == pytest.approx(PLACE)
    detected(library, "parcel", box=turned().pose, size=(0.21, 0.1, 0.3))
    assert library.shape("parcel") is model  # the first detection's


def test_the_best_valid_hypothesis_counts(library):
    found = detected(library, "mug", turned(), score=float("nan"), more=[("can", 0.3), ("brick", 0.2)])
    assert found.model == "can"
