"""The command ``rank``, on scene files that differ in where a box is let go."""

import json
from dataclasses import asdict

import pytest
import yaml

from unc_physics import InRegion, Touches, Upright, load_scene, rank
from unc_physics.__main__ import main
from unc_physics.checks.errors import ErrorCode
from unc_physics.prediction.regions import BoxRegion

SHELF = {"name": "shelf", "box": {"size": [0.4, 0.2, 0.02], "position": [0, 0, -0.01]}}
ABOVE = "{in_region: {object: box, region: {name: above, size: [0.4, 0.2, 0.4], position: [0, 0, 0.2]}}}"
EVENTS = ["--event", ABOVE, "--event", "{not: {touches: {object: box, other: floor}}}"]
SHORT = ["--rollouts", "40", "--seed", "4"]
SCORE = InRegion("box", BoxRegion("above", (0.4, 0.2, 0.4), (0, 0, 0.2))) & ~Touches("box", "floor")


def scene(x, horizon=0.3, **body):
    box = {"name": "box", "model": "salt_box", "spheres": 20, "position": [x, 0, 0.1], "position_std": 0.02}
    floor = {"name": "floor", "plane": {"normal": [0, 0, 1], "offset": -0.3}}
    environment = {"physics": "everyday", "environment": [floor, SHELF]}
    return environment | {"horizon": horizon, "bodies": [box | body]}


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    contents = {
        "far.yaml": scene(0.4),
        "over.yaml": scene(0.0),
        "edge.yaml": scene(0.19),
        "cup.yaml": scene(0.0, name="cup"),
        "long.yaml": scene(0.0, horizon=0.4),
        "actions.yaml": {"scene": scene(0.0), "score": {"upright": "box"}, "actions": {"a": {}}},
    }
    for name, content in contents.items():
        (tmp_path / name).write_text(yaml.safe_dump(content))
    return ["far.yaml", "over.yaml", "edge.yaml"]


def test_files_are_ranked_as_in_python(files, capsys):
    loaded = {name: load_scene(name) for name in files}
    actions = {name: (one.scene, one.belief) for name, one in loaded.items()}
    expected = rank(*actions["far.yaml"], actions, SCORE, 0.3, rollouts=40, seed=4)
    assert main(["rank", *files, *EVENTS, *SHORT, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [row["name"] for row in told["actions"]] == ["over.yaml", "edge.yaml", "far.yaml"]
    for row, action in zip(told["actions"], expected, strict=True):
        assert row == {
            "name": action.name,
            "score": asdict(action.score),
            "difference": action.difference.value,
            "difference_std": action.difference.std,
            **{key: getattr(action, key) for key in ("margin", "tied", "clearly_worse", "rollouts")},
        }
    assert (told["rollouts"], told["seed"], told["score"]) == (expected.rollouts, 4, str(SCORE))
    assert main(["rank", *files, *EVENTS, *SHORT]) == 0
    table = capsys.readouterr().out
    assert table == f"{expected.table()}\n" and len(table.splitlines()) == 5
    head, columns, best, *_, last = table.splitlines()
    assert head == f"probability of: {SCORE}; {expected.rollouts} rollouts, seed 4"
    assert best.split()[0] == "over.yaml" and last.endswith("  clearly worse")
    end = columns.index("probability") + len("probability")
    assert float(best[:end].split()[1]) == pytest.approx(expected.best.score.estimate, abs=5e-4)


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (["far.yaml", *EVENTS, "--time-limit", "1e-6"], "TIMEOUT", "--time-limit ran out in the first round"),
        (["far.yaml", "long.yaml", *EVENTS], "INVALID_HORIZON", "horizon must be the same in all files, 0.3"),
        (["far.yaml", "--event", "upright: ["], "INVALID_REQUEST", "--event must be an event in YAML"),
        (["far.yaml", "cup.yaml", *EVENTS], "INVALID_REQUEST", "actions['cup.yaml']: score.object names no"),
        (
            ["actions.yaml", *EVENTS],
            "INVALID_REQUEST",
            "actions.yaml: scene file is a file of actions, which version 0.3",
        ),
        (["none.yaml", *EVENTS], "INVALID_REQUEST", "scene file"),
    ],
)
def test_wrong_input_is_told_in_a_sentence(files, arguments, code, sentence, capsys):
    assert main(["rank", *arguments]) == ErrorCode[code]
    said = capsys.readouterr().err
    assert said.startswith(f"unc_physics: {sentence}") and said.count("\n") == 1


def test_a_ranking_prints_at_most_thirty_lines(files):
    loaded = load_scene("over.yaml")
    many = {str(k): loaded[:2] for k in range(40)}
    ranking = rank(*loaded[:2], many, Upright("box"), 0.02, rollouts=8)
    lines = str(ranking).splitlines()
    assert len(lines) == 30 and lines[-1] == "... 13 more actions"
    assert ranking._repr_html_().startswith("<pre>probability of: box upright")
