"""Scores of predicted recorded tosses, as one value of ``physics: everyday`` at a time is changed."""

from __future__ import annotations

from unc_physics.scene.presets import PRESETS

from ..jobs import Job, Outcome, Settings
from ..methods import OURS
from ..recorded_sets import RecordedSet, read_sets
from ..results import Results
from . import reality

TITLE = "Values of everyday scenes"
#: Values beside those of the preset: about half and twice, or both neighbours that round numbers give.
OTHERS = {
    "friction": (0.2, 0.22, 0.28, 0.3),
    "friction_std": (0.08, 0.16),
    "restitution": (0.15, 0.2, 0.3, 0.35),
    "restitution_std": (0.1, 0.2),
    "impact_friction_speed": (1.0, 2.0, 4.0, 6.0, 8.0),
    "impact_direction_std": (0.0, 0.015, 0.045, 0.06),
    "impact_point_std": (0.0, 0.0025, 0.0075, 0.01),
    "impact_friction_std": (0.0, 0.05, 0.2),
    "rolling_friction": (0.0, 1e-3),
}


def jobs(settings: Settings) -> list[Job]:
    """Return a job for each set of tosses and each value, and for the preset."""
    changes = [f"{name}={value:g}" for name, values in OTHERS.items() for value in values]
    size = reality.QUICK if settings.quick else reality.FULL
    common = {"data": settings.data or "", "by": OURS, "fold": 0, "folds": 1, **size}
    return [
        Job("presets", settings.parameters(set=name, given=given, **common), cost=0.1 * len(own.motions))
        for name, own in read_sets(settings.data).items()
        if isinstance(own, RecordedSet)
        for given in (reality.DEFAULTS, *changes)
    ]


def run(job: Job) -> Outcome:
    """Predict the motions of a set with one changed value, and score the predictions."""
    return reality.run(Job("reality", job.parameters))


def report(results: Results) -> str:
    """Return the change of the mean score by each value, relative to the preset's."""
    from ..reality_report import above, lines

    rows, what = results.rows("presets"), (reality.POSITION_SCORE, reality.ROTATION_SCORE)
    sets, changes = rows.unique("set"), [given for given in rows.unique("given") if "=" in given]
    scored = [(OURS, given) for given in (reality.DEFAULTS, *changes)]
    found = {(one.of, one.given): one for one in lines(rows, scored)}
    cells = []
    for given in changes:
        name, _, value = given.partition("=")
        own = [name, f"{PRESETS['everyday'][name]:g}", value]
        own += [
            above(found[of, given], found[of, reality.DEFAULTS], quantity) for of in sets for quantity in what
        ]
        cells.append(own)
    head = ["key", "preset", "value", *(f"{of}: {quantity}" for of in sets for quantity in what)]
    words = "Mean score above the preset's [%], with the 95 % interval of a paired bootstrap over motions.\n"
    return words + "\n" + results.table("presets", head, cells)
