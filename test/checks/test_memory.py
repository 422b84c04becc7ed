"""Memory is asked for before it is taken."""

import tracemalloc

import numpy as np
import pytest
from example_scenes import parts_of

from unc_physics import Belief, RigidBody, Scene, load_model, make_propagator, predict
from unc_physics.checks import memory
from unc_physics.checks.errors import InvalidOptionError, LimitExceededError
from unc_physics.checks.memory import available_memory, require_memory
from unc_physics.physics.everyday.columns import REMEMBERED
from unc_physics.physics.everyday.rollouts import FIRST_ROOM
from unc_physics.prediction import request_checks


def test_what_is_there_is_granted_and_what_is_not_is_refused_with_both_numbers(monkeypatch):
    assert 1e8 < available_memory() < 1e14
    require_memory(0.5 * available_memory(), "a half", "samples")
    monkeypatch.setenv(memory.LIMIT, "5e9")
    with pytest.raises(LimitExceededError, match=r"samples must be less: a lot takes about 60 GB.* 5 000 MB"):
        require_memory(6e10, "a lot", "samples", 7)
    monkeypatch.setenv(memory.LIMIT, "1e15")
    require_memory(6e10, "a lot", "samples", 7)
    for value in ("much", "nan", "-1"):
        monkeypatch.setenv(memory.LIMIT, value)
        with pytest.raises(
            InvalidOptionError, match=f"UNC_PHYSICS_MEMORY must be a number of bytes.*{value}"
        ):
            require_memory(6e10, "a lot", "samples", 7)


def many(count, **physics):
    """So many pins beside each other."""
    pin = load_model("pin").prefix(10)
    scene = Scene([RigidBody(f"pin{k}", pin, 1.0) for k in range(count)], **physics)
    mean = np.zeros((count, 13))
    mean[:, 0], mean[:, 9] = 2.0 * np.arange(count), 1.0
    return scene, Belief(mean, np.tile(1e-4 * np.eye(12), (count, 1, 1)))


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_predictions_that_do_not_fit_are_refused_at_once(monkeypatch, integrator):
    monkeypatch.setenv(memory.LIMIT, "1e10")
    scene, belief = many(200, integrator=integrator)
    with pytest.raises(LimitExceededError, match="samples must be less: 200 bodies in 10000000 rollouts"):
        predict(scene, belief, make_propagator("monte_carlo", samples=10_000_000), 1.0)
    with pytest.raises(LimitExceededError, match="number of times must be less"):
        predict(scene, belief, "linearization", times=np.arange(1, 999) * 0.01)
    scene, belief = many(1000, integrator=integrator)
    with pytest.raises(LimitExceededError, match="number of bodies must be less: 1000 bodies in 24001 "):
        predict(scene, belief, "sigma_points", 1.0)
    with pytest.raises(LimitExceededError, match="moving bodies must be less"):
        many(3000)[1].with_common_pose_std([0.01] * 6)


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
@pytest.mark.parametrize(("bodies", "samples"), [(4, 1000), (30, 20)])
def test_the_estimate_is_about_the_bytes_of_a_prediction(monkeypatch, integrator, bodies, samples):
    """Of the arrays that it returns, for many times, and of what it takes while it runs, for one.

    With 12 contacts for each body; here there are none.
    """
    asked = []
    monkeypatch.setattr(request_checks, "require_memory", lambda needed, *_: asked.append(needed))
    scene, belief = many(bodies, integrator=integrator)
    propagator = make_propagator("monte_carlo", samples=samples)
    for times in (1, 21):
        prediction = predict(scene, belief, propagator, times=0.01 * np.arange(1, times + 1))
    arrays = {
        id(array): array.nbytes
        for one in prediction.snapshots
        for array in (*parts_of(one.carry), one.belief.blocks, one.belief._errors)
    }
    contacts = 0 if integrator == "explicit" else samples * bodies * FIRST_ROOM * REMEMBERED * 8
    assert asked[1] - asked[0] - 20 * contacts == pytest.approx(sum(arrays.values()) * 20.0 / 21.0, rel=0.5)
    tracemalloc.start()
    predict(scene, belief, propagator, 0.01)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # two copies, and what is returned
    assert 0.5 * peak < asked[0]
    assert asked[0] - 3 * contacts < 2.5 * peak
