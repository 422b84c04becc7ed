"""The service `~/predict`, over real DDS, from another process."""

import numpy as np
from scenes import (
    assert_answered,
    assert_same,
    explicit,
    floor,
    good_request,
    moving_object,
    position_of,
    request_of,
    with_physics,
)

from unc_physics.checks.errors import ErrorCode
from unc_physics.ros.messages.fields import duration, seconds
from unc_physics_msgs.msg import ObjectState


def test_the_node_s_own_physics_is_a_robot_s_world(predict):
    response = predict(with_physics(good_request(), gravity=None))
    assert_answered(response)
    assert response.prediction.propagator == "auto"
    assert response.prediction.physics_summary == (
        "implicit, dt 0.0041667 s, gravity (0, 0, -9.81) m/s^2, friction 0.25 +- 0.12, "
        "restitution 0.25 +- 0.15, rolling friction 0.1 mm, gyroscopic, sleep"
    )


def test_the_explicit_step_computes_what_rests(predict):
    request = with_physics(good_request(), integrator="explicit", friction=0.0, restitution=1.0)
    response = predict(request)
    assert_answered(response)
    assert not response.prediction.physics.sleep
    refused = predict(with_physics(request, sleep=True)).result
    assert refused.error_code == ErrorCode.INVALID_OPTION and "sleep" in refused.error_msg


def test_the_step_over_exact_shapes_is_served(predict):
    cans = [moving_object(f"can{k}", "can", (0.0, 0.0, 0.2 + 0.2 * k), spheres=0) for k in range(2)]
    # not by `auto`, whose number of rollouts depends on the clock
    request = request_of(*cans, return_probabilities=True, seed=3, propagator="cloud")
    request.scene.environment.elements = [floor()]
    request = with_physics(request, gravity=(0.0, 0.0, -9.81))
    response = predict(request)
    assert_answered(response)
    assert response.prediction.physics.integrator == "implicit"
    again = with_physics(request)
    again.physics = response.prediction.physics  # may be sent back as it is
    assert_same(predict(again), response)


def test_a_trajectory(predict):
    request = explicit(good_request(trajectory_period=0.06, propagator="linearization"))
    request.scene.header.stamp.sec = 123
    response = predict(with_physics(request, dt=0.005))
    assert_answered(response)
    for predicted in response.prediction.objects:
        times = [seconds(state.time_from_start) for state in predicted.states]
        assert np.allclose(times, [0.06, 0.12, 0.18, 0.2])
    assert response.prediction.header.stamp.sec == 123


def test_a_scene_in_which_nothing_moves(predict):
    request = good_request(return_joint_covariance=True, return_probabilities=True, return_samples=2)
    for message in request.scene.objects:
        message.kind = ObjectState.FIXED
    response = predict(request)
    assert_answered(response)
    for predicted, sent in zip(response.prediction.objects, request.scene.objects, strict=True):
        assert np.allclose(position_of(predicted.states[-1].pose.pose), position_of(sent.pose))
        assert not np.any(predicted.states[-1].pose.covariance)


def test_a_budget_of_time_that_not_even_the_fewest_rollouts_keep(predict):
    request = good_request(horizon=60.0)
    request.time_budget = duration(0.05)
    request.scene.environment.elements = [floor(-0.5)]
    response = predict(with_physics(request, gravity=(0.0, 0.0, -9.81), sleep=False))
    assert response.result.error_code == ErrorCode.TIMEOUT
    assert "time_budget" in response.result.error_msg and "0.05" in response.result.error_msg
    for predicted in response.prediction.objects:
        assert 0.0 < seconds(predicted.states[-1].time_from_start) < 60.0
