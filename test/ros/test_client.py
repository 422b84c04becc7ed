"""The client over real DDS: messages from numbers, answers equal to the library's, errors and time-outs."""

import re
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from time import sleep

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import Pose
from rclpy.executors import SingleThreadedExecutor
from running import spin
from scipy.spatial.transform import Rotation

from unc_physics import (
    Belief,
    BodyBelief,
    Box,
    BoxRegion,
    FellOff,
    InRegion,
    Plane,
    RigidBody,
    Scene,
    Touches,
    Upright,
    load_model,
    make_propagator,
    predict,
    rank,
    save_packing,
)
from unc_physics.checks.errors import (
    InvalidCovarianceError,
    InvalidRequestError,
    LimitExceededError,
    NotActiveError,
    PredictionTimeoutError,
    UnknownModelError,
)
from unc_physics.prediction.events import encounters, moving_names
from unc_physics.ros import Client, environment, make_message, object_state, poses_of, prediction_request
from unc_physics.ros.messages.events import object_events
from unc_physics_msgs.msg import BoxRegion as BoxRegionMessage
from unc_physics_msgs.msg import (
    Candidate,
    Event,
    Material,
    ModelInfo,
    ObjectState,
    Physics,
    PredictionRequest,
)
from unc_physics_msgs.srv import GetCapabilities, Predict

ROUND_OFF = 1e-9  # of the way to the models' origins and back, until a contact hangs on it
READY = 200.0  # s
DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "tutorials" / "ros.md"


@pytest.fixture(scope="module")
def asked(node):
    """A client of the shared node."""
    with Client(timeout=READY) as made:
        yield made


def drawn_covariance(rng, size):
    root = size * rng.normal(size=(6, 6)) / np.sqrt(6.0)
    return root @ root.T


def scene_twice():
    """Two turned objects with full covariances over a table and a tilted plane, as arrays and as messages.

    The library's numbers are computed here with SciPy: poses of the models' origins are moved to the centres
    of mass, and rotations about the axes of the frame are turned to those of the body.
    """
    rng, bodies, objects, mean, blocks = np.random.default_rng(1), [], [], [], []
    for name, model, place, scale in (
        ("box", "salt_box", (0, 0, 0.3), 1.0),
        ("mug", "mug", (0.05, 0, 0.8), 1.2),
    ):
        packing = load_model(model).prefix(60).scaled(scale)
        turn, v, w = Rotation.from_rotvec(rng.normal(size=3)), rng.normal(size=3), rng.normal(size=3)
        pose_covariance, twist_covariance = drawn_covariance(rng, 0.02), drawn_covariance(rng, 0.05)
        objects.append(
            object_state(
                name,
                model,
                [*place, *turn.as_quat()],
                pose_covariance,
                twist_covariance,
                twist=[*v, *w],
                mass=0.4,
                spheres=60,
                scale=scale,
            )
        )
        bodies.append(RigidBody(name, packing, 0.4))
        arm = -turn.apply(np.array(packing.origin))  # from the model's origin to the centre of mass
        mean.append([*(place + arm), *(v + np.cross(w, arm)), *turn.as_quat(), *w])
        R, across, spin = turn.as_matrix(), cross(arm), cross(w)
        # errors [dp, dv, dtheta, domega] at the centre of mass from [dp, dphi, dv, domega] at the origin
        A = np.zeros((12, 12))
        A[:3, :3], A[:3, 3:6] = np.eye(3), -across
        A[3:6, 3:6], A[3:6, 6:9], A[3:6, 9:] = -spin @ across, np.eye(3), -across
        A[6:9, 3:6], A[9:, 9:] = R.T, np.eye(3)
        C = np.zeros((12, 12))
        C[:6, :6], C[6:, 6:] = pose_covariance, twist_covariance
        blocks.append(A @ C @ A.T)
    tilted = environment(
        planes={"floor": (0.0, 0.1, 1.0, 0.3)},
        boxes={"table": ((1.0, 1.0, 0.1), (0.0, 0.0, -0.05, 0.0, 0.0, 0.6, 0.8))},
    )
    table = Box((1.0, 1.0, 0.1), (0.0, 0.0, -0.05), (0.0, 0.0, 0.6, 0.8), name="table")
    floor = Plane((0.0, 0.1, 1.0), -0.3 / np.hypot(1.0, 0.1), name="floor")
    scene = Scene.everyday(bodies, exact=True, environment=[floor, table], friction=0.4)
    physics = make_message(Physics, preset="everyday", exact=True, friction=0.4)
    return scene, Belief(np.array(mean), np.array(blocks)), objects, tilted, physics


