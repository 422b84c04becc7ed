"""Probabilities that predictions answer with, against Monte Carlo.

Two bodies that may collide, drops onto a floor and into a bin, a box that slides to rest, a can near a
shelf's edge: each with several spreads of the initial state. Every propagator that takes the scene's
integrator answers whether bodies touch within the horizon, where their centres of mass end, and whether they
come to rest. The truth is the share of many samples.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from unc_physics import (
    PROPAGATORS,
    AtRest,
    Belief,
    Box,
    BoxRegion,
    Event,
    InRegion,
    Plane,
    RigidBody,
    Scene,
    encounters,
    load_model,
    make_propagator,
    predict,
)
from unc_physics.spatial.layout import POSITION, QUATERNION, VELOCITY

from ..jobs import Job, Outcome, Row, Settings
from ..methods import MONTE_CARLO, label
from ..results import Results, Rows
from ..scenarios import MODELS, resting, spread, unit_model

TITLE = "Calibration of probabilities"
TRUTH, EXPECTED = "truth", "expected"
TOLERANCE = 0.1  # half width of the widest interval of an estimate that counts as an answer
COUNTS = (1000, 200)  # samples of Monte Carlo
CONTACT, REGION, REST = KINDS = ("contact", "region", "rest")


class Case(NamedTuple):
    """A scene with an uncertain beginning."""

    name: str
    scene: Scene
    belief: Belief
    horizon: float


def jobs(settings: Settings) -> list[Job]:
    """One for each scene: of a quick sweep the first of each family."""
    return [
        Job("calibration", settings.parameters(case=case.name, truth=2000 if settings.quick else 10_000))
        for family in FAMILIES
        for case in itertools.islice(family(), 1 if settings.quick else None)
    ]


def run(job: Job) -> Outcome:
    """The truth and what propagators answer, NaN where the interval is too wide."""
    case = next(case for family in FAMILIES for case in family() if case.name == job.parameters["case"])
    count, seed = job.parameters["truth"], job.seed("truth")
    truth = make_propagator(MONTE_CARLO, samples=count, seed=seed)
    prediction = predict(case.scene, case.belief, truth, case.horizon)
    asked = questions(case.scene, regions(prediction.carry.states, job.seed("regions")))
    made = {(name, None): make_propagator(name) for name in PROPAGATORS if name != MONTE_CARLO}
    made |= {(MONTE_CARLO, count): make_propagator(MONTE_CARLO, samples=count) for count in COUNTS}
    rows = [
        Row(TRUTH, question, "1", probability, count, 0, seed)
        for question, probability in answers(prediction, asked).items()
    ]
    for (name, samples), propagator in made.items():
        if case.scene.integrator in propagator.integrators:
            found = predict(case.scene, case.belief, propagator, case.horizon, events=asked.values())
            rows += [
                Row(name, question, "1", probability, samples, 0, found.seed)
                for question, probability in answers(found, asked).items()
            ]
    return Outcome(rows)


def report(results: Results) -> str:
    """How often each propagator answers and how far off it is at most, and a reliability plot."""
    from ..plots import draw_calibration

    rows = results.rows("calibration")
    truths = {(row["case"], row["quantity"]): row["value"] for row in rows.where(method=TRUTH)}
    asked = Rows(
        row | {EXPECTED: truths[row["case"], row["quantity"]]} for row in rows if row["method"] != TRUTH
    )
    groups = {
        f"Monte Carlo, {COUNTS[0]} samples": asked.where(method=MONTE_CARLO, samples=COUNTS[0]),
        "auto, with named events": asked.where(method="auto"),
        "sigma points, with named events": asked.where(method="sigma_points"),
    }
    figure = results.figure("calibration")
    draw_calibration(figure, groups, KINDS, TOLERANCE)
    lines = [
        [label(method, samples), kind, *_errors(of_kind(asked.where(method=method, samples=samples), kind))]
        for method, samples in sorted(asked.curves(), key=lambda curve: list(PROPAGATORS).index(curve[0]))
        for kind in KINDS
    ]
    head = ["method", "question", "asked", "answered within ±0.1", "mean error", "largest error"]
    picture = f"![Answered probabilities against the truth](figures/{figure.name})"
    return f"{results.table('calibration', head, lines)}\n{picture}\n"


def of_kind(rows: Rows, kind: str) -> Rows:
    """The rows of one kind of question."""
    return Rows(row for row in rows if row["quantity"].partition(" ")[0] == kind)


def _errors(rows):
    """How many questions are asked and answered, and how far off the answers are."""
    errors = np.array([abs(row["value"] - row[EXPECTED]) for row in rows if np.isfinite(row["value"])])
    off = [f"{errors.mean():.3f}", f"{errors.max():.3f}"] if len(errors) else ["", ""]
    return [str(len(rows)), str(len(errors)), *off]


def questions(scene, boxes) -> dict[str, Event]:
    """Every event that is asked about, by its question."""
    moving = [scene.bodies[k].name for k in scene.moving]
    found: dict[str, Event] = {f"{CONTACT} {e.object} and {e.other}": e for e in encounters(scene)}
    found |= {f"{REGION} {name} in {box.name}": InRegion(name, box) for box in boxes for name in moving}
    return found | {f"{REST} {name}": AtRest(name) for name in moving}


def answers(prediction, asked) -> dict[str, float]:
    """The probability of each event by its question, NaN where the interval is too wide."""
    found = {question: prediction.probability(event) for question, event in asked.items()}
    return {
        question: p.estimate if max(p.high - p.estimate, p.estimate - p.low) <= TOLERANCE else math.nan
        for question, p in found.items()
    }


# -- scenes ----------------------------------------------------------------------------------------


def collisions() -> Iterator[Case]:
    """Two unit models that fly towards each other, ever more off centre."""
    for model, sigma in itertools.product(MODELS, (0.1, 0.03, 0.25)):
        packing = unit_model(model, 100 if model == "bunny" else 10)
        for offset in (0.3, 0.6, 0.8) if model == "bunny" else (0.5,):
            scene = Scene(
                [RigidBody(name, packing, 1.0) for name in ("left", "right")], stiffness=2e4, damping=0.5
            )
            mean = resting([[-0.75, 0.5 * offset, 0.0], [0.75, -0.5 * offset, 0.0]])
            mean[:, VELOCITY] = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
            mean[1, QUATERNION] = 0.0, 0.6, 0.0, 0.8
            P = spread(2, position=sigma, velocity=0.05, rotation=0.05)
            yield Case(f"collision, {model}, sigma {sigma}, offset {offset}", scene, Belief(mean, P), 0.9)


def drops() -> Iterator[Case]:
    """A can and a salt box that may have reached the floor, or have bounced off it, at the horizon."""
    heights = ((0.0, 0.3), (0.15, 1.0), (0.3, 0.3), (0.45, 1.0))
    for (height, velocity), model in itertools.product(heights, ("can", "salt_box")):
        scene = on_earth([model], [Plane(name="floor")], dt=0.005)
        mean = resting([[0.0, 0.0, 0.1 + height]])
        mean[0, QUATERNION] = 0.2, 0.3, 0.1, math.sqrt(0.86)
        P = spread(1, position=0.02, velocity=velocity, rotation=0.1, spin=1.0)
        yield Case(f"drop, {model}, {height} m, {velocity} m/s", scene, Belief(mean, P), 0.3)


def bins() -> Iterator[Case]:
    """A salt box, or that and a can, dropped into a bin out of five boxes."""
    walls = [Box([0.4, 0.4, 0.02], [0.0, 0.0, -0.01], name="bottom")]
    for k, side in enumerate((-0.2, 0.2)):
        walls.append(Box([0.02, 0.4, 0.2], [side, 0.0, 0.1], name=f"wall_x{k}"))
        walls.append(Box([0.4, 0.02, 0.2], [0.0, side, 0.1], name=f"wall_y{k}"))
    for sigma, models in ((0.05, ["salt_box", "can"]), (0.02, ["salt_box"]), (0.1, ["salt_box"])):
        scene = on_earth(models, walls)
        mean = resting([[0.05, 0.0, 0.15], [-0.05, 0.03, 0.32]][: len(models)])
        P = spread(len(models), position=[sigma, sigma, 0.01], velocity=0.05, rotation=0.1)
        yield Case(f"bin, {' and '.join(models)}, sigma {sigma}", scene, Belief(mean, P), 0.6)


def shelves() -> Iterator[Case]:
    """A can that rolls or stands near a shelf's edge, over a floor."""
    elements = [Box([0.6, 0.6, 0.05], [0.0, 0.0, 0.475], name="shelf"), Plane(name="floor")]
    for x, speed, lying in ((0.2, 0.2, True), (0.28, 0.0, False)):
        scene = on_earth(["can"], elements)
        mean = resting([[x, 0.0, 0.5 + (0.0382 if lying else 0.0552)]])
        mean[0, VELOCITY] = speed, 0.0, 0.0
        if lying:
            mean[0, QUATERNION] = math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)
        P = spread(1, position=[0.03, 0.03, 0.0], velocity=[0.1, 0.05, 0.0], rotation=[0.0, 0.02, 0.0])
        yield Case(
            f"shelf, {'lying' if lying else 'standing'}, {x} m, {speed} m/s", scene, Belief(mean, P), 0.8
        )


