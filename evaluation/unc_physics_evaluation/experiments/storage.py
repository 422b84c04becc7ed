"""Storage (the paper's Table 3): size of the distribution's representation."""

from __future__ import annotations

import numpy as np

from unc_physics import Belief, RigidBody, Scene, make_propagator
from unc_physics.spatial.layout import ERROR, STATE

from ..jobs import Job, Outcome, Row, Settings
from ..methods import MONTE_CARLO, label, methods
from ..results import Results
from ..scenarios import MASS, resting, spread, unit_model

TITLE = "Storage"
BODIES, SAMPLES, SCALARS = (2, 4, 8, 16, 32, 64), (10, 100, 1000), "scalars"
#: The paper's Table 3 for B bodies, with dense matrices.
PAPER = {
    "linearization": lambda b: STATE * b + (ERROR * b) ** 2,
    "surrogate": lambda b: STATE * b + ERROR**2 * b,
    "local_sampling": lambda b: STATE * b + ERROR**2 * b,
    "sigma_points_full": lambda b: (2 * ERROR * b + 1) * STATE * b,
}


def jobs(settings: Settings) -> list[Job]:
    """Return a job for each number of bodies."""
    return [Job("storage", settings.parameters(bodies=bodies), cost=0.5) for bodies in BODIES]


def run(job: Job) -> Outcome:
    """Count the scalars of each method's carry for bodies whose positions are uncertain."""
    count = job.parameters["bodies"]
    packing = unit_model("bunny", 10)
    scene = Scene(tuple(RigidBody(f"b{k}", packing, MASS) for k in range(count)), dt=0.01)
    belief = Belief(resting([[3.0 * k, 0.0, 0.0] for k in range(count)]), spread(count, position=0.05))
    made = methods(job) | {(MONTE_CARLO, n): make_propagator(MONTE_CARLO, samples=n) for n in SAMPLES}
    return Outcome(
        [
            Row(name, SCALARS, "1", _scalars(made[name, n], scene, belief), n)
            for name, n in made
            if _counts(name)
        ]
    )


def report(results: Results) -> str:
    """Return the paper's Table 3, with the paper's counts."""
    rows, lines = results.rows("storage"), []
    bodies = rows.unique("bodies")
    for method, samples in rows.curves():
        found = rows.where(method=method, samples=samples)
        lines.append([label(method, samples), *(f"{found.where(bodies=b).mean():.0f}" for b in bodies)])
        if method in PAPER:
            paper = (str(PAPER[method](b)) for b in bodies)
            lines.append([f"{label(method)}, in the paper", *paper])
    return results.table("storage", ["method", *(f"{b} bodies" for b in bodies)], lines)


def _counts(name):
    return name in PAPER or name in (MONTE_CARLO, "sigma_points")


def _scalars(propagator, scene, belief):
    """Count the numbers of the distribution, without counters and contact history."""
    parts = propagator.init(scene, belief)._asdict()
    arrays = (part for name, part in parts.items() if name != "contact_history")
    return sum(part.size for part in arrays if isinstance(part, np.ndarray))
