"""The time that a request without goals may take by the node's parameter."""

import pytest
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import KeyValue
from in_process import FRAMES
from scenes import good_request

from unc_physics.propagators.auto import FIRST_RUNS, Auto
from unc_physics.ros.messages.request import TimeLimits, read_request
from unc_physics.ros.models import ModelLibrary
from unc_physics.ros.parameters import Settings


def job_of(of_node, **goals):
    limits = TimeLimits(budget=of_node)
    return read_request(good_request(**goals), Settings(), ModelLibrary(), FRAMES, limits=limits)


@pytest.mark.parametrize(
    ("goals", "expected"),
    [
        ({}, (0.5, FIRST_RUNS)),
        ({"propagator": "cloud"}, None),
        ({"wanted_position_error": 0.1}, (0.0, 0)),
        ({"time_budget": Duration(sec=2)}, (2.0, 0)),
        ({"propagator_options": [KeyValue(key="runs", value="64")]}, (0.0, 0)),
    ],
)
def test_the_nodes_time_budget_is_for_requests_without_goals(goals, expected):
    job = job_of(0.5, **goals)
    own = job.propagator
    assert ((own.time, own.first) if isinstance(own, Auto) else None) == expected
    assert job.max_computation_time is None or "time_budget" in goals


def test_a_time_budget_that_is_used_up_leaves_the_first_rollouts():
    assert len(job_of(1e-9).run().at().rollout_states) == FIRST_RUNS
