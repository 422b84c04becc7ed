"""Real tosses: the data, the scores, and that every engine is given the same cube on the same table."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics.physics.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY
from unc_physics_evaluation.experiments import tosses as experiment
from unc_physics_evaluation.jobs import Settings
from unc_physics_evaluation.recorded_tosses import (
    DT,
    FLOOR,
    FOLDER,
    FRICTION,
    GRAVITY,
    RESTITUTION,
    cube_packing,
    first_belief,
    recorded_tosses,
    top_face,
    toss_scene,
)
from unc_physics_evaluation.results import Results
from unc_physics_evaluation.rollouts import ENGINES, OURS
from unc_physics_evaluation.rollouts import rollouts as rollouts_in
from unc_physics_evaluation.scores import bootstrap, brier_score, energy_score, log_score

TOSSES = recorded_tosses()


def lowest_corner(states):
    """Height of the cube's lowest corner [m], of states (n, 13)."""
    corners = TOSSES.half_width * np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
    turned = np.einsum("nij,kj->nki", Rotation.from_quat(states[:, QUATERNION]).as_matrix(), corners)
    return states[:, 2] + turned[..., 2].min(axis=1)


def test_the_data_come_with_their_licence_and_source():
    assert "BSD 3-Clause" in (FOLDER / "LICENSE").read_text()
    assert "ContactNets" in (FOLDER / "README.md").read_text()
    assert len(TOSSES.states) == 285 and sum(map(len, TOSSES.states)) == 29521


def test_tosses_fly_under_gravity_and_end_on_a_face():
    fall, height = [], []
    for states in TOSSES.states:
        assert np.linalg.norm(states[:, QUATERNION], axis=1) == pytest.approx(1.0, abs=1e-5)
        contact = np.argmax(lowest_corner(states) < 0.01)
        assert contact >= 2
        if contact >= 8:
            times = np.arange(contact) * TOSSES.dt
            fall.append(-2.0 * np.polyfit(times, states[:contact, 2], 2)[0])
        assert np.abs(states[-1, VELOCITY]).max() < 0.1
        up = Rotation.from_quat(states[-1, QUATERNION]).as_matrix()[2]
        assert np.abs(up).max() > np.cos(0.1)
        height.append(lowest_corner(states[-1:])[0])
    assert np.median(fall) == pytest.approx(GRAVITY, rel=0.04)  # their scale is 2 % off
    assert np.median(height) == pytest.approx(FLOOR, abs=5e-4)


def test_velocities_are_those_of_the_positions():
    """And angular velocities, in world axes, those of the orientations."""
    for states in TOSSES.states[:20]:
        flight = states[: np.argmax(lowest_corner(states) < 0.02)]
        moved = np.diff(flight[:, POSITION], axis=0) / TOSSES.dt
        assert np.median(np.abs(moved - flight[1:, VELOCITY])) < 0.03
        rotations = Rotation.from_quat(flight[:, QUATERNION])
        turned = rotations[1:] * rotations[:-1].inv()
        assert np.median(np.abs(turned.as_rotvec() / TOSSES.dt - flight[1:, ANGULAR_VELOCITY])) < 0.2


