"""The service `~/predict`, over real DDS, from another process."""

import numpy as np
import pytest
from scenes import (
    assert_answered,
    diagonal,
    explicit,
    good_request,
    moving_object,
    numbers_of,
    orientation_of,
    position_of,
    request_of,
    with_physics,
)
from shape_msgs.msg import Plane, SolidPrimitive

from unc_physics import PROPAGATORS
from unc_physics import predict as predict_in_core
from unc_physics.checks.errors import ErrorCode
from unc_physics.geometry.library import list_models
from unc_physics.prediction.status import assess
from unc_physics.propagators.base import Anytime
from unc_physics.ros.messages.fields import duration, seconds
from unc_physics.ros.messages.prediction import write_prediction
from unc_physics.ros.messages.scene import read_scene
from unc_physics.ros.models import ModelLibrary
from unc_physics.spatial.rotation import rotation_matrix
from unc_physics_msgs.msg import EnvironmentElement, ModelInfo, ObjectState, PredictedObject
from unc_physics_msgs.srv import ListModels

ROUND_OFF = 1e-9


@pytest.mark.parametrize("propagator", PROPAGATORS)
def test_every_propagator_answers_as_the_core_does(predict, propagator):
    request = explicit(good_request(propagator=propagator, seed=7, horizon=0.4))
    own = {"dt": 0.01, "stiffness": 1e5, "damping": 0.5}
    response = predict(with_physics(request, **own))
    assert_answered(response)
    answer = response.prediction
    assert (answer.propagator, answer.seed, seconds(answer.time_reached)) == (propagator, 7, 0.4)
    kind = PROPAGATORS[propagator]
    islands = kind.traits.cross_body and not issubclass(kind, Anytime)
    summary = "explicit, dt 0.01 s, stiffness 1e+05 N/m^3, damping 0.5 1/s, gyroscopic"
    assert answer.physics_summary == summary + (", islands" if islands else "")
    assert answer.header.frame_id == "world"
    assert 0.0 < seconds(answer.computation_time) < 60.0
    own |= {"gravity": (0.0, 0.0, 0.0), "integrator": "explicit", "friction": None, "restitution": None}
    own |= {"islands": islands, "gyroscopic": True}
    scene, belief, models, *_ = read_scene(request.scene, ModelLibrary(), own)
    options = {"seed": 7} if "seed" in kind.options() else {}
    if issubclass(kind, Anytime):  # how far it grew within the node's limit of time is for the clock
        options |= {"runs": answer.rollouts, "error": 0.0}
    core = predict_in_core(scene, belief, kind(**options), 0.4)
    at_origins = [one.at_model_origins(core.scene, core.propagator) for one in core.snapshots]
    expected, _ = write_prediction(scene, models, core.times, at_origins)
    assert [predicted.status for predicted in answer.objects] == [
        status.flags for status in assess(core, rollouts=0)
    ]
    for got, want in zip(answer.objects, expected, strict=True):
        assert (got.id, got.model) == (want.id, want.model)
        assert np.allclose(numbers_of(got.states[-1]), numbers_of(want.states[-1]), rtol=0.0, atol=ROUND_OFF)
    end, begin = answer.objects[0].states[-1].pose.pose, request.scene.objects[0].pose
    moved = position_of(end)[0] - begin.position.x
    assert moved > 0.05


def test_the_node_s_own_physics_is_a_robot_s_world(predict):
    response = predict(good_request())
    assert_answered(response)
    assert response.prediction.propagator == "auto"
    summary = response.prediction.physics_summary
    assert summary.startswith("implicit, dt 0.0041667 s, stiffness ")
    assert "friction 0.25 +- 0.12, restitution 0.25 +- 0.15, gyroscopic, sleep" in summary


def test_what_sleeps_is_where_it_would_be_awake(predict):
    def rests(**physics):
        can = moving_object(model="can", velocity=(0.0, 0.0, 0.0))
        can.belief.pose_covariance = diagonal(*[0.004] * 3, *[0.02] * 3)
        request = request_of(can, horizon=2.0, propagator="monte_carlo", samples=40, seed=3)
        floor = EnvironmentElement(id="floor", plane=Plane(coef=[0.0, 0.0, 1.0, 0.0]))
        request.scene.environment.elements.append(floor)
        response = predict(with_physics(request, **physics) if physics else request)
        assert_answered(response)
        return response.prediction.objects[0].states[-1].pose

    asleep, awake = rests(), rests(sleep=False)
    assert np.allclose(position_of(asleep.pose), position_of(awake.pose), rtol=0.0, atol=1e-4)
    assert np.allclose(asleep.covariance, awake.covariance, rtol=0.02, atol=1e-7)


