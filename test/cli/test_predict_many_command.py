"""The command ``predict-many``, on lines of which some cannot be predicted."""

import json
import os
import shutil

import pytest

from unc_physics.__main__ import main
from unc_physics.prediction.many import RequestLine
from unc_physics.shapes.library import find_model

parquet = pytest.importorskip("pyarrow.parquet")

SCENE = {
    "horizon": 0.1,
    "environment": [{"name": "floor", "plane": {"normal": [0, 0, 1], "offset": 0}}],
    "bodies": [{"name": "box", "model": "salt_box", "position": [0, 0, 0.07], "position_std": 0.002}],
}


def line(**changes):
    return json.dumps({"scene": SCENE, "propagator": "monte_carlo", "options": {"samples": 8}} | changes)


def rows(folder):
    return parquet.read_table(folder).sort_by([("number", "ascending"), ("time", "ascending")]).to_pylist()


def test_lines_are_predicted_and_bad_ones_named(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    event = {"touches": {"object": "box", "other": "floor"}}
    body = SCENE["bodies"][0]
    lines = [
        line(),
        line(scene=SCENE | {"bodies": [body | {"mass": -1.0}]}),
        "",
        line(times=[0.05, 0.1], events=[event], seed=9),
        line(options={"samples": 8, "colour": 1}),
        '{"scene": ',
    ]
    (tmp_path / "ask.jsonl").write_text("\n".join(lines))
    command = ["predict-many", "ask.jsonl", "-o", "answers"]
    assert main(command) == 20
    out, err = capsys.readouterr()
    assert out == "answers: 2 answers\n"
    assert "note: 3 lines have no answer: 2, 5, 6" in err
    assert "unc_physics: ask.jsonl, line 2: scene.bodies[0].mass must be positive (got -1.0)" in err
    found = rows("answers")
    assert [(row["number"], row["seed"], row["time"]) for row in found] == [
        (1, 1, 0.1),
        (4, 9, 0.05),
        (4, 9, 0.1),
    ]
    assert [one["event"] for one in found[1]["events"]] == ["box touches floor"]

    (tmp_path / "scene.yaml").write_text(json.dumps(SCENE))
    options = ["--propagator", "monte_carlo", "--samples", "8", "--seed", "1", "--json"]
    assert main(["predict", "scene.yaml", *options]) == 0
    said = json.loads(capsys.readouterr().out)
    (single,), (status,) = said["bodies"], said["statuses"]
    assert found[0]["position"] == single["position"]
    assert found[0]["covariance"] == [value for row in single["covariance"] for value in row]
    assert found[0]["flags"] == status["flags"] == ["OUTSIDE_VALIDITY"]  # by eight samples
    assert found[0]["reasons"] == status["reasons"]

    lines[1], lines[4:] = line(times=0.1), [line(propagator=3)]
    (tmp_path / "ask.jsonl").write_text("\n".join(lines))
    assert main([*command, "--executor", "processes:1"]) == 10
    out, err = capsys.readouterr()
    assert out == "answers: 3 answers, 2 of them earlier\n"
    assert "ask.jsonl, line 5: propagator must be a str, not an int" in err
    assert [row["number"] for row in rows("answers")] == [1, 2, 4, 4]


@pytest.mark.parametrize(
    ("bad", "named"),
    [
        ("3", "request must be a mapping"),
        (line(events={}), "events must be a list"),
        (line(events=[{"lies": "box"}]), "events[0] has no"),
        (line(times=["soon"]), "times[0] must be a number"),
        (line(times="soon"), "times[0] must be a number"),
        (line(seed=-1), "seed must be at least 0"),
        (line(horizon=2.0), "request has no key 'horizon'"),
        (line(scene=None), "scene must be a mapping"),
    ],
)
def test_errors_name_line_key_and_value(tmp_path, monkeypatch, capsys, bad, named):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ask.jsonl").write_text(bad)
    assert main(["predict-many", "ask.jsonl", "-o", "answers"]) > 2
    assert f"ask.jsonl, line 1: {named}" in capsys.readouterr().err


def test_lines_that_differ_in_beliefs_share_a_scene(tmp_path):
    """As long as the file of its model is unchanged."""
    model = shutil.copy(find_model("salt_box"), tmp_path / "box.npz")

    def scene_of(**changes):
        body = SCENE["bodies"][0] | {"model": "box.npz"} | changes
        return RequestLine(1, line(scene=SCENE | {"bodies": [body]}), folder=str(tmp_path)).read(1).scene

    first = scene_of()
    assert scene_of(position=[0, 0, 0.08], position_std=0.0, roll_pitch_yaw=[0, 0, 1]) is first
    for other in ({"mass": 2.0}, {"friction": 0.1}, {"name": "carton"}, {"scale": 0.5}):
        assert scene_of(**other) is not first
    shutil.copy(find_model("can"), model)
    os.utime(model, (0.0, 0.0))
    assert scene_of().bodies[0].model.name == "can"


def test_a_missing_file_is_named(tmp_path, capsys):
    assert main(["predict-many", str(tmp_path / "none.jsonl"), "-o", str(tmp_path)]) == 10
    assert "REQUESTS cannot be read: No such file" in capsys.readouterr().err
