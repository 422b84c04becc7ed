"""The client over real DDS: what the library answers, from a node."""

import dataclasses
import re
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy.client
from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor
from running import wait_until

from unc_physics import (
    PROPAGATORS,
    AtRest,
    Belief,
    Box,
    BoxRegion,
    Capsule,
    Cylinder,
    FellOff,
    InRegion,
    Plane,
    RigidBody,
    Scene,
    Sphere,
    Touches,
    Upright,
    assess,
    encounters,
    load_model,
    make_propagator,
    predict,
    save_packing,
)
from unc_physics.checks.errors import (
    CanceledError,
    DuplicateIdError,
    InvalidModelError,
    InvalidRequestError,
    LimitExceededError,
    NotActiveError,
    NotSupportedError,
    PredictionTimeoutError,
    UnknownModelError,
)
from unc_physics.ros import Client
from unc_physics.ros.connection import spin
from unc_physics.ros.messages.prediction import read_answer
from unc_physics_msgs.msg import Mode as ModeMessage
from unc_physics_msgs.msg import ModelInfo
from unc_physics_msgs.srv import ListModels

ROUND_OFF = 1e-9  # of the way to the models' origins and back, grown by contacts
READY = 100.0  # s
REGION = BoxRegion("front", (0.5, 0.3, 0.4), (0.1, 0.0, 0.1), (0.0, 0.0, 0.6, 0.8))
DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "tutorials" / "ros.md"


@pytest.fixture(scope="module")
def asked(node):
    """A client of the shared node."""
    with Client(timeout=READY) as made:
        yield made


def uncertain(scene, places, velocities, seed=1, size=0.02):
    """A belief with all correlations between the errors of a body, about tilted poses."""
    rng = np.random.default_rng(seed)
    mean = np.zeros((len(scene.bodies), 13))
    mean[:, :3], mean[:, 3:6] = places, velocities
    mean[:, 6:10] = rng.normal(size=(len(mean), 4))
    mean[:, 6:10] /= np.linalg.norm(mean[:, 6:10], axis=1)[:, None]
    mean[scene.moving, 10:] = rng.normal(size=(len(scene.moving), 3))
    roots = size * rng.normal(size=(len(scene.moving), 12, 12)) / np.sqrt(12.0)
    return Belief(mean, roots @ roots.transpose(0, 2, 1), scene.moving)


def in_space():
    """Two bodies that meet, one of a scaled model, as the paper has it."""
    bodies = [
        RigidBody("left", load_model("bunny").prefix(40), 1.0),
        RigidBody("right", load_model("mug").prefix(30).scaled(1.3), 0.5),
    ]
    scene = Scene(bodies, stiffness=1e5, damping=0.2)
    return scene, uncertain(scene, [(-0.15, 0, 0), (0.15, 0, 0.01)], [(0.5, 0, 0), (-0.5, 0, 0)])


def on_table():
    """Everyday physics, with everything that a message has a field for."""
    bodies = [
        RigidBody("box", load_model("salt_box").prefix(60), friction=0.4, friction_std=0.05, mass_std=0.01),
        RigidBody("mug", load_model("mug").prefix(60), 0.3, center_of_mass_std=0.001, restitution=0.3),
        RigidBody("brick", load_model("brick").prefix(60), fixed=True),
    ]
    environment = [
        Plane((0.0, 0.1, 1.0), -0.3, friction=0.3),
        Box((1.0, 1.0, 0.1), (0.0, 0.0, -0.05), (0.0, 0.0, 0.6, 0.8), name="table", restitution=0.2),
        Sphere(0.05, (0.1, 0.1, 0.05)),
        Cylinder(0.04, 0.2, (-0.2, 0.0, 0.1), (0.6, 0.0, 0.0, 0.8)),
    ]
    scene = Scene.everyday(
        bodies, exact=True, environment=environment, gravity_direction_std=0.01, friction_std=0.05
    )
    places = [(0.0, 0.0, 0.2), (0.05, 0.0, 0.4), (0.4, 0.0, 0.03)]
    return scene, uncertain(scene, places, [(0.2, 0, 0), (0, 0, 0), (0, 0, 0)])


