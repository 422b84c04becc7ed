"""Reality: recorded tosses of a cube, predicted with the same parameters and draws in every engine."""

from __future__ import annotations

import numpy as np

from unc_physics.physics.layout import POSITION

from ..jobs import Job, Outcome, Row, Settings
from ..methods import MONTE_CARLO
from ..recorded_tosses import (
    FACES,
    FRICTION,
    RESTITUTION,
    first_belief,
    recorded_tosses,
    top_face,
    toss_scene,
)
from ..results import Results
from ..rollouts import ENGINES, OURS, available, missing_engines, rollouts
from ..scores import bootstrap, brier_score, energy_score, log_score
from ..tables import number, table

TITLE = "Tosses"
SAMPLES = 50
QUICK = 60  # tosses
BRIER, LOG, ENERGY, COST = "brier_score", "log_score", "energy_score", "cpu_time_per_simulated_time"
SCORES = {BRIER: "Brier score, face", LOG: "log score, face", ENERGY: "energy score, position [mm]"}
_UNITS = {BRIER: 1.0, LOG: 1.0, ENERGY: 1e3}  # as the report shows them


def jobs(settings: Settings) -> list[Job]:
    """All tosses in every engine that is there."""
    count = QUICK if settings.quick else len(recorded_tosses().states)
    return [
        Job(
            "tosses",
            settings.parameters(engine=engine, tosses=count, samples_each=SAMPLES),
            cost=count * SAMPLES * 0.0015,
        )
        for engine in available()
    ]


def missing(settings: Settings) -> list[str]:
    """Engines that are not installed."""
    return missing_engines("tosses")


def run(job: Job) -> Outcome:
    """Scores of each toss, predicted until its last frame, and what that cost."""
    p = job.parameters
    tosses = recorded_tosses()
    scene = toss_scene(tosses)
    # the same initial states in every engine, and of a toss whatever the number of tosses
    draws = Job("tosses", {"samples_each": p["samples_each"], "base_seed": p["base_seed"]})
    rows, spent, simulated = [], 0.0, 0.0
    with rollouts(p["engine"], scene) as run_all:
        run_all(tosses.states[0][:1, None], 1)  # compiles, or loads what is compiled
        for k in range(p["tosses"]):
            seed, last = draws.seed(f"toss {k}"), tosses.states[k][-1]
            starts = first_belief(tosses, k).sample(p["samples_each"], np.random.default_rng(seed))
            steps = round(tosses.duration(k) / scene.dt)
            ends, taken = run_all(starts, steps)
            ends, spent = ends[:, 0], spent + taken
            simulated += len(starts) * steps * scene.dt
            faces, face = top_face(ends), int(top_face(last))
            for quantity, unit, value in (
                (BRIER, "1", brier_score(faces, face, FACES)),
                (LOG, "1", log_score(faces, face)),
                (ENERGY, "m", energy_score(ends[:, POSITION], last[POSITION])),
            ):
                rows.append(Row(MONTE_CARLO, quantity, unit, value, p["samples_each"], k, seed))
    rows.append(Row(MONTE_CARLO, COST, "s/s", spent / simulated, p["samples_each"]))
    return Outcome(rows)


def report(results: Results) -> str:
    """Mean scores of each engine, and how much better we are."""
    rows = results.rows("tosses")
    engines = [engine for engine in ENGINES if rows.where(engine=engine)]
    count, samples = rows[0]["tosses"], rows[0]["samples_each"]
    lines = []
    for engine in engines:
        here = rows.where(engine=engine)
        cells = [_mean(_scores(here, quantity)) for quantity in SCORES]
        lines.append([ENGINES[engine], *cells, number(1e3 * here.where(quantity=COST).mean())])
    about = (
        f"{count} real tosses of a cube (ContactNets, see the README beside the data), each predicted from"
        f" its first frame to its last by {samples} samples, with the friction ({FRICTION}) and restitution"
        f" ({RESTITUTION}) that the authors of the recordings give; the same initial states in every engine."
        " Mean scores over tosses ± standard error, the lower the better. Of the face on top a uniform guess"
        " scores 0.833 and 1.792; a face that no sample shows counts as half a sample.\n"
    )
    parts = [about, table(["", *SCORES.values(), "CPU for a simulated second [ms]"], lines)]
    if OURS in engines and len(engines) > 1:
        ours = rows.where(engine=OURS)
        lines = []
        for engine in engines:
            if engine != OURS:
                theirs = rows.where(engine=engine)
                cells = [_difference(_scores(ours, name), _scores(theirs, name)) for name in SCORES]
                lines.append([ENGINES[engine], *cells])
        parts.append("Our mean score less theirs, with the middle 95 % of a paired bootstrap over tosses:\n")
        parts.append(table(["", *SCORES.values()], lines))
    return "\n".join(parts)


def _scores(rows, quantity):
    """Scores in the report's unit, ordered by toss."""
    found = sorted(rows.where(quantity=quantity), key=lambda row: row["replicate"])
    return _UNITS[quantity] * np.array([row["value"] for row in found])


def _mean(values):
    return f"{number(values.mean())} ± {number(values.std(ddof=1) / np.sqrt(len(values)))}"


def _difference(ours, theirs):
    low, high = bootstrap(ours - theirs, np.random.default_rng(0))
    return f"{np.mean(ours - theirs):+.3g} ({low:+.3g} to {high:+.3g})"