def slides() -> Iterator[Case]:
    """A brick that slides on a table until friction holds it."""
    for speed, sigma in ((0.5, 0.1), (1.0, 0.4)):
        scene = on_earth(["brick"], [Plane(name="table")], friction=0.15)
        mean = resting([[0.0, 0.0, 0.0355]])
        mean[0, VELOCITY] = speed, 0.0, 0.0
        P = spread(1, position=[0.01, 0.01, 0.0], velocity=[sigma, 0.02, 0.0])
        yield Case(f"slide, {speed} m/s, sigma {sigma}", scene, Belief(mean, P), 0.6)


def scatters() -> Iterator[Case]:
    """Four cans that fly about without gravity, and a wall."""
    for sigma in (0.1, 0.03):
        packing = load_model("can").prefix(10)
        scene = Scene(
            [RigidBody(f"can{k}", packing, 0.4) for k in range(4)],
            dt=0.005,
            restitution=1.0,
            gravity=(0.0, 0.0, 0.0),
            environment=[Plane([1.0, 0.0, 0.0], -0.3, "wall")],
            integrator="implicit",
        )
        mean = resting([[-0.1, 0.0, 0.0], [0.2, 0.05, 0.0], [0.0, 0.4, 0.0], [0.3, 0.4, 0.1]])
        mean[:, VELOCITY] = [[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0], [0.0, -0.2, 0.0], [-0.3, 0.0, 0.0]]
        yield Case(
            f"scatter, sigma {sigma}",
            scene,
            Belief(mean, spread(4, position=0.03, velocity=sigma, spin=0.5)),
            1.0,
        )


