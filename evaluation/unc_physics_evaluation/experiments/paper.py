"""The paper's evaluation: Tables 2 and 3, Figs. 2 to 8, constants that it leaves open, and its claims."""

from __future__ import annotations

import csv

import numpy as np

from unc_physics import Belief, RigidBody, Scene, predict
from unc_physics.spatial.layout import ERR_POSITION, ERROR, STATE

from ..comparison import (
    CPU_TIME,
    ERRORS,
    REGULARISED,
    distance_cost,
    error_rows,
    monte_carlo,
    predicted,
    rollout_cost,
    time_rows,
    two_truths,
)
from ..jobs import Job, Outcome, Row, Settings
from ..methods import FLOOR, FULL_POINTS, GAUSSIAN, MONTE_CARLO, label, method_of, text_of
from ..paper_claims import COUNTS, SPREAD, Claim, Measured, claims, geometric_mean, samples_for
from ..paper_figures import draw_constant, draw_predictions, draw_sweeps, predictions_to_draw
from ..paper_variants import (
    JointLocalSampling,
    NumericalLinearization,
    RegeneratedSigmaPoints,
    TunedSurrogate,
)
from ..results import Results
from ..scenarios import (
    LARGE,
    MASS,
    MODELS,
    collision,
    collision_free,
    has_packing,
    missing_packings,
    resting,
    spread,
    unit_model,
)
from ..tables import number, table

TITLE = "The paper"
METHODS = ("surrogate", "local_sampling", "linearization", FULL_POINTS, "sigma_points", "cloud", "auto")
SIGMAS, FEW_SIGMAS = tuple(round(0.01 * k, 2) for k in range(1, 11)), (0.01, 0.05, 0.1)  # m
SPHERES = (10, 100, 1000, 10_000, LARGE)
TRUTH, QUICK_TRUTH = 1000, 200  # samples
#: Repeated measurements of a time; few where a prediction takes long.
ROUNDS = {10_000: 3, LARGE: 2}
#: The columns of Table 2: uncertain velocity and its standard deviation [m/s], [rad/s], and what it spreads.
#: The paper states no deviations; these reproduce it. The last one keeps rotations within a small angle.
FREE = (("linear_velocity", 0.1, 0), ("angular_velocity", 1.0, 1), ("angular_velocity", 0.1, 1))
#: Positions [m] and rotations [degrees] in the paper's Table 2.
PAPER_TABLE_2 = {
    (MONTE_CARLO, 100): (0.0094, 1.065),
    (MONTE_CARLO, 50): (0.0147, 1.919),
    (MONTE_CARLO, 10): (0.0873, 3.537),
    ("surrogate", None): (0.0021, 0.792),
    ("local_sampling", None): (0.0021, 0.792),
    ("linearization", None): (0.0021, 0.781),
    (FULL_POINTS, None): (0.0021, 1.861),
}
BODIES, SCALARS = (2, 8), "scalars"
#: The scalar counts of the paper's Table 3, and the same as functions of the number of bodies B.
PAPER_TABLE_3 = {
    (MONTE_CARLO, 100): ("N n_x", lambda b: 100 * STATE * b),
    ("linearization", None): ("n_x + n_δ^2", lambda b: STATE * b + (ERROR * b) ** 2),
    ("surrogate", None): ("n_x + B 12^2", lambda b: STATE * b + ERROR**2 * b),
    (FULL_POINTS, None): ("(2 n_δ + 1) n_x", lambda b: (2 * ERROR * b + 1) * STATE * b),
    ("sigma_points", None): ("", None),
    ("local_sampling", None): ("n_x + B 12^2", lambda b: STATE * b + ERROR**2 * b),
}
#: Values of the constants that the paper leaves open.
SWEPT = {
    "surrogate k_sigma": (0.03, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 2.0, 3.0, 5.0),
    "tuned_surrogate velocity_share": (1 / 30, 0.1, 1 / 3, 1.0),
    "tuned_surrogate spin_share": (1 / 30, 0.1, 1 / 3, 1.0),
    "numerical_linearization regularisation": (0.0, 0.1, 0.3, 1.0, 3.0, 10.0),
    "local_sampling samples": (4, 8, 32, 128, 512),
}
#: What the paper reports on without figures, as a choice against its own.
SWITCHED = (
    NumericalLinearization(contacts="all"),
    NumericalLinearization(force="whole"),
    NumericalLinearization(contacts="all", regularisation=0.0, force="whole"),
    RegeneratedSigmaPoints(points="full"),
    JointLocalSampling(),
)


