"""The verdict on bits names what differs, of the present sources alone."""

import numpy as np
import pytest

from unc_physics_evaluation.experiments import same_bits
from unc_physics_evaluation.jobs import Job, Outcome, Row
from unc_physics_evaluation.results import Results

ORIGIN = {"versions": "", "machine": ""}


@pytest.fixture
def results(tmp_path):
    """Rows of two sources: of the present ones all arrays are the same."""
    results = Results(tmp_path)
    for after, same in ((same_bits.fingerprint(same_bits.ROOT), 1), ("another", 0)):
        rows = [Row("surrogate", f"{same_bits.SAME}, two pins, mean {k}", "1", same or k) for k in range(2)]
        results.add(Job("same_bits", {"before": same_bits.BEFORE, "after": after}), Outcome(rows), ORIGIN)
    return results


def test_all_the_same(results):
    assert same_bits.verdict(results) == "all the same: 2 arrays of 1 predictions"
    assert "| two pins | surrogate | 2 | same bits |" in same_bits.report(results)


def test_what_differs_is_named(results, monkeypatch):
    monkeypatch.setattr(same_bits, "fingerprint", lambda folder: "another")
    assert same_bits.verdict(results) == "NOT THE SAME: two pins by surrogate"
    assert "**different: mean 0**" in same_bits.report(results)


def test_a_change_of_the_last_bit_is_seen():
    states = np.ones((2, 1, 13))
    assert same_bits._same(states.copy(), states)
    assert not same_bits._same(np.nextafter(states, 2.0), states)
