"""What each feature of a scene costs where it is used, and that it costs nothing elsewhere: ``python -m
unc_physics_evaluation.benchmarks.scenes``.

All comparisons are between what runs in turns in this process on one thread: figures are medians of the
rounds' ratios of CPU times. Rollouts are those of the paper's collision of two bodies, 5 s in 500 steps, from
sampled initial states.
"""

from __future__ import annotations

import argparse
import itertools
from dataclasses import replace

import numba
import numpy as np
from numba import types

from unc_physics import PROPAGATORS, Belief, RigidBody, Scene, load_model, make_propagator, predict
from unc_physics.physics.layout import POSITION, QUATERNION
from unc_physics.physics.rollout import advance_explicit, simulate
from unc_physics.propagators.names import REFERENCE
from unc_physics.scene.environment import Plane
from unc_physics.scene.materials import DEFAULT_RESTITUTION
from unc_physics.scene.stiffness import with_stiffness
from unc_physics_evaluation.provenance import versions
from unc_physics_evaluation.scenarios import collision
from unc_physics_evaluation.timing import paired, ratio

from .rows import Report, machine_and_load

FLOOR = {"environment": (Plane(offset=-100.0),)}  # out of reach
NEUTRAL = {  # every feature of a scene named, at the value that means that there is none
    "environment": (),
    "friction": 0.0,
    "gyroscopic": False,
    "islands": False,
    "sleep": False,
    "stiffness_std": 0.0,
    "friction_std": 0.0,
    "restitution_std": 0.0,
    "gravity_direction_std": 0.0,
}
FEATURES = {  # that each integrator has
    "explicit": {"a floor out of reach": FLOOR, "gyroscopic term": {"gyroscopic": True}},
    "implicit": {
        "a floor out of reach": FLOOR,
        "gyroscopic term": {"gyroscopic": True},
        "friction": {"friction": 0.5},
        "restitution": {"restitution": 0.5},
        "sleep": {"sleep": True},
        "all of these": FLOOR | {"gyroscopic": True, "friction": 0.5, "restitution": 0.5, "sleep": True},
    },
}


def _rollouts(scenes, states, steps):
    """For each scene, its rollouts of a round's states, as a function of the round."""

    def in_scene(scene):
        def run(k):
            for state in states[k].copy():
                simulate(state[None], scene.world, steps)

        return run

    return {label: in_scene(scene) for label, scene in scenes.items()}


def _case(model, spheres, rounds, integrator="explicit"):
    """The collision: its scene, (rounds, 8, 2, 13) sampled states, and the number of steps."""
    scene, belief, horizon = collision(model, spheres)
    scene = replace(scene, integrator=integrator)
    states = belief.sample(8 * rounds, np.random.default_rng(1)).reshape(rounds, 8, 2, 13)
    return scene, states, round(horizon / scene.dt)


def measure_unused(report, models, spheres, rounds):
    """The plain scene, and one that names every feature at its neutral value."""
    report.heading(
        "Features that are not used: a scene that names them all as absent, over one that names none"
    )
    for integrator, model, count in itertools.product(FEATURES, models, spheres):
        plain, states, steps = _case(model, count, rounds, integrator)
        named = replace(plain, **NEUTRAL, restitution=DEFAULT_RESTITUTION[integrator])
        before = set(advance_explicit.signatures)
        # each in arrays of its own, as the processor's caches count; a round's first finds them colder: not
        # compared
        runs = {"first": plain, "plain": replace(plain), "named": named, "again": replace(plain)}
        times = paired(_rollouts(runs, states, steps), rounds)
        note = f"plain against itself {ratio(times, 'again', 'plain'):.3f}"
        if integrator == "explicit":
            compiled = [
                s for s in advance_explicit.signatures if s not in before
            ] or advance_explicit.signatures
            without = named.world.surroundings is None and plain.world.surroundings is None
            without = without and all(s[3] == types.none for s in compiled)
            note += (
                "; kernels compiled without surroundings"
                if without
                else "; KERNELS COMPILED WITH SURROUNDINGS"
            )
        report.add(
            "unused",
            f"{integrator}, named / plain",
            f"{model} {count}",
            ratio(times, "named", "plain"),
            goal=1.02,
            at_most=True,
            note=note,
        )


