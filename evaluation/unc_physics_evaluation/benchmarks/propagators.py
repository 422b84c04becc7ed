"""Speed of the simulator and the propagators, beside their goals: ``python -m
unc_physics_evaluation.benchmarks.propagators``.

All comparisons are between what runs in turns in this process, single-threaded but where threads are the
question; figures are medians of the rounds' ratios. The scene is the paper's collision of two bodies: 5 s in
500 steps, initial positions uncertain by 5 cm.
"""

from __future__ import annotations

import argparse
import os
import time
from importlib.util import find_spec

import numba
import numpy as np

from unc_physics import Belief, make_propagator, predict
from unc_physics.checks.errors import UnknownModelError
from unc_physics.physics.rollout import simulate
from unc_physics_evaluation.engines import PEERS
from unc_physics_evaluation.provenance import versions
from unc_physics_evaluation.scenarios import MODELS, collision, many_collisions
from unc_physics_evaluation.timing import paired, ratio

from .contacts import PHASES, course, phase_times
from .rows import Report, machine_and_load

PEER_SPHERES = (10, 100, 1000)
PEER_GOALS = {  # at 1000 spheres
    "pybullet": {"armadillo": 3.0, None: 5.0},
    "mujoco": {"armadillo": 25.0, None: 40.0},
}
METHOD_GOALS = {
    "linearization": 9.0,
    "surrogate": 5.0,
    "local_sampling": 3.0,
    "sigma_points": 0.7,
}  # at 1000 and 10 000
ONE_ROLLOUT = ("linearization", "surrogate", "local_sampling")
LARGE = 100_000


def _case(model, spheres):
    return f"{model} {spheres}"


def measure_peers(report, models, spheres, rounds):
    """One rollout of ours against one of PyBullet's and MuJoCo's, from the same sampled states."""
    report.heading(
        "One rollout: a peer's CPU time over ours (each round sums over four sampled initial states)"
    )
    for name, peer in PEERS.items():
        if find_spec(name) is None:
            report.skip(name, f"not installed; pip install {name}")
            continue
        for model in models:
            for count in spheres:
                _measure_peer(report, name, peer, model, count, rounds)


def _measure_peer(report, name, peer, model, count, rounds):
    scene, belief, horizon = collision(model, count)
    steps = round(horizon / scene.dt)
    states = belief.sample(4 * rounds, np.random.default_rng(1)).reshape(rounds, 4, 2, 13)
    engine = peer(scene)
    held = engine.shapes()
    if held != [count, count]:
        raise RuntimeError(f"{name} holds {held} spheres instead of {count} in each body")

    def ours(k):
        for state in states[k].copy():
            simulate(state[None], scene.world, steps)

    def theirs(k):
        for state in states[k]:
            engine.run(state, steps)

    times = paired({"ours": ours, name: theirs}, rounds)
    ends = np.array([engine.run(state, steps) for state in states[0]])
    counts = np.array([engine.contacts(state, steps) for state in states[0]])
    engine.close()
    own = np.array([course(scene, state, steps).contacts for state in states[0]])
    goals = PEER_GOALS[name]
    report.add(
        "peers",
        f"{name} / ours",
        _case(model, count),
        ratio(times, name, "ours"),
        goal=goals.get(model, goals[None]) if count == 1000 else None,
        note=f"{1e3 * np.median(times[name]) / 4:.2f} against {1e3 * np.median(times['ours']) / 4:.3f} ms; "
        + f"contact steps {np.mean((counts > 0).sum(1)):.0f} against {np.mean((own > 0).sum(1)):.0f}; "
        + _plausible(states[0], ends, scene.damping * horizon),
    )


def _plausible(starts, ends, decay):
    """Whether a peer's bodies collided and kept their momentum, of states (N, 2, 13), in words.

    Bodies of equal mass that start with opposite velocities have no momentum; free ones keep exp(-decay) of
    theirs.
    """
    free = np.exp(-decay) * starts[..., 3:6]
    collided = np.abs(ends[..., 3:6] - free).max(axis=(1, 2)) > 0.05 * np.abs(free).max()
    momentum = np.abs(ends[..., 3:6].sum(axis=1)).max() / np.abs(free).max()
    energy = np.sum(ends[..., 3:6] ** 2) / np.sum(free**2)
    return (
        f"{collided.sum()} of {len(ends)} collided, momentum {momentum:.0e}, translational energy kept"
        f" {energy:.2f}"
    )


