"""A node in a process of its own, and a client to talk to it over real Fast DDS."""

import contextlib
import fcntl
import os
import tempfile
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 (rclpy)")
pytest.importorskip("unc_physics_msgs", reason="needs the interface package unc_physics_msgs")


def own_domain():
    """A domain that no other test process of this user has, and the file that is locked for it."""
    for k in range(100):
        domain = 1 + (os.getpid() + k) % 100
        name = f"unc_physics_tests_{os.getuid()}_domain_{domain}"
        lock = (Path(tempfile.gettempdir()) / name).open("w")
        with contextlib.suppress(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return str(domain), lock
    raise RuntimeError("all domains are in use")


# before any participant exists; child processes inherit all of it
os.environ["ROS_DOMAIN_ID"], LOCK = own_domain()
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"

from running import Client, NodeProcess

from unc_physics import PROPAGATORS


@pytest.fixture(scope="session")
def node():
    """The node with its default parameters, but zeros as exactly known, models by path, and all propagators
    warm; shared.
    """
    # a first request would wait for its kernels
    with NodeProcess(zero_covariance="exact", allow_model_paths=True, warm_up=list(PROPAGATORS)) as process:
        yield process


@pytest.fixture(scope="session")
def client():
    """A client in this process; its calls go over DDS."""
    with Client() as made:
        yield made


@pytest.fixture
def predict(node, client):
    """Function that calls `~/predict` of the shared node."""
    return lambda request, **others: client.predict(request, **others)
