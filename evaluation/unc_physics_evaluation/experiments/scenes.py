"""What each feature of a scene costs where it is used, and that it costs nothing elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from unc_physics import PROPAGATORS, Belief, Plane, RigidBody, Scene, load_model, make_propagator, predict
from unc_physics.physics.layout import ANGULAR_VELOCITY, POSITION, QUATERNION
from unc_physics.physics.rollout import advance_explicit, simulate
from unc_physics.scene.materials import DEFAULT_RESTITUTION
from unc_physics.scene.stiffness import with_stiffness

from ..comparison import CPU_TIME, rollout_cost
from ..goals import Figure, goal_tables, goals_met_by, milliseconds, ratio
from ..jobs import Job, Outcome, Row, Settings
from ..methods import MONTE_CARLO, label
from ..results import Results
from ..scenarios import collision, resting, spread
from ..tables import number
from ..timing import timed

TITLE = "Cost of features"
BATCH = 8  # rollouts in a round
BODIES = 64
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


PLAIN, AGAIN, NAMED = "plain", "plain again", "all named as absent"
FREE, ELASTIC = "free fall", "implicit, elastic"
NEW_KERNELS = "new_kernels"


def jobs(settings: Settings) -> list[Job]:
    """Each section in the scenes that it needs, alone on the machine."""
    rounds = 5 if settings.quick else 21
    models, spheres = (("bunny",), (1000,)) if settings.quick else (("bunny", "pin"), (100, 1000))
    cases = [("unused", name, m, n, 3 * rounds) for name in FEATURES for m in models for n in spheres]
    cases += [("used", "both", model, n, rounds) for model in models for n in spheres]
    cases += [
        ("contact", "implicit", "salt_box", 500, rounds),
        ("parameters", "explicit", "bunny", 1000, max(rounds // 3, 3)),
        ("islands", "explicit", "pin", 100, max(rounds // 4, 3)),
    ]
    return [
        Job(
            "scenes",
            settings.parameters(section=section, integrator=integrator, model=model, spheres=n, rounds=count),
            cost=10.0 + 20 * BATCH * count * rollout_cost(n),
            alone=True,
        )
        for section, integrator, model, n, count in cases
    ]


def run(job: Job) -> Outcome:
    """CPU times of one section, in turns."""
    return Outcome(SECTIONS[job.parameters["section"]](job))


def report(results: Results) -> str:
    """A table of each section, with what is met and missed."""
    return (
        "What is compared runs in turns in one process on one thread; figures are medians of the rounds'"
        f" ratios of CPU times. Rollouts are those of the paper's collision of two bodies, 5 s in 500 steps,"
        f" {BATCH} of them in a round, from sampled initial states.\n\n" + goal_tables(_figures(results))
    )


def _rollouts(scenes: Mapping[str, Scene], states, steps):
    """For each scene its rollouts from a round's states, as a function of the round."""

    def rolls(scene):
        def run(k):
            for state in states[k].copy():
                simulate(state[None], scene.world, steps)

        return run

    return {(name, None, CPU_TIME): rolls(scene) for name, scene in scenes.items()}


def _collision(job, integrator):
    """Its scene, (rounds, 8, 2, 13) sampled states, and the number of steps."""
    p = job.parameters
    scene, belief, horizon = collision(p["model"], p["spheres"])
    states = belief.sample(BATCH * p["rounds"], np.random.default_rng(job.seed("states")))
    scene = replace(scene, integrator=integrator)
    return scene, states.reshape(p["rounds"], BATCH, 2, 13), round(horizon / scene.dt)


def _unused(job) -> list[Row]:
    """The plain scene, and one that names every feature at its neutral value."""
    integrator = job.parameters["integrator"]
    plain, states, steps = _collision(job, integrator)
    named = replace(plain, **NEUTRAL, restitution=DEFAULT_RESTITUTION[integrator])
    kernels = []
    for scene in (plain, named):
        simulate(states[0, :1].copy(), scene.world, 1)
        kernels.append(len(advance_explicit.signatures))
    # each in arrays of its own, as the processor's caches count; a round's first finds them colder: not
    # compared
    scenes = {"first": plain, PLAIN: replace(plain), NAMED: named, AGAIN: replace(plain)}
    times = timed(_rollouts(scenes, states, steps), job.parameters["rounds"])
    return [*times, Row(NAMED, NEW_KERNELS, "1", kernels[1] - kernels[0])]


