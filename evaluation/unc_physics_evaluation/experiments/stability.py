"""Hard cases: conservation in rollouts, and spreads and flags of every propagator."""

from __future__ import annotations

from dataclasses import replace

from unc_physics.checks.errors import DivergedError
from unc_physics.prediction.predict import predict
from unc_physics.prediction.request_checks import periodic_times
from unc_physics.prediction.status import assess
from unc_physics.propagators.registry import PROPAGATORS, make_propagator
from unc_physics.propagators.start import constrain_belief
from unc_physics.spatial.layout import ERR_POSITION, ERR_ROTATION, POSITION, QUATERNION

from .. import everyday_cases
from ..conservation import FINITE, GAIN, mean_gain, rollout_rows, trajectory
from ..everyday_cases import Case
from ..hard_cases import digest, load, names
from ..jobs import Job, Outcome, Row, Settings
from ..methods import MONTE_CARLO
from ..results import Results
from ..scenarios import MANIPULATION, MODELS, collision, collision_free
from ..stability_document import (
    EXTENT,
    MEAN,
    MEASURE,
    POSE,
    POSITION_STD,
    ROTATION_STD,
    TRUE,
    runs_on,
    sections,
)

TITLE = "Stability"
TRUTH, REFINED = 1000, 4  # samples of the truth, and how many times shorter its steps are
FEWER = {  # samples, also of Monte Carlo's prediction, where rollouts take long
    "long_in_a_box": 300,
    "mass_ratio_stack": 100,
    "pile_of_ten": 300,
    "rest_plate_settling": 300,
    "sixty_four_boxes": 100,
    "sixty_four_pairs": 100,
    "stack_of_three": 100,
}
FINER = {  # where that is not short enough
    "spin_free": 32,
    "step_10ms": 64,
    "step_20ms": 128,
    "step_50ms": 256,
    "stiffness_1e7": 16,
    "stiffness_1e8": 64,
}
# at the belief on the way; few with more than ``MANY`` bodies, as eigenvalues take long
LOOKS, FEW_LOOKS, MANY = 50, 8, 20
QUICK = ("covariance_zero", "fast_ball_at_wall", "overlap_in_floor", "rotation_std_near_pi", "stiffness_1e7")
SPHERES = 100  # of the paper's bodies
SIGMAS, ENCOUNTERS = (0.01, 0.05, 0.1), 4


def paper_cases() -> list[str]:
    """Return the names of the paper's scenes."""
    found = [
        f"collision {model} {sigma} {k}" for model in MODELS for sigma in SIGMAS for k in range(ENCOUNTERS)
    ]
    return [*found, "collision_free linear_velocity", "collision_free angular_velocity", *MANIPULATION]


def case(name: str) -> Case:
    """Return a case by its name."""
    if name in everyday_cases.names():
        motion, _, belief = name.rpartition(", ")
        return everyday_cases.case(motion, belief)
    kind, *rest = name.split()
    if kind == "collision":
        return Case(*collision(rest[0], SPHERES, float(rest[1]), int(rest[2])))
    if kind == "collision_free":
        return Case(*collision_free(rest[0], spheres=SPHERES))
    if kind in MANIPULATION:
        scene, belief, horizon = MANIPULATION[kind][0]()
        bodies = [replace(body, model=body.model.prefix(SPHERES)) for body in scene.bodies]
        return Case(replace(scene, bodies=bodies), belief, horizon)
    found = load(name)
    return Case(found.scene, found.belief, found.horizon)


def jobs(settings: Settings) -> list[Job]:
    """Return jobs for each case's truth, and for its predictions by all propagators."""
    hard, paper = (QUICK, ()) if settings.quick else (names(), paper_cases())
    found = []
    others = (*paper, *([] if settings.quick else everyday_cases.names()))
    for name in (*hard, *others):
        same = settings.parameters(case=name, file="none" if name in others else digest(name))
        for work, refined in (("truth", FINER.get(name, REFINED)), ("methods", 1)):
            parameters = {"work": work, **same, "draws": FEWER.get(name, TRUTH), "refined": refined}
            found.append(Job("stability", parameters, cost=40.0 if name in FEWER else 3.0))
    return found


