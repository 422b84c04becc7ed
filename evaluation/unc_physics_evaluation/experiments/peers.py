"""Monte Carlo in PyBullet and in MuJoCo: time of a rollout, and of a prediction at equal error."""

from __future__ import annotations

import numpy as np

from unc_physics.dynamics.rollout import simulate
from unc_physics.propagators.registry import make_propagator

from ..comparison import (
    CPU_TIME,
    POSITION_ERROR,
    ROTATION_ERROR,
    Samples,
    distance_cost,
    error_rows,
    predicted,
    predictors,
)
from ..engines import GEOMETRIES, PEERS
from ..goals import Figure, goal_tables, goals_met_by
from ..jobs import Job, Outcome, Row, Settings
from ..methods import FLOOR, MONTE_CARLO, label
from ..pareto import Choice
from ..results import Results, Rows
from ..rollouts import ENGINES, OURS, available, missing_engines
from ..scenarios import MODELS, collision
from ..tables import number, table
from ..timing import paired

TITLE = "Peers"
SHAPES = {"spheres": "1000 spheres", "pieces": "convex pieces", "box": "a box"}
COUNTS = (2, 5, 10, 20, 50, 100, 200, 500, 1000)
ROLLOUT, ROLLOUT_RATIO = "rollout_time", "rollout_time_over_ours"
#: How many times longer a rollout with the same spheres is to take than ours: of the armadillo, of others.
GOALS = {"pybullet": (3.0, 5.0), "mujoco": (25.0, 40.0)}
_COSTS = {"ours": 1e-3, "pybullet": 4e-3, "mujoco": 8e-3}  # s
_MUJOCO_SPHERES_COST = 0.08  # s


def jobs(settings: Settings) -> list[Job]:
    """Every engine that is there, with spheres and with other geometries."""
    truth, rounds = (100, 2) if settings.quick else (1000, 7)
    models = MODELS[:1] if settings.quick else MODELS
    made = []
    for model in models:
        for engine in available():
            for geometry in GEOMETRIES if engine != OURS else GEOMETRIES[:1]:
                if settings.quick and engine == "mujoco" and geometry == "spheres":
                    continue
                each = _MUJOCO_SPHERES_COST if (engine, geometry) == ("mujoco", "spheres") else _COSTS[engine]
                made.append(
                    Job(
                        "peers",
                        settings.parameters(
                            engine=engine,
                            geometry=geometry,
                            model=model,
                            spheres=1000,
                            sigma=0.05,
                            truth=truth,
                            rounds=rounds,
                        ),
                        cost=(2 * truth + 4 * rounds) * each + 10 * distance_cost(truth),
                    )
                )
    return made


def missing(settings: Settings) -> list[str]:
    """Engines that are not installed."""
    return missing_engines("peers")


def run(job: Job) -> Outcome:
    """Errors of Monte Carlo to the engine's own truth, and CPU times of its rollouts beside ours."""
    p = job.parameters
    scene, belief, horizon = collision(p["model"], p["spheres"], p["sigma"])
    steps = round(horizon / scene.dt)
    simulator = make_propagator(MONTE_CARLO)

    def ours(state):
        states = state[None].copy()
        simulate(states, scene.world, steps)
        return states[0]

    engine = None if p["engine"] == OURS else PEERS[p["engine"]](scene, p["geometry"])
    theirs = ours if engine is None else lambda state: engine.run(state, steps)

    def samples(name):
        seed = job.seed(name)
        states = np.array([theirs(state) for state in belief.sample(p["truth"], np.random.default_rng(seed))])
        carry = simulator.init(scene, belief)._replace(states=states)
        return Samples(states, simulator.belief(carry, scene), seed)

    truth, second = samples("truth"), samples("second")
    answers = predicted(scene, belief, horizon, job) if engine is None else {}
    rows = error_rows(job, truth, second, answers, [n for n in COUNTS if n <= p["truth"]])
    states = belief.sample(4 * p["rounds"], np.random.default_rng(job.seed("timed"))).reshape(
        p["rounds"], 4, *belief.mean.shape
    )

    def four_of(run):
        return lambda k: [run(state) for state in states[k]]

    # each prediction beside the same rollout, so that ratios to it carry over from job to job
    functions = {(OURS, None): four_of(ours)}
    if engine is None:
        functions |= predictors(scene, belief, horizon, job, (10,))
    else:
        functions[p["engine"], None] = four_of(theirs)
    times = paired(functions, p["rounds"])
    for (method, count), taken in times.items():
        share = 4.0 if method in (OURS, p["engine"]) else 1.0
        name, quantity = (MONTE_CARLO, ROLLOUT) if share == 4.0 else (method, CPU_TIME)
        if method == OURS and engine is not None:
            continue
        for k, seconds in enumerate(taken):
            rows.append(Row(name, quantity, "s", seconds / share, count, k))
            rows.append(Row(name, ROLLOUT_RATIO, "1", 4.0 / share * seconds / times[OURS, None][k], count, k))
    if engine is not None:
        engine.close()
    return Outcome(rows, {"states": truth.states})


