"""Half a minute of random and malformed requests; `make soak` sends them for ten."""

import pytest
from soak import GROWTH_LIMIT, soak


@pytest.mark.slow
def test_half_a_minute_of_random_and_malformed_requests():
    growth, counts = soak(duration=30.0, requests=250, seed=1)
    assert growth < 2.0 * GROWTH_LIMIT  # memory is level after minutes only, which `make soak` waits for
    assert len(counts) > 10  # many kinds of errors, and predictions
    assert counts["NONE"] > 25
