"""The experiment about beliefs that overlap: its scenes, its measures, and a small run."""

import numpy as np
import pytest

from unc_physics.__main__ import main
from unc_physics.scene.belief import Belief
from unc_physics_evaluation.experiments import overlap as experiment
from unc_physics_evaluation.jobs import Settings
from unc_physics_evaluation.overlap_measures import off_by, spread_ratios, toppled, watch, without_overlap
from unc_physics_evaluation.overlap_scenes import GROUPS, arrangements, scene_and_belief, slots
from unc_physics_evaluation.results import Results

EVERYTHING = [*arrangements(), *slots()]
FIRST = EVERYTHING[0]


def test_arrangements_have_names_of_their_own_and_every_group_has_some():
    assert len({arrangement.name for arrangement in EVERYTHING}) == len(EVERYTHING)
    for group in GROUPS:
        assert any(arrangement.group.startswith(group) for arrangement in EVERYTHING)


@pytest.mark.parametrize("arrangement", EVERYTHING, ids=[arrangement.name for arrangement in EVERYTHING])
def test_means_touch_but_where_they_reach_into_walls(arrangement):
    scene, belief = scene_and_belief(arrangement, 0.001, 0.01)
    depth = -np.inf
    for body, state in zip(scene.bodies, belief.mean, strict=True):
        for element in scene.environment:
            gap = element.surface(body.model.centers + state[:3])[0] - body.model.radii
            depth = max(depth, -gap.min())
    walled = arrangement.group.startswith(("in a", "no room,"))
    assert 5e-4 < depth < 0.006 if walled else depth < 1e-6


def test_every_start_has_the_same_draws_and_jobs_are_told_apart():
    jobs = experiment.jobs(Settings())
    assert len({job.key for job in jobs}) == len(jobs)
    quick = experiment.jobs(Settings(quick=True))
    assert len(quick) < 60 and {job.parameters["start"] for job in quick} == set(experiment.OPTIONS)


def test_what_leans_more_than_45_degrees_has_toppled():
    scene, belief = scene_and_belief(FIRST, 0.0, 0.0)
    states = np.repeat(belief.mean[None], 3, axis=0)
    for k, degrees in enumerate((10.0, 44.0, 46.0)):
        half = np.radians(degrees) / 2.0
        states[k, 0, 6:10] = np.sin(half), 0.0, 0.0, np.cos(half)
    assert toppled(scene, belief, states).tolist() == [False, False, True]


def test_ratios_farthest_from_one():
    assert off_by([0.5, 1.5, 1.1]) == 0.5
    assert off_by([[0.9], [3.0]]) == 3.0
    _, belief = scene_and_belief(FIRST, 0.002, 0.02)
    _, double = scene_and_belief(FIRST, 0.004, 0.02)
    np.testing.assert_allclose(spread_ratios(double, belief), [2.0, 1.0, 1.0])
    exact = Belief.exact(belief.mean)
    np.testing.assert_array_equal(spread_ratios(exact, exact), 1.0)


def test_a_fall_is_no_rise_and_gains_nothing():
    scene, belief = scene_and_belief(FIRST, 0.0, 0.0)
    mean = belief.mean.copy()
    mean[0, 2] += 0.05
    mean[0, 5] = 0.5
    watched = watch(scene, Belief(mean, belief.covariance), 2, 0, 0.3)
    assert watched.rise.max() < 1e-4 and watched.gain.max() < 1e-4
    assert watched.end[0, 0, 2] < mean[0, 2]


def test_rejection_leaves_what_is_above_the_table():
    scene, belief = scene_and_belief(FIRST, 0.003, 0.0)
    states, drawn = without_overlap(scene, belief, 20, 1, 1000)
    assert len(states) == 20 and drawn > 20
    assert np.all(states[:, 0, 2] > belief.mean[0, 2] - 6e-5)
    few, drawn = without_overlap(scene, belief, 20, 1, 10)
    assert len(few) < 20 and drawn == 10


def test_command_runs_a_scene_with_every_start(tmp_path, monkeypatch):
    some = [arrangement for arrangement in EVERYTHING if arrangement.models == ("mug",)][:1]
    monkeypatch.setattr(experiment, "_chosen", lambda quick: some)
    assert main(["evaluate", "overlap", "--quick", "--workers", "1", "-o", str(tmp_path)]) == 0
    rows = Results(tmp_path).rows("overlap")
    assert set(rows.unique("start")) == set(experiment.OPTIONS)
    rise = {start: rows.where(start=start, quantity=experiment.RISE).mean() for start in experiment.STARTS}
    assert rise["project"] < 1e-3 and rise["at_rest"] < 1e-3 < rise["keep"]
    text = (tmp_path / "report.md").read_text()
    assert "| on a plane |" in text and "overlap_before_and_after.png" in text
    assert (tmp_path / "figures" / "overlap_before_and_after.png").is_file()
