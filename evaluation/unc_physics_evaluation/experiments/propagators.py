"""Time of the propagators relative to Monte Carlo with ten samples, over the number of spheres."""

from __future__ import annotations

import numpy as np

from unc_physics import Belief, make_propagator, predict
from unc_physics.dynamics.rollout import simulate

from ..comparison import TIME_RATIO, rollout_cost, time_rows
from ..jobs import Job, Outcome, Settings
from ..methods import MONTE_CARLO, label, methods
from ..results import Results
from ..scenarios import LARGE, MODELS, collision, has_packing, missing_packings
from ..tables import number

TITLE = "Time of the propagators"
SPHERES = (10, 100, 1000, 10_000, LARGE)
NOMINAL = "nominal_rollout"


def jobs(settings: Settings) -> list[Job]:
    """Return a job for each model with each number of spheres, alone on the machine."""
    rounds = 3 if settings.quick else 15
    spheres = SPHERES[:3] if settings.quick else SPHERES
    return [
        Job(
            "propagators",
            settings.parameters(model=model, spheres=n, rounds=rounds),
            cost=5.0 + 150 * rounds * rollout_cost(n),
            alone=True,
        )
        for model in MODELS
        for n in spheres
        if has_packing(model, n)
    ]


def missing(settings: Settings) -> list[str]:
    """Return missing packings."""
    return [] if settings.quick else missing_packings()


def run(job: Job) -> Outcome:
    """Return times of predictions and of the nominal rollout.

    Each round has another mean, drawn from the belief, because a single nominal rollout may have far more or
    fewer contacts than its neighbours.
    """
    p = job.parameters
    scene, belief, horizon = collision(p["model"], p["spheres"])
    means = belief.sample(p["rounds"], np.random.default_rng(job.seed("means")))

    def predicts(propagator):
        return lambda k: predict(scene, Belief(means[k], belief.covariance), propagator, horizon)

    def rolls(k):
        simulate(means[k : k + 1].copy(), scene.world, round(horizon / scene.dt))

    rollouts = make_propagator(MONTE_CARLO, samples=10, seed=job.seed(MONTE_CARLO))
    functions = {
        key: predicts(propagator) for key, propagator in {(MONTE_CARLO, 10): rollouts, **methods(job)}.items()
    }
    return Outcome(time_rows({**functions, (NOMINAL, None): rolls}, p["rounds"]))


def report(results: Results) -> str:
    """Return a table of speed relative to MC-10."""
    rows = results.rows("propagators")
    models = rows.unique("model")
    lines = []
    for spheres in rows.unique("spheres"):
        here = rows.where(spheres=spheres)
        for method, samples in here.curves():
            if method == MONTE_CARLO:
                continue
            found = here.where(method=method, samples=samples, quantity=TIME_RATIO)
            faster = [number(1.0 / found.where(model=model).median()) for model in models]
            lines.append([str(spheres), label(method, samples), *faster])
    return results.table("propagator_times", ["spheres", "method", *models], lines)
