"""Files that users start from: parameters, documents, launch files, examples."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from message_fields import element_type, message_type
from running import ANSWER_TIMEOUT, NodeProcess
from scenes import assert_answered

from unc_physics.ros.messages.fields import seconds
from unc_physics.ros.parameters import parameter_file
from unc_physics_msgs import srv

ROOT = Path(__file__).resolve().parents[2]


def test_the_parameter_file_is_up_to_date():
    assert (ROOT / "config" / "unc_physics.yaml").read_text() == parameter_file() + "\n"


def test_a_node_starts_with_the_parameter_file_and_without_models_or_kernels():
    others = "-p", "models_dir:=/nowhere", "-p", "warm_up:=['']"
    with NodeProcess("--params-file", str(ROOT / "config" / "unc_physics.yaml"), *others) as process:
        assert process.end() == 0
        assert "models_dir is no folder: /nowhere" in process.output


def test_rviz_shows_covariances_in_the_fixed_frame():
    content = yaml.safe_load((ROOT / "config" / "predict.rviz").read_text())
    displays = {display["Class"]: display for display in content["Visualization Manager"]["Displays"]}
    covariance = displays["rviz_default_plugins/PoseWithCovariance"]["Covariance"]
    assert covariance["Orientation"]["Frame"] == "Fixed"


def calls(document):
    """Each ``ros2 service call`` of a document: the service's type, and its request in YAML."""
    text = (ROOT / document).read_text()
    return re.findall(r'ros2 service call \S+ unc_physics_msgs/srv/(\w+) "(.*?)"', text, re.DOTALL)


def fill(message, content):
    """Set fields of a message as the command line does from YAML."""
    for name, value in content.items():
        element, count = element_type(message.get_fields_and_field_types()[name])
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        elif count is not None and "/" in element:
            made = [message_type(element)() for _ in value]
            for entry, own in zip(made, value, strict=True):
                fill(entry, own)
            setattr(message, name, made)
        elif count is not None and element == "double":
            setattr(message, name, np.array(value, float))
        else:
            setattr(message, name, float(value) if element == "double" else value)


@pytest.mark.parametrize("document", ["docs/tutorials/ros.md", "docs/reference/ros.md"])
def test_the_calls_of_the_documents_are_answered(node, client, document):
    (found,) = calls(document)
    kind = getattr(srv, found[0])
    sent = kind.Request()
    fill(sent, yaml.safe_load(found[1]))
    answer = client.call(kind, "/unc_physics/predict", sent)
    assert_answered(answer)
    assert [own.id for own in answer.prediction.objects] == [own.id for own in sent.request.scene.objects]
    assert seconds(answer.prediction.time_reached) == pytest.approx(seconds(sent.request.horizon))


def output_of(example):
    """What an example prints beside a running node; the document names it."""
    assert f"examples/{example}" in (ROOT / "docs" / "reference" / "ros.md").read_text()
    done = subprocess.run(
        [sys.executable, str(ROOT / "examples" / example)],
        check=False,
        capture_output=True,
        text=True,
        timeout=ANSWER_TIMEOUT,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_smallest_client_runs(node):
    assert len(re.findall(r"^0\.\d s: ", output_of("predict_client.py"), re.MULTILINE)) == 5


def test_release_poses_over_the_bin_s_middle_are_better_than_those_beside_it(node):
    shares = {
        name: int(share)
        for name, share in re.findall(r"^([\d.]+) m +(\d+)%", output_of("drop_into_bin.py"), re.MULTILINE)
    }
    assert len(shares) == 6
    assert shares["0.00"] == 100 and shares["0.20"] == 0
    assert 5 < shares["0.14"] < 95
