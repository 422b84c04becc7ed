"""The id of a request's client, which rclpy does not show; `test_long_prediction` kills such clients."""

import ctypes
from types import SimpleNamespace

import pytest

from unc_physics.ros.client_process import ClientProcess, participant_of


@pytest.mark.parametrize("header", [object(), SimpleNamespace(sequence_number="7")])
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


def test_a_participant_of_another_machine_is_not_watched():
    process = ClientProcess(bytes(range(12)), bytes(range(1, 17)))
    assert not process.has_ended
    process.close()
