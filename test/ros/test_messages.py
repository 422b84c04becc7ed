"""Every message goes over real DDS with all of its fields."""

import inspect
import itertools
import time

import pytest
from message_fields import OWN, filled
from running import Client, Inbox, wait_until

from unc_physics_msgs import msg

TYPES = sorted(name for name, kind in inspect.getmembers(msg, inspect.isclass))


@pytest.fixture(scope="module")
def other():
    """A second client, with a participant of its own."""
    with Client() as made:
        yield made


@pytest.mark.parametrize("name", TYPES)
def test_every_field_arrives(client, other, name):
    kind, topic = getattr(msg, name), f"/every_field/{name}"
    sent = filled(f"{OWN}/{name}", itertools.count(1))
    publisher = client.node.create_publisher(kind, topic, 1)
    with Inbox(other, kind, topic) as inbox:
        wait_until(lambda: publisher.get_subscription_count() == 1)
        time.sleep(0.1)
        publisher.publish(sent)
        assert inbox.next() == sent
    client.node.destroy_publisher(publisher)
