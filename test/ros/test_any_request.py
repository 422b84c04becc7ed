"""Spoiled requests through the node's own functions, without DDS: an answer of finite numbers, or a sentence.

`soak` sends such over DDS, too.
"""

import random

import in_process
import pytest
from example_scenes import examples
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scenes import good_request, packed
from soak import LIMITS, TEXTS, check, spoiled

from unc_physics.propagators.names import ANYTIME, REFERENCE
from unc_physics.ros.models import ModelLibrary
from unc_physics.ros.parameters import Settings
from unc_physics_msgs.msg import PredictionRequest

SETTINGS = Settings(zero_covariance="exact", **LIMITS)
LIBRARY = ModelLibrary()


def answer_to(request):
    """The node's response; those of other propagators, whose kernels are compiled elsewhere, are empty."""
    return in_process.answer_to(
        request, SETTINGS, LIBRARY, computed=lambda job: job.propagator.name in (ANYTIME, REFERENCE)
    )


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
    spoiled_object.id, request.propagator = name, ANYTIME
    spoiled_object.model = model or "bunny"
    position = spoiled_object.pose.pose.position
    position.x, position.y, spoiled_object.mass = numbers
    check_sentence(answer_to(request))


@pytest.mark.parametrize("count", [10**4, 10**6])
def test_a_request_of_many_numbers_is_refused_at_once(count):
    request = good_request()
    request.scene.objects[0].covariance = packed([0.0] * count)
    response = answer_to(request)
    check_sentence(response)
    assert response.result.error_code
    assert answer_to(PredictionRequest()).result.error_code