def measure_used(report, models, spheres, rounds):
    """Each feature alone, and all together, over the plain scene with the same integrator; and one integrator
    over the other.
    """
    report.heading("Features that are used: one rollout with the feature, over one without")
    for model, count in itertools.product(models, spheres):
        scenes = {"implicit, elastic": replace(_case(model, count, rounds, "implicit")[0], restitution=1.0)}
        for integrator, features in FEATURES.items():
            plain, states, steps = _case(model, count, rounds, integrator)
            scenes[integrator] = plain
            scenes |= {f"{integrator}, {label}": replace(plain, **given) for label, given in features.items()}
        times = paired(_rollouts(scenes, states, steps), rounds)

        def add(label, base, times=times, case=f"{model} {count}"):
            report.add(
                "used",
                label,
                case,
                ratio(times, label, base),
                note=(
                    f"{1e3 * np.median(times[label]) / 8:.3f} against"
                    f" {1e3 * np.median(times[base]) / 8:.3f} ms"
                ),
            )

        add("implicit, elastic", "explicit")
        for integrator, features in FEATURES.items():
            for label in features:
                add(f"{integrator}, {label}", integrator)


def measure_contact(report, rounds, count=500):
    """A box that falls onto a floor and comes to rest, over the same fall without a floor."""
    report.heading(
        "A salt box of 500 spheres that falls 5 cm onto a floor and rests there: 1 s in 240 steps, over free"
        " fall"
    )
    box = RigidBody("box", load_model("salt_box").prefix(count), 0.52)
    rng = np.random.default_rng(2)
    states = np.zeros((rounds, 8, 1, 13))
    states[..., QUATERNION] = np.array([0.0, 0.04, 0.1, 1.0]) + 0.02 * rng.standard_normal((rounds, 8, 1, 4))
    states[..., QUATERNION] /= np.linalg.norm(states[..., QUATERNION], axis=-1, keepdims=True)
    states[..., 2] = 0.115
    scene = with_stiffness(Scene.everyday([box]), states[0, 0])
    landing = replace(scene, environment=(Plane(),))
    scenes = {"falls": scene, "lands": landing, "lands, sleep": replace(landing, sleep=True)}
    times = paired(_rollouts(scenes, states, 240), rounds)
    for label in ("lands", "lands, sleep"):
        report.add(
            "contact",
            f"{label} / falls",
            f"salt_box {count}",
            ratio(times, label, "falls"),
            note=(
                f"{1e3 * np.median(times[label]) / 8:.3f} against"
                f" {1e3 * np.median(times['falls']) / 8:.3f} ms"
            ),
        )


def measure_parameters(report, rounds):
    """Uncertain parameters, over the same prediction without."""
    report.heading(
        "Uncertain parameters: a prediction with the collision's mass or stiffness uncertain, over one"
        " without"
    )
    scene, belief, horizon = collision("bunny", 1000)
    heavy = replace(scene, bodies=[replace(body, mass_std=0.1 * body.mass) for body in scene.bodies])
    stiff = replace(scene, stiffness_std=0.1 * scene.stiffness)
    shifted = replace(scene, bodies=[replace(body, center_of_mass_std=0.01) for body in scene.bodies])
    means = belief.sample(rounds, np.random.default_rng(3))
    for name, propagator in (
        ("MC-100", make_propagator("monte_carlo", samples=100)),
        ("sigma_points", make_propagator("sigma_points")),
    ):

        def in_scene(own, propagator=propagator):
            return lambda k: predict(own, Belief(means[k], belief.covariance), propagator, horizon)

        scenes = {"none": scene, "mass of both": heavy, "stiffness": stiff, "centres of mass": shifted}
        times = paired({label: in_scene(own) for label, own in scenes.items()}, rounds)
        for label in scenes:
            if label != "none":
                report.add(
                    "parameters",
                    f"{name}, {label}",
                    "bunny 1000",
                    ratio(times, label, "none"),
                    note=(
                        f"{1e3 * np.median(times[label]):.3g} against {1e3 * np.median(times['none']):.3g} ms"
                    ),
                )