def cross(v):
    """The matrix of the cross product with a vector."""
    return np.cross(v, -np.eye(3))


@pytest.mark.parametrize(
    ("name", "options"), [("sigma_points", {}), ("monte_carlo", {"samples": 300, "seed": 3})]
)
def test_an_answer_has_the_library_s_poses_and_covariances(asked, name, options):
    scene, belief, objects, tilted, physics = scene_twice()
    request = prediction_request(
        objects,
        0.25,
        tilted,
        physics=physics,
        propagator=name,
        times=[0.1],
        return_covariance=True,
        return_probabilities=True,
        **options,
    )
    found = asked.predict(request)
    expected = predict(
        scene,
        belief,
        make_propagator(name, **options),
        0.25,
        times=[0.1],
        events=[*encounters(scene), *object_events(moving_names(scene))],
    )
    assert (found.propagator, found.rollouts) == (name, 300 if options else len(expected.at().points))
    for body, (poses, covariances) in poses_of(found).items():
        (own,) = [one for one in found.objects if one.id == body]
        for k, time in enumerate((0.1, 0.25)):
            wanted = expected.body(body, time=time, origin="model")
            np.testing.assert_allclose(poses[k, :3], wanted.position, atol=ROUND_OFF)
            np.testing.assert_allclose(poses[k, 3:], wanted.orientation, atol=ROUND_OFF)
            np.testing.assert_allclose(covariances[k], wanted.covariance("ros"), atol=ROUND_OFF)
            T = np.eye(12)  # from rotations about the body's axes to those of the frame
            T[6:9, 6:9] = Rotation.from_quat(poses[k, 3:]).as_matrix()
            C = T @ wanted.covariance("error_state") @ T.T
            P = np.reshape(own.states[k].covariance, (12, 12))
            np.testing.assert_allclose(P, C, atol=ROUND_OFF)
    (upright,) = (one for one in found.events if (one.kind, one.object) == (Event.UPRIGHT, "mug"))
    wanted = expected.probability(Upright("mug"))
    assert (upright.probability, upright.low, upright.high) == pytest.approx(
        (wanted.estimate, wanted.low, wanted.high)
    )


REGION = make_message(BoxRegionMessage, id="above", size=(0.4, 0.4, 0.4), pose=(0, 0, 0.2))
ABOVE = InRegion("box", BoxRegion("above", (0.4, 0.4, 0.4), (0, 0, 0.2)))
IN_REGION = Event(kind=Event.IN_REGION, object="box", other="above")
ON_FLOOR = Event(kind=Event.TOUCHES, object="box", other="floor", negated=True)
OFF_SHELF = Event(kind=Event.FELL_OFF, object="box", other="shelf", negated=True)


def box_at(x, **fields):
    covariance = np.square([0.02] * 3 + [0.05] * 3)
    return object_state(
        "box", "salt_box", (x, 0, 0.15), covariance, [1e-6] * 6, mass=0.4, spheres=20, **fields
    )


