"""Recorded motions from files: what is read, and what is refused."""

import struct
import sys
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics import Motion, UncPhysicsError, read_motions
from unc_physics.calibration.motions import POSES, pose_in

HEAD = "time,x,y,z,qx,qy,qz,qw"


def poses(count=5):
    """Positions and quaternions (count, 7)."""
    turned = Rotation.from_rotvec(np.outer(np.arange(count), [0.0, 0.0, 0.1])).as_quat()
    return np.concatenate([np.arange(3.0 * count).reshape(count, 3), turned], axis=1)


def written(path, text):
    path.write_text(text)
    return path


def csv_text(columns, rows):
    return "\n".join([columns, *(",".join(map(str, row)) for row in rows)]) + "\n"


def test_csv_of_several_motions(tmp_path):
    rows = [[name, 10.0 + 0.1 * k, *pose] for name in "ab" for k, pose in enumerate(poses())]
    path = written(tmp_path / "m.csv", csv_text(f"motion,{HEAD}", rows))
    first, second = read_motions(path)
    assert (first.name, second.name) == ("a", "b")
    np.testing.assert_allclose(first.times, 0.1 * np.arange(5))
    np.testing.assert_allclose(second.poses, poses())
    assert first.duration == pytest.approx(0.4)


def test_a_folder_of_files(tmp_path):
    written(tmp_path / "one.csv", csv_text(HEAD, [[0.1 * k, *pose] for k, pose in enumerate(poses())]))
    states = np.zeros((7, 13))
    states[:, 9] = 1.0
    np.savez(tmp_path / "two.npz", states=states, offsets=[0, 3, 7], dt=0.01)
    assert [len(motion.times) for motion in read_motions(tmp_path)] == [5, 3, 4]


def test_positions_of_the_models_origin(tmp_path):
    path = written(tmp_path / "m.csv", csv_text(HEAD, [[k, *pose] for k, pose in enumerate(poses())]))
    origin = np.array([0.0, 0.1, 0.0])  # seen from the centre of mass
    (motion,) = read_motions(path, origin=origin)
    turned = Rotation.from_quat(poses()[:, 3:]).apply(origin)
    np.testing.assert_allclose(motion.poses[:, :3] + turned, poses()[:, :3])


def test_a_pose_between_two():
    motion = Motion("m", [0.0, 1.0, 3.0], poses(3) * [1, 1, 1, *[-1] * 4])
    np.testing.assert_allclose(motion.pose(2.0)[:3], [4.5, 5.5, 6.5])
    turn = Rotation.from_quat(motion.pose(2.0)[3:]) * Rotation.from_euler("z", -0.15)
    assert turn.magnitude() < 1e-6
    assert motion.nearest(0.6) == 1.0 and motion.nearest(1.9) == 1.0
    np.testing.assert_array_equal(motion.pose(-1.0), motion.poses[0])
    np.testing.assert_array_equal(motion.pose(9.0), motion.poses[-1])
    flipped = motion.poses.copy()
    flipped[2, 3:] *= -1.0  # the same rotation
    same = Motion("m", motion.times, flipped).pose(2.0)
    assert (Rotation.from_quat(same[3:]) * Rotation.from_euler("z", -0.15)).magnitude() < 1e-6


@pytest.mark.parametrize(
    "text, message",
    [
        ("time,x,y,z\n", "has no column 'qx'"),
        (csv_text(HEAD, [[0.0, "a", *poses()[0][1:]]]), "must hold numbers"),
        (csv_text(HEAD, [[0.0, *poses()[0]]] * 3), "must ascend"),
        (csv_text(HEAD, [[0.0, *poses()[0]]]), "at least three poses"),
        (csv_text(HEAD, [[k, *[0.0] * 7] for k in range(3)]), "orientation of pose 0"),
        (HEAD + "\n", "holds no motion"),
        (
            csv_text(HEAD, [[k, 1e300, *poses()[0][1:]] for k in range(3)]),
            "position of pose 0 .* must be within",
        ),
        (HEAD + "\n" + "1" * 200_000, "cannot be read: it is no table in UTF-8 text"),
    ],
)
def test_refused_files(tmp_path, text, message):
    with pytest.raises(UncPhysicsError, match=message):
        read_motions(written(tmp_path / "m.csv", text))


