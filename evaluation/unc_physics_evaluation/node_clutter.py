"""What a node in a process of its own answers to requests about clutter, and what it takes for it."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from unc_physics.prediction.prediction import Prediction
from unc_physics.propagators.base import Propagator
from unc_physics.ros.prediction_reader import read_answer
from unc_physics.ros.request_writer import Question, write_request
from unc_physics.scene.belief import Belief
from unc_physics.scene.scene import Scene
from unc_physics_msgs.srv import ListModels, Predict

from .node_latency import READY_TIMEOUT, processes, round_trip, spinning_client, until_ready
from .scores import rms

WARM_UP = 10  # requests


class Answer(NamedTuple):
    """A node's answer, and what it took.

    Attributes
    ----------
    prediction : Prediction
    rollouts : int
    mean_error : float
        Standard error of the means over the standard deviation, as the status says: root mean square over
        the bodies; NaN where it does not.
    round_trip, cpu_time : float
        Wall time at the client, and CPU time of the node, NaN where the system does not tell [s].
    """

    prediction: Prediction
    rollouts: int
    mean_error: float
    round_trip: float
    cpu_time: float


def ask(
    case: tuple[Scene, Belief, float], propagators: Mapping[str, Propagator], calls: int
) -> dict[str, list[Answer]]:
    """Answers to so many requests for each propagator, in turns, each with a seed of its own.

    Raises
    ------
    UncPhysicsError
        If the node is not ready in time, or answers with an error.
    """
    scene, belief, horizon = case
    steps = [round(horizon / scene.dt)]
    found = {name: [] for name in propagators}
    node = ["node", "--ros-args", "--log-level", "warn"]
    with processes([node]) as (process,), spinning_client() as (client, _):
        predict = client.create_client(Predict, "/unc_physics/predict")
        until_ready(predict, process)
        models = client.create_client(ListModels, "/unc_physics/list_models")
        models.wait_for_service(READY_TIMEOUT)
        known = {info.name: info for info in models.call(ListModels.Request()).models}
        for k in range(-WARM_UP, calls):
            for name, propagator in propagators.items():
                seed = 1 + k % calls
                question = Question(scene, belief, propagator, seed, steps, None, 0, (), False, False, False)
                request = Predict.Request(request=write_request(question, known.__getitem__))
                before = _cpu_time(process.pid)
                took, answer = round_trip(predict, request)
                prediction = read_answer(answer.result, answer.prediction, question)
                if k >= 0:
                    spent = _cpu_time(process.pid) - before
                    told = _mean_error(answer.prediction)
                    found[name].append(Answer(prediction, answer.prediction.rollouts, told, took, spent))
    return found


def _mean_error(message):
    values = (pair for each in message.objects for pair in each.status_values)
    told = [float(pair.value) for pair in values if pair.key == "mean_error"]
    return rms(np.array(told)) if told else math.nan


def _cpu_time(process):
    """CPU time of a process with all its threads [s]; NaN where the system does not tell."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return math.nan
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
