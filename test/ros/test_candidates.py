"""`~/predict_candidates`: alternatives of one scene."""

import numpy as np
from scenes import explicit, good_request, moving_object, numbers_of

from unc_physics.checks.errors import ErrorCode
from unc_physics.ros.durations import duration, seconds
from unc_physics_msgs.msg import Candidate, PredictedObject
from unc_physics_msgs.srv import PredictCandidates

HEIGHTS = (0.0, 0.05, 0.1)


def alone():
    """A request whose answer does not depend on how its steps are grouped, not even by round-off."""
    return explicit(good_request(seed=3, propagator="sigma_points", horizon=0.8))


def request_with(candidates, **others):
    request = alone()
    for name, value in others.items():
        setattr(request, name, value)
    return PredictCandidates.Request(request=request, candidates=candidates)


def candidate(name, height):
    return Candidate(id=name, objects=[moving_object("left", position=(-0.2, 0.0, height))])


def ask(client, request):
    return client.call(PredictCandidates, "/unc_physics/predict_candidates", request)


def test_each_candidate_gets_the_prediction_of_its_own_scene(node, client):
    response = ask(client, request_with([candidate(f"{h}", h) for h in HEIGHTS]))
    assert response.result.error_code == ErrorCode.NONE, response.result.error_msg
    assert [entry.candidate for entry in response.predictions] == [f"{h}" for h in HEIGHTS]
    assert response.seed == 3 and seconds(response.computation_time) > 0.0
    for entry, height in zip(response.predictions, HEIGHTS, strict=True):
        single = alone()
        single.scene.objects[0] = moving_object("left", position=(-0.2, 0.0, height))
        expected = client.predict(single)
        assert entry.result.error_code == ErrorCode.NONE
        assert not entry.score.available and entry.difference_std == 0.0
        for got, want in zip(entry.prediction.objects, expected.prediction.objects, strict=True):
            assert np.allclose(numbers_of(got.states[-1]), numbers_of(want.states[-1]), rtol=0.0, atol=1e-9)
            assert got.status == want.status != PredictedObject.STATUS_NOT_ASSESSED


def test_a_bad_candidate_leaves_the_others_intact(node, client):
    bad = candidate("bad", 0.1)
    bad.objects[0].mass = -1.0
    response = ask(client, request_with([candidate("good", 0.0), bad]))
    assert response.result.error_code == ErrorCode.NONE
    good, bad = response.predictions
    assert good.result.error_code == ErrorCode.NONE and good.prediction.objects
    assert bad.result.error_code == ErrorCode.INVALID_MASS and not bad.prediction.objects
    assert "candidates[1].objects[0].mass" in bad.result.error_msg


def test_bad_requests(node, client):
    stranger = Candidate(id="x", objects=[moving_object("stranger")])
    for request, code in (
        (request_with([]), ErrorCode.INVALID_REQUEST),
        (request_with([candidate("same", 0.0), candidate("same", 0.1)]), ErrorCode.DUPLICATE_ID),
        (request_with([stranger]), ErrorCode.INVALID_REQUEST),
        (request_with([candidate(str(k), 0.0) for k in range(101)]), ErrorCode.LIMIT_EXCEEDED),
        (request_with([candidate("a", 0.0)], propagator="none"), ErrorCode.UNKNOWN_PROPAGATOR),
    ):
        response = ask(client, request)
        assert response.result.error_code == code, response.result.error_msg
        assert not response.predictions


def test_the_computation_time_runs_out(node, client):
    request = request_with(
        [candidate(str(k), 0.0) for k in range(5)],
        propagator="monte_carlo",
        samples=20_000,
        max_computation_time=duration(0.5),
        horizon=duration(50.0),
    )
    response = ask(client, request)
    assert response.result.error_code == ErrorCode.TIMEOUT
    assert len(response.predictions) == 5
    assert seconds(response.computation_time) < 5.0
    assert {entry.result.error_code for entry in response.predictions} == {ErrorCode.TIMEOUT}
    assert all(0.0 <= seconds(entry.prediction.time_reached) < 50.0 for entry in response.predictions)
