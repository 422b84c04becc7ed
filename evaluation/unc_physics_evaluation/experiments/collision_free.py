"""Motion without contact (the paper's Table 2): does every method reach the sampling floor?"""

from __future__ import annotations

from ..comparison import POSITION_ERROR, ROTATION_ERROR, distance_cost, error_rows, predicted, two_truths
from ..jobs import Job, Outcome, Settings
from ..methods import FLOOR, GAUSSIAN, MONTE_CARLO, label
from ..results import Results
from ..scenarios import collision_free
from ..tables import number

TITLE = "Collision-free motion"
COUNTS = (10, 50, 100)
#: W1 [m] and [degrees] in the paper's Table 2.
PAPER = {
    (MONTE_CARLO, 100): (0.0094, 1.065),
    (MONTE_CARLO, 50): (0.0147, 1.919),
    (MONTE_CARLO, 10): (0.0873, 3.537),
    ("surrogate", None): (0.0021, 0.792),
    ("local_sampling", None): (0.0021, 0.792),
    ("linearization", None): (0.0021, 0.781),
    ("sigma_points_full", None): (0.0021, 1.861),
}
COLUMNS = (("linear_velocity", POSITION_ERROR, "m"), ("angular_velocity", ROTATION_ERROR, "deg"))


def jobs(settings: Settings) -> list[Job]:
    """Return a job for each uncertain velocity and each of several independent truths."""
    size, repeats = (200, 2) if settings.quick else (1000, 10)
    return [
        Job(
            "collision_free",
            settings.parameters(
                uncertain=uncertain, model="pin", spheres=10, sigma=0.1, truth=size, repeat=k
            ),
            cost=0.2 + 5 * distance_cost(size),
        )
        for uncertain, *_ in COLUMNS
        for k in range(repeats)
    ]


def run(job: Job) -> Outcome:
    """Return W1 of every method after 4 s."""
    p = job.parameters
    scene, belief, horizon = collision_free(p["uncertain"], p["model"], p["spheres"], p["sigma"])
    truth, second = two_truths(scene, belief, horizon, job)
    answers = predicted(scene, belief, horizon, job)
    return Outcome(error_rows(job, truth, second, answers, COUNTS))


def report(results: Results) -> str:
    """Return Table 2, with mean and scatter over the truths."""
    rows = results.rows("collision_free")
    shown = [(name, None) for name in rows.unique("method") if name not in (MONTE_CARLO, FLOOR, GAUSSIAN)]
    shown += [(MONTE_CARLO, count) for count in reversed(COUNTS)]
    shown += [(GAUSSIAN, None), (FLOOR, None)]
    lines = []
    for method, samples in shown:
        cells = [label(method, samples)]
        for k, (uncertain, quantity, _) in enumerate(COLUMNS):
            found = rows.where(uncertain=uncertain, quantity=quantity, method=method, samples=samples)
            floor = rows.where(uncertain=uncertain, quantity=quantity, method=FLOOR)
            cells.append(f"{number(found.mean())} ± {number(found.std())}")
            cells.append(f"{found.mean() / floor.mean():.2f}")
            cells.append(number(PAPER[method, samples][k]) if (method, samples) in PAPER else "")
        lines.append(cells)
    head = ["method"]
    for quantity, unit in (("position", "m"), ("rotation", "deg")):
        head += [f"{quantity} [{unit}]", "over floor", f"paper [{unit}]"]
    return results.table("collision_free", head, lines)