def jobs(settings: Settings) -> list[Job]:
    """Return the jobs of all tables and figures, and again those of added methods alone."""
    quick = settings.quick
    truth, sigmas, sizes = (QUICK_TRUTH, FEW_SIGMAS, SPHERES[:3]) if quick else (TRUTH, SIGMAS, SPHERES)
    sized = [(model, n) for model in MODELS for n in sizes if has_packing(model, n)]
    made = []

    def add(section, cost, case="", spheres=0, sigma=0.0, repeat=0, truth=0, rounds=0):
        parameters = {"case": case, "spheres": spheres, "sigma": sigma, "repeat": repeat, "truth": truth}
        for added in ("", *settings.methods) if section in _MEASURED else ("",):
            own = settings.parameters(section=section, **parameters, rounds=rounds, added=added)
            made.append(Job("paper", own, cost=cost, alone=rounds > 0))

    add("pictures", 20.0, truth=truth)
    add("storage", 1.0)
    for uncertain, deviation, _ in FREE:
        for k in range(2 if quick else 10):
            cost = 0.2 + 8 * distance_cost(truth)
            add("free", cost, uncertain, 10, deviation, repeat=k, truth=truth)
    for model, n in sized:
        for sigma in sigmas:
            cost = 2 * truth * rollout_cost(n) + 16 * distance_cost(truth)
            add("error", cost, model, n, sigma, truth=truth)
            rounds = 1 if quick else ROUNDS.get(n, 5)
            add("time", 600 * (rounds + 1) * rollout_cost(n), model, n, sigma, rounds=rounds)
    for k in (1,) if quick else (1, 2):
        for model in MODELS:
            for n in (100, 1000) if quick else (100, 1000, 10_000):
                for sigma in FEW_SIGMAS:
                    add("variants", 10.0, model, n, sigma, repeat=k, truth=truth // 2)
    return made


def missing(settings: Settings) -> list[str]:
    """Return missing packings."""
    return [] if settings.quick else missing_packings()


def run(job: Job) -> Outcome:
    """Return the rows of a job."""
    return _SECTIONS[job.parameters["section"]](job)


def _errors(job):
    """Errors in free flight (Table 2) or after a collision (Fig. 7)."""
    p = job.parameters
    if p["section"] == "free":
        scene, belief, horizon = collision_free(p["case"], "pin", p["spheres"], p["sigma"])
    else:
        scene, belief, horizon = collision(p["case"], p["spheres"], p["sigma"])
    added, base = job.parameters["added"], _base(job)
    truth, second = two_truths(scene, belief, horizon, base)
    answers = predicted(scene, belief, horizon, _methods(job))
    rows = error_rows(base, truth, second, answers, () if added else COUNTS, regularised=True)
    return Outcome([row for row in rows if row.method == added or not added])


def _time(job):
    """CPU times of predictions of a collision (Fig. 6)."""
    p = job.parameters
    scene, belief, horizon = collision(p["case"], p["spheres"], p["sigma"])
    counts = () if p["added"] else COUNTS
    return Outcome(time_rows(scene, belief, horizon, job, counts, _methods(job), p["rounds"]))


def _storage(job):
    """Scalars of each method's carry for bodies whose positions are uncertain (Table 3)."""
    rows = []
    for count in BODIES:
        packing = unit_model("bunny", 10)
        scene = Scene(tuple(RigidBody(f"b{k}", packing, MASS) for k in range(count)), dt=0.01)
        belief = Belief(resting([[3.0 * k, 0.0, 0.0] for k in range(count)]), spread(count, position=0.05))
        for method, samples in _with_added(PAPER_TABLE_3, job):
            text = method if samples is None else f"{method} samples={samples}"
            parts = method_of(text, job).init(scene, belief)._asdict()
            size = sum(
                part.size
                for name, part in parts.items()
                if name != "contact_history" and isinstance(part, np.ndarray)
            )
            rows.append(Row(method, SCALARS, "1", size, samples, count))
    return Outcome(rows)


def _variants(job):
    """Errors with other choices and constants, of other encounters than those of the figures."""
    p = job.parameters
    scene, belief, horizon = collision(p["case"], p["spheres"], p["sigma"], p["repeat"])
    truth, second = two_truths(scene, belief, horizon, job)
    answers, wide = {}, _position_spread(truth.belief)
    swept = [propagator for *_, propagator in _swept(job)]
    plain = [method_of(text, job) for text in METHODS[:4]]
    for propagator in (*swept, *SWITCHED, *plain):
        answers[text_of(propagator), None] = predict(scene, belief, propagator, horizon).belief
    rows = error_rows(job, truth, second, answers, COUNTS[:2])
    rows += [
        Row(method, SPREAD, "1", _position_spread(found) / wide) for (method, _), found in answers.items()
    ]
    return Outcome(rows)


def _pictures(job):
    """States for Figs. 3, 4, 5 and 8."""
    rows = [Row(MONTE_CARLO, "pictures", "1", 1.0)]
    return Outcome(rows, predictions_to_draw(lambda *case: monte_carlo(*case, job.parameters["truth"], 1)))


_SECTIONS = {
    "free": _errors,
    "error": _errors,
    "time": _time,
    "storage": _storage,
    "variants": _variants,
    "pictures": _pictures,
}
_MEASURED = ("free", "error", "time", "storage")  # sections that take added methods


def _base(job):
    """Return the job without an added method, whose truth it shares."""
    return Job(job.experiment, {**job.parameters, "added": ""})


def _methods(job):
    """Return the compared propagators, or an added one alone."""
    added = job.parameters["added"]
    return {(text, None): method_of(text, _base(job)) for text in ([added] if added else METHODS)}


def _with_added(table, job):
    added = job.parameters["added"]
    return [(added, None)] if added else list(table)


def _swept(job):
    """Yield each value of each swept constant with its propagator."""
    classes = {cls.name: cls for cls in (TunedSurrogate, NumericalLinearization)}
    for constant, values in SWEPT.items():
        name, option = constant.split()
        for value in values:
            if name in classes:
                yield constant, value, classes[name](**{option: value})
            else:
                yield constant, value, method_of(f"{name} {option}={value}", job)


def _position_spread(belief):
    """Return the standard deviation of positions, all axes and bodies together [m]."""
    blocks = belief.blocks[:, ERR_POSITION, ERR_POSITION]
    return float(np.sqrt(np.trace(blocks, axis1=1, axis2=2).mean()))


def report(results: Results) -> str:
    """Write the tables and figures of the available rows, and return them in Markdown."""
    rows = results.rows("paper")
    measured, parts = Measured(rows), []

    def write(name, head, lines):
        with open(results.folder / f"{name}.csv", "w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([head, *lines])
        return lines

    def show(title, name, head, lines):
        parts.append(f"### {title}\n\n{table(head, write(name, head, lines))}")

    errors = rows.where(section="error")
    if errors:
        parts.append(_scale(errors))
    if len(measured.cases("free")) == len(FREE):
        show("Table 2", "table_2", *_table_2(measured))
    storage = rows.where(section="storage")
    if storage:
        show("Table 3", "table_3", *_table_3(storage))
    write("figure_6", *_curves(measured, "time", {"time_ms": CPU_TIME}))
    write("figure_7", *_curves(measured, "error", {name: name for name in (*ERRORS, *REGULARISED)}))
    if measured.cases("error"):
        show("Fig. 7, averages", "figure_7_average", *_averages(measured))
    if measured.cases("variants"):
        show("Constants that the paper leaves open", "constants", *_constants(measured))
    found = list(claims(measured, _counts(storage)))
    show("Claims", "claims", Claim._fields, [list(claim) for claim in found])
    for figure in _figures(results, rows, measured):
        parts.append(f"![{figure.stem.replace('_', ' ')}](figures/{figure.name})\n")
    return "\n".join(parts)


def _scale(errors):
    """Return a line with the numbers of samples, sigmas and spheres of a run."""
    truths, sigmas, spheres = (sorted(errors.unique(name)) for name in ("truth", "sigma", "spheres"))
    lists = [", ".join(map(str, found)) for found in (truths, sigmas, spheres)]
    return (
        f"{'Reduced run (`--quick`)' if QUICK_TRUTH in truths else 'Run'} with truths of {lists[0]} samples,"
        f" sigmas of {lists[1]} m, and {lists[2]} spheres.\n"
    )


def _figures(results, rows, measured):
    """Draw all figures that there are rows for, and yield their files."""
    pictures = rows.where(section="pictures")
    if pictures:
        yield from draw_predictions(results.figure, results.arrays("paper", pictures[-1]["job"]))
    for name, section, quantity, title in (
        ("figure_6", "time", CPU_TIME, "CPU time of a prediction [ms]"),
        ("figure_7_position", "error", ERRORS[0], "W1 of positions [m]"),
        ("figure_7_rotation", "error", ERRORS[1], "W1 of rotations [degrees]"),
    ):
        if measured.cases(section):
            draw_sweeps(results.figure(name), measured, section, quantity, title)
            yield results.figure(name)
    if measured.cases("variants"):
        found = [one for one in _swept(Job("paper", {})) if one[0] == "surrogate k_sigma"]
        texts = {value: text_of(propagator) for _, value, propagator in found}
        draw_constant(results.figure("k_sigma"), measured, texts)
        yield results.figure("k_sigma")


def _table_2(measured):
    """Return head and lines of Table 2: both metrics beside the paper's."""
    head = ["method"]
    lines = [[label(*method)] for method in measured.methods("free")]
    for uncertain, deviation, k in FREE:
        quantity, unit = ("position", "m") if k == 0 else ("rotation", "deg")
        at = f" at {deviation:g} {'m/s' if k == 0 else 'rad/s'}"
        head += [f"W1 of {quantity}{at} [{unit}]", f"regularised{at} [{unit}]"]
        paper = uncertain == "linear_velocity" or deviation == FREE[1][1]
        if paper:
            head.append(f"paper, {quantity} [{unit}]")
        case = next(c for c in measured.cases("free") if (c[0], c[2]) == (uncertain, deviation))
        for line, method in zip(lines, measured.methods("free"), strict=True):
            line += [
                number(measured.value("free", case, method, names[k])) for names in (ERRORS, REGULARISED)
            ]
            if paper:
                line.append(str(PAPER_TABLE_2[method][k]) if method in PAPER_TABLE_2 else "")
    return head, lines


def _table_3(storage):
    """Return head and lines of Table 3."""
    head = ["method", "scalar count", *(f"{where}, B = {b}" for b in BODIES for where in ("paper", "here"))]
    lines = []
    for method, samples in storage.curves():
        formula, count = PAPER_TABLE_3.get((method, samples), ("", None))
        line = [label(method, samples), formula]
        for b in BODIES:
            line.append("" if count is None else str(count(b)))
            line.append(f"{storage.where(method=method, samples=samples, replicate=b).mean():.0f}")
        lines.append(line)
    return head, lines


def _counts(storage):
    """Return the methods of Table 3 with their scalars for two bodies, here and in the paper."""
    found = storage.where(replicate=BODIES[0])
    return [
        (method, round(found.where(method=method, samples=samples).mean()), count(BODIES[0]))
        for (method, samples), (_, count) in PAPER_TABLE_3.items()
        if count is not None and found.where(method=method, samples=samples)
    ]


def _curves(measured, section, quantities):
    """Return head and lines of all values of a section; errors with those of a second truth."""
    floors = {f"floor_{name.removeprefix('w1_')}": name for name in quantities if section == "error"}
    head = ["model", "spheres", "sigma", "method", "options", "samples", *quantities, *floors]
    lines = []
    for case in measured.cases(section):
        for method in measured.methods(section):
            scale = 1e3 if section == "time" else 1.0
            values = [scale * measured.value(section, case, method, name) for name in quantities.values()]
            if method[0] == FLOOR or not np.isfinite(values[0]):
                continue
            name, _, options = method[0].partition(" ")
            values += [measured.value(section, case, (FLOOR, None), name) for name in floors.values()]
            samples = "" if method[1] is None else str(method[1])
            lines.append([*map(str, case[:3]), name, options, samples, *(f"{v:.4g}" for v in values)])
    return head, lines


def _averages(measured):
    """Return head and lines of mean errors over all cases, and of how many samples have the same."""
    head = ["method", "W1 of positions [m]", "regularised [m]", "as samples"]
    head += ["W1 of rotations [deg]", "regularised [deg]", "as samples (rotation)"]
    lines = []
    for method in measured.methods("error"):
        line = [label(*method)]
        for exact, regularised in zip(ERRORS, REGULARISED, strict=True):
            for name in (exact, regularised):
                line.append(
                    number(
                        np.mean([measured.value("error", c, method, name) for c in measured.cases("error")])
                    )
                )
            line.append(
                ""
                if method[0] in (FLOOR, GAUSSIAN)
                else number(samples_for(measured, "error", method, exact))
            )
        lines.append(line)
    return head, lines


def _constants(measured):
    """Return head and lines of the errors for each value of each constant, over those of ten samples."""
    head = ["constant", "value", "position", "rotation", "both"]
    lines = []
    for constant, value, propagator in _swept(Job("paper", {})):
        method = text_of(propagator), None
        errors = [measured.ratio("variants", method, (MONTE_CARLO, 10), name) for name in ERRORS]
        lines.append([constant, f"{value:.3g}", *map(number, errors), number(geometric_mean(errors))])
    return head, lines
