"""The command ``evaluate`` as a user calls it."""

import pytest

from unc_physics.__main__ import main
from unc_physics.checks.errors import ErrorCode
from unc_physics_evaluation.experiments import BY_NAME


def test_an_experiment_named_alone(tmp_path, capsys, monkeypatch):
    """Interrupted at first, then finished, then asked for again."""

    def interrupted(bar):
        raise KeyboardInterrupt

    folder = tmp_path / "results"
    arguments = ["evaluate", "collision_free", "--quick", "--workers", "1", "-o", str(folder)]
    with monkeypatch.context() as patch:
        patch.setattr("tqdm.tqdm.refresh", interrupted)
        assert main(arguments) == 130
    assert capsys.readouterr().err.endswith(
        f"interrupted: what is finished is kept in {folder}; the same command goes on there\n"
    )
    assert main(arguments) == 0
    assert capsys.readouterr().out.endswith(f"wrote {folder}/report.md\n")
    report = (folder / "report.md").read_text()
    lines = {line.split(" | ")[0]: line for line in report.splitlines()}
    assert lines["| MC-100"].split(" | ")[3] == "0.00940", "the paper's Table 2"
    assert {"| surrogate", "| sigma points, full", "| floor"} <= set(lines)
    before = (folder / "collision_free.csv").read_bytes()
    assert main(arguments) == 0
    assert (folder / "collision_free.csv").read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (["colision_free"], ErrorCode.INVALID_OPTION, "experiment must be one of collision_free"),
        (["--workers", "0"], ErrorCode.INVALID_OPTION, "--workers must be at least 1 (got 0)"),
        (["--seed", "-1"], ErrorCode.INVALID_OPTION, "--seed must not be negative (got -1)"),
    ],
)
def test_bad_input_is_one_sentence(arguments, code, sentence, tmp_path, capsys):
    assert main(["evaluate", *arguments, "-o", str(tmp_path)]) == code
    assert capsys.readouterr().err.startswith(f"unc_physics: {sentence}")


@pytest.mark.parametrize(
    ("name", "place", "value", "sentence"),
    [
        ("same_bits", "same_bits.BEFORE", "0" * 40, "is no git checkout that has the commit 000"),
        ("packing", "packing.find_spec", lambda name: None, "is not installed; pip install libigl"),
    ],
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
