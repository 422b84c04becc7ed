"""Probabilities that predictions answer with, against Monte Carlo: ``python -m
unc_physics_evaluation.benchmarks.calibration``.

Scenes: two bodies that may collide, drops onto a floor and into a bin, a box that slides to rest, a can near
a shelf's edge, each with several spreads of the initial state. In each, every propagator that takes the
scene's integrator answers whether bodies touch within the horizon, where their centres of mass end, and
whether they come to rest. The truth is the share of 10 000 samples.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from unc_physics import PROPAGATORS, Belief, RigidBody, Scene, load_model, make_propagator, predict
from unc_physics.physics.layout import (
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    ERROR,
    POSITION,
    QUATERNION,
    STATE,
    VELOCITY,
)
from unc_physics.prediction import probabilities as answers
from unc_physics.propagators.names import REFERENCE
from unc_physics.scene.environment import Box, Plane
from unc_physics_evaluation.scenarios import unit_model

TRUTH = 10_000
SEED_OF_TRUTH = 1
METHODS = {name: (name, {}) for name in PROPAGATORS if name != REFERENCE} | {
    f"{REFERENCE}, {count}": (REFERENCE, {"samples": count}) for count in (1000, 200)
}
CONTACT, REGION, REST = KINDS = ("contact", "region", "rest")


class Case(NamedTuple):
    """A scene with an uncertain beginning."""

    name: str
    scene: Scene
    belief: Belief
    horizon: float


class Row(NamedTuple):
    """One probability, and what a propagator answers."""

    kind: str
    scene: str
    what: str
    propagator: str
    truth: float
    available: bool
    answer: float


# -- scenes ----------------------------------------------------------------------------------------


def collisions(quick: bool) -> Iterator[Case]:
    """Two unit models that fly towards each other, ever more off centre."""
    models = ("bunny",) if quick else ("bunny", "armadillo", "pin")
    for model, sigma in itertools.product(models, (0.1,) if quick else (0.03, 0.1, 0.25)):
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


def drops(quick: bool) -> Iterator[Case]:
    """A can and a salt box that may have reached the floor, or have bounced off it, at the horizon."""
    heights = ((0.0, 0.3),) if quick else ((0.0, 0.3), (0.15, 1.0), (0.3, 0.3), (0.45, 1.0))
    for (height, velocity), model in itertools.product(
        heights, ("salt_box",) if quick else ("can", "salt_box")
    ):
        scene = on_earth([model], [Plane(name="floor")], dt=0.005)
        mean = resting([[0.0, 0.0, 0.1 + height]])
        mean[0, QUATERNION] = 0.2, 0.3, 0.1, math.sqrt(0.86)
        P = spread(1, position=0.02, velocity=velocity, rotation=0.1, spin=1.0)
        yield Case(f"drop, {model}, {height} m, {velocity} m/s", scene, Belief(mean, P), 0.3)


def bins(quick: bool) -> Iterator[Case]:
    """A salt box, or that and a can, dropped into a bin out of five boxes."""
    walls = [Box([0.4, 0.4, 0.02], [0.0, 0.0, -0.01], name="bottom")]
    for k, side in enumerate((-0.2, 0.2)):
        walls.append(Box([0.02, 0.4, 0.2], [side, 0.0, 0.1], name=f"wall_x{k}"))
        walls.append(Box([0.4, 0.02, 0.2], [0.0, side, 0.1], name=f"wall_y{k}"))
    cases = [(0.02, ["salt_box"]), (0.1, ["salt_box"]), (0.05, ["salt_box", "can"])]
    for sigma, models in cases[2:] if quick else cases:
        scene = on_earth(models, walls)
        mean = resting([[0.05, 0.0, 0.15], [-0.05, 0.03, 0.32]][: len(models)])
        P = spread(len(models), position=[sigma, sigma, 0.01], velocity=0.05, rotation=0.1)
        yield Case(f"bin, {' and '.join(models)}, sigma {sigma}", scene, Belief(mean, P), 0.6)


def shelves(quick: bool) -> Iterator[Case]:
    """A can that rolls or stands near a shelf's edge, over a floor."""
    elements = [Box([0.6, 0.6, 0.05], [0.0, 0.0, 0.475], name="shelf"), Plane(name="floor")]
    for x, speed, lying in ((0.2, 0.2, True),) if quick else ((0.2, 0.2, True), (0.28, 0.0, False)):
        scene = on_earth(["can"], elements)
        mean = resting([[x, 0.0, 0.5 + (0.0382 if lying else 0.0552)]])
        mean[0, VELOCITY] = speed, 0.0, 0.0
        if lying:
            mean[0, QUATERNION] = math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)
        P = spread(1, position=[0.03, 0.03, 0.0], velocity=[0.1, 0.05, 0.0], rotation=[0.0, 0.02, 0.0])
        yield Case(
            f"shelf, {'lying' if lying else 'standing'}, {x} m, {speed} m/s", scene, Belief(mean, P), 0.8
        )