def test_refused_paths(tmp_path):
    with pytest.raises(UncPhysicsError, match="does not exist"):
        read_motions(tmp_path / "nothing.csv")
    with pytest.raises(UncPhysicsError, match="holds no .csv"):
        read_motions(tmp_path)
    with pytest.raises(UncPhysicsError, match="must be an .npz"):
        read_motions(written(tmp_path / "m.txt", ""))
    with pytest.raises(UncPhysicsError, match="is no .npz archive"):
        read_motions(written(tmp_path / "m.npz", "text"))
    with pytest.raises(UncPhysicsError, match="is no .npz archive"):
        read_motions(written(tmp_path / "m.npz", "PK\x03\x04 cut off"))
    (tmp_path / "m.csv").write_bytes(b"\x8e\xff")
    with pytest.raises(UncPhysicsError, match="m.csv cannot be read: it is no table in UTF-8 text"):
        read_motions(tmp_path / "m.csv")
    for offsets, names in (([], []), ([0.0, 3.0], ["a"]), ([0, 3], ["a", "b"])):
        np.savez(tmp_path / "a.npz", states=np.zeros((3, 13)), dt=0.1, offsets=offsets, names=names)
        with pytest.raises(UncPhysicsError, match="whole offsets that end with total"):
            read_motions(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", states=np.zeros((3, 13)))
    with pytest.raises(UncPhysicsError, match="has no 'offsets'"):
        read_motions(tmp_path / "a.npz")


def test_a_rosbag_needs_its_reader(tmp_path, monkeypatch):
    (tmp_path / "metadata.yaml").write_text("")
    monkeypatch.setattr("unc_physics.calibration.motions.find_spec", lambda name: None)
    with pytest.raises(UncPhysicsError, match="write a CSV file"):
        read_motions(tmp_path)


class Bag:
    """A reader of a rosbag with poses of two topics, and messages of another topic between them."""

    topics: ClassVar = {
        "/a": "geometry_msgs/msg/PoseStamped",
        "/b": "nav_msgs/msg/Odometry",
        "/c": "std_msgs/msg/Int8",
    }

    def open(self, storage, conversion):
        assert storage.endswith("bag") and conversion == ("cdr", "cdr")
        self.rows = [(name, k) for k in range(4) for name in ("/c", *self.topics)]

    def get_all_topics_and_types(self):
        return [SimpleNamespace(name=name, type=kind) for name, kind in self.topics.items()]

    def has_next(self):
        return bool(self.rows)

    def read_next(self):
        name, k = self.rows.pop(0)
        frames = struct.pack("<xBxxiII4s", 1, 5, 250_000_000 * k, 4, b"map")
        frames += struct.pack("<I4s", 4, b"box") if name == "/b" else b""
        frames += bytes(-(len(frames) - 4) % 8)
        return name, frames + struct.pack("<7d", k, *poses()[k][1:]), 0


@pytest.mark.parametrize(
    ("topics", "topic", "found"),
    [
        ("/a /b", "/b", "/b"),
        ("/a /b", "/a", "/a"),
        ("/b /c", None, "/b"),
        ("/a /b", None, "topic must name one of the bag's topics with poses: /a, /b"),
        ("/c", None, "topic must name one .*: none of geometry_msgs/msg/PoseStamped"),
        ("/a /c", "/c", r"topic must be one of /a \(got '/c'\)"),
    ],
)
def test_poses_of_one_topic_of_a_rosbag(tmp_path, monkeypatch, topics, topic, found):
    module = SimpleNamespace(
        SequentialReader=Bag, StorageOptions=lambda uri: uri, ConverterOptions=lambda *both: both
    )
    monkeypatch.setitem(sys.modules, "rosbag2_py", module)
    monkeypatch.setattr("unc_physics.calibration.motions.find_spec", lambda name: module)
    monkeypatch.setattr(Bag, "topics", {name: kind for name, kind in Bag.topics.items() if name in topics})
    folder = tmp_path / "bag"
    folder.mkdir()
    (folder / "metadata.yaml").write_text("")
    if not found.startswith("/"):
        with pytest.raises(UncPhysicsError, match=found):
            read_motions(folder, topic=topic)
        return
    (motion,) = read_motions(folder, topic=topic)
    assert motion.name == found
    np.testing.assert_allclose(motion.times, 0.25 * np.arange(4))
    np.testing.assert_allclose(motion.poses, np.c_[np.arange(4), poses(4)[:, 1:]])


@pytest.mark.parametrize("kind", POSES)
@pytest.mark.parametrize("frame", ["", "map", "a_longer_frame"])
def test_poses_in_messages(kind, frame):
    """What ROS' own serialization writes."""
    serialization = pytest.importorskip("rclpy.serialization")
    package, _, name = kind.split("/")
    message = getattr(pytest.importorskip(f"{package}.msg"), name)()
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = 12, 250_000_000
    if name == "Odometry":
        message.child_frame_id = "box"
    pose = message.pose if name == "PoseStamped" else message.pose.pose
    pose.position.x, pose.position.y, pose.position.z = 1.0, 2.0, 3.0
    pose.orientation.x, pose.orientation.w = 0.6, 0.8
    found = pose_in(serialization.serialize_message(message), kind)
    assert found == [12.25, 1.0, 2.0, 3.0, 0.6, 0.0, 0.0, 0.8]
