"""A node in a process of its own, and a client to talk to it over real Fast DDS."""

import os

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 (rclpy)")
pytest.importorskip("unc_physics_msgs", reason="needs the interface package unc_physics_msgs")

# before any participant exists; child processes inherit all of it
os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
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
