"""The page that shows what is streamed: a process over DDS, and what it draws."""

import re
import subprocess
import sys
import urllib.request
from array import array

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from running import NodeProcess, wait_until
from scenes import moving_object

from unc_physics_msgs.msg import Scene, TrackedObject, TrackedObjects

pytest.importorskip("viser", reason="the extra 'view' is not installed")

MODULE = "unc_physics.ros.view_node"


@pytest.fixture(scope="module")
def publisher(client):
    """Publishes scenes as a tracker does, to the topic that a node of the default name hears."""
    return client.node.create_publisher(Scene, "/unc_physics/scene", qos_profile_sensor_data)


def test_a_process_shows_what_is_streamed(publisher):
    with NodeProcess("-p", "port:=0", module=MODULE, name="page") as process:

        def shown():
            publisher.publish(Scene(objects=[moving_object()]))
            return re.findall(r"(http://127\.0\.0\.1:\d+) shows", process.output)

        wait_until(shown)
        with urllib.request.urlopen(shown()[0]) as page:
            assert page.status == 200 and b"<html" in page.read()
        assert process.end() == 0
    assert "Traceback" not in process.output


def test_the_page_follows_the_scene(publisher, client):
    from unc_physics.ros.view_node import ViewNode

    context = rclpy.Context()
    rclpy.init(context=context)
    settings = {"port": 0, "frames": 4, "ghosts": 2, "horizons": [0.1], "gravity": [0.0, 0.0, 0.0]}
    node = ViewNode(
        context=context,
        parameter_overrides=[Parameter(name, value=value) for name, value in settings.items()],
    )
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def shows(*objects):
        """Whether the page shows these, from the place where they are."""
        publisher.publish(Scene(objects=list(objects)))
        executor.spin_once(timeout_sec=0.1)
        if node.page is None:
            return False
        drawn = node.page.drawn.frames.positions[0, :, :2]  # centres of mass: right above the models' origins
        names = [body.name for body in node.page.drawn.scene.bodies]
        places = [[getattr(one.pose.position, axis) for axis in "xy"] for one in objects]
        return names == [one.id for one in objects] and np.allclose(drawn, places)

    def follows(tracked):
        """Whether the page shows this tracked object, and where it will be after 0.1 s."""
        of_tracker.publish(TrackedObjects(objects=[tracked]))
        executor.spin_once(timeout_sec=0.1)
        assert node.page is not None
        drawn, place = node.page.drawn.frames.positions, tracked.pose.pose.position
        if [body.name for body in node.page.drawn.scene.bodies] != [tracked.id]:
            return False
        ends = [[place.x, place.y], [place.x, place.y + 0.1 * tracked.twist.twist.linear.y]]
        return np.allclose(drawn[[0, -1], 0, :2], ends, atol=1e-3)

    of_tracker = client.node.create_publisher(TrackedObjects, "/unc_physics/tracked", 1)
    try:
        one = moving_object("box", "salt_box", (0.0, 0.0, 0.0))
        wait_until(lambda: shows(one))
        moved, can = moving_object("box", "salt_box", (0.3, 0.1, 0.0)), moving_object("can", "can")
        wait_until(lambda: shows(moved))
        wait_until(lambda: shows(moved, can))
        for bad in (moving_object("nobody", "no_such_model"), moving_object(position=(np.nan, 0.0, 0.0))):
            publisher.publish(Scene(objects=[bad]))
            executor.spin_once(timeout_sec=0.1)
        wait_until(lambda: shows(one))
        tracked = TrackedObject(id="can", model="can", covariance=array("d", np.eye(12).ravel() * 1e-6))
        tracked.pose.pose.position.x, tracked.twist.twist.linear.y = 0.7, 0.5
        wait_until(lambda: follows(tracked))
    finally:
        executor.shutdown()
        node.close()
        node.destroy_node()
        context.try_shutdown()


def test_a_parameter_that_cannot_be_is_one_line():
    command = [sys.executable, "-m", MODULE, "--ros-args", "-p", "dt:=0.0"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode != 0 and done.stderr.startswith("unc_physics_view: ")
    assert len(done.stderr.strip().splitlines()) == 1
