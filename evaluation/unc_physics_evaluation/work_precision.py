"""Work and precision: error and CPU time of engines over the time step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from unc_physics.spatial.layout import POSITION, QUATERNION

from .comparison import CPU_TIME
from .jobs import Job, Outcome, Row, Settings
from .methods import MONTE_CARLO
from .results import Results, Rows
from .rollouts import ENGINES, OURS, available, rollouts
from .scenarios import MANIPULATION, PILES, is_upright
from .tables import number
from .wasserstein import geodesic_of_pairs, state_distance

SCENES = MANIPULATION | PILES
RATES = (60, 120, 240, 500, 1000, 2000)  # steps in a second
UNIT = 240  # reference rate of our times in the report
#: Steps in a second that count as converged. PyBullet does not converge: from 2000 on a sliding can hops, and
#: falls off a shelf on which it stays at 120 to 1000.
CONVERGED = {OURS: 8000, "pybullet": 1000, "mujoco": 8000}
#: For each scene the number of samples, and about the cost of a rollout at `UNIT` [s].
SIZES = {
    "salt_box_into_bin": (200, 0.002),
    "can_off_shelf": (200, 0.002),
    "five_into_bin": (50, 0.02),
    "tableware_into_box": (20, 0.1),
}
QUICK_SIZES = {"salt_box_into_bin": (20, 0.002), "five_into_bin": (5, 0.02)}
QUICK_RATES, QUICK_CONVERGED = (60, 240), 1000
CHUNK = 5  # samples that run in turns with ours, so that a busy machine slows both alike
OVER_UNIT = "cpu_time_over_ours"
HEAD = (
    f"scene|engine|steps in 1 s|CPU time [ms]|over unc_physics at {UNIT} steps, in turns"
    "|median error of positions [mm]|of rotations [deg]"
    "|same outcome|W1 of positions / floor [mm]|of rotations [deg]"
)


def parameters(settings, section, scene, engine, rate, converged, count) -> dict:
    """Return the parameters of a job, equal for all jobs of an experiment."""
    return settings.parameters(
        section=section, scene=scene, engine=engine, rate=rate, converged=converged, samples_each=count
    )


def jobs(settings: Settings, experiment: str, section: str) -> list[Job]:
    """Return a job for every scene in every installed engine at every rate."""
    found = []
    for scene, (count, cost) in (QUICK_SIZES if settings.quick else SIZES).items():
        for engine in available():
            converged = QUICK_CONVERGED if settings.quick else CONVERGED[engine]
            for rate in dict.fromkeys((*(QUICK_RATES if settings.quick else RATES), converged)):
                own = parameters(settings, section, scene, engine, rate, converged, count)
                seconds = count * cost * rate / UNIT * (1 + (rate == converged))
                found.append(Job(experiment, own, seconds))
    return found


def run(job: Job) -> Outcome:
    """Return final states and time of a rollout; at the converged rate also of a second set of samples."""
    p = job.parameters
    make, _ = SCENES[p["scene"]]
    scene, belief, horizon = make()
    at_rate, steps = replace(scene, dt=1.0 / p["rate"]), round(horizon * p["rate"])
    unit, unit_steps = replace(scene, dt=1.0 / UNIT), round(horizon * UNIT)
    # the same initial states in every engine at every rate
    draws = Job("engines", {name: p[name] for name in ("scene", "samples_each", "base_seed")})
    seed = draws.seed("starts")
    starts = belief.sample(p["samples_each"], np.random.default_rng(seed))
    ends, spent, beside = np.empty_like(starts), [], []
    with rollouts(p["engine"], at_rate) as run_all, rollouts(OURS, unit) as run_unit:
        run_all(starts[:1], 1)  # compile, or load what is compiled
        run_unit(starts[:1], 1)
        for k in range(0, len(starts), CHUNK):
            some = slice(k, k + CHUNK)
            ends[some], taken = run_all(starts[some], steps)
            spent.append(taken)
            beside.append(run_unit(starts[some], unit_steps)[1])
        arrays = {"states": ends}
        if p["rate"] == p["converged"]:
            others = belief.sample(p["samples_each"], np.random.default_rng(draws.seed("second")))
            arrays["second"] = run_all(others, steps)[0]
    count = len(starts)
    return Outcome(
        [
            Row(MONTE_CARLO, CPU_TIME, "s", sum(spent) / count, count, 0, seed),
            Row(MONTE_CARLO, OVER_UNIT, "1", sum(spent) / sum(beside), count, 0, seed),
        ],
        arrays,
    )


def report(results: Results, rows: Rows) -> str:
    """Return a table of all scenes."""
    lines = [
        [scene.replace("_", " "), *line]
        for scene in rows.unique("scene")
        for line in _errors(results, scene, rows.where(scene=scene))
    ]
    return results.table("work_precision", HEAD.split("|"), lines)


def _errors(results, scene, rows):
    """Return the lines of the table."""
    lines = []
    for engine in (name for name in ENGINES if rows.where(engine=name)):
        own = rows.where(engine=engine)
        converged = own[0]["converged"]
        truth = results.arrays("engines", own.where(rate=converged)[0]["job"])
        floor = state_distance(truth["states"], truth["second"])
        limits = number(1e3 * np.mean(floor.position)), number(np.mean(floor.rotation))
        for rate in sorted(own.unique("rate"), key=lambda rate: (rate != converged, rate)):
            found = own.where(rate=rate)
            share = found.where(quantity=OVER_UNIT).mean()
            cells = [ENGINES[engine], str(rate), number(1e3 * found.where(quantity=CPU_TIME).mean())]
            cells.append(number(share))
            if rate == converged:
                lines.append([*cells, "", "", "", *limits])
                continue
            ends, exact = results.arrays("engines", found[0]["job"])["states"], truth["states"]
            moved = np.linalg.norm(ends[..., POSITION] - exact[..., POSITION], axis=-1)
            turned = geodesic_of_pairs(ends[..., QUATERNION], exact[..., QUATERNION])
            same = np.all(_fate(scene, ends) == _fate(scene, exact), axis=0)
            distance = state_distance(ends, exact)
            cells += [
                number(1e3 * np.median(moved)),
                number(np.median(turned)),
                f"{100.0 * np.mean(same):.1f} %",
            ]
            means = number(1e3 * np.mean(distance.position)), number(np.mean(distance.rotation))
            lines.append(cells + [f"{mean} / {limit}" for mean, limit in zip(means, limits, strict=True)])
    return lines


def _fate(scene, states):
    """Return whether bodies are in place and whether they are upright (2, N, B), for states (N, B, 13)."""
    return np.array([SCENES[scene][1](states), is_upright(states)])
