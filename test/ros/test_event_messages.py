"""Events in messages: each class has its constant."""

from unc_physics import AtRest, FellOff, Upright
from unc_physics.prediction.events import EVENTS
from unc_physics.ros.messages.events import EVENT_ROWS, object_events
from unc_physics_msgs.msg import Event


def test_constants_have_the_keys_of_the_command_line():
    assert set(EVENT_ROWS) == set(EVENTS.values())
    for key, kind in EVENTS.items():
        assert EVENT_ROWS[kind][0] == getattr(Event, key.upper())


def test_the_events_of_an_object_need_nothing_else():
    assert object_events(["cup"]) == [AtRest("cup"), Upright("cup"), FellOff("cup")]
