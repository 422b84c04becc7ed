"""The explicit step against an earlier revision of it: ``python -m
unc_physics_evaluation.benchmarks.same_bits REVISION``.

Each tree runs in a process of its own, with a compile cache of its own. Both predict the same scenes with the
same propagators; every array that comes out is compared to the last bit. Then the two are timed in turns, so
that a busy machine slows both alike; figures are medians of the rounds' ratios of CPU times. The script uses
only what both revisions offer.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[3]
PAPER = "e2c9ee2"  # what the paper's step is held to
PROPAGATORS = {
    "monte_carlo": ("monte_carlo", {"samples": 12}),
    "sigma_points": ("sigma_points", {}),
    "linearization": ("linearization", {}),
    "finite_difference": ("linearization", {"jacobian": "finite_difference"}),
    "surrogate": ("surrogate", {}),
    "local_sampling": ("local_sampling", {}),
}
SLOW = ("finite_difference",)  # compared, but not timed


# -- what runs in both trees -----------------------------------------------------------------------


def scenes():
    """Scenes by name: (scene, belief, horizon [s])."""
    from unc_physics import Belief, RigidBody, Scene, load_model, load_scene

    try:
        from unc_physics import Box, Plane
    except ImportError:  # the root exports them since the implicit step
        from unc_physics.environment import Box, Plane

    def belief(mean, position=0.01, rotation=0.02):
        P = np.zeros((len(mean), 12, 12))
        P[:, [0, 1, 2], [0, 1, 2]] = position**2
        P[:, [6, 7, 8], [6, 7, 8]] = rotation**2
        return Belief(mean, P)

    def states(*bodies):
        rows = np.zeros((len(bodies), 13))
        for row, (position, velocity, spin) in zip(rows, bodies, strict=True):
            row[0:3], row[3:6], row[10:13], row[9] = position, velocity, spin, 1.0
        return rows

    found = {}
    bunnies, bunnies_belief, horizon = load_scene("examples/scenes/two_bunnies.yaml")
    found["two bunnies"] = bunnies, bunnies_belief, horizon
    pin = load_model("pin").prefix(100)
    size = 0.5 / pin.bounding_radius
    pin = pin.scaled(size)
    pair = states(
        ((-0.6, 0.05, 0.0), (1.0, 0.0, 0.0), (0.5, 1.0, -2.0)),
        ((0.6, 0.0, 0.1), (-1.0, 0.0, 0.0), (0.0, -1.0, 1.0)),
    )
    pins = Scene([RigidBody("a", pin, 1.0), RigidBody("b", pin, 2.0)], dt=0.01, stiffness=2e4, damping=0.5)
    found["two pins"] = pins, belief(pair, 0.05, 0.05), 3.0
    third = np.concatenate([pair, states(((0.0, 0.1, -1.2), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))])
    fixed = [*pins.bodies, RigidBody("fixed", pin, fixed=True)]
    P = np.array(belief(pair, 0.03).covariance)
    onto = replace(pins, bodies=fixed, gravity=(0.2, 0.0, -3.0))
    found["onto a fixed body"] = onto, Belief(third, P, [0, 1]), 1.5
    floor = (Plane((0.0, 0.1, 1.0), -0.5), Box((1.0, 1.0, 0.2), (0.3, 0.0, -0.6)))
    ground = replace(pins, gravity=(0.0, 0.0, -5.0), environment=floor, stiffness=2e5, dt=0.005)
    found["plane and box"] = ground, belief(pair), 2.0
    found["gyroscopic"] = replace(pins, gyroscopic=True), belief(pair, 0.03), 2.0
    found["all together"] = replace(ground, bodies=fixed, gyroscopic=True), Belief(third, P, [0, 1]), 2.0
    found["a long flight"] = (
        replace(pins, environment=(Plane(offset=-100.0),)),
        belief(pair + 3.0 * np.eye(2, 13, 1)),
        3.0,
    )
    can = load_model("can").prefix(100)
    many = states(
        *(
            ((0.09 * (k % 2), 0.01 * k, 0.1 + 0.15 * k), (0.0, 0.0, -0.3), (0.0, 1.0, 0.2 * k))
            for k in range(5)
        )
    )
    walls = (Plane(), Box((0.02, 1.0, 1.0), (-0.2, 0.0, 0.5)), Box((0.02, 1.0, 1.0), (0.25, 0.0, 0.5)))
    pile = Scene(
        [RigidBody(f"can{k}", can, 0.3) for k in range(5)],
        dt=0.004,
        stiffness=2e6,
        damping=0.3,
        gravity=(0.0, 0.0, -9.81),
        environment=walls,
    )
    found["a pile"] = pile, belief(many, 0.004), 0.8
    apart = np.concatenate([pair, pair + 8.0 * np.eye(1, 13, 1)])
    islands = [RigidBody(f"p{k}", pin, 1.0 + k) for k in range(4)]
    found["islands"] = replace(pins, bodies=islands, islands=True), belief(apart, 0.02), 2.0
    uncertain = [replace(pins.bodies[0], mass_std=0.2), replace(pins.bodies[1], center_of_mass_std=0.02)]
    found["uncertain parameters"] = (
        replace(
            pins, bodies=uncertain, stiffness_std=1e3, gravity=(0.0, 0.0, -0.1), gravity_direction_std=0.05
        ),
        belief(pair, 0.03),
        1.5,
    )
    return found


def cases(found):
    """Pairs of a scene's and a propagator's name that go together."""
    return [
        (name, label)
        for name, (scene, *_) in found.items()
        for label in PROPAGATORS
        if not (scene.uncertain and label not in ("monte_carlo", "sigma_points"))
        and not (label == "finite_difference" and (scene.environment or scene.gyroscopic))
    ]


def results(scene, belief, horizon, label):
    """Every array that a prediction gives, its statuses' flags and its answers, by name."""
    from unc_physics import make_propagator, predict

    try:
        from unc_physics import assess, contact_probabilities
    except ImportError:  # likewise
        from unc_physics.propagation.answers import contact_probabilities
        from unc_physics.propagation.status import assess

    name, options = PROPAGATORS[label]
    prediction = predict(scene, belief, make_propagator(name, **options), horizon, times=(0.5 * horizon,))
    arrays = {}
    for k, found in enumerate(prediction.beliefs):
        arrays[f"mean {k}"], arrays[f"covariance {k}"] = found.mean, found.covariance
    for field, part in prediction.carry._asdict().items():
        if field == "contact_history":
            arrays["first contacts"] = part.first_time
        elif field == "memory":  # its former name and layout
            arrays["first contacts"] = part[..., 0]
        elif isinstance(part, np.ndarray):
            arrays[field] = part
    arrays["flags"] = np.array([int(status.flags) for status in assess(prediction)])
    for k, answer in enumerate(contact_probabilities(prediction)):
        arrays[f"contact {k}"] = np.array(
            [answer.probability, answer.first_contact_time_mean, answer.first_contact_time_std]
        )
    return arrays