@pytest.mark.parametrize(
    ("score", "event"),
    [([IN_REGION, ON_FLOOR], ABOVE & ~Touches("box", "floor")), ([OFF_SHELF], ~FellOff("box", "shelf"))],
)
def test_a_ranking_is_the_library_s(asked, score, event):
    rough = make_message(Material, friction=1.0)
    candidates = [
        Candidate(id="beside", objects=[box_at(0.4)]),
        Candidate(id="over"),
        Candidate(id="rough", objects=[box_at(0.18, material=rough)]),
    ]
    around = environment({"floor": (0, 0, 1, 0.5)}, {"shelf": ((0.4, 0.4, 0.02), (0, 0, 0))})
    physics = make_message(Physics, preset="everyday", exact=True)
    request = prediction_request(
        [box_at(0.0)], 0.5, around, physics=physics, samples=100, seed=3, regions=[REGION]
    )
    answer = asked.rank(request, candidates, score=score)
    elements = [Plane(offset=-0.5, name="floor"), Box((0.4, 0.4, 0.02), name="shelf")]
    box = RigidBody("box", load_model("salt_box").prefix(20), 0.4)
    scene = Scene.everyday([box], exact=True, environment=elements)
    stds = {"linear_velocity_std": 1e-3, "angular_velocity_std": 1e-3}
    held = BodyBelief(origin="model", position=(0, 0, 0.15), position_std=0.02, orientation_std=0.05, **stds)
    actions = {
        "beside": {"box": {"origin": "model", "position": (0.4, 0, 0.15)}},
        "over": {"box": held},
        "rough": {"box": {"origin": "model", "position": (0.18, 0, 0.15), "friction": 1.0}},
    }
    expected = rank(scene, Belief.of(scene, {"box": held}), actions, event, 0.5, rollouts=100, seed=3)
    assert answer.seed == 3 and len(answer.predictions) == 3
    opposite = len(score) == 1  # the message has the probability of the event itself
    for entry, action in zip(answer.predictions, expected, strict=True):
        assert (entry.candidate, entry.prediction.rollouts) == (action.name, action.rollouts)
        assert (entry.tied, entry.clearly_worse) == (action.tied, action.clearly_worse)
        assert entry.margin == (0.0 if action.margin is None else pytest.approx(action.margin))
        wanted = action.score
        wanted = (wanted.estimate, wanted.low, wanted.high)
        wanted = (1.0 - wanted[0], 1.0 - wanted[2], 1.0 - wanted[1]) if opposite else wanted
        assert (entry.score, entry.score_low, entry.score_high) == pytest.approx(wanted, abs=1e-12)
        difference = action.difference.value * (-1 if opposite else 1)
        assert entry.difference == pytest.approx(difference)


def test_messages_are_made_of_numbers():
    physics = make_message(Physics, friction=0.4, gravity=(0, 0, -1), stiffness_std=3)
    assert physics.has_friction and physics.friction == 0.4 and not physics.has_restitution
    assert physics.has_gravity and (physics.gravity.z, physics.stiffness_std) == (-1.0, 3.0)
    known = object_state("can", "can", (1, 2, 3), [1, 2, 3, 4, 5, 6], twist=range(6), kind=ObjectState.FIXED)
    assert known.pose.pose.position.y == 2.0 and known.pose.pose.orientation.w == 1.0
    assert np.reshape(known.pose.covariance, (6, 6)).diagonal().tolist() == [1, 2, 3, 4, 5, 6]
    assert known.twist.covariance[0] == -1.0, "unknown"
    assert (known.twist.twist.linear.z, known.twist.twist.angular.x, known.kind) == (
        2.0,
        3.0,
        ObjectState.FIXED,
    )
    request = prediction_request(
        [known], 1.25, times=[0.5], propagator_options={"runs": 64}, time_budget=0.125
    )
    assert (request.horizon.sec, request.horizon.nanosec, request.time_budget.nanosec) == (
        1,
        250_000_000,
        125_000_000,
    )
    assert request.times[0].nanosec == 500_000_000
    assert [(pair.key, pair.value) for pair in request.propagator_options] == [("runs", "64")]
    assert not request.scene.environment.complete and environment().complete
    region = make_message(BoxRegionMessage, id="bin", size=(1, 2, 3), pose=Pose())
    assert (region.id, region.size.y) == ("bin", 2.0)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: make_message(Physics, fricton=0.4),
            "^fricton is no field of Physics; did you mean 'friction'",
        ),
        (lambda: object_state("a", "can", (1, 2)), r"^pose must .*\(3,\)"),
        (lambda: object_state("a", "can", (1, 2, 3), np.eye(5)), r"^covariance must .*36"),
        (lambda: object_state("a", "can", (1, 2, 3), mass="1 kg"), "^mass must be a number"),
        (lambda: object_state(3, "can", (1, 2, 3)), "^id must be a str"),
        (lambda: prediction_request([], "soon"), "^horizon must be a number"),
        (lambda: prediction_request([], 1.0, samples=-1), "^samples must"),
        (lambda: prediction_request([], 1.0, return_modes="yes"), "^return_modes must be true or false"),
        (lambda: Client(timeout=0.0), "^timeout must be positive"),
    ],
)
def test_numbers_that_fit_no_field_are_named(make, words):
    with pytest.raises(InvalidRequestError, match=words):
        make()