def on_earth(models, environment, dt=0.01, friction=0.5):
    """A scene of everyday things of 0.4 kg, 100 spheres each, with everything that a robot's scene needs."""
    bodies = [RigidBody(name, load_model(name).prefix(100), 0.4) for name in models]
    return Scene.everyday(
        bodies, exact=True, dt=dt, environment=environment, friction=friction, restitution=0.3
    )


FAMILIES = (collisions, drops, bins, shelves, slides, scatters)


def regions(states: np.ndarray, seed: int) -> list[BoxRegion]:
    """Boxes about where bodies end, in about half of which they do: of several sizes, places and
    orientations.

    Parameters
    ----------
    states : (N, B, 13) array
        Samples of the end.
    seed : int
    """
    rng, boxes = np.random.default_rng(seed), []
    for body in range(states.shape[1]):
        where = states[:, body, POSITION]
        scale = np.maximum(where.std(axis=0), 1e-3)
        for k, size in enumerate((1.0, 2.5, 5.0, 20.0)):
            q = rng.standard_normal(4) if k % 2 else np.array([0.0, 0.0, 0.0, 1.0])
            shift = rng.uniform(-1.0, 1.0, 3) * scale * (0.5 * size if size == 20.0 else 1.0)
            boxes.append(
                BoxRegion(
                    f"box_{body}_{k}", 2.0 * size * scale, where.mean(axis=0) + shift, q / np.linalg.norm(q)
                )
            )
    return boxes
