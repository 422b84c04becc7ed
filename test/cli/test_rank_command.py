"""The command ``rank``, on the example that comes with the package and on files that are wrong."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import yaml

from unc_physics import Touches, Upright, rank
from unc_physics.__main__ import main
from unc_physics.checks.errors import ErrorCode
from unc_physics.cli.schema_command import schema_text
from unc_physics.prediction.actions import apply_action
from unc_physics.prediction.actions_file import load_actions

EXAMPLE = Path(__file__).parents[2] / "examples" / "actions" / "release_over_bin.yaml"
SHORT = ["--rollouts", "20", "--horizon", "0.05"]


def changed(tmp_path, **entries):
    """The example with other entries; None leaves one out."""
    content = yaml.safe_load(EXAMPLE.read_text()) | entries
    path = tmp_path / "actions.yaml"
    path.write_text(yaml.safe_dump({key: value for key, value in content.items() if value is not None}))
    return str(path)


def test_the_example_is_ranked(tmp_path, capsys):
    picture = tmp_path / "ranking.png"
    assert main(["rank", str(EXAMPLE), *SHORT, "--seed", "4", "--json", "--picture", str(picture)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert picture.read_bytes().startswith(b"\x89PNG")
    scene, belief, horizon, actions, score, also = load_actions(EXAMPLE)
    assert (horizon, len(actions)) == (0.8, 10)
    expected = rank(scene, belief, actions, score, 0.05, rollouts=20, seed=4)
    assert [action["name"] for action in told["actions"]] == [action.name for action in expected]
    for found, action in zip(told["actions"], expected, strict=True):
        assert found["score"] == asdict(action.score)
        assert (found["rollouts"], found["difference"]) == (action.rollouts, action.difference.value)
        assert found["also"][str(also[0])] == asdict(action.prediction.probability(also[0]))
    assert told["rollouts"] == expected.rollouts and told["seed"] == 4


def test_the_table_has_what_it_tells_below_its_headings(capsys):
    assert main(["rank", str(EXAMPLE), *SHORT]) == 0
    head, columns, *rows = capsys.readouterr().out.splitlines()
    assert head.startswith("probability of: salt_box in bin; ") and "[4]" in columns
    assert len([row for row in rows if " cm " in row]) == 10 and "[1] salt_box upright" in rows
    for row in rows[:10]:
        for k in range(1, 5):
            end = columns.index(f"[{k}]") + 3
            assert 0.0 <= float(row[end - 5 : end]) <= 1.0 and row[end - 6] == " "


def test_several_scores_are_one_event_of_all(tmp_path):
    several = [{"not": {"touches": {"object": "salt_box", "other": "floor"}}}, {"upright": "salt_box"}]
    (touched, happens), (upright, _) = load_actions(changed(tmp_path, score=several)).score.parts
    assert (touched, happens) == (Touches("salt_box", "floor"), False) and upright == Upright("salt_box")


def test_a_scene_may_be_in_a_file_of_its_own(tmp_path):
    content = yaml.safe_load(EXAMPLE.read_text())
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(content["scene"]))
    apart = load_actions(changed(tmp_path, scene="scene.yaml", horizon=0.3))
    assert [body.name for body in apart.scene.bodies] == ["salt_box"] and apart.horizon == 0.3


def test_paths_and_wrenches_are_written_as_in_scene_files(tmp_path):
    poses = [{"time": 0.0, "position": [0, 0, 0.3]}, {"time": 0.5, "position": [0.1, 0, 0.3]}]
    changes = {"trajectory": poses}, {"wrenches": [{"force": [1, 0, 0], "duration": 0.2}]}
    actions = {str(k): {"salt_box": change} for k, change in enumerate(changes)}
    loaded: Any = load_actions(changed(tmp_path, actions=actions)).actions
    assert loaded["0"]["salt_box"]["trajectory"].positions.tolist() == [[0, 0, 0.3], [0.1, 0, 0.3]]
    (wrench,) = loaded["1"]["salt_box"]["wrenches"]
    assert wrench.force.tolist() == [1, 0, 0] and wrench.duration == 0.2


def score(**event):
    return {"score": event}


def action(**change):
    return {"actions": {"a": {"salt_box": change}}}


#: Entries, the sentence, and whether the schema cannot say what is wrong.
BAD = [
    ({"score": None}, "score must be given"),
    ({"scores": []}, "actions file has no key 'scores'; did you mean 'score'?"),
    ({"score": []}, "score must name at least one event"),
    (score(uprigth="salt_box"), "score has no key 'uprigth'; did you mean 'upright'?"),
    (score(upright="salt_box", at_rest="salt_box"), "score must be "),
    (score(in_region="salt_box"), "score.in_region.region must be given"),
    (score(in_region={"object": "salt_box", "region": {"name": "bin"}}), "score.in_region.region"),
    (score(upright={"object": 3}), "score.upright.object must be a non-empty text"),
    (score(upright={"object": "salt_box", "axis": [0, 1]}), "score.upright.axis"),
    (score(upright={"object": "salt_box", "angle": -0.1}), "score.upright.angle"),
    (score(at_rest={"object": "salt_box", "speed": "slow"}), "score.at_rest.speed"),
    (score(touches="salt_box"), "score.touches"),
    (score(touches={"object": "salt_box", "other": ""}), "score.touches.other"),
    (score(upright="cup"), "score.object names no body of the scene", True),
    ({"also": [{"upright": "cup"}]}, "also[0].object names no body of the scene", True),
    ({"also": {"upright": "salt_box"}}, "also must be a list"),
    ({"actions": {}}, "actions must name at least one action"),
    ({"actions": [1]}, "actions must be a mapping of names to changes"),
    ({"actions": {"a": {"salt_box": 3}}}, "actions['a'].salt_box must be a mapping of fields"),
    (action(position=[0, 0]), "actions['a'].salt_box.position must be a list of 3 numbers", True),
    (action(trajectory=[{"time": 0}]), "actions['a'].salt_box.trajectory[0].position must be given", True),
    ({"smallest_first": True}, "actions file has the key 'smallest_first', which was removed in version 0.3"),
    ({"regions": [{"name": "bin", "size": [1, 1, 1]}] * 2}, "regions[1].name is the name of two", True),
    ({"regions": [{"name": "bin"}]}, "regions[0] must have a name and a size"),
    ({"scene": {"bodies": []}}, "scene.bodies must name at least one body"),
    ({"scene": 3}, "scene must be the path of a scene file, or its content"),
    ({"bodies": []}, "actions file is a scene file, which 'predict' and 'view' take"),
]


@pytest.mark.parametrize(("entries", "sentence", "unseen"), [(*case, False)[:3] for case in BAD])
def test_a_wrong_file_is_told_in_a_sentence_and_does_not_fit_the_schema(
    entries, sentence, unseen, tmp_path, capsys
):
    path = changed(tmp_path, **entries)
    status = main(["rank", path, *SHORT])
    said = capsys.readouterr().err
    assert status >= ErrorCode.INVALID_REQUEST and said.count("\n") == 1
    assert said.startswith(f"unc_physics: {sentence}"), said
    schema = jsonschema.Draft202012Validator(json.loads(schema_text("actions")))
    assert schema.is_valid(yaml.safe_load(Path(path).read_text())) == unseen


def test_a_wrong_option_is_told_in_a_sentence(tmp_path, capsys):
    assert main(["rank", str(EXAMPLE), "--rollouts", "0"]) == ErrorCode.INVALID_REQUEST
    assert "rollouts must be at least 1" in capsys.readouterr().err
    assert main(["rank", str(EXAMPLE), "--time-limit", "1e-3"]) == ErrorCode.TIMEOUT
    assert "--time-limit ran out in the first round (got 0.001)" in capsys.readouterr().err
    assert main(["predict", str(EXAMPLE)]) == ErrorCode.INVALID_REQUEST
    assert "is a file of actions, which the command 'rank' takes" in capsys.readouterr().err
    assert main(["rank", str(tmp_path / "none.yaml")]) == ErrorCode.INVALID_REQUEST
    assert "actions file" in capsys.readouterr().err


def test_a_ranking_prints_at_most_thirty_lines():
    scene, belief, _, actions, score, *_ = load_actions(EXAMPLE)
    many = {f"{name}, again {k}": action for k in range(4) for name, action in actions.items()}
    ranking = rank(scene, belief, many, score, 0.02, rollouts=8)
    lines = str(ranking).splitlines()
    assert len(lines) <= 30 and any(line.endswith("more actions") for line in lines)
    assert ranking._repr_html_().startswith("<pre>probability of: salt_box in bin")
    assert len(ranking.to_dict()["actions"]) == 40


def test_positions_of_actions_are_of_the_point_that_the_scene_names(tmp_path):
    half = [0.0, 0.0, 0.7071067811865476, 0.7071067811865476]
    body = {
        "name": "mug",
        "model": "mug",
        "origin": "model",
        "orientation": half,
        "position": [0.1, 0.0, 0.0],
    }
    scene = {"physics": "everyday", "exact": True, "environment": [{"plane": {}}], "bodies": [body]}
    moved = {"position": [0.2, 0.0, 0.0]}
    actions = {
        "as it is": {},
        "there": {"mug": moved},
        "centre": {"mug": moved | {"origin": "center_of_mass"}},
    }
    path = tmp_path / "actions.yaml"
    path.write_text(yaml.safe_dump({"scene": scene, "score": {"upright": "mug"}, "actions": actions}))
    loaded = load_actions(path)
    before = loaded.belief.mean[0, :3]
    _, there = apply_action(loaded.scene, loaded.belief, loaded.actions["there"], "action")
    np.testing.assert_allclose(there.mean[0, :3] - before, [0.1, 0.0, 0.0], atol=1e-12)
    _, centre = apply_action(loaded.scene, loaded.belief, loaded.actions["centre"], "action")
    np.testing.assert_allclose(centre.mean[0, :3], [0.2, 0.0, 0.0], atol=1e-12)
