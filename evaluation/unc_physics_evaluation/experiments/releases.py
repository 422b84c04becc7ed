"""Releases and pushes: share of outcomes in the 90 % regions that the node publishes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import binomtest

from unc_physics import Belief, BodyBelief, Plane, RigidBody, Scene, load_model, make_propagator, predict
from unc_physics.spatial.layout import POSITION, QUATERNION

from ..engines import MuJoCoRollouts
from ..jobs import Job, Outcome, Row, Settings
from ..methods import MONTE_CARLO
from ..results import Results
from ..served_scenes import missing_ros as missing
from ..served_scenes import served

TITLE = "Releases and pushes"
NODE = "measured"
RELEASE, PUSH = "release", "push"
#: Simulators of the outcomes.
OWN, MUJOCO = "own simulation", "MuJoCo"
ELLIPSOID, SAMPLES = "mean and covariance", "samples"
LEVEL = 0.9
MODELS = "can", "salt_box"  # MuJoCo has their shapes exactly
HORIZON = 1.5  # s
_SQUARE = 6.251388631170325  # that a chi-square number of three degrees of freedom exceeds in 10 %
_POSITION_STD, _ROTATION_STD = 0.004, 0.03  # m, rad: errors of a detection
_VELOCITY_STD, _SPIN_STD = 0.05, 0.2  # m/s, rad/s: errors of a velocity
_HEIGHTS = 0.02, 0.15  # m, of releases
_TILT = 0.2  # rad, standard deviation of releases
_SPEEDS = 0.2, 0.7  # m/s, of pushes
_GIVES = 5e-4  # m, standard deviation of a contact's own compliance: at rest MuJoCo's cans sink by 0.14 mm
_RETURNED = 1000


def jobs(settings: Settings) -> list[Job]:
    """Return jobs for fifty releases and fifty pushes."""
    count = 5 if settings.quick else 50
    return [
        Job("releases", settings.parameters(action=action, count=count), cost=60.0, alone=True)
        for action in (RELEASE, PUSH)
    ]


def run(job: Job) -> Outcome:
    """Return whether each outcome lies in each region: 0 or 1."""
    if missing():
        return Outcome([])
    from unc_physics.ros.client import Client

    rng, rows = np.random.default_rng(job.seed("scenes")), []
    with served(NODE, {}), Client(f"/{NODE}") as client:
        for k in range(int(job.parameters["count"])):
            scene, state = true_start(str(job.parameters["action"]), MODELS[k % len(MODELS)], rng)
            predicted = client.predict(observed(scene, state, rng)).objects[0].states[-1]
            seed = int(rng.integers(1, 2**31))
            for by, end in ((OWN, own_end(scene, state, seed)), (MUJOCO, mujoco_end(scene, state, seed))):
                for region, inside in held(predicted, end).items():
                    rows.append(Row(by, region, "1", float(inside), None, k, seed))
    return Outcome(rows)


def true_start(action: str, model: str, rng: np.random.Generator) -> tuple[Scene, np.ndarray]:
    """Return a scene of one object above or on a table, and its true state (1, 13)."""
    body = RigidBody("object", load_model(model))
    scene = Scene.everyday([body], environment=[Plane(name="table")])
    turn = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi))
    velocity, spin = rng.normal(0.0, _VELOCITY_STD, 3), rng.normal(0.0, _SPIN_STD, 3)
    place = np.append(rng.uniform(-0.1, 0.1, 2), 0.0)
    if action == RELEASE:
        turn = Rotation.from_rotvec(rng.normal(0.0, _TILT, 3)) * turn
        place[2] = 0.05 + rng.uniform(*_HEIGHTS)
    else:
        direction = rng.uniform(-np.pi, np.pi)
        velocity = rng.uniform(*_SPEEDS) * np.array([np.cos(direction), np.sin(direction), 0.0])
        spin = np.zeros(3)
    state = np.concatenate([_center(body, place, turn), velocity, turn.as_quat(), spin])
    return scene, state[None]


def observed(scene: Scene, state: np.ndarray, rng: np.random.Generator):
    """Return the PredictionRequest of a detection with errors."""
    from unc_physics.ros.client import environment, object_state, prediction_request

    (body,), x = scene.bodies, state[0]
    turn = Rotation.from_quat(x[QUATERNION])
    velocity = x[3:6] + np.cross(x[10:13], turn.apply(np.array(body.model.origin)))
    place = _origin(body, x) + rng.normal(0.0, _POSITION_STD, 3)
    turned = Rotation.from_rotvec(rng.normal(0.0, _ROTATION_STD, 3)) * turn
    twist = [*(velocity + rng.normal(0.0, _VELOCITY_STD, 3)), *(x[10:13] + rng.normal(0.0, _SPIN_STD, 3))]
    seen = object_state(
        "object",
        body.model.name,
        [*place, *turned.as_quat()],
        np.repeat([_POSITION_STD, _ROTATION_STD], 3) ** 2,
        np.repeat([_VELOCITY_STD, _SPIN_STD], 3) ** 2,
        twist=twist,
    )
    table = environment(planes={"table": (0.0, 0.0, 1.0, 0.0)})
    return prediction_request([seen], HORIZON, table, return_samples=_RETURNED)


def own_end(scene: Scene, state: np.ndarray, seed: int) -> np.ndarray:
    """Return where the model's origin (3,) ends in one rollout with drawn friction and impacts."""
    start = BodyBelief(
        position=state[0, POSITION],
        orientation=state[0, QUATERNION],
        linear_velocity=state[0, 3:6],
        angular_velocity=state[0, 10:13],
    )
    propagator = make_propagator(MONTE_CARLO, samples=1, seed=seed)
    end = predict(scene, Belief.of(scene, {"object": start}), propagator, HORIZON).samples()[0, 0]
    return _origin(scene.bodies[0], end)


