"""Beliefs that reach into tables, walls and neighbours: as they are, projected and at rest."""

from __future__ import annotations

import numpy as np

from unc_physics.prediction.predict import predict
from unc_physics.prediction.status import assess
from unc_physics.prediction.status_rules import Status

from ..comparison import CPU_TIME
from ..jobs import Job, Outcome, Row, Settings
from ..methods import MONTE_CARLO
from ..overlap_measures import (
    fallen_through,
    spread_ratio,
    spread_ratios,
    start_time,
    toppled,
    watch,
    without_overlap,
)
from ..overlap_scenes import GROUPS, MOVING, SLOTS, arrangements, scene_and_belief, slots
from ..results import Results, Rows
from ..tables import number, table

TITLE = "Overlap"
HORIZON = 1.0  # s
POSITIONS = (1, 3, 10)  # mm, standard deviations
ANGLES = (1, 5)  # degrees
KEEP, PROJECT, AT_REST, REJECT = "keep", "project", "at_rest", "rejection"
STARTS = {KEEP: "as the belief is", PROJECT: "projected", AT_REST: "at rest"}
OPTIONS = {KEEP: {"overlap": "keep"}, PROJECT: {}, AT_REST: {"at_rest": True}, REJECT: {"overlap": "keep"}}
PICTURE = "on a plane: mug", 10, 5  # whose samples are drawn
SAMPLES = {KEEP: 100}  # of what is slow, and shown beside the others only; 400 of all else
DRAWS = 60_000  # at most, of a sample without overlap
TIMED, ROUNDS = 100, 5  # samples whose start is timed at once, and how often

RISE, GAIN, TOPPLED, THROUGH = "rise", "energy_gain", "toppled", "fallen_through"
BEGIN, END = "spread_at_start", "spread_at_end"
SIGMA = ("sigma_points_position", "sigma_points_tilt", "sigma_points_yaw")
OVERLAPS, FLAGGED, ACCEPTED = "overlap_share", "flagged", "accepted"
#: The most of each quantity that is good, and what it is in the report: a name and a factor to its unit.
GOALS = {RISE: 1e-3, GAIN: 5e-3, TOPPLED: 0.005, THROUGH: 0.0}
NO_ROOM_GAIN = 1e-3  # J, where there is no room
SPREAD, SIGMA_SPREAD = 0.05, 0.10  # of x and y; of sigma points against Monte Carlo
CPU_GOALS = {1: 30e-6, 2: 600e-6}  # s for a sample's projection, by the number of bodies
HEAD = (
    "|rise [mm]|energy [mJ]|toppled, 1° [%]|5° [%]|by rejection [%]|fell through [%]|x, y at the start|at 1 s"
    "|CPU time [us]|flagged [%]"
)
GOAL_LINE = "goal|1|5|0.5|by rejection||0|±5 % on tables|±5 % at rest|30, pairs 600|"


def jobs(settings: Settings) -> list[Job]:
    """Every arrangement with every uncertainty and each of the starts."""
    made = []
    for arrangement in _chosen(settings.quick):
        for position in POSITIONS[-1:] if settings.quick else POSITIONS:
            for angle in ANGLES[-1:] if settings.quick else ANGLES:
                for start in _starts(arrangement, position, angle):
                    count = 50 if settings.quick else SAMPLES.get(start, 400)
                    parameters = settings.parameters(
                        arrangement=arrangement.name,
                        position=position,
                        angle=angle,
                        start=start,
                        samples_each=count,
                    )
                    made.append(Job("overlap", parameters, cost=0.002 * count * len(arrangement.models) ** 2))
    return made


