"""Prescribed bodies, belts and releases in other engines do as mechanics says."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics import Belief, Plane, PosePath, RigidBody, Scene, load_model
from unc_physics.physics.layout import QUATERNION
from unc_physics.scene.action_arrays import with_driven
from unc_physics_evaluation.action_engine_base import shapes_of
from unc_physics_evaluation.action_engines import FINE, opened
from unc_physics_evaluation.action_scenes import ACTION_SCENES, turn_of_push
from unc_physics_evaluation.experiments import actions as experiment
from unc_physics_evaluation.jobs import Job, Settings
from unc_physics_evaluation.push_engines import pushed_in
from unc_physics_evaluation.recorded_pushes import planar_before, recorded_pushes, seen
from unc_physics_evaluation.results import Results
from unc_physics_evaluation.scenarios import resting


@pytest.fixture(params=list(FINE))
def engine(request):
    pytest.importorskip(request.param)
    return request.param


def after(engine, scene, mean, horizon):
    with opened(engine, scene, FINE[engine]) as made:
        return made.run(with_driven(scene, mean, 0.0), horizon)[0]


def test_a_belt_brings_a_can_to_its_speed(engine):
    """It falls behind by v^2 / (2 mu g) while it slides."""
    made = ACTION_SCENES["belt"]()
    can = after(engine, made.scene, made.belief.mean, 0.5)[0]
    assert can[0] == pytest.approx(0.15 - 0.3**2 / (2 * 0.3 * 9.81), abs=2e-3)
    assert can[3] == pytest.approx(0.3, abs=5e-3)


def test_what_follows_a_path_drags_what_it_carries(engine):
    """Friction feels the velocity of a tray that goes as it is told."""
    model = load_model("salt_box").prefix(300)
    side = float(shapes_of(RigidBody("box", model, 1.0))[0].size[2])
    low = [0.0, 0.0, 0.5 * side + 0.05]
    path = PosePath(
        times=[0.0, 10.0], positions=[low, [1.0, 0.0, low[2]]], linear_velocities=[[0.1, 0.0, 0.0]] * 2
    )
    bodies = [RigidBody("box", model, 1.0), RigidBody("tray", model, trajectory=path)]
    scene = Scene.everyday(bodies, environment=[Plane()], friction=0.5)
    box = after(engine, scene, resting([[0.0, 0.0, low[2] + side], low]), 0.5)[0]
    assert box[3] == pytest.approx(0.1, abs=2e-3)
    assert box[0] == pytest.approx(0.05 - 0.1**2 / (2 * 0.5 * 9.81), abs=1e-3)


def test_what_is_let_go_flies_as_thrown(engine):
    made = ACTION_SCENES["release"]()
    box = after(engine, made.scene, made.belief.mean, 0.65)[0]
    speed = 0.6  # of the hand, at the middle of its way of 0.4 m
    np.testing.assert_allclose(
        box[:3], [-0.32 + 0.2 + 0.15 * speed, 0.0, 0.3 - 0.5 * 9.81 * 0.15**2], atol=3e-3
    )


def test_a_tip_pushes_the_block_as_it_was_pushed(engine):
    k = int(np.flatnonzero(recorded_pushes().kind == 0)[0])
    place, spent = pushed_in(engine, FINE[engine], k)
    off, stays = (np.hypot(*(x - seen(k))[:2]) for x in (place, planar_before(k)))
    assert off < 0.5 * stays and spent > 0.0


def test_an_experiment_compares_final_poses(tmp_path):
    job = Job("actions", Settings().parameters(scene="release", samples_each=4, blocks=1))
    results = Results(tmp_path)
    results.add(job, experiment.run(job), {"versions": "", "machine": ""})
    rows = results.rows("actions")
    floor = rows.where(method="floor", quantity=experiment.POSITION_ERROR).values()
    assert len(floor) == 1 and floor[0] > 0.0
    shares = rows.where(quantity=experiment.PROBABILITY).values()
    assert ((shares >= 0.0) & (shares <= 1.0)).all()
    assert "stands in the bin" in experiment.report(results)


def test_a_pushed_box_turns_between_loads_at_the_corners_and_even_ones(engine):
    made = ACTION_SCENES["push"]()
    box = after(engine, made.scene, made.belief.mean, made.horizon)
    x, _, _ = Rotation.from_quat(box[0, QUATERNION]).apply([1.0, 0.0, 0.0])
    assert 0.9 * turn_of_push(even=False) < math.acos(x) < 1.05 * turn_of_push(even=True)


def test_beliefs_are_of_the_scenes():
    for make in ACTION_SCENES.values():
        made = make()
        assert isinstance(made.belief, Belief) and made.happened(made.belief.mean[:1]).shape == (1,)