@pytest.fixture(scope="module")
def space():
    return in_space()


@pytest.fixture(scope="module")
def table():
    return on_table()


def assert_same(found, expected, tolerance=ROUND_OFF):
    """Both tell the same, whoever computed it."""
    assert found.times == expected.times
    assert found.seed == expected.seed and found.propagator == expected.propagator
    assert found.scene.stiffness == pytest.approx(expected.scene.stiffness, rel=ROUND_OFF)
    for one, other in zip(found.beliefs, expected.beliefs, strict=True):
        np.testing.assert_array_equal(one.moving, other.moving)
        np.testing.assert_allclose(one.mean, other.mean, rtol=0.0, atol=tolerance)
        np.testing.assert_allclose(one.covariance, other.covariance, rtol=0.0, atol=tolerance)
    np.testing.assert_allclose(found.start.mean, expected.start.mean, rtol=0.0, atol=ROUND_OFF)


@pytest.mark.parametrize("name", PROPAGATORS)
def test_a_node_answers_what_the_library_does(asked, space, name):
    scene, belief = space
    known = PROPAGATORS[name].options()
    options = {key: value for key, value in (("samples", 30), ("seed", 7)) if key in known}
    found = asked.predict(scene, belief, name, 0.4, times=[0.1, 0.25], samples=30, seed=7)
    expected = predict(scene, belief, make_propagator(name, **options), 0.4, times=[0.1, 0.25])
    assert np.linalg.norm(expected["left"].linear_velocity - belief.mean[0, 3:6]) > 0.01, "they must touch"
    # which direction comes first, among equal ones, round-off decides, and points follow
    assert_same(found, expected, 2e-3 if name in ("cloud", "auto") else ROUND_OFF)
    assert [status.body for status in assess(found)] == ["left", "right"]


@pytest.mark.parametrize("common", [False, True], ids=["independent", "joint"])
@pytest.mark.parametrize("name", ["sigma_points", "monte_carlo"])
def test_everything_of_an_everyday_scene_arrives(asked, table, name, common):
    scene, belief = table
    if common:
        belief = belief.with_common_pose_std([0.01] * 3 + [0.02] * 3, origin=(1.0, 0.0, 0.5))
    sampled = "samples" in PROPAGATORS[name].options()
    propagator = make_propagator(name, samples=300, seed=3) if sampled else make_propagator(name)
    keep = 20 if sampled else 0
    names = ("box", "mug", "brick")
    events = [kind(name) for kind in (AtRest, Upright, FellOff) for name in names] + encounters(scene)
    events += [InRegion(name, REGION) for name in names]
    wishes: Any = {"events": events, "modes": True}
    found = asked.predict(scene, belief, propagator, 0.3, times=[0.2], keep_samples=keep, **wishes)
    expected = predict(scene, belief, propagator, 0.3, times=[0.2], events=events)
    assert_same(found, expected)
    assert_same_answers(found, expected, events)
    judged = assess(expected, rollouts=0)  # the node's default
    assert any(status.notes for status in judged), "60 spheres are few"
    assert [status.flags for status in assess(found)] == [status.flags for status in judged]
    for one, other in zip(assess(found), judged, strict=True):
        assert (one.reasons, one.notes) == (other.reasons, other.notes)
        assert one.measures == pytest.approx(other.measures, rel=1e-4, abs=1e-5), "six digits are told"
    if sampled:
        poses = [*range(3), *range(6, 10)]
        for time in found.times:
            one, other = found.samples(time=time), expected.samples(20, time=time)
            np.testing.assert_allclose(one[..., poses], other[..., poses], rtol=0.0, atol=ROUND_OFF)
        assert np.isnan(found.samples()[:, 0, 3:6]).all()


