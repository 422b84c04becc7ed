"""What a robot does beside other engines: a push, a belt and a release, from the same uncertain starts."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping

import numpy as np

from unc_physics import make_propagator, predict
from unc_physics.scene.action_arrays import with_driven

from ..action_engines import FINE, OWN, opened
from ..action_scenes import ACTION_SCENES, RELEASED_STD, turn_of_push
from ..comparison import CPU_TIME, POSITION_ERROR, ROTATION_ERROR
from ..jobs import Job, Outcome, Row, Settings
from ..methods import FLOOR, MONTE_CARLO, OURS, label
from ..results import Results
from ..rollouts import available, missing_engines
from ..tables import number, table
from ..wasserstein import state_distance

TITLE = "Actions beside engines"
SAMPLES, BLOCKS = 100, 4
_QUICK = 10, 1
_FINE = "_fine"
PROBABILITY = "probability"


def jobs(settings: Settings) -> list[Job]:
    """Each scene with all engines."""
    samples, blocks = _QUICK if settings.quick else (SAMPLES, BLOCKS)
    return [
        Job(
            "actions",
            settings.parameters(scene=scene, samples_each=samples, blocks=blocks),
            cost=0.5 * samples * blocks,
        )
        for scene in ACTION_SCENES
    ]


def missing(settings: Settings) -> list[str]:
    """Engines that are not installed."""
    return missing_engines("actions")


def run(job: Job) -> Outcome:
    """Final states of ours, twice, and of each engine; their distances, probabilities and times."""
    p = job.parameters
    made = ACTION_SCENES[p["scene"]]()
    count = p["samples_each"] * p["blocks"]
    truth, seconds = _ours(made, count, job.seed("truth"))
    second, _ = _ours(made, count, job.seed("second"))
    found, times = {FLOOR: second}, {OURS: seconds}
    for engine in available()[1:]:
        for end, settings in (("", OWN), (_FINE, FINE)):
            name = engine + end
            found[name], times[name] = _theirs(made, engine, settings[engine], count, job.seed("starts"))
    rows = _distances(job, truth, found)
    for name, states in {OURS: truth, **found}.items():
        if name != FLOOR:
            share = float(made.happened(states[:, 0]).mean())
            rows.append(Row(name, PROBABILITY, "1", share, count))
            rows.append(Row(name, CPU_TIME, "s", times[name], count))
    return Outcome(rows)


def _ours(made, count, seed):
    """Final states (n, 1, 13) of what something is done to, and the CPU time of a rollout [s]."""
    few = make_propagator(MONTE_CARLO, samples=1, seed=seed)
    predict(made.scene, made.belief, few, made.horizon)  # compiles, or loads what is compiled
    many = make_propagator(MONTE_CARLO, samples=count, seed=seed)
    began = time.process_time()
    prediction = predict(made.scene, made.belief, many, made.horizon)
    return prediction.samples()[:, :1], (time.process_time() - began) / count


def _theirs(made, engine, settings, count, seed):
    rng = np.random.default_rng(seed)
    starts = made.belief.sample(count, rng)
    late = RELEASED_STD * rng.standard_normal(count)
    ends, spent = np.empty((count, 1, 13)), 0.0
    with opened(engine, made.scene, settings) as run:
        for n, start in enumerate(starts):
            # a belief has no entry for what follows a path
            state = with_driven(made.scene, start, 0.0)
            released = {
                k: body.released_at + float(late[n])
                for k, body in enumerate(made.scene.bodies)
                if body.attached_to is not None
            }
            end, taken = run.run(state, made.horizon, released)
            ends[n, 0], spent = end[0], spent + taken
    return ends, spent / count


def _distances(job, truth, found: Mapping[str, np.ndarray]):
    """W1 between blocks of ours and as large ones of each."""
    p, rows = job.parameters, []
    for block in range(p["blocks"]):
        some = slice(p["samples_each"] * block, p["samples_each"] * (block + 1))
        for name, states in found.items():
            distance = state_distance(states[some], truth[some])
            size = p["samples_each"]
            rows.append(Row(name, POSITION_ERROR, "m", float(distance.position[0]), size, block))
            rows.append(Row(name, ROTATION_ERROR, "deg", float(distance.rotation[0]), size, block))
    return rows


def _titles():
    """How methods are written."""
    titles = {OURS: label(OURS), FLOOR: "ours, other draws: the floor"}
    for engine in OWN:
        for end, settings in (("", OWN), (_FINE, FINE)):
            titles[engine + end] = f"{label(engine)}, {settings[engine].words(engine)}"
    return titles


def report(results: Results) -> str:
    """W1 of final poses, probabilities, and times."""
    rows, lines = results.rows("actions"), []
    for scene in rows.unique("scene"):
        asked, own = ACTION_SCENES[scene]().asked, rows.where(scene=scene)
        ours = own.where(method=OURS, quantity=CPU_TIME)
        for name, title in _titles().items():
            here = own.where(method=name)
            if not here:
                continue
            cells = [scene, title]
            for quantity, factor in ((POSITION_ERROR, 1e3), (ROTATION_ERROR, 1.0)):
                values = here.where(quantity=quantity)
                spread = f"{number(factor * values.mean())} ± {number(factor * values.std())}"
                cells.append(spread if values else "")
            share, cost = here.where(quantity=PROBABILITY), here.where(quantity=CPU_TIME)
            cells.append(f"{asked}: {share.mean():.2f}" if share else "")
            times = f" ({number(cost.mean() / ours.mean())}x)" if cost and name != OURS else ""
            cells.append(f"{number(1e3 * cost.mean())}{times}" if cost else "")
            lines.append(cells)
    first = rows[0]
    about = (
        f"Final poses of {first['samples_each'] * first['blocks']} samples: W1 to ours, of blocks of"
        f" {first['samples_each']} (mean ± standard deviation over blocks), beside W1 between two such"
        " blocks of ours, the floor; the probability of what is asked; CPU time of a rollout on one thread,"
        " in other engines of their steps alone. Ours has 1000 spheres of what is moved; theirs a box or a"
        " cylinder as large. In MuJoCo prescribed bodies are mocap bodies whose surface has their velocity,"
        " and belts are its own (surfacevel); in PyBullet both are bodies without mass whose velocity is"
        " set before each step. What is held is put where the hand is until it is let go. How the load of the"
        " pushed box is spread, statics does not say: by a limit surface the mean push turns it by"
        f" {math.degrees(turn_of_push(even=False)):.0f} degrees with the load at its corners, and by"
        f" {math.degrees(turn_of_push(even=True)):.0f} with an even one.\n"
    )
    head = ["", "", "W1, position [mm]", "rotation [degrees]", "probability", "CPU time [ms]"]
    return "\n".join([about, table(head, lines)])
