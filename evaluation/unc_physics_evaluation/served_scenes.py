"""A node in a separate process, and messages as from a robot's perception."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import numpy as np

from .jobs import Settings

POSITION_STD, ROTATION_STD = 0.004, 0.02  # m, rad: of a detected pose
_MODELS = ("can", "salt_box", "bottle", "can", "mug", "salt_box", "can", "brick", "bottle", "can")
_SPACING = 0.16  # m, between objects on the table
_BIN = (0.6, 0.4, 0.25, 0.01)  # m: length, width, height, thickness of walls
_DROP = 0.01  # m, of the objects above the bin's floor
_READY_TIMEOUT = 600.0  # s; a cold cache compiles everything
_END_TIMEOUT = 20.0  # s
#: Keys of the kinds of scenes.
BOX, TABLE, BIN = "box", "table", "bin"


def missing_ros(*_: Settings) -> list[str]:
    """Return ROS 2 if it is not installed."""
    return [] if find_spec("rclpy") else ["the node: it needs ROS 2 (rclpy)"]


@contextlib.contextmanager
def served(name: str, parameters: dict[str, Any]) -> Iterator[tuple[Any, int]]:
    """Start a node with parameters; yield an rclpy node in this process, spun in a thread, and its number."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    from unc_physics_msgs.srv import GetCapabilities

    options = [part for key, value in parameters.items() for part in ("-p", f"{key}:={value}")]
    command = [sys.executable, "-m", "unc_physics.ros.node", "--ros-args", "-r", f"__node:={name}", *options]
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("evaluation", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    with tempfile.TemporaryFile("w+") as log:
        process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)
        try:
            client = node.create_client(GetCapabilities, f"/{name}/get_capabilities")
            if not client.wait_for_service(_READY_TIMEOUT):
                log.seek(0)
                raise RuntimeError(f"the node did not get ready:\n{log.read()}")
            yield node, process.pid
        finally:
            process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_END_TIMEOUT)
            executor.shutdown()
            context.try_shutdown()
            thread.join(5.0)
            node.destroy_node()


def cpu_time(pid: int) -> float:
    """Return the CPU time of a process so far [s]; NaN if the system does not report it."""
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8") as file:
            fields = file.read().rpartition(")")[2].split()
    except OSError:
        return float("nan")
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def scene_message(kind: str, count: int, rng: np.random.Generator, at_rest: bool = False) -> Any:
    """Return the Scene of detected objects, with newly drawn errors of their poses.

    Parameters
    ----------
    kind : str
        `BOX`: a salt box on a table; `TABLE`: cans on a table; `BIN`: objects above the floor of a bin.
    count : int
        Number of objects.
    rng : Generator
    at_rest : bool
        Whether the objects are at rest; otherwise their velocities are unknown.
    """
    from unc_physics.ros.client import environment, make_message, object_state
    from unc_physics_msgs.msg import Scene

    if kind == BIN:
        length, width, height, wall = _BIN
        places = [
            ((k % 5 - 2) * length / 5.5, (k // 5 - 0.5) * width / 2.4, wall + _DROP) for k in range(count)
        ]
        sides = [((length, width, wall), (0.0, 0.0, 0.5 * wall))]
        for sign in (-1.0, 1.0):
            sides.append(((wall, width, height), (sign * 0.5 * length, 0.0, 0.5 * height)))
            sides.append(((length, wall, height), (0.0, sign * 0.5 * width, 0.5 * height)))
        surroundings = environment(boxes={f"side_{k}": side for k, side in enumerate(sides)})
    else:
        places = [((k % 5) * _SPACING, (k // 5) * _SPACING, 0.0) for k in range(count)]
        surroundings = environment(planes={"table": (0.0, 0.0, 1.0, 0.0)})
    models = {BOX: ("salt_box",), TABLE: ("can",), BIN: _MODELS}[kind]
    variances = np.repeat([POSITION_STD, ROTATION_STD], 3) ** 2
    objects = []
    for k, place in enumerate(places):
        turn = np.append(0.5 * rng.normal(0.0, ROTATION_STD, 3), 1.0)
        pose = [*(place + rng.normal(0.0, POSITION_STD, 3)), *(turn / np.linalg.norm(turn))]
        model = models[k % len(models)]
        objects.append(object_state(f"object_{k}", model, pose, variances, at_rest=at_rest))
    return make_message(Scene, objects=objects, environment=surroundings)


def wait_until(condition, timeout: float = 30.0) -> None:
    """Wait until a condition holds that another thread changes."""
    deadline = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > deadline:
            raise RuntimeError("nothing answers")
        time.sleep(0.02)