def scattered(count, touching=False, islands=True):
    """So many pins that drift two metres apart from each other; two of them so close that they touch."""
    pin = load_model("pin").prefix(100)
    scene = Scene([RigidBody(f"pin{k}", pin, 1.0) for k in range(count)], stiffness=1e6, islands=islands)
    mean = np.zeros((count, 13))
    mean[:, QUATERNION] = 0.0, 0.0, 0.0, 1.0
    side = int(np.ceil(np.sqrt(count)))
    mean[:, 0], mean[:, 1] = 2.0 * (np.arange(count) % side), 2.0 * (np.arange(count) // side)
    mean[:, 10:] = 0.5
    if touching:
        mean[1, POSITION] = mean[0, POSITION] + [1.5 * pin.bounding_radius, 0.0, 0.0]
        mean[1, 3] = -0.2
    P = np.zeros((count, 12, 12))
    P[:, range(3), range(3)] = 0.005**2
    return scene, Belief(mean, P)


def measure_islands(report, rounds, count=64):
    """Many scattered bodies, over one; and with islands over without."""
    report.heading(
        f"Islands: {count} scattered bodies over one, two of them touching over none, without islands over"
        " with (1 s)"
    )
    cases = {
        "one": scattered(1),
        "many": scattered(count),
        "two touch": scattered(count, True),
        "a pair": scattered(2, True),
        "joint": scattered(count, islands=False),
    }
    for name in PROPAGATORS:
        propagator = make_propagator(name, **({"samples": 100} if name == REFERENCE else {}))

        def run(case, propagator=propagator):
            return lambda k: predict(*case, propagator, 1.0)

        times = paired({label: run(case) for label, case in cases.items()}, rounds)
        note = f"{1e3 * np.median(times['many']):.3g} against {1e3 * np.median(times['one']):.3g} ms"
        report.add("islands", "64 bodies / 1", name, ratio(times, "many", "one"), note=note)
        more = np.median((times["two touch"] - times["many"]) / times["one"])
        report.add(
            "islands",
            "two touch, more than none / 1",
            name,
            more,
            note=f"a pair by itself {ratio(times, 'a pair', 'one'):.2f}",
        )
        report.add(
            "islands",
            "joint / islands",
            name,
            ratio(times, "joint", "many"),
            note=f"{1e3 * np.median(times['joint']):.3g} ms",
        )


SECTIONS = ("unused", "used", "contact", "parameters", "islands")


def main():
    """Run the sections asked for."""
    parser = argparse.ArgumentParser(
        prog="python -m unc_physics_evaluation.benchmarks.scenes", description=__doc__.partition(":")[0] + "."
    )
    parser.add_argument(
        "--models", nargs="+", default=["bunny", "pin"], metavar="NAME", help="default: bunny pin"
    )
    parser.add_argument(
        "--spheres",
        nargs="+",
        type=int,
        default=[100, 1000],
        metavar="N",
        help="of each body (default: 100 1000)",
    )
    parser.add_argument(
        "--only",
        nargs="+",
        choices=SECTIONS,
        default=list(SECTIONS),
        metavar="SECTION",
        help=f"of {', '.join(SECTIONS)}",
    )
    parser.add_argument("--quick", action="store_true", help="few rounds: a look, not a result")
    parser.add_argument("--json", metavar="FILE", help="also write all rows with versions and machine")
    arguments = parser.parse_args()
    numba.set_num_threads(1)
    rounds = 5 if arguments.quick else 21
    report = Report()
    print(machine_and_load())
    print(", ".join(f"{name} {number}" for name, number in versions().items()))
    if "unused" in arguments.only:
        measure_unused(report, arguments.models, arguments.spheres, 3 * rounds)
    if "used" in arguments.only:
        measure_used(report, arguments.models, arguments.spheres, rounds)
    if "contact" in arguments.only:
        measure_contact(report, rounds)
    if "parameters" in arguments.only:
        measure_parameters(report, max(rounds // 3, 3))
    if "islands" in arguments.only:
        measure_islands(report, max(rounds // 4, 3))
    print(f"\n{report.summary()}")
    if arguments.json:
        report.write(arguments.json)


if __name__ == "__main__":
    main()