def test_the_explicit_step_computes_what_rests(predict):
    request = with_physics(good_request(), integrator="explicit", friction=0.0, restitution=1.0)
    response = predict(request)
    assert_answered(response)
    assert not response.prediction.physics.sleep
    refused = predict(with_physics(request, sleep=True)).result
    assert refused.error_code == ErrorCode.INVALID_OPTION and "sleep" in refused.error_msg


@pytest.mark.parametrize("propagator", ["linearization", "surrogate", "local_sampling"])
def test_propagators_with_a_nominal_rollout_run_in_it(predict, propagator):
    response = predict(good_request(propagator=propagator))
    assert_answered(response)
    assert response.prediction.propagator == propagator
    assert response.prediction.physics_summary.startswith("implicit, ")


def test_a_preset_takes_the_place_of_the_node_s_physics(predict):
    response = predict(with_physics(good_request(propagator="surrogate"), preset="paper"))
    assert_answered(response)
    assert response.prediction.physics_summary == "explicit, dt 0.01 s, stiffness 1e+04 N/m^3"


def test_a_mesh_in_millimetres_is_flagged(predict):
    box = moving_object("box", "", (0.0, 0.0, 500.0), (0.0, 0.0, 0.0), spheres=20)
    box.primitive, box.mass = SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[100.0] * 3), 0.5
    (flagged,) = predict(request_of(box)).prediction.objects
    assert flagged.status & PredictedObject.STATUS_OUTSIDE_VALIDITY
    assert (
        "mass that does not fit its size, 0.5 kg and 1e+06 m^3; is its mesh in millimetres"
        in flagged.status_msg
    )
    box.scale, box.pose.position.z = 1e-3, 0.0
    (fine,) = predict(request_of(box)).prediction.objects
    assert "fit its size" not in fine.status_msg


def test_a_trajectory(predict):
    request = explicit(good_request(trajectory_period=0.06, propagator="linearization"))
    request.scene.header.stamp.sec = 123
    response = predict(with_physics(request, dt=0.005))
    assert_answered(response)
    for predicted in response.prediction.objects:
        times = [seconds(state.time_from_start) for state in predicted.states]
        assert np.allclose(times, [0.06, 0.12, 0.18, 0.2])
    assert response.prediction.header.stamp.sec == 123


def test_samples_of_a_gaussian_are_drawn_from_it(predict):
    response = predict(explicit(good_request(propagator="linearization", seed=5, return_samples=1000)))
    assert_answered(response)
    for predicted in response.prediction.objects:
        (state,) = predicted.states
        positions = np.array([position_of(pose) for pose in state.pose_samples])
        P = np.reshape(state.pose.covariance, (6, 6))
        standard_error = np.sqrt(np.diag(P)[:3] / 1000)
        assert np.all(
            np.abs(positions.mean(axis=0) - position_of(state.pose.pose)) < 5.0 * standard_error + 1e-3
        )
        assert np.allclose(np.var(positions, axis=0), np.diag(P)[:3], rtol=0.25)
        assert all(abs(np.linalg.norm(orientation_of(pose)) - 1.0) < 1e-9 for pose in state.pose_samples)


def test_the_computation_time_runs_out(predict):
    request = good_request(propagator="monte_carlo", samples=2000, horizon=50.0, max_computation_time=3.0)
    response = predict(request)
    assert response.result.error_code == ErrorCode.TIMEOUT
    assert "max_computation_time" in response.result.error_msg
    reached = seconds(response.prediction.time_reached)
    assert 0.0 < reached < 50.0
    for predicted in response.prediction.objects:
        assert seconds(predicted.states[-1].time_from_start) == pytest.approx(reached)
        assert np.isfinite(numbers_of(predicted.states[-1])).all()


def test_the_shipped_models_are_all_ready(node, client):
    response = client.call(ListModels, "/unc_physics/list_models", ListModels.Request())
    found = {model.name: model for model in response.models}  # other tests may have loaded more
    assert set(list_models()) <= set(found) and list(found) == sorted(found)
    assert all(found[name].status == ModelInfo.STATUS_READY for name in list_models())


