"""Events as the command line has them: keys and arguments follow from the classes."""

import json
from dataclasses import dataclass

import numpy as np
import pytest
import yaml
from example_scenes import two_bodies

from unc_physics import AtRest, BoxRegion, FellOff, InRegion, Touches, Upright
from unc_physics.__main__ import main
from unc_physics.checks.errors import InvalidRequestError
from unc_physics.prediction.event_entries import event_from_text
from unc_physics.prediction.events import EVENTS, BodyEvent, register_event
from unc_physics.spatial.layout import VELOCITY

BIN = BoxRegion("bin", (1.0, 2.0, 3.0))


@pytest.fixture
def faster_than():
    """A class of events with a required number, which is registered during a test."""

    @register_event
    @dataclass(frozen=True, eq=False)
    class FasterThan(BodyEvent):
        """The body's centre of mass is faster than a limit."""

        speed: float

        def distances(self, outcomes):
            return np.linalg.norm(self.states(outcomes)[:, VELOCITY], axis=1) - self.speed

        def __str__(self):
            return f"{self.object} faster than {self.speed:g} m/s"

    yield FasterThan
    del EVENTS["faster_than"]


@pytest.mark.parametrize(
    ("text", "event"),
    [
        ("upright: cup", Upright("cup")),
        ("{at_rest: {object: cup, speed: 0.5}}", AtRest("cup", speed=0.5)),
        ("{upright: {object: cup, axis: [0, 0, 2], angle: 1e-1}}", Upright("cup", (0, 0, 1), 0.1)),
        ("{touches: {object: cup, other: pot}}", Touches("pot", "cup")),
        ("{fell_off: {object: cup, support: shelf, drop: null}}", FellOff("cup", "shelf")),
        ("{in_region: {object: cup, region: {name: bin, size: [1, 2, 3]}}}", InRegion("cup", BIN)),
        ("{not: {at_rest: cup}}", ~AtRest("cup")),
    ],
)
def test_a_text_is_an_event(text, event):
    assert event_from_text(text, "--event") == event


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("upright: [", "--event must be an event in YAML"),
        ("upright", "--event must be a mapping with one key of in_region, at_rest, "),
        ("faster_than: can", "--event.faster_than.speed must be given"),
        ("faster_than: {object: can, speed: quick}", "--event.faster_than.speed must be a number"),
        ("faster_than: {object: can, speed: [1]}", "--event.faster_than.speed must be a number"),
        ("faster_than: {speed: 1}", "--event.faster_than.object must be given"),
        ("faster_than: {object: can, sped: 1}", "--event.faster_than has no key 'sped'; did"),
        ("faster_than: [can, 1]", "--event.faster_than must be a mapping of keys to values"),
        ("at_rest: {object: can, speed: -1}", "--event.at_rest.speed must be positive"),
        ("upright: {object: can, axis: 1}", "--event.upright.axis must be a list of 3 numbers"),
        ("touches: {object: can, other: 3}", "--event.touches.other must be a non-empty text"),
        ("in_region: {object: can, region: bin}", "--event.in_region.region must be a mapping"),
        ("in_region: {object: can, region: {name: bin}}", "--event.in_region.region must have a name and"),
    ],
)
def test_a_wrong_event_is_told_in_a_sentence(text, sentence, faster_than):
    with pytest.raises(InvalidRequestError) as caught:
        event_from_text(text, "--event")
    assert str(caught.value).startswith(sentence)


def test_a_new_class_is_known_to_the_command_line(faster_than, tmp_path, capsys):
    text = "faster_than: {object: left, speed: 2}"
    assert event_from_text(text, "--event") == faster_than("left", 2.0)
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(two_bodies() | {"horizon": 0.01}))
    answers = []
    for limit in (1.0, 2.0):  # it begins at 1.503 m/s, std 0.02 m/s
        events = [f"faster_than: {{object: left, speed: {limit}}}", "{not: {at_rest: left}}"]
        arguments = ["predict", str(path), "--json", "--propagator", "monte_carlo", "--samples", "50"]
        assert main([*arguments, "--event", events[0], "--event", events[1]]) == 0
        answers.append(json.loads(capsys.readouterr().out)["probabilities"])
    assert [answer[0]["estimate"] for answer in answers] == [1.0, 0.0]
    assert [answer["event"] for answer in answers[0]] == ["left faster than 1 m/s", "not left at rest"]
