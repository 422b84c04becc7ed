"""The tosses by every propagator that runs on their scene, from the registry."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from unc_physics.calibration.objective import Simulator
from unc_physics.checks.errors import NotSupportedError
from unc_physics.prediction.predict import predict
from unc_physics.prediction.request_checks import check_supported
from unc_physics.propagators.base import Propagator, Samples
from unc_physics.propagators.registry import PROPAGATORS, make_propagator
from unc_physics.scene.belief import Belief
from unc_physics.scene.scene import IMPACT_STDS, Scene

from .methods import MONTE_CARLO


def toss_methods(
    scene: Scene, samples: int, truth: int | None = None, names: Iterable[str] = tuple(PROPAGATORS)
) -> dict[tuple[str, int | None], Simulator]:
    """Functions that predict tosses, by the names of their propagators and their numbers of samples.

    Parameters
    ----------
    scene : Scene
    samples : int
        Of Monte Carlo.
    truth : int, optional
        As many again, for comparison.
    names : iterable of str
        Of propagators.

    Notes
    -----
    A propagator that refuses errors of impacts, or uncertain parameters, is given the scene without them;
    one that refuses the scene even so is left out.
    """
    found: dict[tuple[str, int | None], Simulator] = {}
    for name in names:
        if _accepted(scene, make_propagator(name)) is None:
            continue
        for count in (samples, truth) if name == MONTE_CARLO else (None,):
            if name != MONTE_CARLO or count is not None:
                found[name, count] = _by(name)
    return found


def _by(name) -> Simulator:
    def states(
        scene: Scene, belief: Belief, times: Sequence[float], samples: int, seed: int
    ) -> list[np.ndarray]:
        known = PROPAGATORS[name].options()
        options = {"seed": seed} if "seed" in known else {}
        if name == MONTE_CARLO:
            options["samples"] = samples
        propagator = make_propagator(name, **options)
        accepted = _accepted(scene, propagator)
        assert accepted is not None
        prediction = predict(accepted, belief, propagator, times=times)
        if isinstance(propagator, Samples):
            return [prediction.samples(time=time)[:, 0] for time in prediction.times]
        rng = np.random.default_rng(seed)
        return [own.sample(samples, rng)[:, 0] for own in prediction.beliefs]

    return states


_variants: dict[tuple[int, str], tuple[Scene, Scene | None]] = {}


def _accepted(scene: Scene, propagator: Propagator) -> Scene | None:
    """The scene, or as much of it as the propagator takes; None if it takes none."""
    key = id(scene), propagator.name
    if key not in _variants or _variants[key][0] is not scene:
        _variants[key] = scene, _first_accepted(scene, propagator)
    return _variants[key][1]


def _first_accepted(scene, propagator):
    plain = replace(scene, **dict.fromkeys(IMPACT_STDS, 0.0))
    certain = replace(
        plain,
        friction_std=0.0,
        restitution_std=0.0,
        environment=[replace(element, surface_tilt_std=0.0) for element in plain.environment],
    )
    for one in (scene, plain, certain):
        try:
            check_supported(one, propagator)
        except NotSupportedError:
            continue
        return one
    return None