def _used(job) -> list[Row]:
    """Each feature alone, and all together, with both integrators."""
    scenes = {ELASTIC: replace(_collision(job, "implicit")[0], restitution=1.0)}
    for integrator, features in FEATURES.items():
        plain, states, steps = _collision(job, integrator)
        scenes[integrator] = plain
        scenes |= {f"{integrator}, {name}": replace(plain, **given) for name, given in features.items()}
    return timed(_rollouts(scenes, states, steps), job.parameters["rounds"])


def _contact(job) -> list[Row]:
    """A box that falls onto a floor and comes to rest, and the same fall without a floor."""
    p = job.parameters
    box = RigidBody("box", load_model(p["model"]).prefix(p["spheres"]), 0.52)
    rng = np.random.default_rng(job.seed("states"))
    states = np.zeros((p["rounds"], BATCH, 1, 13))
    turns = 0.02 * rng.standard_normal((p["rounds"], BATCH, 1, 4))
    states[..., QUATERNION] = np.array([0.0, 0.04, 0.1, 1.0]) + turns
    states[..., QUATERNION] /= np.linalg.norm(states[..., QUATERNION], axis=-1, keepdims=True)
    states[..., 2] = 0.115
    scene = with_stiffness(Scene.everyday([box]), states[0, 0])
    landing = replace(scene, environment=(Plane(),))
    scenes = {FREE: scene, "lands": landing, "lands, sleep": replace(landing, sleep=True)}
    return timed(_rollouts(scenes, states, 240), p["rounds"])


def _parameters(job) -> list[Row]:
    """Predictions with and without uncertain parameters."""
    p = job.parameters
    scene, belief, horizon = collision(p["model"], p["spheres"])
    heavy = [replace(body, mass_std=0.1 * body.mass) for body in scene.bodies]
    shifted = [replace(body, center_of_mass_std=0.01) for body in scene.bodies]
    scenes = {
        PLAIN: scene,
        "masses": replace(scene, bodies=heavy),
        "stiffness": replace(scene, stiffness_std=0.1 * scene.stiffness),
        "centres of mass": replace(scene, bodies=shifted),
    }
    means = belief.sample(p["rounds"], np.random.default_rng(job.seed("means")))

    def predicts(scene, propagator):
        return lambda k: predict(scene, Belief(means[k], belief.covariance), propagator, horizon)

    functions = {
        (*key, f"{CPU_TIME} {name}"): predicts(own, propagator)
        for key, propagator in _everyone().items()
        if propagator.varies_parameters
        for name, own in scenes.items()
    }
    return timed(functions, p["rounds"])


def _islands(job) -> list[Row]:
    """Many scattered bodies, one, and two that touch; with islands and without."""
    cases = {
        "one": _scattered(1),
        "many": _scattered(BODIES),
        "two touch": _scattered(BODIES, True),
        "a pair": _scattered(2, True),
        "joint": _scattered(BODIES, islands=False),
    }

    def predicts(case, propagator):
        return lambda k: predict(*case, propagator, 1.0)

    functions = {
        (*key, f"{CPU_TIME} {name}"): predicts(case, propagator)
        for key, propagator in _everyone().items()
        for name, case in cases.items()
    }
    return timed(functions, job.parameters["rounds"])


def _everyone():
    """All propagators by method and samples: of Monte Carlo 100."""
    return {
        (name, 100 if name == MONTE_CARLO else None): make_propagator(
            name, **({"samples": 100} if name == MONTE_CARLO else {})
        )
        for name in PROPAGATORS
    }


