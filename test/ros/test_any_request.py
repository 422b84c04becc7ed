"""Spoiled requests through the node's own functions, without DDS: an answer of finite numbers, or a sentence.

`soak` sends such over DDS, too.
"""

import random

import pytest
from example_scenes import examples
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scenes import good_request, packed
from soak import LIMITS, TEXTS, check, spoiled

from unc_physics.checks.errors import UncPhysicsError
from unc_physics.propagators.names import DEFAULT, REFERENCE
from unc_physics.ros.messages.fields import write_error
from unc_physics.ros.messages.frames import Frames
from unc_physics.ros.messages.prediction import write_answer
from unc_physics.ros.messages.request import read_request
from unc_physics.ros.models import ModelLibrary
from unc_physics.ros.parameters import Settings
from unc_physics_msgs.msg import PredictionRequest
from unc_physics_msgs.srv import Predict

SETTINGS = Settings(zero_covariance="exact", **LIMITS)
FRAMES = object.__new__(Frames)  # of no node: it knows the world's frame alone
FRAMES._world_frame, FRAMES._buffer = SETTINGS.world_frame, None
LIBRARY = ModelLibrary()


def answer_to(request):
    """The node's response to a request, with its result and its prediction."""
    response = Predict.Response()
    try:
        job = read_request(request, SETTINGS, LIBRARY, FRAMES, time_limit=SETTINGS.max_computation_time)
        if job.propagator.name in (DEFAULT, REFERENCE):  # the others' kernels are compiled elsewhere
            write_answer(response.prediction, request.scene.header, SETTINGS, job, job.run())
    except UncPhysicsError as error:
        write_error(response.result, error)
    return response


def check_sentence(response):
    """A known code; an error is one line that shows nothing of Python's inside."""
    check(response)
    text = response.result.error_msg
    assert text.isprintable() and "np." not in text and "object at 0x" not in text


@settings(max_examples=examples(150), suppress_health_check=[HealthCheck.too_slow])
@given(st.integers(0, 2**32 - 1))
def test_a_spoiled_request_gets_an_answer_or_a_sentence(seed):
    _, _, request = spoiled(random.Random(seed))
    check_sentence(answer_to(request.request))


@settings(max_examples=examples(60), suppress_health_check=[HealthCheck.too_slow])
@given(
    st.text(max_size=20) | st.sampled_from(TEXTS),
    st.text(max_size=20) | st.sampled_from(TEXTS),
    st.lists(st.floats(), min_size=3, max_size=3),
)
def test_any_text_and_number_of_an_object_gets_an_answer_or_a_sentence(name, model, numbers):
    request = good_request()
    spoiled_object = request.scene.objects[0]
    spoiled_object.id, request.propagator = name, DEFAULT
    spoiled_object.model = model or "bunny"
    position = spoiled_object.pose.position
    position.x, position.y, spoiled_object.mass = numbers
    check_sentence(answer_to(request))


@pytest.mark.parametrize("count", [10**4, 10**6])
def test_a_request_of_many_numbers_is_refused_at_once(count):
    request = good_request()
    request.scene.objects[0].belief.covariance = packed([0.0] * count)
    response = answer_to(request)
    check_sentence(response)
    assert response.result.error_code
    assert answer_to(PredictionRequest()).result.error_code