def run(job: Job) -> Outcome:
    """What becomes of the samples of one arrangement, with one uncertainty and one start."""
    p = job.parameters
    start, count = p["start"], p["samples_each"]
    arrangement = next(some for some in (*arrangements(), *slots()) if some.name == p["arrangement"])
    scene, belief = scene_and_belief(
        arrangement, 1e-3 * p["position"], np.radians(p["angle"]), **OPTIONS[start]
    )
    # the same draws for every start, of which some take only the first
    seed = Job("overlap", {**p, "start": "any", "samples_each": "any"}).seed("samples")
    if start == REJECT:
        states, drawn = without_overlap(scene, belief, count, seed, DRAWS)
        if len(states) < count:
            return Outcome([Row(REJECT, ACCEPTED, "1", len(states) / drawn, drawn, 0, seed)])
        watched = watch(scene, belief, count, seed, HORIZON, states)
        return Outcome(
            [
                Row(REJECT, ACCEPTED, "1", len(states) / drawn, drawn, 0, seed),
                Row(REJECT, TOPPLED, "1", _share(toppled(scene, belief, watched.end)), count, 0, seed),
            ]
        )
    watched = watch(scene, belief, count, seed, HORIZON)
    drawn = belief.sample(count, np.random.default_rng(seed))
    found = {
        RISE: ("m", watched.rise.max()),
        GAIN: ("J", watched.gain.max()),
        TOPPLED: ("1", _share(toppled(scene, belief, watched.end))),
        THROUGH: ("1", _share(fallen_through(watched.end))),
        BEGIN: ("1", spread_ratio(watched.start, drawn)),
        END: ("1", spread_ratio(watched.end, drawn)),
        CPU_TIME: ("s", start_time(scene, belief, min(count, TIMED), ROUNDS)),
    }
    statuses = assess(watched.prediction)
    found[FLAGGED] = "1", _share([status.flags != Status.FINE for status in statuses])
    found[OVERLAPS] = "1", max(status.measures.get(OVERLAPS, 0.0) for status in statuses)
    if start != KEEP:
        points = predict(scene, belief, "sigma_points", HORIZON).belief
        ratios = spread_ratios(points, watched.prediction.belief)
        found |= {quantity: ("1", ratio) for quantity, ratio in zip(SIGMA, ratios, strict=True)}
    rows = [
        Row(MONTE_CARLO, name, unit, float(value), count, 0, seed) for name, (unit, value) in found.items()
    ]
    drawn_here = (p["arrangement"], p["position"], p["angle"]) == PICTURE
    return Outcome(rows, {"states": watched.start} if drawn_here else {})


def report(results: Results) -> str:
    """The worst of each group, beside the goals; a picture of a belief before and after."""
    from ..overlap_plots import draw_goals, draw_starts

    rows = results.rows("overlap")
    counts = rows.unique("samples_each")
    about = (
        "Bodies on tables, beside each other, stacked and in walls, known to 1, 3 and 10 mm and to 1 and 5"
        " degrees, as the belief is for 10 mm and 5 degrees alone. Each line is the worst over its models,"
        f" uncertainties and {max(counts)} samples ({min(counts)} as the belief is) within {HORIZON:g} s;"
        " bold is what misses its goal. Rise: of a centre of mass above where it began, less what the"
        " sample's own speed and the fall of its other bodies explain. Toppled: by more than 45 degrees."
        " Spread: standard deviation of x or y over that of the belief, farthest from 1. CPU time: of what"
        " is done before time 0, for a sample.\n"
    )
    figure = results.figure("overlap_goals")
    draw_goals(figure, rows.where(method=MONTE_CARLO), GROUPS, STARTS, (RISE, GAIN), GOALS)
    parts = [about, f"![Rise and energy gained](figures/{figure.name})\n"]
    for start, title in STARTS.items():
        found = rows.where(start=start)
        if found:
            parts += [f"### {title.capitalize()}\n", _worst_table(found, rows.where(start=REJECT))]
    goal = f"goal {1 - SIGMA_SPREAD:g} to {1 + SIGMA_SPREAD:g}"
    parts.append(
        "### Sigma points\n\nTheir spreads at the end over Monte Carlo's, of the body farthest from 1, "
        f"and how many reach the {goal}:\n"
    )
    parts.append(_sigma_table(rows))
    states = _pictured(results, rows)
    if len(states) == len(STARTS):
        figure = results.figure("overlap_before_and_after")
        draw_starts(figure, PICTURE[0].rpartition(" ")[2], states)
        parts.append(f"![A mug on a table, before and after](figures/{figure.name})\n")
    return "\n".join(parts)


def _chosen(quick):
    """The arrangements of a sweep: of a quick one, the first with a mug of each group, or just the first."""
    everything = [*arrangements(), *slots()]
    if not quick:
        return everything
    chosen = {}
    for arrangement in everything:
        if arrangement.group not in chosen or arrangement.models == ("mug",):
            chosen[arrangement.group] = arrangement
    return list(chosen.values())


def _starts(arrangement, position, angle):
    """What is compared; the slow ``keep`` for the most uncertain belief only."""
    starts = [PROJECT]
    if (position, angle) == (POSITIONS[-1], ANGLES[-1]):
        starts.append(KEEP)
    if not arrangement.group.startswith((MOVING, SLOTS)):
        starts.append(AT_REST)
    if angle == ANGLES[-1] and not arrangement.group.startswith(SLOTS):
        starts.append(REJECT)
    return starts


