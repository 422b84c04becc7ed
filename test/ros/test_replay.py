"""Bags that are replayed offline: calibration of a can that stands and one that falls."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from message_fields import message_type
from scenes import floor, measured

from unc_physics.checks.errors import ErrorCode
from unc_physics.ros.messages.fields import stamp_of
from unc_physics.ros.node_environment import NodeEnvironment
from unc_physics.ros.parameters import Settings
from unc_physics.ros.replay import POSE, main, replay, report

PERIOD, STD = 0.1, 0.004  # s, m


def poses(count, stated=STD, speed=0.0):
    """Detections of a can on the table, with errors of `STD` and another standard deviation stated."""
    rng, found = np.random.default_rng(1), []
    for k in range(count):
        error = rng.normal(0.0, STD, 3)
        place = error[0] + speed * k * PERIOD, error[1], abs(error[2])
        message = PoseWithCovarianceStamped(pose=measured(place, stated, 0.01))
        message.header.stamp = stamp_of(round(k * PERIOD * 1e9))
        found.append(message)
    return found


def definition(message):
    """The definition of a message and of those in it, as a bag has it."""
    fields = message.get_fields_and_field_types()
    text = "".join(f"{kind.replace('double', 'float64')} {name}\n" for name, kind in fields.items())
    nested = [kind for kind in fields.values() if "/" in kind]
    return text + "".join(f"{'=' * 80}\nMSG: {kind}\n{definition(message_type(kind))}" for kind in nested)


def plain(message):
    """The same message as the writer takes it, which knows no arrays."""
    if isinstance(message, np.ndarray):
        return message.tolist()
    if not hasattr(message, "get_fields_and_field_types"):
        return message
    names = message.get_fields_and_field_types()
    return SimpleNamespace(**{name: plain(getattr(message, name)) for name in names})


@pytest.fixture
def environment():
    made = NodeEnvironment()
    made.set([floor()])
    return made


@pytest.mark.parametrize(
    ("parameters", "low", "high"),
    [({}, 0.8, 1.0), ({"stated": 0.2 * STD}, 0.0, 0.5), ({"speed": 0.5}, 0.0, 0.1)],
)
def test_calibration_of_what_stands(environment, parameters, low, high):
    messages = [(k * PERIOD, POSE, message) for k, message in enumerate(poses(30, **parameters))]
    outcomes, left_out = replay(messages, environment, Settings(horizons=(0.2, 0.5)), "can")
    assert not left_out or parameters
    assert len(outcomes) == 28 + 25 or left_out
    assert low <= np.mean([outcome.square < 6.25 for outcome in outcomes]) <= high
    text = report(outcomes, left_out)
    assert "        0.2" in text and "90 % region" in text


def test_a_bag_from_the_command_line(tmp_path, capsys):
    writer_module = pytest.importorskip("mcap_ros2.writer", reason="needs mcap-ros2-support")
    bag = tmp_path / "bag.mcap"
    with bag.open("wb") as stream:
        writer = writer_module.Writer(stream)
        schema = writer.register_msgdef(POSE, definition(PoseWithCovarianceStamped))
        for k, message in enumerate(poses(8)):
            writer.write_message("/can", schema, plain(message), log_time=k)
        writer.finish()
    scene = tmp_path / "table.yaml"
    scene.write_text("environment:\n  - plane: {normal: [0, 0, 1], offset: 0.0}\n")
    assert main([str(bag), "--environment", str(scene), "--model", "can", "--horizons", "0.3"]) == 0
    found = capsys.readouterr().out.splitlines()
    assert found[1].split()[:2] == ["0.3", "5"]
    assert main([str(bag)]) == ErrorCode.INVALID_REQUEST
    assert "--model" in capsys.readouterr().err
    assert main([str(bag), "--topic", "/mug"]) == ErrorCode.INVALID_REQUEST
    assert "--topic" in capsys.readouterr().err


def test_a_bag_that_cannot_be_read(tmp_path, capsys, monkeypatch):
    assert main([str(tmp_path / "none.mcap")]) == ErrorCode.INVALID_REQUEST
    assert "is no bag" in capsys.readouterr().err
    (tmp_path / "empty.mcap").touch()
    monkeypatch.setitem(sys.modules, "mcap.reader", None)
    assert main([str(tmp_path)]) == ErrorCode.NOT_SUPPORTED
    assert "pip install mcap-ros2-support" in capsys.readouterr().err
