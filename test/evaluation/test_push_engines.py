"""Prescribed bodies in other engines do as mechanics says."""

import numpy as np
import pytest

from unc_physics import Plane, PosePath, RigidBody, Scene, load_model
from unc_physics.scene.kinematic_states import with_kinematic
from unc_physics_evaluation.push_engines import FINE, Shape, pushed_in, run_in
from unc_physics_evaluation.recorded_pushes import (
    measured_frictions,
    planar_before,
    push_scene,
    recorded_pushes,
    seen,
)
from unc_physics_evaluation.scenarios import resting


@pytest.fixture(params=list(FINE))
def engine(request):
    pytest.importorskip(request.param)
    return request.param


def test_what_follows_a_path_drags_what_it_carries(engine):
    """Friction feels the velocity of a tray that goes as it is told."""
    model, side = load_model("salt_box").prefix(300), 0.1
    shapes = {name: [Shape((0.1, 0.1, side), np.zeros(3))] for name in ("box", "tray")}
    low = [0.0, 0.0, 0.5 * side + 0.05]
    path = PosePath(
        times=[0.0, 10.0], positions=[low, [1.0, 0.0, low[2]]], linear_velocities=[[0.1, 0.0, 0.0]] * 2
    )
    bodies = [RigidBody("box", model, 1.0), RigidBody("tray", model, trajectory=path)]
    scene = Scene.everyday(bodies, exact=True, environment=[Plane()], friction=0.5)
    mean = with_kinematic(scene, resting([[0.0, 0.0, low[2] + side], low]), 0.0)
    box = run_in(engine, FINE[engine], scene, shapes, mean, 0.5)[0]
    assert box[3] == pytest.approx(0.1, abs=2e-3)
    assert box[0] == pytest.approx(0.05 - 0.1**2 / (2 * 0.5 * 9.81), abs=1e-3)


def test_a_tip_pushes_the_block_as_it_was_pushed(engine):
    k = int(np.flatnonzero(recorded_pushes().kind == 0)[0])
    push = push_scene(k, measured_frictions(k))
    place = pushed_in(engine, FINE[engine], push, int(recorded_pushes().support[k]))
    off, stays = (np.hypot(*(x - seen(k))[:2]) for x in (place, planar_before(k)))
    assert off < 0.5 * stays