def measure_methods(report, models, spheres, rounds):
    """Each propagator against Monte Carlo with 10 samples, whole predictions."""
    report.heading("Propagators: MC-10's CPU time over theirs (another mean and other draws in each round)")
    for model, count, case in _cases(report, models, spheres):
        times = paired(_predictions(*case, rounds), rounds)
        for name in times:
            if name == "MC-10":
                continue
            share = 100.0 / ratio(times, name, "nominal rollout")
            report.add(
                "methods",
                f"MC-10 / {name}",
                _case(model, count),
                ratio(times, "MC-10", name),
                goal=METHOD_GOALS.get(name) if count in (1000, 10_000) else None,
                note=f"{1e3 * np.median(times[name]):.3g} ms"
                + (f", of which nominal rollout {share:.0f} %" if name in ONE_ROLLOUT else ""),
            )


def _predictions(scene, belief, horizon, rounds):
    """What is compared in a scene, each as a function of the round, which serves as seed.

    Each round has another mean, drawn from the belief: one nominal rollout may have far more or less contact
    than those about it, and would say more of the scene than of the method.
    """
    steps = round(horizon / scene.dt)
    means = belief.sample(rounds, np.random.default_rng(3))
    beliefs = [Belief(mean, belief.covariance) for mean in means]

    def fixed(name, **options):
        return lambda k: predict(scene, beliefs[k], make_propagator(name, **options), horizon)

    def seeded(name, **options):
        return lambda k: predict(scene, beliefs[k], make_propagator(name, seed=k, **options), horizon)

    return {
        "MC-10": seeded("monte_carlo", samples=10),
        "linearization": fixed("linearization"),
        "surrogate": fixed("surrogate"),
        "local_sampling": seeded("local_sampling", samples=32),
        "sigma_points": fixed("sigma_points"),
        "sigma_points, full": fixed("sigma_points", points="full"),
        "nominal rollout": lambda k: simulate(means[k : k + 1].copy(), scene.world, steps),
    }


def _cases(report, models, spheres):
    """(model, number of spheres, (scene, belief, horizon)) of all there are packings for; says which there
    are not.
    """
    for model in models:
        for count in spheres:
            try:
                case = collision(model, count)
            except UnknownModelError:
                report.skip(
                    _case(model, count),
                    f"no packing; python -m unc_physics models --make {model} -n {count} makes it",
                )
            else:
                yield model, count, case


def measure_profile(report, models, spheres, repeats):
    """Contacts of the nominal rollout, and where its time goes."""
    report.heading("The nominal rollout: contacts, and where its wall time goes")
    for model, count, (scene, belief, horizon) in _cases(report, models, spheres):
        steps = round(horizon / scene.dt)
        followed = course(scene, belief.mean, steps)
        touching = followed.contacts[followed.contacts > 0]
        contacts = (
            f"{touching.mean():.1f} contacts in each, at most {touching.max()}" if len(touching) else ""
        )
        report.add(
            "profile", f"contact steps of {steps}", _case(model, count), len(touching), "", note=contacts
        )
        times = phase_times(scene, followed, repeats)
        for k, phase in enumerate(PHASES):
            number = np.count_nonzero(followed.phase == k)
            if number:
                report.add(
                    "profile",
                    f"share of {phase}",
                    _case(model, count),
                    100.0 * times[k] / times.sum(),
                    "%",
                    note=f"{number} steps of {1e6 * times[k] / number:.2f} us",
                )