def slides(quick: bool) -> Iterator[Case]:
    """A brick that slides on a table until friction holds it."""
    for speed, sigma in ((0.8, 0.2),) if quick else ((0.5, 0.1), (1.0, 0.4)):
        scene = on_earth(["brick"], [Plane(name="table")], friction=0.15)
        mean = resting([[0.0, 0.0, 0.0355]])
        mean[0, VELOCITY] = speed, 0.0, 0.0
        P = spread(1, position=[0.01, 0.01, 0.0], velocity=[sigma, 0.02, 0.0])
        yield Case(f"slide, {speed} m/s, sigma {sigma}", scene, Belief(mean, P), 0.6)


def scatters(quick: bool) -> Iterator[Case]:
    """Four cans that fly about without gravity, and a wall."""
    for sigma in (0.1,) if quick else (0.03, 0.1):
        packing = load_model("can").prefix(10)
        scene = Scene(
            [RigidBody(f"can{k}", packing, 0.4) for k in range(4)],
            dt=0.005,
            restitution=1.0,
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
    return Scene.everyday(bodies, dt=dt, environment=environment, friction=friction, restitution=0.3)


def resting(positions):
    """States (B, 13) of bodies at rest, not turned."""
    mean = np.zeros((len(positions), STATE))
    mean[:, POSITION] = positions
    mean[:, QUATERNION] = 0.0, 0.0, 0.0, 1.0
    return mean


def spread(bodies, position=0.0, velocity=0.0, rotation=0.0, spin=0.0):
    """Covariances (B, 12, 12) from standard deviations, a number or three each."""
    std = np.zeros(ERROR)
    for part, value in (
        (ERR_POSITION, position),
        (ERR_VELOCITY, velocity),
        (ERR_ROTATION, rotation),
        (ERR_ANGULAR_VELOCITY, spin),
    ):
        std[part] = value
    return np.tile(np.diag(std**2), (bodies, 1, 1))


FAMILIES = (collisions, drops, bins, shelves, slides, scatters)


def regions(states: np.ndarray, seed: int) -> list[answers.BoxRegion]:
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
                answers.BoxRegion(
                    f"box_{body}_{k}", 2.0 * size * scale, where.mean(axis=0) + shift, q / np.linalg.norm(q)
                )
            )
    return boxes


# -- answers ---------------------------------------------------------------------------------------


def all_answers(case, prediction, boxes):
    """Every probability of a prediction, as {(kind, what): (available, probability)}."""
    scene, initial = case.scene, case.belief
    found = {}
    for a in answers.contact_probabilities(scene, prediction, initial):
        found[CONTACT, f"{a.object_a} and {a.object_b}"] = a.available, a.probability
    for a in answers.region_probabilities(scene, prediction, boxes, initial):
        found[REGION, f"{a.object} in {a.region}"] = a.available, a.probability
    for a in answers.rest_probabilities(scene, prediction, initial):
        found[REST, a.object] = a.available, a.probability
    return found


def calibrate(case: Case, truth_samples: int = TRUTH) -> list[Row]:
    """All propagators' answers in one scene beside the truth."""
    truth = make_propagator(REFERENCE, samples=truth_samples, seed=SEED_OF_TRUTH)
    prediction = predict(case.scene, case.belief, truth, case.horizon)
    boxes = regions(prediction.carry.states, seed=0)
    truths = all_answers(case, prediction, boxes)
    rows = []
    for label, (name, options) in METHODS.items():
        propagator = make_propagator(name, **options)
        if case.scene.integrator not in propagator.integrators:
            continue
        found = all_answers(case, predict(case.scene, case.belief, propagator, case.horizon), boxes)
        rows += [
            Row(kind, case.name, what, label, truths[kind, what][1], *answer)
            for (kind, what), answer in found.items()
        ]
    return rows