def test_the_packing_reaches_as_far_as_the_cube():
    packing = cube_packing(TOSSES.half_width)
    directions = np.random.default_rng(0).standard_normal((500, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    spheres = np.max(packing.centers @ directions.T + packing.radii[:, None], axis=0)
    cube = TOSSES.half_width * np.abs(directions).sum(axis=1)
    assert np.all(spheres <= cube + 1e-12)
    assert np.all(spheres > cube - 1e-4)


def test_the_face_on_top():
    for face in range(6):
        axis = np.zeros(3)
        axis[face % 3] = 1.0 if face < 3 else -1.0
        turned = Rotation.align_vectors([[0.0, 0.0, 1.0]], [axis])[0]
        state = np.zeros((4, 13))
        for k, (about_up, tilt) in enumerate([(0.0, 0.0), (1.0, 0.0), (2.0, 0.3), (3.0, -0.3)]):
            state[k, QUATERNION] = (Rotation.from_euler("xz", [tilt, about_up]) * turned).as_quat()
        assert top_face(state).tolist() == [face] * 4


def test_scores_of_certain_and_of_uniform_predictions():
    right, uniform = np.full(60, 2), np.arange(60) % 6
    assert brier_score(right, 2, 6) == 0.0
    assert brier_score(right, 3, 6) == 2.0
    assert brier_score(uniform, 3, 6) == pytest.approx(5.0 / 6.0)
    assert log_score(right, 2) == 0.0
    assert log_score(right, 3) == pytest.approx(np.log(120.0)), "half a sample"
    assert log_score(uniform, 3) == pytest.approx(np.log(6.0))


def test_energy_score():
    x = np.array([1.0, -2.0, 0.5])
    assert energy_score(np.tile(x, (20, 1)), x) == 0.0
    assert energy_score(np.tile(x, (20, 1)), x + [3.0, 0.0, 4.0]) == pytest.approx(5.0)
    rng = np.random.default_rng(0)
    observed = rng.standard_normal((200, 3))
    means = [
        np.mean([energy_score(shift + spread * rng.standard_normal((50, 3)), y) for y in observed])
        for shift, spread in ((0.0, 1.0), (1.0, 1.0), (0.0, 0.3), (0.0, 3.0))
    ]
    assert min(means) == means[0], "proper: the truth scores best"


def test_the_bootstraps_interval():
    values = np.random.default_rng(1).standard_normal(400)
    low, high = bootstrap(values, np.random.default_rng(2))
    assert low < values.mean() < high
    assert high - low == pytest.approx(2.0 * 1.96 * values.std() / 20.0, rel=0.1)


@pytest.fixture(params=ENGINES)
def rollouts(request):
    """Function that returns final states of the cube on the table, for each engine."""
    if request.param != OURS:
        pytest.importorskip(request.param)
    with rollouts_in(request.param, toss_scene(TOSSES)) as run_all:

        def function(states, steps):
            return run_all(states, steps)[0]

        function.engine = request.param
        yield function


def at_rest(height=0.0, **parts):
    """A state (1, 1, 13) of the cube, so high above the table."""
    state = np.zeros((1, 1, 13))
    state[0, 0, 9], state[0, 0, 2] = 1.0, FLOOR + TOSSES.half_width + height
    for part, value in parts.items():
        state[0, 0, {"velocity": VELOCITY, "spin": ANGULAR_VELOCITY}[part]] = value
    return state


@pytest.mark.parametrize("direction", [0.0, 0.3, np.pi / 4])
def test_the_cube_slides_as_friction_says(rollouts, direction):
    """In every direction; engines whose bodies tremble as they slide do so on average."""
    heading = np.array([np.cos(direction), np.sin(direction), 0.0])
    settled = round(0.1 / DT)
    ends = [rollouts(at_rest(velocity=2.0 * heading), n)[0, 0] for n in (settled, 9 * settled)]
    speeds = [np.linalg.norm(end[VELOCITY][:2]) for end in ends]
    assert (speeds[0] - speeds[1]) / (8 * settled * DT) == pytest.approx(FRICTION * GRAVITY, rel=0.05)


def test_the_cube_comes_back_as_restitution_says(rollouts):
    """The flat fall of a cube; on average over when in a step it arrives."""
    shares = []
    for height in np.linspace(0.001, 0.006, 6):
        start = at_rest(height, velocity=[0.0, 0.0, -1.0])
        speeds = [rollouts(start, n)[0, 0, VELOCITY][2] for n in range(1, 12)]
        shares.append(max(speeds) / np.sqrt(1.0 + 2.0 * GRAVITY * height))
    assert np.mean(shares) == pytest.approx(RESTITUTION, abs=0.025)


def test_the_cube_stays_at_rest(rollouts):
    end = rollouts(at_rest(), 240)[0, 0]
    assert end[POSITION] == pytest.approx([0.0, 0.0, FLOOR + TOSSES.half_width], abs=2e-3)
    assert top_face(end) == 2


def test_flight_is_a_parabola(rollouts):
    spin = np.array([1.0, -2.0, 3.0])
    start = at_rest(0.5, velocity=[1.0, 0.5, 0.2], spin=spin)
    steps = 24
    end, passed = rollouts(start, steps)[0, 0], steps * DT
    fallen = start[0, 0, 2] + 0.2 * passed - 0.5 * GRAVITY * passed**2
    assert end[POSITION] == pytest.approx([passed, 0.5 * passed, fallen], abs=GRAVITY * passed * DT)
    turned = Rotation.from_quat(end[QUATERNION]) * Rotation.from_rotvec(spin * passed).inv()
    assert turned.magnitude() < 2e-3
    assert end[ANGULAR_VELOCITY] == pytest.approx(spin, abs=1e-6)


def test_a_belief_is_of_the_first_frame():
    belief = first_belief(TOSSES, 7)
    np.testing.assert_array_equal(belief.mean[0, POSITION], TOSSES.states[7][0, POSITION])
    np.testing.assert_allclose(np.sqrt(belief.joint.diagonal()), np.repeat([1e-3, 0.02, 0.01, 0.15], 3))


def test_rows_and_report(tmp_path, monkeypatch):
    monkeypatch.setattr(experiment, "QUICK", 6)
    results = Results(tmp_path)
    for job in experiment.jobs(Settings(quick=True)):
        outcome = experiment.run(job)
        assert len(outcome.rows) == 6 * 3 + 1
        assert all(np.isfinite(row.value) for row in outcome.rows)
        assert outcome.rows == experiment.run(job).rows[:-1] + outcome.rows[-1:], "seeded; the cost is not"
        results.add(job, outcome, {"versions": "", "machine": ""})
    report = experiment.report(results)
    assert "6 real tosses" in report and "| unc_physics |" in report