def measure_large(report, models, rounds):
    """One rollout with 100 000 spheres against one with 10 000."""
    report.heading(
        "One rollout: CPU time with 100 000 spheres over that with 10 000 (same sampled initial states)"
    )
    for model, count, (scene, belief, horizon) in _cases(report, models, [LARGE]):
        small, steps = collision(model, LARGE // 10)[0], round(horizon / scene.dt)
        states = belief.sample(rounds, np.random.default_rng(2))
        times = paired(
            {
                size: lambda k, world=world, x=states, steps=steps: simulate(
                    x[k : k + 1].copy(), world, steps
                )
                for size, world in (("large", scene.world), ("small", small.world))
            },
            rounds,
        )
        report.add(
            "large",
            "100 000 / 10 000 spheres",
            _case(model, count),
            ratio(times, "large", "small"),
            goal=6.0,
            at_most=True,
            note=f"{1e3 * np.median(times['large']):.2f} against {1e3 * np.median(times['small']):.2f} ms",
        )


def measure_threads(report, models, rounds):
    """Wall time on one thread over that on two."""
    report.heading("One thread's wall time over two threads'")
    if min(len(os.sched_getaffinity(0)), numba.config.NUMBA_NUM_THREADS) < 2:
        report.skip("two threads", "this machine lends one")
        return
    scene, belief, horizon = collision(models[0], 1000)
    for label, propagator in (
        ("MC-100", make_propagator("monte_carlo", samples=100)),
        ("sigma_points", make_propagator("sigma_points")),
        ("sigma_points, full", make_propagator("sigma_points", points="full")),
    ):

        def on(threads, propagator=propagator):
            def run(k):
                numba.set_num_threads(threads)
                predict(scene, belief, propagator, horizon)

            return run

        times = paired({"one": on(1), "two": on(2)}, rounds, time.perf_counter)
        numba.set_num_threads(1)
        note = (
            f"{1e3 * np.median(times['one']):.2f} against {1e3 * np.median(times['two']):.2f} ms; load"
            f" {os.getloadavg()[0]:.1f}"
        )
        report.add("threads", label, _case(models[0], 1000), ratio(times, "one", "two"), goal=1.7, note=note)


def measure_dispatch(report, rounds):
    """What a prediction of two bodies costs but for its steps: one step, less what a step more costs."""
    report.heading("Python's share of a prediction of two bodies: dispatch, validation, sampling, moments")
    scene, belief, _ = collision("bunny", 10)
    calls, more = 20, 20  # so few steps lead to no contact
    for label, propagator in (
        ("linearization", "linearization"),
        ("surrogate", "surrogate"),
        ("local_sampling", "local_sampling"),
        ("sigma_points", "sigma_points"),
        ("MC-10", make_propagator("monte_carlo", samples=10)),
    ):

        def ahead(steps, propagator=propagator):
            def run(k):
                for _ in range(calls):
                    predict(scene, belief, propagator, steps * scene.dt)

            return run

        times = paired({"one": ahead(1), "more": ahead(1 + more)}, rounds)
        one, step = np.median(times["one"]) / calls, np.median(times["more"] - times["one"]) / calls / more
        report.add(
            "dispatch",
            label,
            "bunny 10",
            1e3 * (one - step),
            "ms",
            goal=0.1,
            at_most=True,
            note=f"one step more costs {1e6 * step:.2f} us",
        )


def measure_bodies(report, rounds, counts=(2, 8, 32, 64)):
    """Cost of each body in scenes of ever more bodies, in colliding pairs far from each other."""
    report.heading("Cost of each body, over that in a scene of two (pairs that collide, 100 spheres)")
    scenes = {count: many_collisions(count // 2) for count in counts}
    for name in ("surrogate", "local_sampling"):
        times = paired(
            {
                count: lambda k, case=case, name=name: predict(*case[:2], name, case[2])
                for count, case in scenes.items()
            },
            rounds,
        )
        for count in counts[1:]:
            value = ratio(times, count, counts[0]) * counts[0] / count
            report.add(
                "bodies",
                name,
                f"{count} bodies",
                value,
                goal=1.2,
                at_most=True,
                note=f"{1e3 * np.median(times[count]) / count:.3f} ms a body",
            )


SECTIONS = ("peers", "methods", "profile", "large", "threads", "dispatch", "bodies")


def main():
    """Run the sections asked for."""
    parser = argparse.ArgumentParser(
        prog="python -m unc_physics_evaluation.benchmarks.propagators",
        description=__doc__.partition(":")[0] + ".",
        epilog="The peers are extras: pip install pybullet mujoco.",
    )
    parser.add_argument(
        "--models", nargs="+", default=list(MODELS), metavar="NAME", help=f"default: {' '.join(MODELS)}"
    )
    parser.add_argument(
        "--spheres",
        nargs="+",
        type=int,
        metavar="N",
        default=[10, 100, 1000, 10_000, LARGE],
        help="of each body, for the propagators (default: powers of ten up to 100 000)",
    )
    parser.add_argument(
        "--only",
        nargs="+",
        choices=SECTIONS,
        default=list(SECTIONS),
        metavar="SECTION",
        help=f"of {', '.join(SECTIONS)}",
    )
    parser.add_argument(
        "--quick", action="store_true", help="few rounds, up to 1000 spheres: a look, not a result"
    )
    parser.add_argument("--json", metavar="FILE", help="also write all rows with versions and machine")
    arguments = parser.parse_args()
    numba.set_num_threads(1)
    models, rounds = arguments.models, 3 if arguments.quick else 15
    spheres = [n for n in arguments.spheres if n <= 1000] if arguments.quick else arguments.spheres
    report = Report()
    print(machine_and_load())
    print(", ".join(f"{name} {number}" for name, number in versions().items()))
    if "peers" in arguments.only:
        measure_peers(report, models, [n for n in PEER_SPHERES if n in spheres], rounds)
    if "methods" in arguments.only:
        measure_methods(report, models, spheres, rounds)
    if "profile" in arguments.only:
        measure_profile(report, models, spheres, rounds)
    if "large" in arguments.only:
        measure_large(report, models, rounds)
    if "threads" in arguments.only:
        measure_threads(report, models, rounds)
    if "dispatch" in arguments.only:
        measure_dispatch(report, 3 * rounds)
    if "bodies" in arguments.only:
        measure_bodies(report, rounds)
    print(f"\n{report.summary()}")
    if arguments.json:
        report.write(arguments.json)


if __name__ == "__main__":
    main()
