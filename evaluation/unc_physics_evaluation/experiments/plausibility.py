"""Gravity and friction beside other engines: a salt box into a bin, a can off a shelf."""

from __future__ import annotations

import numpy as np

from ..comparison import CPU_TIME, POSITION_ERROR, ROTATION_ERROR
from ..jobs import Job, Outcome, Row, Settings
from ..methods import FLOOR, MONTE_CARLO
from ..results import Results
from ..rollouts import ENGINES, available, missing_engines, rollouts
from ..scenarios import MANIPULATION, is_upright
from ..tables import number, table
from ..wasserstein import state_distance

TITLE = "Plausibility"
PLACE, STANDING = "in_place", "upright"
HEAD = ("W1 / floor, positions [m]", "rotations [deg]", "a rollout [ms]")
PLACES = {"salt_box_into_bin": "in the bin", "can_off_shelf": "on the shelf"}


def jobs(settings: Settings) -> list[Job]:
    """Both scenes in every engine that is there."""
    count = 50 if settings.quick else 500
    return [
        Job(
            "plausibility",
            settings.parameters(scene=scene, engine=engine, samples_each=count),
            cost=0.01 * count,
        )
        for scene in MANIPULATION
        for engine in available()
    ]


def missing(settings: Settings) -> list[str]:
    """Engines that are not installed."""
    return missing_engines("plausibility")


def run(job: Job) -> Outcome:
    """Final states of two independent sets of samples, and what became of the body."""
    p = job.parameters
    make, place = MANIPULATION[p["scene"]]
    scene, belief, horizon = make()
    steps = round(horizon / scene.dt)
    # the same initial states in every engine
    common = Job("plausibility", {**p, "engine": "any"})
    seed, other = common.seed("truth"), common.seed("second")
    count = p["samples_each"]
    with rollouts(p["engine"], scene) as run_all:
        starts = belief.sample(count, np.random.default_rng(seed))
        run_all(starts[:1], 1)  # compiles, or loads what is compiled
        states, taken = run_all(starts, steps)
        second, _ = run_all(belief.sample(count, np.random.default_rng(other)), steps)
    rows = [Row(MONTE_CARLO, CPU_TIME, "s", taken / count)]
    for quantity, hits in ((PLACE, place(states[:, 0])), (STANDING, is_upright(states[:, 0]))):
        rows.append(Row(MONTE_CARLO, quantity, "1", float(np.mean(hits)), len(states), 0, seed))
    floor = state_distance(states, second)
    rows.append(Row(FLOOR, POSITION_ERROR, "m", float(floor.position[0]), len(states), 0, seed))
    rows.append(Row(FLOOR, ROTATION_ERROR, "deg", float(floor.rotation[0]), len(states), 0, seed))
    return Outcome(rows, {"states": states})


def report(results: Results) -> str:
    """Probabilities, distances between the engines' final poses, and a picture of the final positions."""
    from ..plots import draw_final_positions

    rows = results.rows("plausibility")
    parts = []
    for scene in rows.unique("scene"):
        here = rows.where(scene=scene)
        jobs_of = {engine: here.where(engine=engine)[0]["job"] for engine in here.unique("engine")}
        ends = {engine: results.arrays("plausibility", job)["states"] for engine, job in jobs_of.items()}
        order = [engine for engine in ENGINES if engine in ends]
        figure = results.figure(f"plausibility_{scene}")
        elements = MANIPULATION[scene][0]()[0].environment
        last = {engine: ends[engine][:, 0] for engine in order}
        draw_final_positions(figure, last, elements, scene.replace("_", " "))
        head = ["", PLACES[scene], "upright", *HEAD]
        lines = []
        for engine in order:
            found = here.where(engine=engine)
            cells = [ENGINES[engine]]
            for quantity in (PLACE, STANDING):
                (row,) = found.where(quantity=quantity)
                error = np.sqrt(row["value"] * (1.0 - row["value"]) / row["samples"])
                cells.append(f"{100.0 * row['value']:.1f} ± {100.0 * error:.1f} %")
            distance = state_distance(ends[engine], ends[order[0]])
            for quantity, value in zip((POSITION_ERROR, ROTATION_ERROR), distance, strict=True):
                floor = found.where(method=FLOOR, quantity=quantity).mean()
                cells.append(f"{number(value[0])} / {number(floor)}")
            cells.append(number(1e3 * found.where(quantity=CPU_TIME).mean()))
            lines.append(cells)
        title = scene.replace("_", " ")
        parts.append(f"### {title.capitalize()}\n\n![{title}](figures/{figure.name})\n")
        parts.append(
            f"Shares of {here.where(quantity=PLACE)[0]['samples']} samples (± standard error); W1 between the"
            f" final poses in {ENGINES[order[0]]} and in each engine, from the same initial states, beside"
            " the engine's own floor:\n"
        )
        parts.append(table(head, lines))
        if len(order) == 3:
            between = state_distance(ends[order[1]], ends[order[2]])
            parts.append(
                f"Between {ENGINES[order[1]]} and {ENGINES[order[2]]}: {number(float(between.position[0]))}"
                f" m, {number(float(between.rotation[0]))} deg.\n"
            )
    return "\n".join(parts)