def assert_same_answers(found, expected, events):
    """All that can be asked by name."""
    for event in events:
        one, other = found.probability(event), expected.probability(event)
        assert (one.estimate, one.low, one.high) == pytest.approx((other.estimate, other.low, other.high))
        assert one.method == ("certain" if event.names == {"brick"} else "node")
        if isinstance(event, Touches):
            assert found.contact_time(event) == pytest.approx(expected.contact_time(event), abs=1e-8)
    for body in ("box", "mug", "brick"):
        one, other = found[body], expected[body]
        np.testing.assert_allclose(one.covariance(), other.covariance(), rtol=0.0, atol=ROUND_OFF)
        assert [mode.weight for mode in one.modes] == [mode.weight for mode in other.modes]
        np.testing.assert_allclose(one.modes[0].mean, other.modes[0].mean, rtol=0.0, atol=ROUND_OFF)
    one, other = (p.trajectory("mug", origin="model") for p in (found, expected))
    np.testing.assert_allclose(one.positions, other.positions, rtol=0.0, atol=ROUND_OFF)


def test_where_it_began_is_told(asked):
    bodies = [RigidBody("box", load_model("salt_box").prefix(60), at_rest=True)]
    scene = Scene.everyday(bodies, exact=True, environment=[Plane()])
    belief = uncertain(scene, [(0.0, 0.0, 0.06)], [(0.0, 0.0, 0.0)], size=0.002)
    mean = belief.mean.copy()
    mean[:, 6:10], mean[:, 10:] = (0.0, 0.0, 0.0, 1.0), 0.0
    belief = Belief(mean, belief.covariance)
    found, expected = (of(scene, belief, "sigma_points", 0.1) for of in (asked.predict, predict))
    assert_same(found, expected)
    assert not np.allclose(found.start.mean, belief.mean, atol=1e-6)
    for place in (slice(0, 3), slice(6, 9)):
        one, other = (p.start.blocks[0][place, place] for p in (found, expected))
        np.testing.assert_allclose(one, other, rtol=0.0, atol=ROUND_OFF)


def test_outcomes_that_split_are_told_by_their_poses(asked, space, monkeypatch):
    def read(result, message, question):
        state = message.objects[0].states[-1]  # as a node may say:
        state.modes = [ModeMessage(weight=weight, pose=state.pose) for weight in (0.75, 0.25)]
        return read_answer(result, message, question)

    monkeypatch.setattr("unc_physics.ros.client.read_answer", read)
    found = asked.predict(*space, "surrogate", 0.1, modes=True)
    first, second = found["left"].modes
    assert (first.weight, second.weight) == (0.75, 0.25)
    # a mode of several is a Gaussian at the model's origin, which is mapped back as one
    np.testing.assert_allclose(first.mean[:3], found["left"].position, rtol=0.0, atol=1e-4)
    np.testing.assert_allclose(first.mean[6:10], found["left"].orientation, rtol=0.0, atol=ROUND_OFF)
    poses = np.ix_([0, 1, 2, 6, 7, 8], [0, 1, 2, 6, 7, 8])
    known = found.belief.marginal(0)[poses]
    np.testing.assert_allclose(first.covariance[poses], known, rtol=0.0, atol=1e-5)
    assert np.isnan(first.mean[3:6]).all() and np.isnan(first.covariance[3, 0])


def test_a_covariance_of_each_body_instead_of_all_together(asked, space):
    scene, belief = space
    whole, parts = (
        asked.predict(scene, belief, "sigma_points", 0.2, joint_covariance=joint) for joint in (None, False)
    )
    assert parts.belief.independent and not whole.belief.independent
    np.testing.assert_allclose(parts.belief.blocks, whole.belief.blocks, rtol=0.0, atol=ROUND_OFF)


