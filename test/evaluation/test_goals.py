"""What is met and what is missed is said in tables and in one sentence."""

from unc_physics_evaluation.goals import Figure, goal_tables, goals_met_by, ratio
from unc_physics_evaluation.jobs import Job, Outcome
from unc_physics_evaluation.results import Results
from unc_physics_evaluation.timing import timed

FIGURES = {
    "Times": [
        Figure("surrogate", "bunny", 5.04, "x", 5.0, note="1 ms"),
        Figure("surrogate", "pin", 4.9, "x", 5.0),
        Figure("overhead", "bunny", 0.08, "ms", 0.1, at_most=True),
    ],
    "Others": [Figure("fill", "pin", 85.0, "%")],
    "Nothing": [],
}


def test_tables_say_what_is_met():
    text = goal_tables(FIGURES)
    for line in (
        "| surrogate | bunny | 5.04 x | ≥ 5, met | 1 ms |",
        "| surrogate | pin | 4.90 x | **≥ 5, missed** |  |",
        "| overhead | bunny | 0.0800 ms | ≤ 0.1, met |  |",
        "| fill | pin | 85.0 % |  |  |",
    ):
        assert f"{line}\n" in text
    assert "Nothing" not in text


def test_one_sentence_names_what_is_missed():
    assert goals_met_by(lambda results: FIGURES)(None) == "2 of 3 goals met; missed: surrogate, pin"


def test_ratios_pair_the_rounds(tmp_path):
    """A round in which the machine was busy slows both, and changes no ratio."""
    clock = iter([0.0, 2.0, 2.0, 3.0, 3.0, 23.0, 23.0, 33.0, 33.0, 35.0, 35.0, 36.0])
    functions = {("slow", None, "time"): lambda k: None, ("fast", None, "time"): lambda k: None}
    results, job = Results(tmp_path), Job("scenes", {"rounds": 3})
    results.add(job, Outcome(timed(functions, 3, lambda: next(clock))), {"versions": "", "machine": ""})
    rows = results.rows("scenes")
    assert rows.where(method="slow").values().tolist() == [2.0, 20.0, 2.0]
    assert ratio(rows.where(method="slow"), rows.where(method="fast")) == 2.0