def serve():
    """Answer requests, one JSON object a line: a case to compare, with a file for its arrays, or to time."""
    import numba

    from unc_physics import make_propagator, predict

    numba.set_num_threads(1)
    found = scenes()
    print(json.dumps(cases(found)), flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        scene, belief, horizon = found[request["scene"]]
        if "file" in request:
            np.savez(request["file"], **results(scene, belief, horizon, request["propagator"]))
            print("0", flush=True)
            continue
        name, options = PROPAGATORS[request["propagator"]]
        propagator, start, runs = make_propagator(name, **options), time.process_time(), 0
        while time.process_time() - start < request["seconds"]:
            predict(scene, belief, propagator, horizon)
            runs += 1
        print((time.process_time() - start) / runs, flush=True)


# -- the comparison --------------------------------------------------------------------------------


class Tree:
    """A process that serves one tree."""

    def __init__(self, folder):
        cache = ROOT / ".pytest_cache" / "same_bits" / _fingerprint(folder)
        environment = os.environ | {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(cache)}
        self._process = subprocess.Popen(
            [sys.executable, __file__, "--serve"],
            cwd=folder,
            env=environment,
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        self.cases = [tuple(case) for case in json.loads(self._answer())]

    def ask(self, **request) -> float:
        """The answer to a request."""
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        return float(self._answer())

    def _answer(self):
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit(f"a process ended with status {self._process.wait()}")
        return line

    def close(self):
        self._process.stdin.close()
        self._process.wait()


def _fingerprint(folder):
    digest = hashlib.sha256(str(folder).encode())
    for path in sorted((Path(folder) / "unc_physics").rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@contextlib.contextmanager
def checked_out(revision):
    """A temporary worktree of a revision."""
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "tree"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--quiet", "--detach", str(folder), revision], check=True)
        try:
            yield folder
        finally:
            subprocess.run([*git, "remove", "--force", str(folder)], check=True)


def differences(before, after) -> list[str]:
    """Names of the arrays that are not the same to the last bit."""
    names = sorted({*before, *after})
    return [
        name
        for name in names
        if name not in before
        or name not in after
        or before[name].shape != after[name].shape
        or before[name].tobytes() != after[name].tobytes()
    ]


def compare(before, after, rounds, seconds, only) -> bool:
    """Print each case's verdict and ratio of CPU times; whether all are the same."""
    same = True
    with tempfile.TemporaryDirectory() as folder:
        for scene, label in before.cases:
            if only and not any(word in f"{scene} {label}" for word in only):
                continue
            request = {"scene": scene, "propagator": label}
            arrays = []
            for tree, side in ((before, "before"), (after, "after")):
                file = str(Path(folder) / f"{side}.npz")
                tree.ask(**request, file=file)
                with np.load(file) as content:
                    arrays.append(dict(content))
            found = differences(*arrays)
            same = same and not found
            verdict, timing = f"DIFFERENT: {', '.join(found)}" if found else "same bits", ""
            if rounds and label not in SLOW:
                times = np.array(
                    [
                        [tree.ask(**request, seconds=seconds) for tree in (before, after)]
                        for _ in range(rounds)
                    ]
                )
                middle = 1e3 * np.median(times, axis=0)
                ratio = np.median(times[:, 1] / times[:, 0])
                timing = f"CPU time {ratio:5.3f} ({middle[1]:.3g} against {middle[0]:.3g} ms)"
            print(f"{scene:22} {label:18} {len(arrays[0]):3} arrays  {timing:44} {verdict}", flush=True)
    return same


def main():
    """Compare the working tree with a revision."""
    parser = argparse.ArgumentParser(
        prog="python -m unc_physics_evaluation.benchmarks.same_bits",
        description=__doc__.partition(":")[0] + ".",
    )
    parser.add_argument("revision", nargs="?", default=PAPER, help=f"to compare with (default: {PAPER})")
    parser.add_argument(
        "--tree", type=Path, help="a folder that holds that revision already, instead of a temporary worktree"
    )
    parser.add_argument("--rounds", type=int, default=7, help="of the timing; 0 for none (default: 7)")
    parser.add_argument(
        "--seconds", type=float, default=0.2, help="CPU time of each side in a round (default: 0.2)"
    )
    parser.add_argument(
        "--only", nargs="+", metavar="WORDS", help="cases whose scene and propagator contain one of these"
    )
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        serve()
        return 0
    with (
        contextlib.nullcontext(arguments.tree)
        if arguments.tree
        else checked_out(arguments.revision) as folder
    ):
        before, after = Tree(folder), Tree(ROOT)
        try:
            same = compare(before, after, arguments.rounds, arguments.seconds, arguments.only)
        finally:
            before.close()
            after.close()
    print("all the same" if same else "NOT THE SAME")
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
