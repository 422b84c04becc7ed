"""Pictures of packings and of samples (the paper's Figs. 2, 4 and 5)."""

from __future__ import annotations

import numpy as np

from unc_physics.prediction.predict import predict

from ..comparison import monte_carlo, rollout_cost
from ..jobs import Job, Outcome, Row, Settings
from ..methods import label, methods
from ..results import Results
from ..scenarios import collision, collision_free, has_packing, unit_model

TITLE = "Pictures"
PACKINGS = (("pin", 100), ("bunny", 1000), ("armadillo", 100_000))  # Fig. 2
FREE = ("linear_velocity", "angular_velocity")  # Fig. 4
COLLISIONS = (  # Fig. 5
    ("bunny", 1000, "local_sampling"),
    ("bunny", 1000, "sigma_points"),
    ("pin", 100, "linearization"),
    ("armadillo", 10_000, "surrogate"),
)


def jobs(settings: Settings) -> list[Job]:
    """One for each picture of samples."""
    count = 200 if settings.quick else 1000
    free = [
        Job(
            "pictures",
            settings.parameters(
                scene=uncertain, model="pin", spheres=100, propagator="linearization", count=count
            ),
            cost=0.5,
        )
        for uncertain in FREE
    ]
    return free + [
        Job(
            "pictures",
            settings.parameters(
                scene="collision", model=model, spheres=spheres, propagator=propagator, count=count
            ),
            cost=1.2 * count * rollout_cost(spheres),
        )
        for model, spheres, propagator in COLLISIONS
    ]


def run(job: Job) -> Outcome:
    """Samples of the truth and of a prediction, before and after."""
    p = job.parameters
    if p["scene"] == "collision":
        scene, belief, horizon = collision(p["model"], p["spheres"], 0.05)
    else:
        scene, belief, horizon = collision_free(p["scene"], p["model"], p["spheres"])
    truth = monte_carlo(scene, belief, horizon, p["count"], job.seed("truth"))
    prediction = predict(scene, belief, methods(job)[p["propagator"], None], horizon)
    seed = job.seed("draws")
    arrays = {
        "before": belief.sample(p["count"], np.random.default_rng(job.seed("truth"))),
        "truth": truth.states,
        "prediction": prediction.belief.sample(p["count"], np.random.default_rng(seed)),
    }
    return Outcome([Row(p["propagator"], "samples", "1", p["count"], p["count"], 0, seed)], arrays)


def report(results: Results) -> str:
    """The pictures."""
    from ..plots import draw_packings, draw_samples

    parts = []
    packings = [unit_model(*case) for case in PACKINGS if has_packing(*case)]
    figure = results.figure("pictures_packings")
    draw_packings(figure, packings)
    parts.append(f"![Packings (as Fig. 2)](figures/{figure.name})\n")
    shown = {
        (row["scene"], row["model"], row["spheres"], row["method"]): row for row in results.rows("pictures")
    }
    for (scene, model, spheres, method), row in shown.items():
        arrays = results.arrays("pictures", row["job"])
        if not arrays:
            continue
        figure = results.figure(f"pictures_{scene}_{model}_{spheres}_{method}")
        what = f"{model}, {spheres} spheres, {label(method)}"
        what += " after a collision" if scene == "collision" else f", uncertain {scene.replace('_', ' ')}"
        draw_samples(figure, arrays, unit_model(model, min(spheres, 1000)), method, what)
        parts.append(f"![{what}](figures/{figure.name})\n")
    return "\n".join(parts)