def can(**others):
    return object_state("can", "can", (0.0, 0.0, 0.1), [1e-6] * 6, spheres=50, **others)


@pytest.mark.parametrize(
    ("request_", "kind", "field", "words"),
    [
        (
            prediction_request([object_state("x", "teapot", (0, 0, 0))], 1.0),
            UnknownModelError,
            "scene.objects[0].model",
            "is unknown; the models are",
        ),
        (prediction_request([can()], 1e4), LimitExceededError, "horizon", "must be at most 60"),
        (
            prediction_request([object_state("x", "can", (0, 0, 0), [1, 1, -2, 1, 1, 1])], 1.0),
            InvalidCovarianceError,
            "scene.objects[0].pose.covariance",
            "has a negative variance",
        ),
    ],
)
def test_errors_of_answers_are_raised_with_their_field(asked, request_, kind, field, words):
    with pytest.raises(kind, match=words) as caught:
        asked.predict(request_)
    assert caught.value.field == field and str(caught.value).startswith(f"{field} ")


def endless(limit):
    """A request with a limit of its computation time [s]."""
    options = {"propagator": "monte_carlo", "samples": 20_000, "max_computation_time": limit}
    return prediction_request([can(twist=(0, 0, 9, 0, 0, 9))], 50.0, environment(), **options)


def test_out_of_time_with_what_was_done(asked):
    for limit in (0.2, 2.0, 20.0):  # on a busy machine even the first step takes a while
        with pytest.raises(PredictionTimeoutError, match="max_computation_time ran out") as caught:
            asked.predict(endless(limit))
        if caught.value.prediction.objects:
            break
    assert 0 <= caught.value.prediction.time_reached.sec < 50
    assert np.isfinite(poses_of(caught.value.prediction)["can"][0]).all()


def test_several_threads_use_one_client(asked):
    horizons = [0.1, 0.2, 0.3, 0.4]
    requests = [prediction_request([can()], horizon, environment()) for horizon in horizons]
    with ThreadPoolExecutor() as pool:
        found = [answer.time_reached for answer in pool.map(asked.predict, requests)]
    assert [time.nanosec * 1e-9 for time in found] == pytest.approx(horizons)


