"""Predicted final poses of pushed blocks: by unc_physics, by other engines, and without physics."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from unc_physics.prediction.predict import predict
from unc_physics.propagators.registry import make_propagator
from unc_physics.spatial.layout import POSITION, QUATERNION

from .engines import FINE, OWN, Settings, Shape, run_in
from .methods import MARGINAL, MONTE_CARLO, OURS, STILL
from .recorded_pushes import (
    EDGE,
    FOOT,
    HEIGHT,
    REPEATS_STD,
    Frictions,
    Push,
    edges,
    feet_of,
    measured_frictions,
    planar,
    planar_before,
    push_scene,
    recorded_pushes,
    seen,
    uncertain_push,
)

SAMPLES, ENGINE_SAMPLES = 20, 8
#: Friction of engines that nobody has set.
_UNSET = {"mujoco": 1.0, "pybullet": 0.5}


def push_predictions(
    folder: Path, tests: Sequence[int], every: Sequence[int], by: str, calibrated: bool, seed: int
) -> Iterator[dict[str, np.ndarray]]:
    """Return the states (n, 13) of the block at the end of each push.

    Predictions by physics include the spread of repeated pushes, like the recording errors in predictions of
    tosses. It was measured between pushes by the same command and is not a parameter of the block.

    Parameters
    ----------
    folder : Path
        Folder of the pushes.
    tests, every : sequence of int
        Predicted pushes, and all pushes of their kind.
    by : str
        Our package, an engine, or the outcomes of other pushes.
    calibrated : bool
        Whether to use the measured frictions with their errors.
    seed : int
    """
    moves = np.array([_move(k, folder) for k in every]) if by == MARGINAL else np.empty((0, 3))
    for k in tests:
        rng = np.random.default_rng([seed, k])
        if by == MARGINAL:
            own = moves[[other != k for other in every]]
            yield {MARGINAL: _states(_moved(k, own, folder)), STILL: _states(planar_before(k, folder)[None])}
            continue
        if by == OURS:
            push = uncertain_push(k, calibrated, folder)
            propagator = make_propagator(MONTE_CARLO, samples=SAMPLES, seed=int(rng.integers(1 << 30)))
            prediction = predict(push.scene, push.belief, propagator, push.horizon)
            places = planar(prediction.samples()[:, 0])
        else:
            places = np.array(list(_in_engine(by, k, calibrated, folder, rng)))
            places = places[np.arange(SAMPLES) % len(places)]
        yield {by: _states(places + REPEATS_STD * rng.standard_normal(places.shape))}


def push_outcomes(folder: Path, tests: Sequence[int]) -> list[np.ndarray]:
    """Return the pose (7,) of the block after each push."""
    states = _states(np.array([seen(k, folder) for k in tests]))
    return list(np.concatenate([states[:, POSITION], states[:, QUATERNION]], axis=1))


def _in_engine(engine, k, calibrated, folder, rng):
    """Return final poses (3,): one with default settings, or several with finer ones and drawn frictions."""
    support = int(recorded_pushes(folder).support[k])
    if not calibrated:
        push = push_scene(k, Frictions(*[_UNSET[engine]] * 2), folder=folder)
        yield pushed_in(engine, OWN[engine], push, support)
        return
    table, tip, table_std, tip_std = measured_frictions(k, folder)
    for z in rng.standard_normal((ENGINE_SAMPLES, 2)):
        drawn = Frictions(table * np.exp(z[0] * table_std / table), tip * np.exp(z[1] * tip_std / tip))
        yield pushed_in(engine, FINE[engine], push_scene(k, drawn, folder=folder), support)


def pushed_in(engine: str, settings: Settings, push: Push, support: int) -> np.ndarray:
    """Return the block's final pose (3,) after a push in an engine, on some of its feet, as `planar`."""
    pusher = push.scene.bodies[1].model
    shapes = {
        "block": _block_shapes(support),
        "pusher": [
            Shape("sphere", (r,), c) for c, r in zip(pusher.centers, pusher.radii.tolist(), strict=True)
        ],
    }
    return planar(run_in(engine, settings, push.scene, shapes, push.belief.mean, push.horizon)[0])


def _block_shapes(support: int) -> list[Shape]:
    """Return the shapes of our block: boxes as thick as our spheres' radius along its edges, and its feet."""
    pushes = recorded_pushes()
    low, shapes = -0.5 * pushes.height, []
    for a, along, inward, length, margin in edges():
        middle = a + 0.5 * length * along + 0.5 * EDGE * inward - pushes.com
        turned = Rotation.from_rotvec([0.0, 0.0, math.atan2(along[1], along[0])])
        place = np.array([*middle, low + HEIGHT])
        shapes.append(Shape("box", (length - 2.0 * margin, EDGE, 2.0 * EDGE), place, turned))
    feet = feet_of(support) - pushes.com
    return shapes + [Shape("sphere", (FOOT,), np.array([*foot, low + FOOT])) for foot in feet]


def _heading(k, folder):
    """Return the direction of the tips' total displacement [rad]."""
    path = recorded_pushes(folder).paths[k]
    return np.arctan2(*(path[-1, 1:3] - path[0, 1:3])[::-1])


def _turned(places, angle):
    c, s = np.cos(angle), np.sin(angle)
    x, y, yaw = np.moveaxis(places, -1, 0)
    return np.stack([c * x - s * y, s * x + c * y, yaw], axis=-1)


def _move(k, folder):
    """Return the block's displacement and rotation (3,) by push ``k``, in the axes of its heading."""
    return _turned(seen(k, folder) - planar_before(k, folder), -_heading(k, folder))


def _moved(k, moves, folder):
    return planar_before(k, folder) + _turned(moves, _heading(k, folder))


def _states(places):
    """Return the states (n, 13) of a block at positions and yaws (n, 3) on the table."""
    states = np.zeros((len(places), 13))
    states[:, :2] = places[:, :2]
    states[:, 8], states[:, 9] = np.sin(0.5 * places[:, 2]), np.cos(0.5 * places[:, 2])
    return states
