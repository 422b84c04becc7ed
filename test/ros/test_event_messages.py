"""Events in messages: each class has its constant and field."""

from unc_physics import AtRest, FellOff, Upright
from unc_physics.prediction.events import EVENTS
from unc_physics.ros.messages.events import EVENT_MESSAGES, object_events
from unc_physics_msgs.msg import PredictedObject, Score


def test_constants_and_fields_have_the_keys_of_files():
    assert set(EVENT_MESSAGES) == set(EVENTS.values())
    fields = PredictedObject.get_fields_and_field_types()
    for key, kind in EVENTS.items():
        row = EVENT_MESSAGES[kind]
        assert row.quantity == getattr(Score, key.upper())
        assert row.probability in ("", key) and (row.probability == key) == (key in fields)


def test_the_events_of_an_object_need_nothing_else():
    assert object_events(["cup"]) == [AtRest("cup"), Upright("cup"), FellOff("cup")]