@pytest.mark.parametrize(
    ("question", "argument"),
    [
        (lambda p: p.probability(Touches("left", "right")), "among its events"),
        (lambda p: p.contact_time(Touches("left", "right")), "among its events"),
        (lambda p: p.probability(AtRest("left")), "among its events"),
        (lambda p: p["left"].modes, "modes=True"),
        (lambda p: p.probability(InRegion("left", REGION)), "among its events"),
        (lambda p: p.samples(3), "keep_samples"),
    ],
)
def test_what_was_not_asked_for_says_how_to(asked, space, question, argument):
    prediction = asked.predict(*space, "surrogate", 0.02)
    with pytest.raises(NotSupportedError, match=argument):
        question(prediction)


def test_another_region_of_the_same_name_was_not_asked_for(asked, space):
    prediction = asked.predict(*space, "surrogate", 0.02, events=[InRegion("left", REGION)])
    assert prediction.probability(InRegion("left", dataclasses.replace(REGION))).method == "node"
    other = InRegion("left", dataclasses.replace(REGION, size=(1.0, 1.0, 1.0)))
    with pytest.raises(NotSupportedError, match="among its events"):
        prediction.probability(other)
    with pytest.raises(DuplicateIdError, match="two regions"):
        asked.predict(*space, "surrogate", 0.02, events=[InRegion("left", REGION), other])


@pytest.mark.parametrize("event", [AtRest("left", speed=1.0), AtRest("left") & AtRest("right")])
def test_events_without_a_message_are_refused(asked, space, event):
    with pytest.raises(NotSupportedError, match="not combined|is fixed at the node"):
        asked.predict(*space, "surrogate", 0.02, events=[event])


def test_the_node_chooses_a_seed_and_tells_it(asked, space):
    first, second = (asked.predict(*space, "monte_carlo", 0.1, samples=20) for _ in range(2))
    assert first.seed != second.seed
    assert_same(asked.predict(*space, "monte_carlo", 0.1, samples=20, seed=first.seed), first)


def test_candidates_share_their_draws(asked, space):
    scene, belief = space
    moved = belief.mean.copy()
    moved[1, 0] += 5.0
    candidates = {"near": belief, "far": Belief(moved, belief.covariance)}
    found = asked.predict_candidates(scene, candidates, "monte_carlo", 0.2, samples=30, seed=4)
    assert list(found) == ["near", "far"]
    propagator = make_propagator("monte_carlo", samples=30, seed=4)
    for name, prediction in found.items():
        assert_same(prediction, predict(scene, candidates[name], propagator, 0.2))
    with pytest.raises(NotSupportedError, match="for each body"):
        asked.predict_candidates(scene, {"joint": belief.with_common_pose_std([0.1] * 6)}, "monte_carlo", 0.2)
    with pytest.raises(PredictionTimeoutError, match="in candidate 'near'"):
        asked.predict_candidates(scene, candidates, "monte_carlo", 30.0, max_computation_time=0.05)


def test_several_futures_at_a_time(asked, space):
    futures = [asked.predict_async(*space, "surrogate", horizon) for horizon in (0.1, 0.2, 0.3)]
    assert [future.result(READY).time for future in futures] == pytest.approx([0.1, 0.2, 0.3])
    with pytest.raises(LimitExceededError, match="horizon"):
        asked.predict_async(*space, "surrogate", 1e4).result(READY)


def test_out_of_time_with_what_was_done(asked, space):
    for limit in (0.2, 2.0, 20.0):  # on a busy machine even the first step takes a while
        with pytest.raises(PredictionTimeoutError, match="max_computation_time ran out") as caught:
            asked.predict(*space, "monte_carlo", 50.0, samples=2000, max_computation_time=limit)
        if caught.value.prediction is not None:
            break
    assert 0.0 < caught.value.prediction.time < 50.0
    assert np.isfinite(caught.value.prediction["left"].position).all()