# -- report ----------------------------------------------------------------------------------------


def summarize(rows: list[Row]) -> list[str]:
    """A table in Markdown: for each propagator and kind, how often it answers, and how far off
    it is at most.
    """
    lines = ["| propagator | " + " | ".join(KINDS) + " |", "|---" * (1 + len(KINDS)) + "|"]
    for label in METHODS:
        cells = []
        for kind in KINDS:
            own = [row for row in rows if row.propagator == label and row.kind == kind]
            errors = np.array([abs(row.answer - row.truth) for row in own if row.available])
            cells.append(
                f"answers {len(errors)} of {len(own)}"
                + (
                    f", off by {errors.mean():.3f} on average, {np.quantile(errors, 0.95):.3f} at 95 %,"
                    f" {errors.max():.3f} at most"
                    if len(errors)
                    else ""
                )
            )
        lines.append(f"| {label} | " + " | ".join(cells) + " |")
    return lines


def draw(rows: list[Row], path: str) -> None:
    """A reliability plot: what is answered against the truth, a panel for each kind of question."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(
        2, len(KINDS), figsize=(11.0, 7.6), sharex=True, sharey=True, constrained_layout=True
    )
    groups = {
        "Monte Carlo, 1000 samples": ["monte_carlo, 1000"],
        "from flights up to the first contacts\n(all propagators without samples)": ["sigma_points"],
    }
    for line, (title, labels) in zip(axes, groups.items(), strict=True):
        for axis, kind in zip(line, KINDS, strict=True):
            own = [row for row in rows if row.kind == kind and row.propagator in labels]
            shown = [row for row in own if row.available]
            axis.fill_between(
                [0.0, 1.0],
                [-answers.TOLERANCE, 1.0 - answers.TOLERANCE],
                [answers.TOLERANCE, 1.0 + answers.TOLERANCE],
                color="0.9",
                lw=0.0,
            )
            axis.plot([0.0, 1.0], [0.0, 1.0], color="0.6", lw=1.0)
            axis.plot(
                [row.truth for row in shown],
                [row.answer for row in shown],
                "o",
                ms=4.0,
                mew=0.0,
                alpha=0.6,
                color="tab:blue",
            )
            axis.set(
                aspect="equal",
                xlim=(-0.03, 1.03),
                ylim=(-0.03, 1.03),
                title=f"{kind}: {len(shown)} of {len(own)} available",
            )
        line[0].set_ylabel(f"{title}\nprobability answered")
    for axis in axes[-1]:
        axis.set_xlabel(f"truth: share of {TRUTH} samples")
    figure.suptitle(f"Answered probabilities against the truth; shaded: within {answers.TOLERANCE}")
    figure.savefig(path, dpi=110)


def main():
    """Calibrate in all scenes, print the table and draw the plot."""
    parser = argparse.ArgumentParser(
        prog="python -m unc_physics_evaluation.benchmarks.calibration",
        description=__doc__.partition(":")[0] + ".",
    )
    parser.add_argument(
        "--quick", action="store_true", help="few scenes, 2000 samples as truth: a look, not a result"
    )
    parser.add_argument(
        "--plot", metavar="FILE", default="docs/images/calibration.png", help="default: %(default)s"
    )
    parser.add_argument("--json", metavar="FILE", help="also write every probability")
    arguments = parser.parse_args()
    started, rows = time.perf_counter(), []
    for family in FAMILIES:
        for case in family(arguments.quick):
            begun = time.perf_counter()
            found = calibrate(case, 2000 if arguments.quick else TRUTH)
            rows += found
            worst = max((abs(row.answer - row.truth) for row in found if row.available), default=0.0)
            print(f"{case.name}: off by {worst:.3f} at most, {time.perf_counter() - begun:.1f} s", flush=True)
    print(
        "\n".join(
            ["", *summarize(rows), "", f"{len(rows)} probabilities in {time.perf_counter() - started:.0f} s"]
        )
    )
    draw(rows, arguments.plot)
    if arguments.json:
        with open(arguments.json, "w", encoding="utf-8") as file:
            json.dump([row._asdict() for row in rows], file)


if __name__ == "__main__":
    main()