def _scattered(count, touching=False, islands=True):
    """So many pins that drift two metres apart from each other; two of them so close that they touch."""
    pin = load_model("pin").prefix(100)
    scene = Scene([RigidBody(f"pin{k}", pin, 1.0) for k in range(count)], stiffness=1e6, islands=islands)
    side = int(np.ceil(np.sqrt(count)))
    places = np.arange(count)
    mean = resting(2.0 * np.stack([places % side, places // side, np.zeros(count)], axis=1))
    mean[:, ANGULAR_VELOCITY] = 0.5
    if touching:
        mean[1, POSITION] = mean[0, POSITION] + [1.5 * pin.bounding_radius, 0.0, 0.0]
        mean[1, 3] = -0.2
    return scene, Belief(mean, spread(count, position=0.005))


SECTIONS = {
    "unused": _unused,
    "used": _used,
    "contact": _contact,
    "parameters": _parameters,
    "islands": _islands,
}


def _figures(results) -> dict[str, list[Figure]]:
    rows = results.rows("scenes")
    of = {section: rows.where(section=section) for section in SECTIONS}
    unused = [
        of["unused"].where(integrator=integrator, model=model, spheres=n)
        for integrator in FEATURES
        for model in rows.unique("model")
        for n in rows.unique("spheres")
    ]
    used = [
        of["used"].where(model=model, spheres=n)
        for model in rows.unique("model")
        for n in rows.unique("spheres")
    ]
    return {
        "Features that are not used, a scene that names them all as absent over one that names none": [
            _unused_figure(here) for here in unused if here
        ],
        "Features that are used, one rollout with the feature over one without": [
            _figure(here, name, _without(name), f"{name} / {_without(name)}")
            for here in used
            for name in here.unique("method")
            if name not in FEATURES
        ],
        "A salt box that falls 5 cm onto a floor and rests there, 1 s in 240 steps, over free fall": [
            _figure(of["contact"], name, FREE, name)
            for name in of["contact"].unique("method")
            if name != FREE
        ],
        "Uncertain parameters, a prediction with them over one without": [
            Figure(
                f"{label(method, samples)}, {quantity.removeprefix(CPU_TIME).strip()}",
                "bunny 1000",
                ratio(here.where(quantity=quantity), here.where(quantity=f"{CPU_TIME} {PLAIN}")),
                note=milliseconds(here.where(quantity=quantity), here.where(quantity=f"{CPU_TIME} {PLAIN}")),
            )
            for method, samples in of["parameters"].curves()
            for here in [of["parameters"].where(method=method)]
            for quantity in here.unique("quantity")
            if not quantity.endswith(PLAIN)
        ],
        f"Islands, {BODIES} scattered bodies over one, two that touch over none, without islands over with"
        " (1 s)": [
            figure
            for method, samples in of["islands"].curves()
            for figure in _island_figures(of["islands"].where(method=method), label(method, samples))
        ],
    }


def _without(feature):
    """What a scene with a feature is compared with."""
    return "explicit" if feature == ELASTIC else feature.partition(",")[0]


def _case(rows):
    return f"{rows[0]['model']} {rows[0]['spheres']}"


def _figure(rows, slow, fast, what):
    times = [rows.where(method=method, quantity=CPU_TIME) for method in (slow, fast)]
    return Figure(what, _case(rows), ratio(*times), note=milliseconds(*times, 1.0 / BATCH))


def _unused_figure(rows):
    named, plain, again = (rows.where(method=name, quantity=CPU_TIME) for name in (NAMED, PLAIN, AGAIN))
    new = rows.where(quantity=NEW_KERNELS).mean()
    note = f"plain over itself {ratio(again, plain):.3f}; {'OTHER KERNELS' if new else 'the same kernels'}"
    what = f"{rows[0]['integrator']}, named / plain"
    return Figure(what, _case(rows), ratio(named, plain), "x", 1.02, at_most=True, note=note)


def _island_figures(rows, what):
    one, many, touch, pair, joint = (
        rows.where(quantity=f"{CPU_TIME} {name}") for name in ("one", "many", "two touch", "a pair", "joint")
    )
    more = float(np.median((touch.values() - many.values()) / one.values()))
    return [
        Figure(f"{BODIES} bodies / 1", what, ratio(many, one), note=milliseconds(many, one)),
        Figure("two touch, more than none / 1", what, more, note=f"a pair alone {ratio(pair, one):.2f}"),
        Figure("joint / islands", what, ratio(joint, many), note=f"{number(1e3 * joint.median())} ms"),
    ]


verdict = goals_met_by(_figures)