def run(job: Job) -> Outcome:
    """Return spreads of the truth, or rows of the mean's rollout and of all propagators."""
    given = case(job.parameters["case"])
    if job.parameters["work"] == "truth":
        return Outcome(_truth(given, job))
    rows = rollout_rows(
        MEAN, given.scene, trajectory(given.scene, given.belief.mean, round(given.horizon / given.scene.dt))
    )
    for name in runs_on(given.scene.integrator):
        rows += _prediction(given, name, job)
    return Outcome(rows)


def report(results: Results) -> str:
    """Return the sections on goals and on rates of flags."""
    return sections(results)


def _truth(given, job):
    """Return spreads of samples with short steps."""
    p, seed = job.parameters, job.seed("truth")
    fine = replace(given.scene, dt=given.scene.dt / p["refined"])
    truth = make_propagator(MONTE_CARLO, samples=p["draws"], seed=seed)
    belief = predict(fine, given.belief, truth, given.horizon).belief
    rows = _moment_rows(TRUE, fine, belief, p["draws"], seed)
    for k in given.scene.moving.tolist():
        rows.append(Row(TRUE, EXTENT, "m", 2.0 * given.scene.bodies[k].model.bounding_radius, None, k))
    return rows


def _prediction(given, name, job):
    """Return a propagator's final spreads and measures, and the energy that rollouts gain."""
    scene, belief, horizon = given
    looks = LOOKS if len(scene.bodies) <= MANY else FEW_LOOKS
    times = periodic_times(scene, max(round(horizon / looks / scene.dt), 1) * scene.dt, horizon)
    options = {"seed": job.seed(name)} if "seed" in PROPAGATORS[name].options() else {}
    samples = job.parameters["draws"] if name == MONTE_CARLO else None
    if samples is not None:
        options["samples"] = samples
    propagator = make_propagator(name, **options)
    try:
        prediction = predict(scene, belief, propagator, horizon, times=times)
    except DivergedError:
        return [Row(name, FINITE, "1", 0.0)]
    rows = [Row(name, FINITE, "1", 1.0)]
    if name == MONTE_CARLO:
        carry = propagator.init(scene, constrain_belief(scene, belief))
        gain = mean_gain(scene, _rollouts(propagator, carry, scene, (0.0, *prediction.times)))
        rows.append(Row(name, GAIN, "1", gain))
    rows += _moment_rows(name, scene, prediction.belief, samples, prediction.seed)
    statuses = assess(prediction)
    for k in scene.moving.tolist():
        rows += [
            Row(name, MEASURE + measure, "1", value, samples, k)
            for measure, value in statuses[k].measures.items()
        ]
    return rows


def _rollouts(propagator, carry, scene, times):
    """Return the states of the prediction's rollouts, from a carry at time 0 on."""
    done = 0
    for time in times:
        steps = round(time / scene.dt)
        if steps > done:
            carry, done = propagator.advance(carry, scene, steps - done), steps
        yield propagator.rollout_states(carry, scene)


def _moment_rows(method, scene, belief, samples, seed):
    """Return rows of each body's mean pose, and of the standard deviations of its position and rotation.

    The replicate is the body.
    """
    rows = []
    for k, P in zip(scene.moving.tolist(), belief.blocks, strict=True):
        for quantity, unit, block in ((POSITION_STD, "m", ERR_POSITION), (ROTATION_STD, "rad", ERR_ROTATION)):
            rows.append(
                Row(method, quantity, unit, float(max(P[block, block].trace(), 0.0) ** 0.5), samples, k, seed)
            )
        pose = [*belief.mean[k, POSITION], *belief.mean[k, QUATERNION]]
        rows += [
            Row(method, quantity, "m" if n < 3 else "1", float(value), samples, k, seed)
            for n, (quantity, value) in enumerate(zip(POSE, pose, strict=True))
        ]
    return rows
