"""Real tosses: the data, the scores, and that every engine is given the same cube on the same table."""

from dataclasses import replace

import numpy as np
import pytest

from unc_physics import Belief, Plane
from unc_physics.spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY
from unc_physics_evaluation.engines import PEERS
from unc_physics_evaluation.recorded_engines import RecordedEngine
from unc_physics_evaluation.recorded_tosses import (
    FLOOR,
    FRICTION,
    GRAVITY,
    RESTITUTION,
    recorded_tosses,
    toss_scene,
)
from unc_physics_evaluation.rollouts import ENGINES, OURS
from unc_physics_evaluation.rollouts import rollouts as rollouts_in
from unc_physics_evaluation.scores import bootstrap, brier_score

TOSSES = recorded_tosses()
DT = toss_scene(TOSSES).dt


def test_scores_of_certain_and_of_uniform_predictions():
    right, uniform = np.full(60, 2), np.arange(60) % 6
    assert brier_score(right, 2, 6) == 0.0
    assert brier_score(right, 3, 6) == 2.0
    assert brier_score(uniform, 3, 6) == pytest.approx(5.0 / 6.0)


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
    assert abs(end[QUATERNION][3]) > 0.999


def test_the_table_is_turned_to_the_horizontal():
    level = TOSSES.level(range(285))
    ends = np.array([TOSSES.motion(k, level).poses[-1, :3] for k in range(285)])
    slope = np.polyfit(ends[:, 1], ends[:, 2], 1)[0]
    assert abs(slope) < 3e-4
    assert 3e-3 < level.magnitude() < 1e-2


@pytest.mark.parametrize("name", PEERS)
def test_errors_of_impacts_in_other_engines(name):
    """They spread what is otherwise certain, the same for the same seed, and add no energy."""
    pytest.importorskip(name)
    engine = RecordedEngine(name)
    state = at_rest(0.05, velocity=[0.5, 0.0, -1.0], spin=[1.0, 2.0, 0.5])[0]
    belief = Belief.exact(state)
    scene = toss_scene(TOSSES)
    certain = engine(scene, belief, [0.2], 4, 0)[0]
    assert np.ptp(certain, axis=0).max() < 1e-9
    rough = replace(scene, impact_direction_std=0.05, impact_point_std=5e-3, impact_friction_std=0.2)
    found = [engine(rough, belief, [0.2], 6, seed)[0] for seed in (1, 1, 2)]
    engine.close()
    np.testing.assert_array_equal(found[0], found[1])
    assert not np.array_equal(found[0], found[2])
    assert np.std(found[0], axis=0).max() > 0.02
    inertia = scene.bodies[0].unit_inertia[0, 0]

    def energy(x):
        speeds = (x[..., 3:6] ** 2).sum(-1) + inertia * (x[..., 10:] ** 2).sum(-1)
        return 0.5 * speeds + GRAVITY * x[..., 2]

    assert np.all(energy(found[0]) <= energy(state[0]) * 1.001)


def test_spreads_of_friction_and_tilt_in_other_engines():
    pytest.importorskip("mujoco")
    engine = RecordedEngine("mujoco")
    table = Plane(offset=FLOOR, surface_tilt_std=0.02)
    scene = toss_scene(TOSSES, friction_std=0.03, environment=[table])
    ends = engine(scene, Belief.exact(at_rest(velocity=[1.0, 0.0, 0.0])[0]), [0.3], 30, 0)[0]
    engine.close()
    # v t - 0.5 mu g t^2 with friction's spread, and across by gravity's tilt
    assert np.std(ends[:, 0]) == pytest.approx(0.5 * 0.09 * GRAVITY * np.hypot(0.03, 0.02), rel=0.4)
    assert np.std(ends[:, 1]) > 1e-3
