"""The command ``rank``, on the example that comes with the package and on files that are wrong."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from unc_physics import FellOff, InRegion, Touches, Upright, rank
from unc_physics.__main__ import main
from unc_physics.checks.errors import ErrorCode
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


def test_scores_of_a_file_are_events(tmp_path):
    score = [
        {"in_region": {"object": "salt_box", "region": "bin"}},
        {"not": {"touches": {"object": "salt_box", "other": "floor"}}},
        {"upright": {"object": "salt_box", "axis": [0, 0, 1], "angle": 0.5}},
        {"not": {"fell_off": "salt_box"}},
    ]
    (inside, _), (touched, happens), (upright, _), (off, off_happens) = load_actions(
        changed(tmp_path, score=score)
    ).score.parts
    assert isinstance(inside, InRegion) and inside.region.size.tolist() == [0.3, 0.2, 0.147]
    assert isinstance(touched, Touches) and not happens and touched.other == "floor"
    assert isinstance(upright, Upright) and upright.angle == 0.5 and upright.axis.tolist() == [0.0, 0.0, 1.0]
    assert isinstance(off, FellOff) and not off_happens and off.support == ""


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


BAD = {
    "no score": ({"score": None}, "score must be given"),
    "an unknown key": ({"scores": []}, "actions file has no key 'scores'; did you mean 'score'?"),
    "no events": ({"score": []}, "score must name at least one event"),
    "an unknown event": (
        {"score": {"uprigth": "salt_box"}},
        "score has no key 'uprigth'; did you mean 'upright'?",
    ),
    "no region": ({"score": {"in_region": "salt_box"}}, "score.in_region.region must be given"),
    "no text": ({"score": {"upright": {"object": 3}}}, "score.upright.object must be a non-empty text"),
    "no such object": ({"score": {"upright": "cup"}}, "score.object names no body of the scene"),
    "of what is reported": ({"also": [{"upright": "cup"}]}, "also[0].object names no body of the scene"),
    "no actions": ({"actions": {}}, "actions must name at least one action"),
    "actions in a list": ({"actions": [1]}, "actions must be a mapping of names to changes"),
    "a key of version 0.2": (
        {"smallest_first": True},
        "actions file has the key 'smallest_first', which was removed in version 0.3: negate",
    ),
    "two regions of a name": (
        {"regions": [{"name": "bin", "size": [1, 1, 1]}] * 2},
        "regions[1].name is the name of two regions",
    ),
    "no list": ({"also": {"upright": "salt_box"}}, "also must be a list"),
    "no change": ({"actions": {"a": {"salt_box": 3}}}, "actions['a'].salt_box must be a mapping of fields"),
    "a bad change": (
        {"actions": {"a": {"salt_box": {"position": [0, 0]}}}},
        "actions['a'].salt_box.position must be a list of 3 numbers",
    ),
    "no region's size": ({"regions": [{"name": "bin"}]}, "regions[0] must have a name and a size"),
    "a bad scene": ({"scene": {"bodies": []}}, "scene.bodies must name at least one body"),
    "a bad pose": (
        {"actions": {"a": {"salt_box": {"trajectory": [{"time": 0}]}}}},
        "actions['a'].salt_box.trajectory[0].position must be given",
    ),
    "a scene file": ({"bodies": []}, "actions file is a scene file, which 'predict' and 'view' take"),
    "no scene": ({"scene": 3}, "scene must be the path of a scene file, or its content"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_wrong_file_is_told_in_a_sentence(case, tmp_path, capsys):
    entries, sentence = BAD[case]
    status = main(["rank", changed(tmp_path, **entries), *SHORT])
    said = capsys.readouterr().err
    assert status >= ErrorCode.INVALID_REQUEST and said.count("\n") == 1
    assert said.startswith(f"unc_physics: {sentence}"), said


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
