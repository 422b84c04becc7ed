"""Monte Carlo in PyBullet and in MuJoCo: time of a rollout, and error over the number of samples."""

from __future__ import annotations

import itertools

import numpy as np

from unc_physics.dynamics.rollout import simulate
from unc_physics.propagators.registry import make_propagator

from ..comparison import Samples, distance_cost, error_rows
from ..engines import GEOMETRIES, PEERS
from ..jobs import Job, Outcome, Row, Settings
from ..methods import FLOOR, MONTE_CARLO
from ..pareto import Choice
from ..results import Results, Rows
from ..rollouts import ENGINES, OURS, available, missing_engines
from ..scenarios import MODELS, collision
from ..tables import number
from ..timing import paired

TITLE = "Peers"
SHAPES = {"spheres": "1000 spheres", "pieces": "convex pieces", "box": "a box"}
COUNTS = (2, 5, 10, 20, 50, 100, 200, 500, 1000)
ROLLOUT, ROLLOUT_RATIO = "rollout_time", "rollout_time_over_ours"
_COSTS = {"ours": 1e-3, "pybullet": 4e-3, "mujoco": 8e-3}  # s
_MUJOCO_SPHERES_COST = 0.08  # s


def jobs(settings: Settings) -> list[Job]:
    """Return a job for every installed engine, with spheres and with other geometries."""
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
    """Return missing engines."""
    return missing_engines("peers")


def run(job: Job) -> Outcome:
    """Return errors of Monte Carlo to the engine's own truth, and CPU times of its and our rollouts."""
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
    rows = error_rows(job, truth, second, {}, [n for n in COUNTS if n <= p["truth"]])
    states = belief.sample(4 * p["rounds"], np.random.default_rng(job.seed("timed"))).reshape(
        p["rounds"], 4, *belief.mean.shape
    )

    def four_of(run):
        return lambda k: [run(state) for state in states[k]]

    functions = {(OURS, None): four_of(ours)}
    if engine is not None:
        functions[p["engine"], None] = four_of(theirs)
    times = paired(functions, p["rounds"])
    own = times[p["engine"], None]
    for k, (seconds, ours_took) in enumerate(zip(own, times[OURS, None], strict=True)):
        rows.append(Row(MONTE_CARLO, ROLLOUT, "s", seconds / 4.0, None, k))
        rows.append(Row(MONTE_CARLO, ROLLOUT_RATIO, "1", seconds / ours_took, None, k))
    if engine is not None:
        engine.close()
    return Outcome(rows, {"states": truth.states})


def report(results: Results) -> str:
    """Return a table of the time of a rollout in each engine with each geometry."""
    rows = results.rows("peers")
    models = rows.unique("model")
    cases = [
        (engine, geometry)
        for engine in ENGINES
        for geometry in SHAPES
        if rows.where(engine=engine, geometry=geometry)
    ]
    lines = []
    for (engine, geometry), model in itertools.product(cases, models):
        found = rows.where(engine=engine, geometry=geometry, model=model, method=MONTE_CARLO)
        each = 1e3 * found.where(quantity=ROLLOUT).median()
        share = found.where(quantity=ROLLOUT_RATIO, samples=None).median()
        lines.append([_name(engine, geometry), model, number(each), number(share)])
    head = ["engine and shape", "model", "CPU time [ms]", "median of paired ratios to unc_physics"]
    return results.table("peers", head, lines)


def engine_choices(rows: Rows, quantity: str) -> dict[str, dict[str, list[Choice]]]:
    """Return Monte Carlo's time and error over the floor for each model and other engine."""
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


def _name(engine, geometry):
    return f"{ENGINES[engine]}, {SHAPES[geometry]}"


def _curve(rows, quantity):
    """Return (samples, error over the floor) of Monte Carlo in one engine."""
    floor = rows.where(method=FLOOR, quantity=quantity).mean()
    errors = rows.where(method=MONTE_CARLO, quantity=quantity)
    return [(n, errors.where(samples=n).mean() / floor) for n in sorted(errors.unique("samples"))]