def mujoco_end(scene: Scene, state: np.ndarray, seed: int) -> np.ndarray:
    """Return where the model's origin (3,) ends in MuJoCo, with friction drawn as the node does."""
    assert scene.friction is not None
    z = np.random.default_rng(seed).normal()
    friction = float(scene.friction * np.exp(z * scene.friction_std / scene.friction))
    engine = MuJoCoRollouts(replace(scene, friction=friction, friction_std=0.0), "primitive")
    end = engine.run(state, round(HORIZON / scene.dt))[0]
    return _origin(scene.bodies[0], end)


def held(predicted, end: np.ndarray) -> dict[str, bool]:
    """Return whether each kind of region contains a position (3,).

    Parameters
    ----------
    predicted : PredictedState
        With samples of its pose.
    end : (3,) array
    """
    place = predicted.pose.pose.position
    samples = np.array([(own.position.x, own.position.y, own.position.z) for own in predicted.pose_samples])
    P = np.reshape(predicted.pose.covariance, (6, 6))[:3, :3] + _GIVES**2 * np.eye(3)
    root = np.linalg.cholesky(P)

    def squares(points):
        return np.sum(np.linalg.solve(root, (points - [place.x, place.y, place.z]).T) ** 2, axis=0)

    square = squares(end[None])[0]
    return {ELLIPSOID: square <= _SQUARE, SAMPLES: square <= np.quantile(squares(samples), LEVEL)}


def _center(body, origin, turn):
    """Return the centre of mass (3,) where the model's origin is."""
    return origin - turn.apply(np.array(body.model.origin))


def _origin(body, x):
    """Return the model's origin (3,) of a state (13,)."""
    return x[POSITION] + Rotation.from_quat(x[QUATERNION]).apply(np.array(body.model.origin))


def report(results: Results) -> str:
    """Return a table of shares with binomial intervals."""
    head = ["action", "outcomes of", "region of", "outcomes", "held [%]", "95 % interval [%]"]
    lines = [
        [action, by, region, str(count), f"{100.0 * share:.0f}", f"{100.0 * low:.0f} to {100.0 * high:.0f}"]
        for action, by, region, count, share, (low, high) in _shares(results)
    ]
    return results.table("releases", head, lines)


def verdict(results: Results) -> str:
    """Return a sentence on the number of intervals that contain 90 %."""
    found = [low <= LEVEL <= high for *_, (low, high) in _shares(results)]
    return f"{sum(found)} of {len(found)} binomial intervals hold 90 %"


def _shares(results):
    """Yield action, simulator, region, number of outcomes, share in the region and its interval."""
    rows = results.rows("releases")
    for action in rows.unique("action"):
        for by in (OWN, MUJOCO):
            for region in (ELLIPSOID, SAMPLES):
                values = rows.where(action=action, method=by, quantity=region).values()
                found = binomtest(int(values.sum()), len(values)).proportion_ci(0.95)
                yield action, by, region, len(values), float(values.mean()), (found.low, found.high)