def _share(hits):
    return float(np.mean(hits))


def _worst_table(rows, references):
    """A line for each group."""
    start, lines = rows[0]["start"], []
    for group in _groups(rows):
        here = Rows(row for row in rows if row["arrangement"].partition(":")[0] == group)
        no_room = group.startswith(SLOTS)
        most = {name: max(here.where(quantity=name).values()) for name in (RISE, GAIN, THROUGH, CPU_TIME)}
        bodies = 1 + max(" and " in row["arrangement"] for row in here)
        low = _most(here.where(quantity=TOPPLED, angle=ANGLES[0]))
        high, reference, beyond = _beside_rejection(here, references)
        begin, end = (_farthest(here.where(quantity=name)) for name in (BEGIN, END))
        on_table = group in ("on a plane", "on a board")
        lines.append(
            [
                group,
                _cell(1e3 * most[RISE], not no_room and most[RISE] > GOALS[RISE]),
                _cell(1e3 * most[GAIN], most[GAIN] > (NO_ROOM_GAIN if no_room else GOALS[GAIN])),
                _cell(100.0 * low, not no_room and low > GOALS[TOPPLED]),
                _cell(100.0 * high, not no_room and beyond),
                number(100.0 * reference),
                _cell(100.0 * most[THROUGH], most[THROUGH] > 0.0),
                _cell(begin, on_table and abs(begin - 1.0) > SPREAD),
                _cell(end, on_table and start == AT_REST and abs(end - 1.0) > SPREAD),
                _cell(1e6 * most[CPU_TIME], start == PROJECT and most[CPU_TIME] > CPU_GOALS[bodies]),
                f"{100.0 * here.where(quantity=FLAGGED).mean():.0f}",
            ]
        )
    return table(HEAD.split("|"), [GOAL_LINE.split("|"), *lines])


def _beside_rejection(rows, references):
    """Largest share toppled at the largest angle, that by rejection, and whether any is beyond its goal.

    The goal is the share by rejection, give and take two standard errors, where that is known.
    """
    found, misses = [(0.0, np.nan)], False
    for row in rows.where(quantity=TOPPLED, angle=ANGLES[-1]):
        same = {name: row[name] for name in ("arrangement", "position", "angle")}
        share, reference = row["value"], references.where(quantity=TOPPLED, **same).mean()
        found.append((share, reference))
        known = np.nan_to_num(reference)
        error = np.sqrt((share * (1.0 - share) + known * (1.0 - known)) / row["samples"])
        misses |= share > max(GOALS[TOPPLED], known + 2.0 * error)
    return *max(found[1:] or found, key=lambda shares: shares[0]), misses


def _sigma_table(rows):
    lines = []
    for group in _groups(rows):
        cells = [group]
        for start in (PROJECT, AT_REST):
            here = Rows(
                row for row in rows.where(start=start) if row["arrangement"].partition(":")[0] == group
            )
            for quantity in SIGMA:
                found = here.where(quantity=quantity)
                ratios = found.values()
                near = np.abs(ratios - 1.0) <= SIGMA_SPREAD
                cells.append(f"{_farthest(found):.2f} ({near.sum()} of {len(near)})" if found else "")
        lines.append(cells)
    titles = [
        f"{STARTS[start]}: {name}" for start in (PROJECT, AT_REST) for name in ("position", "tilt", "yaw")
    ]
    return table(["farthest from 1 (within the goal)", *titles], lines)


def _groups(rows):
    found = dict.fromkeys(name.partition(":")[0] for name in rows.unique("arrangement"))
    return sorted(found, key=lambda name: next(k for k, group in enumerate(GROUPS) if name.startswith(group)))


def _most(rows):
    return max(rows.values(), default=0.0)


def _farthest(rows):
    """The ratio that is farthest from 1."""
    return max(rows.values(), key=lambda ratio: abs(np.log(max(ratio, 1e-12))), default=np.nan)


def _cell(value, misses):
    return f"**{number(value)}**" if misses else number(value)


def _pictured(results, rows):
    """States of the samples that are drawn, by their start."""
    name, position, angle = PICTURE
    found = {}
    for start, title in STARTS.items():
        some = rows.where(arrangement=name, position=position, angle=angle, start=start)
        if some:
            arrays = results.arrays("overlap", some[0]["job"])
            if arrays:
                found[title] = arrays["states"]
    return found
