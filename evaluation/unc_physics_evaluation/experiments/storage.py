"""Storage (the paper's Table 3): how many scalars stand for the distribution."""

from __future__ import annotations

import numpy as np

from unc_physics.physics.layout import ERROR, STATE
from unc_physics.propagators.registry import make_propagator

from ..jobs import Job, Outcome, Row, Settings
from ..methods import MONTE_CARLO, label, methods
from ..results import Results
from ..scenarios import many_collisions
from ..tables import table

TITLE = "Storage"
BODIES = (2, 4, 8, 16, 32, 64)
SAMPLES = (10, 100, 1000)
SCALARS = "scalars"
#: Table 3, with B bodies, as dense matrices.
PAPER = {
    "linearization": lambda b: STATE * b + (ERROR * b) ** 2,
    "surrogate": lambda b: STATE * b + ERROR**2 * b,
    "local_sampling": lambda b: STATE * b + ERROR**2 * b,
    "sigma_points_full": lambda b: (2 * ERROR * b + 1) * STATE * b,
}


def jobs(settings: Settings) -> list[Job]:
    """One for each number of bodies."""
    return [Job("storage", settings.parameters(bodies=bodies), cost=0.5) for bodies in BODIES]


def run(job: Job) -> Outcome:
    """Count the scalars of every method's carry, at the start of colliding pairs."""
    scene, belief, _ = many_collisions(job.parameters["bodies"] // 2, spheres=10)
    made = methods(job)
    made |= {(MONTE_CARLO, count): make_propagator(MONTE_CARLO, samples=count) for count in SAMPLES}
    return Outcome(
        [
            Row(name, SCALARS, "1", _scalars(propagator, scene, belief), samples)
            for (name, samples), propagator in made.items()
        ]
    )


def report(results: Results) -> str:
    """A table and a figure over the number of bodies."""
    from ..plots import draw_storage

    rows = results.rows("storage")
    figure = results.figure("storage")
    draw_storage(figure, rows)
    bodies = rows.unique("bodies")
    lines = []
    for method, samples in rows.curves():
        found = rows.where(method=method, samples=samples)
        lines.append([label(method, samples), *(f"{found.where(bodies=b).mean():.0f}" for b in bodies)])
        if method in PAPER:
            lines.append(["the paper's, dense", *(str(PAPER[method](b)) for b in bodies)])
    return (
        "Scalars in each method's carry, where the positions alone are uncertain (3 of 12 directions of a"
        " body). Linearization's root and the minimal sigma points have as many columns and points as that"
        " takes.\n\n"
        + table(["", *(f"{b} bodies" for b in bodies)], lines)
        + f"\n![Scalars over the number of bodies](figures/{figure.name})\n"
    )


def _scalars(propagator, scene, belief):
    """Numbers in a carry that stand for the distribution, without counters and contact history."""
    parts = propagator.init(scene, belief)._asdict()
    return sum(
        part.size
        for name, part in parts.items()
        if name != "contact_history" and isinstance(part, np.ndarray)
    )