def report(results: Results) -> str:
    """Time of a rollout, and of predictions as accurate as each of our propagators."""
    rows = results.rows("peers")
    models = rows.unique("model")
    cases = [
        (engine, geometry)
        for engine in ENGINES
        for geometry in SHAPES
        if rows.where(engine=engine, geometry=geometry)
    ]
    lines = []
    for engine, geometry in cases:
        cells = [_name(engine, geometry)]
        for model in models:
            found = rows.where(engine=engine, geometry=geometry, model=model, method=MONTE_CARLO)
            cells += [
                number(1e3 * found.where(quantity=ROLLOUT).median()),
                number(found.where(quantity=ROLLOUT_RATIO, samples=None).median()),
            ]
        lines.append(cells)
    head = [""]
    for model in models:
        head += [f"{model} [ms]", "over ours"]
    parts = [table(head, lines), goal_tables(_figures(results))]
    for quantity, what in ((POSITION_ERROR, "positions"), (ROTATION_ERROR, "rotations")):
        parts.append(f"### Rollouts for equal error, {what}\n")
        parts.append(_equal_error(rows, quantity, cases))
    return "\n".join(parts)


def engine_choices(rows: Rows, quantity: str) -> dict[str, dict[str, list[Choice]]]:
    """For each model and other engine, Monte Carlo's time and error over the floor."""
    made: dict[str, dict[str, list[Choice]]] = {}
    for model in rows.unique("model"):
        for engine in rows.unique("engine"):
            if engine == OURS:
                continue
            geometry = "pieces"
            found = rows.where(engine=engine, geometry=geometry, model=model)
            if found:
                each = found.where(quantity=ROLLOUT).median()
                made.setdefault(model, {})[_name(engine, geometry)] = [
                    Choice(MONTE_CARLO, n, n * each, error) for n, error in _curve(found, quantity)
                ]
    return made


def _figures(results) -> dict[str, list[Figure]]:
    rows = results.rows("peers")
    found = []
    for engine in (name for name in GOALS if rows.where(engine=name)):
        for model in rows.unique("model"):
            here = rows.where(engine=engine, geometry="spheres", model=model)
            if not here:
                continue
            slower = here.where(quantity=ROLLOUT_RATIO, samples=None).median()
            goal = GOALS[engine][model != "armadillo"]
            found.append(Figure(f"{label(engine)} / ours", model, slower, "x", goal))
    return {"One rollout with the same spheres, CPU time over ours": found}


def _name(engine, geometry):
    return f"{ENGINES[engine]}, {SHAPES[geometry]}"


def _curve(rows, quantity):
    """(samples, error over the floor) of Monte Carlo in one engine."""
    floor = rows.where(method=FLOOR, quantity=quantity).mean()
    errors = rows.where(method=MONTE_CARLO, quantity=quantity)
    return [(n, errors.where(samples=n).mean() / floor) for n in sorted(errors.unique("samples"))]


def _samples_for(error, curve):
    """Number of samples that have that error, by the measured ones; NaN beyond them."""
    counts, errors = np.log([n for n, _ in curve]), np.minimum.accumulate([e for _, e in curve])
    if not errors[-1] <= error <= errors[0]:
        return float("nan")
    return float(np.exp(np.interp(-np.log(error), -np.log(errors), counts)))


def _equal_error(rows, quantity, cases):
    lines = []
    for model in rows.unique("model"):
        ours = rows.where(model=model, engine=OURS)
        floor = ours.where(method=FLOOR, quantity=quantity).mean()
        for method in ours.where(quantity=CPU_TIME).unique("method"):
            if method == MONTE_CARLO:
                continue
            error = ours.where(method=method, quantity=quantity).mean() / floor
            cost = ours.where(method=method, quantity=ROLLOUT_RATIO).median()
            cells = [f"{model}, {label(method)}", number(error)]
            for engine, geometry in cases:
                found = rows.where(model=model, engine=engine, geometry=geometry)
                n = _samples_for(error, _curve(found, quantity))
                each = found.where(method=MONTE_CARLO, quantity=ROLLOUT_RATIO, samples=None).median()
                cells.append(f"{n:.0f}: {number(n * each / cost)}x" if np.isfinite(n) else "")
            lines.append(cells)
    return table(["", "error / floor", *(_name(*case) for case in cases)], lines)


verdict = goals_met_by(_figures)
