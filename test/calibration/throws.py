"""Recorded motions that are made up: throws of a box by a known scene, seen with known errors."""

import numpy as np

from unc_physics import Belief, Motion, Plane, RigidBody, Scene, make_propagator, predict, rounded_box
from unc_physics.spatial.quaternions import product
from unc_physics.spatial.rotation import exp_vectors

BOX = rounded_box((0.1, 0.1, 0.06), 0.004, "box").prefix(8)
NOISE = 2e-4, 2e-3  # m, rad


def scene(inertia=None, **physics):
    """A box over a table."""
    body = RigidBody("box", BOX, 0.3, inertia=inertia)
    return Scene.everyday([body], exact=True, **({"environment": [Plane(name="table")]} | physics))


def everyday(**physics):
    """The same with the impacts of the preset: friction that falls with their speed, and their errors."""
    return Scene.everyday([RigidBody("box", BOX, 0.3)], environment=[Plane(name="table")], **physics)


def throws(of, count, seed=0, dt=1 / 120, poses=84, noise=NOISE, height=0.14):
    """Motions of a scene's box, thrown at random."""
    rng, found = np.random.default_rng(seed), []
    for k in range(count):
        state = np.zeros((1, 13))
        state[0, :6] = [0.0, 0.0, height, 1.0, 0.0, -0.3]
        q = rng.standard_normal(4)
        state[0, 6:10] = q / np.linalg.norm(q)
        state[0, 10:] = 4.0 * rng.standard_normal(3)
        times = dt * np.arange(1, poses)
        one = make_propagator("monte_carlo", samples=1, seed=int(rng.integers(1 << 30)))
        thrown = predict(of, Belief.exact(state), one, times=times.tolist())
        states = np.concatenate([state, *(snapshot.samples[0] for snapshot in thrown.snapshots)])
        positions = states[:, :3] + noise[0] * rng.standard_normal((poses, 3))
        turned = product(states[:, 6:10], exp_vectors(noise[1] * rng.standard_normal((poses, 3))))
        found.append(Motion(str(k), [0.0, *times], np.concatenate([positions, turned], axis=1)))
    return found
