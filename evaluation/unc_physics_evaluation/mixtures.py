"""Study of mixtures: a belief is split where outcomes bend, and each part runs on its own.

``python -m unc_physics_evaluation.mixtures`` prints the rollouts of each method, and its W1 of positions and
rotations over the floor: geometric means over 36 encounters of three models with 100 and 1000 spheres.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from unc_physics import Belief, predict
from unc_physics.propagators.registry import make_propagator
from unc_physics.spatial.layout import ERR_ANGULAR_VELOCITY, ERR_POSITION, ERR_ROTATION, ERROR
from unc_physics.spatial.moments import spread_states

from .comparison import monte_carlo
from .scenarios import MODELS, collision
from .wasserstein import state_distance

SAMPLES, MOST = 500, 9
#: Three equally wide Gaussians in place of a standard one, by least squares of the densities: the outer
#: ones' weight and mean, and the standard deviation.
WEIGHT, SHIFT, WIDTH = 0.2252246249, 1.0575154615, 0.6715662887


class Part(NamedTuple):
    """A component: weight, belief at time 0 and at the end, and its priority by direction."""

    weight: float
    start: Belief
    end: Belief
    priority: np.ndarray


def run(scene, belief, horizon, method, weight) -> tuple[Part, int]:
    """Return a component that has run, and its number of rollouts.

    The priority of a direction is the bend of the outcome along it (sigma points), or its share of the
    spread where there is no bend (linearization).
    """
    steps, propagator = round(horizon / scene.dt), make_propagator(method)
    carry = propagator.advance(propagator.init(scene, belief), scene, steps)
    end = propagator.belief(carry, scene)
    if method == "linearization":
        spread = np.sqrt(np.trace(end.blocks[:, ERR_POSITION, ERR_POSITION], axis1=1, axis2=2).sum())
        lengths = np.linalg.norm(belief.root(), axis=0)
        return Part(weight, belief, end, weight * spread * lengths / lengths.max()), 1
    from unc_physics.propagators.point_pairs import errors_about_first

    states = propagator.point_states(carry, scene)
    errors, count = errors_about_first(states), len(states) // 2
    sums = (errors[1 : count + 1] + errors[count + 1 :]).reshape(count, -1, ERROR)[..., ERR_POSITION]
    return Part(weight, belief, end, weight * np.linalg.norm(sums.reshape(count, -1), axis=1)), len(states)


def mixtures(scene, belief, horizon, method):
    """Yield (parts, rollouts so far) with 1, 3, 5, ... parts."""
    first, spent = run(scene, belief, horizon, method, 1.0)
    parts = [first]
    while True:
        yield list(parts), spent
        if len(parts) == MOST:
            return
        part = parts.pop(int(np.argmax([one.priority.max() for one in parts])))
        along = part.start.root()[:, int(np.argmax(part.priority))]
        joint = part.start.joint - (1.0 - WIDTH**2) * np.outer(along, along)
        for shift, share in ((0.0, 1.0 - 2.0 * WEIGHT), (SHIFT, WEIGHT), (-SHIFT, WEIGHT)):
            mean = spread_states(part.start.mean.copy(), np.arange(len(joint) // ERROR), shift * along[None])[
                0
            ]
            start = Belief.trusted(mean, 0.5 * (joint + joint.T), scene.moving)
            found, rollouts = run(scene, start, horizon, method, share * part.weight)
            parts.append(found)
            spent += rollouts


def drawn(parts, rng):
    """Return states of a mixture, in proportion to the weights."""
    last = np.floor(np.cumsum([part.weight for part in parts]) * SAMPLES + 0.5).astype(int)
    counts = np.diff(np.concatenate([[0], last]))
    return np.concatenate(
        [part.end.sample(int(n), rng) for part, n in zip(parts, counts, strict=True) if n > 0]
    )


def combined(rotations: Belief, positions: Belief, scene) -> Belief:
    """Return a belief with rotations and spins of one and positions and velocities of another one."""
    turning = np.zeros(ERROR, bool)
    turning[ERR_ROTATION] = turning[ERR_ANGULAR_VELOCITY] = True
    same = turning[:, None] & turning
    kept = ~turning[:, None] & ~turning
    return Belief.trusted(
        positions.mean.copy(),
        np.where(same, rotations.blocks, np.where(kept, positions.blocks, 0.0)),
        scene.moving,
    )


def errors(model, spheres, sigma, encounter) -> dict[str, tuple[int, np.ndarray]]:
    """Return rollouts and W1 (2,) of each method."""
    scene, belief, horizon = collision(model, spheres, sigma, encounter)
    truth, second = (monte_carlo(scene, belief, horizon, SAMPLES, seed) for seed in (11, 12))
    rng = np.random.default_rng(3)

    def error(states):
        return np.array([np.mean(values) for values in state_distance(states, truth.states)])

    found = {"floor": (SAMPLES, error(second.states))}
    for n in (13, 39, 65, 117):
        own = [error(second.states[n * k : n * (k + 1)]) for k in range(4)]
        found[f"monte_carlo {n}"] = n, np.mean(own, axis=0)
    for n in (16, 32, 64):
        answer = predict(scene, belief, make_propagator("cloud", samples=n), horizon)
        found[f"cloud {n}"] = n, error(answer.samples())
    beliefs = {
        name: predict(scene, belief, make_propagator(name), horizon).belief
        for name in ("surrogate", "local_sampling")
    }
    beliefs["surrogate's rotations, local sampling's positions"] = combined(*beliefs.values(), scene)
    for name, own in beliefs.items():
        found[name] = 1, error(own.sample(SAMPLES, rng))
    for method in ("sigma_points", "linearization"):
        for parts, rollouts in mixtures(scene, belief, horizon, method):
            found[f"{method}, {len(parts)} parts"] = rollouts, error(drawn(parts, rng))
    return found


def main():
    """Print the table."""
    found = [
        errors(model, spheres, sigma, encounter)
        for encounter in (1, 2)
        for model in MODELS
        for spheres in (100, 1000)
        for sigma in (0.01, 0.05, 0.1)
    ]
    for method in found[0]:
        ratios = [one[method][1] / one["floor"][1] for one in found]
        means = np.exp(np.mean(np.log(ratios), axis=0))
        rollouts = np.mean([one[method][0] for one in found])
        print(f"{method:50s} {rollouts:5.0f} rollouts  {means[0]:.2f} {means[1]:.2f}")


if __name__ == "__main__":
    main()
