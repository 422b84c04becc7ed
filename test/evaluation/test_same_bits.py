"""The verdict on bits names what differs, of the present sources alone."""

import numpy as np
import pytest

from unc_physics_evaluation import served_predictions
from unc_physics_evaluation.experiments import same_bits
from unc_physics_evaluation.jobs import Job, Outcome, Row, Settings
from unc_physics_evaluation.results import Results

ORIGIN = {"versions": "", "machine": ""}


@pytest.fixture
def results(tmp_path):
    """Rows of two sources: of the present ones all arrays are the same."""
    results = Results(tmp_path)
    for after, same in ((same_bits.fingerprint(same_bits.ROOT), 1), ("another", 0)):
        rows = [Row("surrogate", f"{same_bits.SAME}, two pins, mean {k}", "1", same or k) for k in range(2)]
        results.add(
            Job("same_bits", {"kind": "explicit", "before": same_bits.BEFORE, "after": after}),
            Outcome(rows),
            ORIGIN,
        )
    return results


def test_all_the_same(results):
    assert same_bits.verdict(results) == "all the same: 2 arrays of 1 predictions"
    assert "| two pins | surrogate | 2 | same bits |" in same_bits.report(results)


def test_what_differs_is_named(results, monkeypatch):
    monkeypatch.setattr(same_bits, "fingerprint", lambda folder: "another")
    assert same_bits.verdict(results) == "NOT THE SAME: two pins by surrogate"
    assert "**different: mean 0**" in same_bits.report(results)


def test_a_quick_look_compares_the_everyday_step_alone():
    if same_bits.missing(Settings()):
        pytest.skip("no git checkout with the reference revisions")
    kinds = [[job.parameters["kind"] for job in same_bits.jobs(Settings(quick))] for quick in (False, True)]
    assert kinds == [["everyday", "explicit"], ["everyday"]]


def test_a_change_of_the_last_bit_is_seen():
    states = np.ones((2, 1, 13))
    assert same_bits._same(states.copy(), states)
    assert not same_bits._same(np.nextafter(states, 2.0), states)


def test_everyday_examples_are_read_without_islands(tmp_path, monkeypatch):
    """A scene of a file of actions counts, a file with other physics does not."""
    bodies = "bodies: [{name: can, model: can, position: [0, 0, 1]}]"
    (tmp_path / "examples" / "any").mkdir(parents=True)
    for name, text in {
        "with_islands": f"physics: everyday\nislands: true\nhorizon: 0.5\n{bodies}",
        "actions": f"scene: {{physics: everyday, {bodies}}}\nactions: {{}}",
        "explicit": bodies,
    }.items():
        (tmp_path / "examples" / "any" / f"{name}.yaml").write_text(text)
    monkeypatch.chdir(tmp_path)
    found = {name: horizon for name, (_, _, horizon) in served_predictions.everyday_scenes().items()}
    assert found.pop("demo") > 0.0
    assert found == {"any/with_islands": 0.5, "any/actions": 1.0}
