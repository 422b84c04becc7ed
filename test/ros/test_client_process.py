"""The id of a request's client, which rclpy does not show."""

import ctypes
import subprocess
import sys
from types import SimpleNamespace

import pytest
import rclpy
from running import READY_TIMEOUT, wait_until
from std_srvs.srv import Empty

from unc_physics.ros.client_process import ClientProcess, participant_of

PREFIX = 12  # bytes of an endpoint's id that all endpoints of a participant share


class Header:
    """Object whose first word after its head is an address, like that of a header."""

    __slots__ = ("place", "sequence_number")

    def __init__(self, place, sequence_number=0):
        self.place, self.sequence_number = place, sequence_number


@pytest.fixture
def sent():
    """Header of a request as the middleware delivers it, and the participant of its client."""
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("asker", context=context)
    service = node.create_service(Empty, "~/ask", lambda _, response: response)
    client = node.create_client(Empty, "~/ask")
    assert client.wait_for_service(READY_TIMEOUT)
    client.call_async(Empty.Request())
    taken = []

    def take():
        with service.handle:
            request, info = service.handle.service_take_request(Empty.Request)
        if request is not None:
            taken.append(info.request_id)
        return taken

    def endpoints():
        return node.get_publishers_info_by_topic("/rosout")

    wait_until(take)
    wait_until(endpoints)
    yield taken[0], bytes(next(one.endpoint_gid for one in endpoints() if one.node_name == "asker"))[:PREFIX]
    node.destroy_node()
    context.try_shutdown()


def test_the_client_of_a_request_is_known(sent):
    header, participant = sent
    assert len(participant) == PREFIX and any(participant)
    assert participant_of(header) == participant


@pytest.mark.parametrize(
    "header",
    [
        object(),
        SimpleNamespace(sequence_number=7),
        SimpleNamespace(sequence_number="7"),
        Header("no address"),
        Header(None, -1),
    ],
)
def test_other_objects_have_no_client(header):
    assert participant_of(header) == b""


@pytest.mark.parametrize("address", [0, 8, 1 << 46, (1 << 64) - 8])
def test_an_address_without_memory_is_no_fault(address, monkeypatch):
    """A structure that moved in another version of rclpy: any word may stand where its address stood."""
    word = ctypes.c_uint64(address)
    header = SimpleNamespace(sequence_number=0)
    place = ctypes.addressof(word) - object.__basicsize__
    monkeypatch.setattr("unc_physics.ros.client_process.id", lambda _: place, raising=False)
    assert participant_of(header) == b""


def test_a_killed_process_has_ended_before_its_parent_has_waited_for_it(sent):
    """Nor does it take the middleware's lease of 20 s."""
    _, own = sent
    code = "import sys, rclpy; rclpy.init(); print('running', flush=True); sys.stdin.read()"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    other = subprocess.Popen([sys.executable, "-c", code], **pipes, text=True)
    assert other.stdout.readline() == "running\n"
    process = ClientProcess(own[:4] + (other.pid % 65536).to_bytes(2, "little") + own[6:], own + bytes(4))
    assert not process.has_ended
    other.kill()
    wait_until(lambda: process.has_ended)
    process.close()
    other.communicate()


def test_a_participant_of_another_machine_is_not_watched():
    process = ClientProcess(bytes(range(12)), bytes(range(1, 17)))
    assert not process.has_ended
    process.close()
