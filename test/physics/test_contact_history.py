"""Contact histories of scenes that lose a body or get another one, as a tracker's does."""

import numpy as np
import pytest
from plain_scenes import BLOCK, independent, state, world

from unc_physics import RigidBody, make_propagator
from unc_physics.physics.contact_history import of_bodies, with_another_body
from unc_physics.scene.stiffness import with_stiffness

LOWER, UPPER, BESIDE = range(3)


@pytest.fixture(scope="module")
def history():
    """Two rollouts of a block on another one, and a third block beside them, on a floor."""
    scene = world(*(RigidBody(name, BLOCK, 0.5) for name in ("lower", "upper", "beside")))
    places = (0, 0, 0.02), (0, 0, 0.06), (1, 0, 0.02)
    belief = independent(*map(state, places), position=1e-5)
    scene = with_stiffness(scene, belief.mean)
    propagator = make_propagator("monte_carlo", samples=2)
    return propagator.advance(propagator.init(scene, belief), scene, 20).contact_history


def pairs(history, n=0):
    """Bodies and elements in contact in a rollout, as the solver remembers them."""
    return {tuple(row[:2].tolist()) for row in history.solver.contact[n, : history.solver.count[n]]}


def test_contacts_with_a_removed_body_are_forgotten(history):
    assert pairs(history) == {(LOWER, -1), (LOWER, UPPER), (BESIDE, -1)}
    kept = of_bodies(history, np.array([UPPER, BESIDE]))
    assert pairs(kept) == {(1, -1)}, "the upper block has no support, and the third one keeps the floor"
    np.testing.assert_array_equal(kept.first_time[:, 1, 2], history.first_time[:, BESIDE, 3])
    assert np.isinf(kept.first_time[:, 0]).all()
    np.testing.assert_array_equal(kept.solver.residual, history.solver.residual[:, [UPPER, BESIDE]])


def test_an_added_body_has_touched_nothing(history):
    kept = np.zeros_like(history.first_time)
    kept[:, BESIDE, 3] = 0.001
    old = history._replace(solver=history.solver._replace(kept_overlap=kept))
    new = with_another_body(old)
    assert pairs(new) == pairs(old) and new.solver.contact.shape[1] * 3 == old.solver.contact.shape[1] * 4
    assert np.isinf(new.first_time[:, 3]).all() and np.isinf(new.first_time[:, :, 3]).all()
    assert not new.solver.kept_overlap[:, :, 3].any() and not new.solver.rest_steps[:, 3].any()
    again = of_bodies(new, np.arange(3))
    for name in ("first_time", "start"):
        np.testing.assert_array_equal(getattr(again, name), getattr(old, name))
    for name in ("count", "rest_steps", "residual", "kept_overlap", "key"):
        np.testing.assert_array_equal(getattr(again.solver, name), getattr(old.solver, name))
    for n, count in enumerate(old.solver.count):
        np.testing.assert_array_equal(again.solver.contact[n, :count], old.solver.contact[n, :count])
        np.testing.assert_array_equal(again.solver.force[n, :count], old.solver.force[n, :count])
