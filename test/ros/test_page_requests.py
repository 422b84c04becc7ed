"""The requests that the pages send from a shell: the node understands and answers them."""

import importlib
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from unc_physics.propagators.auto import FIRST_RUNS, Auto
from unc_physics.ros.messages.frames import Frames
from unc_physics.ros.messages.request import read_request
from unc_physics.ros.models import ModelLibrary
from unc_physics.ros.parameters import Settings
from unc_physics_msgs.srv import Predict

ROOT = Path(__file__).resolve().parents[2]
CALL = re.compile(r'ros2 service call /unc_physics/predict unc_physics_msgs/srv/Predict "(.*?)"', re.DOTALL)
SETTINGS = Settings()
FRAMES = object.__new__(Frames)  # of no node: it has the world's frame alone
FRAMES._world_frame, FRAMES._buffer = SETTINGS.world_frame, None
PAGES = "docs/tutorials/ros.md", "docs/reference/ros.md"


def filled(message, values):
    """A message with the fields of a mapping, as `ros2 service call` reads it; unknown names are errors."""
    kinds = message.get_fields_and_field_types()
    for name, value in values.items():
        element = re.search(r"<(\w+)/(\w+)", kinds[name])
        if isinstance(value, dict):
            filled(getattr(message, name), value)
        elif isinstance(value, list) and element is not None:
            kind = getattr(importlib.import_module(f"{element[1]}.msg"), element[2])
            setattr(message, name, [filled(kind(), one) for one in value])
        elif isinstance(value, list):
            setattr(message, name, [float(one) for one in value])
        else:
            setattr(message, name, type(getattr(message, name))(value))
    return message


@pytest.mark.parametrize("page", PAGES)
def test_a_request_of_the_page_is_answered(page):
    (text,) = CALL.findall((ROOT / page).read_text(encoding="utf-8"))
    request = filled(Predict.Request(), yaml.safe_load(text)).request
    library = ModelLibrary()
    job = read_request(request, SETTINGS, library, FRAMES)
    prediction = job.run()
    library.discard()
    assert [body.name for body in prediction.scene.bodies] == [one.id for one in request.scene.objects]
    assert prediction.time == request.horizon.sec + 1e-9 * request.horizon.nanosec
    assert np.isfinite(prediction.belief.covariance).all() and prediction.belief.covariance.any()


@pytest.mark.parametrize(
    ("goals", "expected"),
    [
        ({}, (0.5, FIRST_RUNS)),
        ({"propagator": "cloud"}, None),
        ({"wanted_position_error": 0.1}, (0.0, 0)),
        ({"time_budget": {"sec": 2}}, (2.0, 0)),
        ({"propagator_options": [{"key": "runs", "value": "64"}]}, (0.0, 0)),
    ],
)
def test_the_nodes_time_budget_is_for_requests_without_goals(goals, expected):
    (text,) = CALL.findall((ROOT / PAGES[0]).read_text(encoding="utf-8"))
    request = filled(Predict.Request(), yaml.safe_load(text)).request
    filled(request, goals)
    library = ModelLibrary()
    job = read_request(request, SETTINGS, library, FRAMES, time_budget=0.5)
    library.discard()
    own = job.propagator
    assert ((own.time, own.first) if isinstance(own, Auto) else None) == expected
    assert job.max_computation_time is None or "time_budget" in goals


def test_a_time_budget_that_is_used_up_leaves_the_first_rollouts():
    (text,) = CALL.findall((ROOT / PAGES[0]).read_text(encoding="utf-8"))
    request = filled(Predict.Request(), yaml.safe_load(text)).request
    library = ModelLibrary()
    job = read_request(request, SETTINGS, library, FRAMES, time_budget=1e-9)
    library.discard()
    assert len(job.run().at().rollout_states) == FIRST_RUNS