def test_models_are_loaded_and_listed(asked, tmp_path):
    packing = load_model("bunny").prefix(40)
    save_packing(tmp_path / "hare.npz", packing)
    info = asked.load_model(tmp_path / "hare.npz", name="hare")
    assert (info.name, info.status, info.spheres) == ("hare", ModelInfo.STATUS_READY, 40)
    assert {"hare", "can"} <= set(asked.models())
    (tmp_path / "wedge.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    info = asked.load_model(tmp_path / "wedge.obj", spheres=20)
    assert (info.name, info.status, info.spheres) == ("wedge", ModelInfo.STATUS_READY, 20)
    with pytest.raises(InvalidRequestError, match="is no file"):
        asked.load_model(tmp_path / "nothing.npz")
    assert asked.capabilities().default_propagator == "auto"


# -- time-outs -----------------------------------------------------------------------------------------


def test_a_node_that_is_not_there_is_named():
    with Client(server="/nobody", timeout=0.3) as client:
        for call in (client.models, client.capabilities, client.fork, client.reset):
            with pytest.raises(
                NotActiveError,
                match="/nobody/(models has no message|[a-z_]+ is offered by no node; start one)",
            ):
                call()
        with pytest.raises(NotActiveError, match="/nobody/tracked has no message; start the node with track"):
            client.tracked()
    for call in (client.models, client.tracked):
        with pytest.raises(NotActiveError, match="the client is closed"):
            call()
    client.close()  # once more does nothing


class Robot:
    """A user's node in a single-threaded executor, whose timer calls a function once."""

    def __init__(self, name, call):
        self.context, self.called, self.result = rclpy.Context(), threading.Event(), None
        rclpy.init(context=self.context)
        self.node = rclpy.create_node(name, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._call, self._timer = call, self.node.create_timer(0.0, self._tick)
        self._thread = threading.Thread(target=spin, args=[self.executor])

    def _tick(self):
        self._timer.cancel()
        try:
            self.result = self._call()
        except Exception as error:  # noqa: BLE001
            self.result = error
        self.called.set()

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self.executor.shutdown()
        self._thread.join()
        self.node.destroy_node()
        self.context.try_shutdown()


def test_a_call_in_a_callback_is_answered(asked):
    request = prediction_request([can()], 0.1, environment())
    with Robot("robot", lambda: asked.predict(request)) as robot:
        assert robot.called.wait(READY)
    assert robot.result.time_reached.nanosec == 100_000_000


def test_a_call_that_only_the_calling_thread_could_answer_times_out():
    """The robot serves the request itself, in the executor whose thread waits for the answer."""
    served = threading.Event()

    def answer(request, response):
        served.set()
        return response

    with Client(server="/lonely", timeout=READY) as client:
        robot = Robot("lonely", lambda: client.predict(PredictionRequest(), timeout=0.5))
        robot.node.create_service(Predict, "~/predict", answer)
        with robot:
            assert robot.called.wait(READY)
            assert not served.is_set() or isinstance(robot.result, NotActiveError)
            assert isinstance(robot.result, NotActiveError)
            assert "has not answered" in str(robot.result) and "another thread" in str(robot.result)
            assert served.wait(READY), "the executor goes on, and takes up the request"


@pytest.mark.parametrize("after", [0.0, 0.01, 0.5])  # s: in any state, from the search for the service on
def test_closing_a_client_ends_its_calls(node, after):
    with Client(timeout=READY) as client, ThreadPoolExecutor() as pool:
        asking = pool.submit(client.predict, endless(2.0))
        sleep(after)
        client.close()
        with pytest.raises(NotActiveError, match="the client is closed"):
            asking.result(READY)


def test_a_node_that_leaves_during_a_call_is_not_waited_for():
    context = rclpy.Context()
    rclpy.init(context=context)
    leaving = rclpy.create_node("leaving", context=context)
    executor, asked = SingleThreadedExecutor(context=context), threading.Event()
    executor.add_node(leaving)

    def leave(request, response):
        asked.set()
        executor.remove_node(leaving)
        leaving.destroy_node()
        raise RuntimeError("left")  # so that no answer is sent

    leaving.create_service(GetCapabilities, "~/get_capabilities", leave)
    thread = threading.Thread(target=lambda: pytest.raises(RuntimeError, executor.spin))
    thread.start()
    with (
        Client(server="/leaving", timeout=READY) as client,
        pytest.raises(NotActiveError, match="/leaving/get_capabilities ended before it answered"),
    ):
        client.capabilities()
    assert asked.is_set()
    executor.shutdown()
    thread.join()
    context.try_shutdown()


def test_the_document_s_snippet_runs(node):
    snippets = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.DOTALL)
    (snippet,) = [one for one in snippets if "client.predict(" in one]
    found = {}
    exec(snippet, found)  # noqa: S102
    assert found["poses"].shape == (1, 7)
