"""Run each documented kind of prediction once: ``python release/kinds.py EXAMPLES``.

``make wheels`` runs it to compile the kernels of a wheel, and to check that an installed wheel compiles none.
EXAMPLES is the folder of the examples. A kind whose optional dependencies are missing is left out by name.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import tempfile
import time
import warnings
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from unc_physics import (
    Belief,
    ErrorCode,
    Plane,
    PoseMeasurement,
    RigidBody,
    Scene,
    Tracker,
    encounters,
    load_model,
    load_scene,
    make_propagator,
    predict,
    primitive_model,
)
from unc_physics.__main__ import main as command
from unc_physics.prediction.status import assess
from unc_physics.prediction.warm_up import warm_up
from unc_physics.propagators.registry import PROPAGATORS
from unc_physics.scene.presets import PRESETS
from unc_physics.shapes import signed_distance


def kinds(examples: Path):
    """Yield the name of each kind, what it imports beyond the core's dependencies, and a function."""
    for physics, values in PRESETS.items():
        for name in PROPAGATORS:
            yield f"warm-up {physics} {name}", (), partial(warm_up, (name,), values)
    for scene in sorted((examples / "scenes").glob("*.yaml")):
        for name in PROPAGATORS:
            few = ["--samples", "8"] if "samples" in PROPAGATORS[name].options() else []
            options = ["--propagator", name, "--json", "--probabilities", "--horizon", "0.1", *few]
            yield f"predict {scene.stem} {name}", (), partial(run, "predict", scene, *options)
    for name in PROPAGATORS:
        yield f"all outputs {name}", (), partial(ask_everything, examples / "scenes" / "table.yaml", name)
    yield "plot", ("matplotlib",), partial(plot, examples / "scenes" / "table.yaml")
    ranked = [examples / "scenes" / f"{name}.yaml" for name in ("salt_box_on_table", "table")]
    options = ["--event", "upright: salt_box", "--rollouts", "8", "--horizon", "0.5"]
    yield "rank", (), partial(run, "rank", *ranked, *options)
    yield "track", (), track
    yield "distance", (), measure_distance
    motions = examples / "tosses" / "cube.csv", examples / "tosses" / "cube.yaml"
    few = ["--samples", "4", "--evaluations", "80"]
    yield "calibrate", ("matplotlib", "scipy"), partial(run, "calibrate", *motions, *few)
    yield "pack", ("manifold3d", "networkx", "scipy", "trimesh"), pack


def run(*arguments):
    """Run a command; a propagator may refuse a scene, and nothing else may fail."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = command([str(argument) for argument in arguments])
    if status not in (0, ErrorCode.NOT_SUPPORTED):
        raise RuntimeError(f"{arguments} ended with {status}: {err.getvalue()}")


def ask_everything(file, name):
    """Predict a scene until bodies have met, with times, events, modes, samples, status and tables."""
    scene, belief, horizon = load_scene(file)
    assert horizon, f"{file} has no horizon"
    few = {"samples": 32} if "samples" in PROPAGATORS[name].options() else {}
    times, events = [0.5 * horizon, horizon], encounters(scene)
    prediction = predict(scene, belief, make_propagator(name, **few), horizon, times=times, events=events)
    for snapshot in prediction.snapshots:
        _ = snapshot.samples
    prediction.samples(20)
    for body in scene.bodies:
        found = prediction[body.name]
        _ = found.modes, found.position_std
    _ = assess(prediction), prediction.to_dict(), str(prediction)


def plot(file):
    """Draw a prediction."""
    scene, belief, _ = load_scene(file)
    predict(scene, belief, "monte_carlo", 0.1).plot()


def track():
    """Correct a falling can by measurements, and predict it."""
    scene = Scene.everyday([RigidBody("can", load_model("can"))], environment=[Plane(name="table")])
    mean = np.array([[0.0, 0, 0.6, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0]])
    tracker = Tracker(scene, Belief(mean, np.diag([0.1] * 3 + [2.0] * 3 + [1.0] * 3 + [5.0] * 3)[None]))
    std = np.array([0.002, 0.002, 0.002, 0.02, 0.02, 0.02])
    for k in range(10):
        fall = 0.6 - 0.5 * 9.81 * (k / 30) ** 2
        tracker.correct(k / 30, {"can": PoseMeasurement([0, 0, max(fall, 0.06), 0, 0, 0, 1], std)})
    tracker.predict(0.5)
    tracker.ahead([0.5])


def measure_distance():
    """Measure the distance of two models."""
    mug, ball = load_model("mug"), primitive_model("sphere", radius=0.1)
    assert 0.8 < signed_distance(mug, None, ball, ((1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))).distance < 0.9


def pack():
    """Fill a box with spheres."""
    with tempfile.TemporaryDirectory() as folder:
        mesh = Path(folder) / "box.stl"
        import trimesh

        trimesh.creation.box((0.1, 0.06, 0.2)).export(mesh)
        run("pack", mesh, "-n", "50", "--mass", "0.3", "-o", Path(folder) / "box.npz")


def main():
    """Run all kinds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("examples", type=Path)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    for name, imports, run_kind in kinds(options.examples):
        if missing := [module for module in imports if find_spec(module) is None]:
            print(f"{name}: left out without {', '.join(missing)}", flush=True)
            continue
        started = time.perf_counter()
        run_kind()
        print(f"{name}: {time.perf_counter() - started:.2f} s", flush=True)


if __name__ == "__main__":
    main()
