"""Tracking of recorded tosses: the frames, the followers and the experiment."""

import numpy as np

from unc_physics_evaluation.experiments import tracking as experiment
from unc_physics_evaluation.jobs import Job, Settings
from unc_physics_evaluation.recorded_tosses import recorded_tosses
from unc_physics_evaluation.results import Results
from unc_physics_evaluation.tracked_tosses import (
    FilterFollower,
    TrackerFollower,
    frames_of,
    scores,
    tracked_scene,
)


def test_conditions_leave_out_and_spoil_poses():
    tosses = recorded_tosses()
    gap, spoiled = (frames_of(tosses, 5, 30.0, condition, 0) for condition in ("gap", "outliers"))
    hidden = gap.times[~gap.is_seen]
    assert 0.13 < np.ptp(hidden) < 0.2
    assert gap.in_contact[~gap.is_seen].all()
    far = np.linalg.norm(spoiled.measured[:, :3] - spoiled.truth[:, :3], axis=1)
    assert (far[~spoiled.is_outlier] < 0.01).all()
    assert spoiled.is_seen.all()


def test_the_tracker_knows_velocities_that_a_filter_does_not():
    tosses, scene = recorded_tosses(), tracked_scene(recorded_tosses())
    errors = {}
    for kind in (TrackerFollower, FilterFollower):
        found = []
        for k in (3, 8, 21):
            frames = frames_of(tosses, k, 30.0, "plain", 0)
            follower = kind(scene, frames, 0)
            found += [one.velocity for one in scores(follower, frames, 1000) if one.in_contact]
        errors[kind] = np.mean(found)
    assert errors[TrackerFollower] < 0.5 * errors[FilterFollower]


def test_an_experiment_tracks_tosses(tmp_path):
    results = Results(tmp_path)
    jobs = experiment.jobs(Settings(quick=True))
    for job in jobs:
        few = Job(job.experiment, {**job.parameters, "tosses": 1}, job.cost)
        if job.parameters["rate"] == 148.0 and job.parameters["condition"] == "plain":
            continue
        results.add(few, experiment.run(few), {"versions": "", "machine": ""})
    report = experiment.report(results)
    assert "tracker, 30 Hz, plain, after contact" in report
    assert "constant_velocity_predict, 30 Hz" in report
    if experiment.missing(Settings()) == []:
        beside = (tmp_path / "tables" / "tracking_particles.csv").read_text()
        assert '"particle_filter_1000, after contact"' in beside
        assert '"tracker, after contact"' in beside
    assert "a hand takes it" in report
    assert "within 20 % of 1" in experiment.verdict(results)
    assert results.missing(jobs)[0].parameters["by"] == experiment.TRACKER
