"""Half a minute of random and malformed requests; `make soak` sends them for ten."""

import pytest
from soak import GROWTH_LIMIT, soak


@pytest.mark.slow
def test_half_a_minute_of_random_and_malformed_requests():
    growth, counts = soak(duration=30.0, requests=250, seed=1)
    assert growth < GROWTH_LIMIT
    assert len(counts) > 10  # many kinds of errors, and predictions
    assert counts["NONE"] > 25