def test_a_long_prediction_tells_its_progress(asked, space):
    told = []
    found = asked.predict_long(
        *space, "monte_carlo", 20.0, samples=500, seed=1, progress=lambda *steps: told.append(steps)
    )
    assert found.time == pytest.approx(20.0)
    assert told and all(done <= steps == 2000 for done, steps in told) and told == sorted(told)


class Stop(CanceledError):
    """Of whoever looks at the progress."""


def test_what_progress_raises_ends_a_long_prediction(asked, space):
    def stop(done, steps):
        if done > 0:
            raise Stop("have seen enough", field="I")

    with pytest.raises(Stop) as caught:
        asked.predict_long(*space, "monte_carlo", 59.0, samples=20_000, progress=stop)
    assert 0.0 < caught.value.prediction.time < 59.0


def test_a_long_prediction_is_canceled_from_elsewhere(asked, space):
    cancel, begun = threading.Event(), threading.Event()
    future = asked.predict_long_async(
        *space,
        "monte_carlo",
        59.0,
        samples=20_000,
        cancel=cancel,
        progress=lambda done, _: done > 0 and begun.set(),
    )
    assert begun.wait(READY) and not future.done()
    cancel.set()
    with pytest.raises(CanceledError) as caught:
        future.result(READY)
    assert 0.0 < caught.value.prediction.time < 59.0


def test_models_are_compared(asked, space, tmp_path):
    scene, belief = space
    bunny = scene.bodies[0].model

    def with_model(model):
        return dataclasses.replace(scene, bodies=[RigidBody("left", model, 1.0), scene.bodies[1]])

    def asks(model):
        return asked.predict(with_model(model), belief, "surrogate", 0.1)

    with pytest.raises(UnknownModelError, match="load_model"):
        asks(dataclasses.replace(bunny, name="hare"))
    with pytest.raises(InvalidModelError, match="inertia"):
        asks(dataclasses.replace(bunny, inertia=1.001 * bunny.inertia))
    with pytest.raises(InvalidModelError, match="origin"):
        asks(dataclasses.replace(bunny, origin=bunny.origin + 1e-6))
    hare = dataclasses.replace(bunny, name="hare", origin=bunny.origin + 0.01)
    save_packing(tmp_path / "hare.npz", hare)
    info = asked.load_model(tmp_path / "hare.npz")
    assert (info.name, info.status, info.spheres) == ("hare", ModelInfo.STATUS_READY, 40)
    assert "hare" in asked.models()
    assert_same(asks(hare), predict(with_model(hare), belief, "surrogate", 0.1))
    with pytest.raises(InvalidModelError, match="number of spheres"):
        asks(dataclasses.replace(load_model("bunny").prefix(41), name="hare", origin=hare.origin))
    with pytest.raises(InvalidRequestError, match="is no file"):
        asked.load_model(tmp_path / "nothing.npz")


def test_what_messages_have_no_room_for(asked, space):
    scene, belief = space
    rail = dataclasses.replace(scene, environment=[Capsule(0.1, 1.0, name="rail")])
    with pytest.raises(NotSupportedError, match="cylinder"):
        asked.predict(rail, belief, "surrogate", 0.1)


def test_arguments_are_checked_before_anything_is_sent(asked, space, table):
    with pytest.raises(NotSupportedError, match="gravity_direction_std is not supported by surrogate"):
        asked.predict(*table, "surrogate", 0.1)
    with pytest.raises(LimitExceededError, match="seed must be below 2.64"):
        asked.predict(*space, "monte_carlo", 0.1, seed=2**64)
    with pytest.raises(InvalidRequestError, match="belief"):
        asked.predict(table[0], space[1], "sigma_points", 0.1)


def test_a_node_that_does_not_track_is_named_at_once(asked):
    for name, ask in (("fork", lambda: asked.fork(0.5)), ("reset", asked.reset)):
        with pytest.raises(
            NotActiveError, match=f"/{name} is not offered, as the node does not track.*track:=true"
        ):
            ask()


