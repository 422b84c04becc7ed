"""The command ``evaluate`` as a user calls it."""

import pytest

from unc_physics.__main__ import main
from unc_physics.checks.errors import ErrorCode
from unc_physics_evaluation.experiments import BY_NAME, paper


def test_an_experiment_named_alone(tmp_path, capsys, monkeypatch):
    """Interrupted at first, then finished, then asked for again."""

    def interrupted(bar, n=1):
        raise KeyboardInterrupt

    every = paper.jobs
    monkeypatch.setattr(
        paper,
        "jobs",
        lambda settings: [job for job in every(settings) if job.parameters["section"] == "storage"],
    )
    folder = tmp_path / "results"
    arguments = ["evaluate", "paper", "--quick", "--executor", "processes:1", "-o", str(folder)]
    with monkeypatch.context() as patch:
        patch.setattr("tqdm.tqdm.update", interrupted)
        assert main(arguments) == 130
    assert capsys.readouterr().err.endswith(
        f"interrupted: what is finished is kept in {folder}; the same command goes on there\n"
    )
    assert main(arguments) == 0
    assert capsys.readouterr().out.endswith(f"wrote {folder}/report.md\n")
    assert "| surrogate | n_x + B 12^2 | 314 | 314 |" in (folder / "report.md").read_text()
    before = (folder / "paper.csv").read_bytes()
    assert main(arguments) == 0
    assert (folder / "paper.csv").read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (["papers"], ErrorCode.INVALID_OPTION, "experiment must be one of paper"),
        (["--executor", "threads:2"], ErrorCode.INVALID_OPTION, "executor must be processes:N"),
        (["--seed", "-1"], ErrorCode.INVALID_OPTION, "--seed must not be negative (got -1)"),
        (["paper", "--method", "cloudy"], ErrorCode.UNKNOWN_PROPAGATOR, "propagator must be one of"),
        (["paper", "--method", "cloud run=9"], ErrorCode.INVALID_OPTION, "run is no option of cloud"),
        (
            ["orders", "--method", "cloud"],
            ErrorCode.INVALID_OPTION,
            "--method goes with the experiment paper",
        ),
    ],
)
def test_bad_input_is_one_sentence(arguments, code, sentence, tmp_path, capsys):
    assert main(["evaluate", *arguments, "-o", str(tmp_path)]) == code
    assert capsys.readouterr().err.startswith(f"unc_physics: {sentence}")


def test_a_report_without_rows_is_refused(tmp_path, capsys):
    folder = tmp_path / "mistyped"
    assert main(["evaluate", "paper", "--report", "-o", str(folder)]) == ErrorCode.INVALID_OPTION
    assert capsys.readouterr().err.startswith("unc_physics: --output has no rows to report on; run the same")
    assert not folder.exists()


@pytest.mark.parametrize(
    ("name", "place", "value", "sentence"),
    [("same_bits", "same_bits.BEFORE", "0" * 40, "is no git checkout that has the commit 000")],
)
def test_what_is_not_there_is_said(name, place, value, sentence, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(f"unc_physics_evaluation.experiments.{place}", value)
    assert main(["evaluate", name, "-o", str(tmp_path)]) == 0
    (said, wrote) = capsys.readouterr().out.splitlines()
    assert said.startswith(f"left out: {name}: ") and sentence in said
    assert f"* {name}: " in (tmp_path / "report.md").read_text()
    assert wrote.startswith("wrote ")


def test_help_tells_apart_what_runs_only_where_named(capsys):
    with pytest.raises(SystemExit):
        main(["evaluate", "--help"])
    listed, _, by_name = " ".join(capsys.readouterr().out.split()).partition("Only where named")
    assert "calibration" in listed and "same_bits" not in listed
    assert by_name.endswith(f": {', '.join(BY_NAME)}.") and "same_bits" in BY_NAME
