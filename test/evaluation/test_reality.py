"""Reality: sets of recorded motions from folders, what is predicted without physics, and the experiment."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics import UncPhysicsError
from unc_physics.calibration.calibrate import Fit
from unc_physics_evaluation.experiments import reality as experiment
from unc_physics_evaluation.jobs import Settings
from unc_physics_evaluation.methods import MARGINAL, OURS, STILL
from unc_physics_evaluation.polyhedron import Polyhedron, box, face_normals, lowest_face
from unc_physics_evaluation.reality_report import above, lines
from unc_physics_evaluation.recorded_sets import DATA, read_sets
from unc_physics_evaluation.results import Results

EXAMPLE = Path(__file__).parents[2] / "examples" / "tosses"


@pytest.fixture(scope="module")
def sets():
    return read_sets()


@pytest.fixture
def folder(tmp_path):
    """A set in the documented format: a scene file and motions."""
    own = tmp_path / "data" / "cube on a table"
    own.mkdir(parents=True)
    shutil.copy(EXAMPLE / "cube.yaml", own / "scene.yaml")
    shutil.copy(EXAMPLE / "cube.csv", own / "motions.csv")
    return own.parent


def test_all_recorded_sets_are_read(sets):
    counts = {name: len(own.motions) for name, own in sets.items()}
    assert counts["household cube"] == 11 and counts["household toblerone"] == 3
    assert counts["household napkin"] == 2 and counts["cube tosses"] == 285
    assert counts["pushes, point"] == 273
    for name in ("household_tosses", "tosses"):
        assert "BSD 3-Clause" in (DATA / name / "LICENSE").read_text()
        assert (DATA / name / "README.md").is_file()


@pytest.mark.parametrize("name", ["household cube", "household toblerone", "household napkin"])
def test_household_objects_fly_and_end_on_the_table(sets, name):
    """Where the mesh's lowest corner says, to what the README says of heights, in steps of gravity."""
    own = sets[name]
    for motion, start in zip(own.motions, own.starts, strict=True):
        corners = Rotation.from_quat(motion.poses[-1, 3:]).apply(own.solid.vertices)
        assert motion.poses[-1, 2] + corners[:, 2].min() == pytest.approx(0.0, abs=3e-3)
        low = start.state[2] + Rotation.from_quat(start.state[6:10]).apply(own.solid.vertices)[:, 2].min()
        assert -5e-3 < low < 0.1  # last frame of flight
        turned = Rotation.from_quat(start.state[6:10]) * Rotation.from_quat(motion.poses[0, 3:]).inv()
        assert turned.magnitude() < 0.03
        assert np.linalg.norm(start.state[:3] - motion.poses[0, :3]) < 0.01


def test_a_set_as_documented(folder):
    (own,) = read_sets(folder).values()
    assert own.name == "cube on a table" and len(own.motions) == 8
    assert read_sets(folder / "cube on a table").keys() == {own.name}
    (folder / "cube on a table" / "motions.csv").unlink()
    with pytest.raises(UncPhysicsError, match="needs motions.csv or motions.npz"):
        read_sets(folder)


def test_refused_folders(tmp_path):
    with pytest.raises(UncPhysicsError, match="--data must be a folder"):
        read_sets(tmp_path / "nothing")
    with pytest.raises(UncPhysicsError, match="holds no set"):
        read_sets(tmp_path)


def test_a_rounded_polyhedron_keeps_its_faces():
    """An octahedron and a box: spheres touch the planes of all faces that meet at a corner."""
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    for solid, distance in (
        (Polyhedron("octahedron", axes, np.eye(3)), 3.0**-0.5),
        (box("b", [2, 2, 2]), 1.0),
    ):
        model = solid.packing(0.1)
        normals = face_normals(model)
        assert len(normals) == (8 if solid.name == "octahedron" else 6)
        reach = (model.centers @ normals.T).max(axis=0) + 0.1
        assert reach == pytest.approx(distance)
    assert box("b", [0.1, 0.2, 0.3]).inertia == pytest.approx(np.diag([0.13, 0.10, 0.05]) / 12.0)


def test_the_lowest_face():
    normals, states = face_normals(box("b", [1, 2, 3]).packing()), np.zeros((len(range(6)), 13))
    for state, normal in zip(states, normals, strict=True):
        down = Rotation.align_vectors([[0.0, 0.0, -1.0]], [normal])[0]
        state[6:10] = (Rotation.from_euler("x", 0.3) * down).as_quat()
    assert lowest_face(states, normals).tolist() == list(range(6))


def test_rows_and_report(folder, tmp_path, monkeypatch):
    """A set of its own, by ours and without physics; hardly a search."""
    small = {"motions": 4, "samples_each": 20, "fit_motions": 3, "fit_draws": 12, "evaluations": 56}
    monkeypatch.setattr(experiment, "QUICK", small)
    monkeypatch.setattr(experiment, "available", lambda: [OURS])

    def fit(motions, before, adjusted, *arguments, **options):
        assert len(motions) == 3 and len(adjusted) == len(experiment.FITTABLE)
        return Fit(before, (), (0.0, 0.0))

    monkeypatch.setattr(experiment, "fit_model", fit)  # tested where it is
    results = Results(tmp_path / "results")
    jobs = experiment.jobs(Settings(quick=True, data=str(folder)))
    assert len(jobs) == 1 + 1 + 4 + 1  # defaults, exact, leave one out, without physics
    for job in jobs:
        outcome = experiment.run(job)
        assert all(np.isfinite(row.value) for row in outcome.rows)
        results.add(job, outcome, {"versions": "", "machine": ""})
    found = lines(results.rows("reality"))
    assert [(line.method, line.given) for line in found] == [
        (OURS, "default"),
        (OURS, "exact"),
        (OURS, "calibrated"),
        (MARGINAL, "default"),
        (STILL, "default"),
    ]
    ours, exact, _, marginal, still = found
    assert _in_90(exact) < _in_90(ours)
    assert above(marginal, marginal, experiment.POSITION_SCORE) == "+0 (+0 to +0)"
    assert above(ours, still, experiment.POSITION_SCORE).startswith("-")
    assert "worse at" in above(still, ours, experiment.POSITION_SCORE)
    report = experiment.report(results)
    assert "| cube on a table, 4 | unc_physics, default |" in report
    assert (results.folder / "reality_scores.csv").read_text().count("\n") == 6
    assert (results.folder / "reality_coverage.csv").is_file()


def _in_90(line):
    """Number of positions in regions of 90 %."""
    ranks = [line.values[f"{experiment.POSITION_RANK} {when}"].values() for when in experiment.TIMES]
    return sum(rank <= 0.9 for own in ranks for rank in own)


def test_pushes_by_ours_and_without_physics(monkeypatch):
    """Two pushes: ours is nearer than a block that stays, calibrated within 5 mm."""
    monkeypatch.setattr(experiment, "available", lambda: [OURS])
    monkeypatch.setattr(experiment, "QUICK", experiment.QUICK | {"motions": 2})
    jobs = experiment.jobs(Settings(quick=True))
    errors = {}
    for job in jobs:
        if job.parameters["set"] == "pushes, point":
            for row in experiment.run(job).rows:
                if row.quantity == f"{experiment.POSITION_SCORE} rest":
                    errors.setdefault((row.method, job.parameters["given"]), []).append(row.value)
    assert {len(own) for own in errors.values()} == {2}
    stays = np.array(errors[STILL, "default"])
    assert (np.array(errors[OURS, "calibrated"]) < np.minimum(0.5 * stays, 5e-3)).all()
    assert (np.array(errors[OURS, "default"]) < stays).all()