def test_a_node_that_does_not_answer_is_named(space):
    with Client(server="/nobody", timeout=0.2) as client:
        with pytest.raises(NotActiveError, match="/nobody/list_models is not offered.*start one"):
            client.predict(*space, "surrogate", 0.1)
        with pytest.raises(NotActiveError, match="start one"):
            client.predict_async(*space, "surrogate", 0.1).result(READY)
    with pytest.raises(NotActiveError, match="closed"):
        client.models()
    client.close()  # once more does nothing


def test_a_node_that_goes_away_is_waited_for_no_longer(monkeypatch):
    context = rclpy.Context()
    rclpy.init(context=context)
    leaving = rclpy.create_node("leaving", context=context)  # which nobody spins
    leaving.create_service(ListModels, "~/list_models", lambda _, response: response)
    staying = rclpy.create_node("staying", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(staying)
    spinning = threading.Thread(target=executor.spin)
    spinning.start()
    with Client(staying, server="/leaving", timeout=READY) as client:
        offered = staying.create_client(ListModels, "/leaving/list_models")
        assert offered.wait_for_service(READY)  # discovery may take seconds
        call = rclpy.client.Client.call_async

        def ask_and_leave(self, request):
            asked = call(self, request)
            leaving.destroy_node()
            return asked

        monkeypatch.setattr(rclpy.client.Client, "call_async", ask_and_leave)
        with pytest.raises(NotActiveError, match="/leaving/list_models went away"):
            client.models()
    executor.shutdown()
    context.try_shutdown()
    spinning.join()


def test_closing_a_client_ends_what_it_waits_for(asked, space):
    for _ in range(2):  # as many as the node computes at a time
        with Client(timeout=READY) as client:
            begun = threading.Event()
            future = client.predict_long_async(
                *space, "monte_carlo", 59.0, samples=20_000, progress=lambda *_, begun=begun: begun.set()
            )
            assert begun.wait(READY)
        with pytest.raises(NotActiveError, match="closed"):
            future.result(0.0)

    def takes_another():
        try:
            return asked.predict_long(*space, "surrogate", 0.1)
        except LimitExceededError:
            return None

    wait_until(takes_another)


def test_what_other_threads_destroy_does_not_end_the_thread_that_spins():
    class Late(SingleThreadedExecutor):
        """Finds at first what was destroyed since it looked, as rclpy's does now and then."""

        found = False

        def spin_once(self, timeout_sec=None):
            if not self.found:
                self.found = True
                raise InvalidHandle("destruction was requested")
            super().spin_once(timeout_sec)

    context = rclpy.Context()
    rclpy.init(context=context)
    executor = Late(context=context)
    thread = threading.Thread(target=spin, args=[executor], daemon=True)
    thread.start()
    wait_until(executor.create_task(lambda: True).done)
    assert executor.found
    executor.shutdown()
    context.try_shutdown()
    thread.join(5.0)
    assert not thread.is_alive()


def test_a_node_of_one_s_own(node, space):
    context = rclpy.Context()
    rclpy.init(context=context)
    own = rclpy.create_node("own", context=context)
    with Client(own, timeout=READY) as client:
        with pytest.raises(InvalidRequestError, match="spins in another thread"):
            client.models()
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(own)
        thread = threading.Thread(target=executor.spin)
        thread.start()
        assert client.predict(*space, "surrogate", 0.1).time == pytest.approx(0.1)
        assert client.predict_long(*space, "surrogate", 0.1).time == pytest.approx(0.1)
    executor.shutdown()
    thread.join(READY)
    assert context.ok()
    own.destroy_node()
    context.try_shutdown()


def test_the_document_s_snippet_runs(node):
    snippets = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.DOTALL)
    (snippet,) = [one for one in snippets if "client.predict(" in one]
    found = {}
    exec(snippet, found)  # noqa: S102
    assert found["prediction"]["mug"].position.shape == (3,)