def test_a_scaled_model_s_origin(predict):
    message = moving_object(velocity=(0.0, 0.0, 0.0))
    message.scale, message.belief.pose_covariance = 2.0, np.zeros(36)
    message.twist.angular.z = 1.0
    request = request_of(message, horizon=1.0)
    with_physics(request, gyroscopic=False)  # turns about an axis that is not principal
    (predicted,) = predict(request).prediction.objects
    core, *_ = read_scene(request.scene, ModelLibrary(), {})
    r = core.bodies[0].model.origin.copy()
    com_velocity = -np.cross([0.0, 0.0, 1.0], r)  # the origin is at rest at first
    turned = rotation_matrix(np.array([0.0, 0.0, np.sin(0.5), np.cos(0.5)])) @ r
    expected = position_of(message.pose) - r + com_velocity + turned
    assert np.allclose(position_of(predicted.states[-1].pose.pose), expected, atol=1e-9)


def test_statuses_name_an_overlap_at_the_start_and_are_fine_without(predict):
    overlapping = with_physics(
        explicit(good_request(propagator="surrogate", trajectory_period=0.01)), dt=0.005
    )
    overlapping.scene.objects[1].pose.position.x = -0.15
    apart = with_physics(explicit(good_request(propagator="surrogate", trajectory_period=0.01)), dt=0.005)
    bad, good = predict(overlapping), predict(apart)
    for response in (bad, good):
        assert_answered(response)
        assert all(
            len(predicted.states) == 20 for predicted in response.prediction.objects
        )  # more than are judged one by one
    for predicted in bad.prediction.objects:
        assert predicted.status & PredictedObject.STATUS_INITIAL_OVERLAP
        assert "overlap" in predicted.status_msg
        assert float({pair.key: pair.value for pair in predicted.status_values}["initial_overlap"]) > 0.02
        assert all(state.status & PredictedObject.STATUS_INITIAL_OVERLAP for state in predicted.states)
    for predicted in good.prediction.objects:
        assert (predicted.status, predicted.status_msg) == (PredictedObject.STATUS_FINE, "")
        assert predicted.status_values
        assert all(state.status == PredictedObject.STATUS_FINE for state in predicted.states)


def test_a_scene_in_which_nothing_moves(predict):
    request = good_request(return_joint_covariance=True, return_probabilities=True, return_samples=2)
    for message in request.scene.objects:
        message.kind = ObjectState.FIXED
    response = predict(request)
    assert_answered(response)
    for predicted, sent in zip(response.prediction.objects, request.scene.objects, strict=True):
        assert np.allclose(position_of(predicted.states[-1].pose.pose), position_of(sent.pose))
        assert not np.any(predicted.states[-1].pose.covariance)


def test_an_object_at_rest_stands_where_it_is_put(predict):
    standing = moving_object(
        "standing", "brick", (0.0, 0.0, 0.001), (0.0, 0.0, 0.0), 60
    )  # its origin is its underside
    request = request_of(standing, horizon=0.5)
    with_physics(request, gravity=None)  # the node's
    table = EnvironmentElement(plane=Plane(coef=[0.0, 0.0, 1.0, 0.0]))
    request.scene.environment.elements.append(table)
    request.scene.objects[0].at_rest = True
    request.scene.objects[0].belief.pose_covariance = diagonal(0.02, 0.02, 0.005, 0.03, 0.03, 0.05)
    response = predict(request)
    assert_answered(response)
    (standing,) = response.prediction.objects
    assert standing.start.covariance[14] < 1e-6 < standing.start.covariance[0]
    assert np.allclose(
        position_of(standing.states[-1].pose.pose), position_of(standing.start.pose), atol=1e-3
    )
    assert np.allclose(standing.states[-1].pose.covariance, standing.start.covariance, atol=1e-4)
    assert standing.overlap_share > 0.0 == standing.overlap_kept
    values = {pair.key: float(pair.value) for pair in standing.status_values}
    assert values["overlap_share"] == pytest.approx(standing.overlap_share, rel=1e-4)


def test_a_budget_of_time_that_not_even_the_fewest_rollouts_keep(predict):
    request = good_request(horizon=60.0)
    request.time_budget = duration(0.05)
    request.scene.environment.elements = [EnvironmentElement(plane=Plane(coef=[0.0, 0.0, 1.0, 0.5]))]
    response = predict(with_physics(request, gravity=(0.0, 0.0, -9.81), sleep=False))
    assert response.result.error_code == ErrorCode.TIMEOUT
    assert "time_budget" in response.result.error_msg and "0.05" in response.result.error_msg
    for predicted in response.prediction.objects:
        assert 0.0 < seconds(predicted.states[-1].time_from_start) < 60.0
