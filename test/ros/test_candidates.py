"""`~/predict_candidates`: alternatives of one scene."""

import contextlib
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Vector3, Wrench
from scenes import good_request, moving_object, numbers_of, request_of, with_physics
from shape_msgs.msg import Plane as PlaneMessage
from shape_msgs.msg import SolidPrimitive

from unc_physics.checks.errors import ErrorCode, PredictionTimeoutError, UncPhysicsError
from unc_physics.prediction.rank import rank_candidates
from unc_physics.ros import candidates as node_candidates
from unc_physics.ros.messages.fields import duration, seconds, write_error
from unc_physics.ros.messages.frames import Frames
from unc_physics.ros.messages.request import read_request
from unc_physics.ros.models import ModelLibrary
from unc_physics.ros.parameters import Settings
from unc_physics_msgs.msg import (
    Action,
    BoxRegion,
    Candidate,
    CandidatePrediction,
    EnvironmentElement,
    Event,
    ObjectState,
    Result,
)
from unc_physics_msgs.srv import PredictCandidates


def ask(client, request):
    return client.call(PredictCandidates, "/unc_physics/predict_candidates", request)


def held_until(seconds, holder="right"):
    return Action(type=Action.ATTACHMENT, object="left", attached_to=holder, duration=duration(seconds))


def test_actions_of_a_candidate_replace_those_on_the_same_object(node, client):
    """Releases at other times; an object that a candidate replaces has no action but the candidate's."""
    request = request_of(*good_request().scene.objects, horizon=0.4, seed=3, propagator="sigma_points")
    request.scene.objects[1].kind = ObjectState.FIXED
    push = Action(type=Action.WRENCH, object="left", wrench=Wrench(force=Vector3(y=2.0)))
    request.actions = [held_until(0.3), push]
    late, alone = held_until(0.2), request.scene.objects[0]
    candidates = [
        Candidate(id="as the request"),
        Candidate(id="late", actions=[late]),
        Candidate(id="free", objects=[alone]),
        Candidate(id="bad", actions=[held_until(0.1, holder="nobody")]),
    ]
    response = ask(client, PredictCandidates.Request(request=request, candidates=candidates))
    assert response.result.error_code == ErrorCode.NONE, response.result.error_msg
    bad = response.predictions.pop()
    assert bad.result.error_msg.startswith("candidates[3].actions[0].attached_to is no body")
    for entry, actions in zip(response.predictions, (request.actions, [late], []), strict=True):
        request.actions = actions
        expected = client.predict(request)
        for got, want in zip(entry.prediction.objects, expected.prediction.objects, strict=True):
            assert np.allclose(numbers_of(got.states[-1]), numbers_of(want.states[-1]), rtol=0.0, atol=1e-9)
    ends = [entry.prediction.objects[0].states[-1].pose.pose.position for entry in response.predictions]
    assert ends[0].y > 1e-3 > abs(ends[1].y) and ends[2].x > ends[1].x + 0.01


@pytest.mark.parametrize("scores", [0, 1])
def test_bad_candidates_leave_the_others_intact(node, client, scores):
    heavy = over("heavy", 0.1)
    heavy.objects[0].mass = -1.0
    typo = Candidate(id="typo", objects=[moving_object("bx", "salt_box")])
    response = ask(client, ranked([ABOVE] * scores, [over("good", 0.0), heavy, typo]))
    assert response.result.error_code == ErrorCode.NONE, response.result.error_msg
    good, heavy, typo = response.predictions
    assert good.result.error_code == ErrorCode.NONE and good.prediction.objects
    assert (good.score_high > 0.0) == bool(scores)
    assert (heavy.candidate, heavy.result.error_code) == ("heavy", ErrorCode.INVALID_MASS)
    assert "candidates[1].objects[0].mass" in heavy.result.error_msg and not heavy.prediction.objects
    assert (typo.candidate, typo.result.error_code) == ("typo", ErrorCode.INVALID_REQUEST)
    assert typo.result.error_msg.startswith("candidates[2].objects[0].id is no object of the scene; did you")


@pytest.mark.parametrize("rounds", [0, 1])
def test_a_ranking_that_is_ended_holds_what_was_ranked(monkeypatch, rounds):
    """In this process, where it can be ended for certain, before and after the first round."""
    request = ranked([ABOVE], candidates=[over("beside", 0.4), over("bad", 0.0), over("over", 0.0)])
    request.candidates[1].objects[0].mass = -1.0

    def next_round_ends(*arguments, **options):
        error = PredictionTimeoutError("ran out", field="max_computation_time", value=0.3)
        error.prediction = rank_candidates(*arguments, **options) if rounds else None
        raise error

    monkeypatch.setattr(node_candidates, "rank_candidates", next_round_ends)
    settings, library = Settings(zero_covariance="exact"), ModelLibrary()
    server = SimpleNamespace(
        settings=settings,
        read=lambda request, fields=None: read_request(request, settings, library, Frames(), fields=fields),
        diagnostics=SimpleNamespace(predicted=lambda prediction: None),
        check_open=lambda: None,
    )

    @contextlib.contextmanager
    def errors_into(result):
        try:
            yield
        except UncPhysicsError as error:
            write_error(result, error)

    server.errors_into = errors_into
    entries = [CandidatePrediction(candidate=candidate.id) for candidate in request.candidates]
    request.request.propagator, result = "monte_carlo", Result()
    order = node_candidates.rank_entries(server, request, server.read(request.request), entries, result)
    assert order == ({"over": 0, "beside": 1} if rounds else {}) and result.error_code == ErrorCode.TIMEOUT
    codes = [entry.result.error_code for entry in entries]
    others = ErrorCode.NONE if rounds else ErrorCode.TIMEOUT
    assert codes == [others, ErrorCode.INVALID_MASS, others]
    assert [bool(entry.prediction.objects) for entry in entries] == [bool(rounds), False, bool(rounds)]


def over(name, x):
    return Candidate(id=name, objects=[moving_object("box", "salt_box", (x, 0.0, 0.15), (0.0, 0.0, 0.0))])


OVER = [over("beside", 0.4), over("over", 0.0), over("edge", 0.18)]


def ranked(scores, candidates=OVER, **others):
    """A request to rank boxes that are let go over a shelf and beside it."""
    request = request_of(
        moving_object("box", "salt_box", (0.0, 0.0, 0.15), (0.0, 0.0, 0.0)), horizon=0.5, samples=100, seed=3
    )
    request.scene.environment.elements = [
        EnvironmentElement(id="floor", plane=PlaneMessage(coef=[0.0, 0.0, 1.0, 0.5])),
        EnvironmentElement(
            id="shelf", primitive=SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[0.4, 0.4, 0.02])
        ),
    ]
    request.regions = [BoxRegion(id="above", size=Vector3(x=0.4, y=0.4, z=0.4))]
    request.regions[0].pose.position.z = 0.2
    for name, value in others.items():
        setattr(request, name, value)
    return PredictCandidates.Request(
        request=with_physics(request, gravity=None), candidates=candidates, score=scores
    )


ABOVE = Event(kind=Event.IN_REGION, object="box", other="above")


def alike(*names):
    """A request without scores, of candidates that differ in their ids alone."""
    return ranked([], [over(name, 0.0) for name in names])


def badly_ranked(*scores, **others):
    return ranked(scores, **others)


@pytest.mark.parametrize(
    ("request_", "code", "words"),
    [
        (alike(), "INVALID_REQUEST", "candidates"),
        (alike("same", "same"), "DUPLICATE_ID", "candidates[1].id"),
        (alike(*map(str, range(201))), "LIMIT_EXCEEDED", "candidates"),
        (badly_ranked(propagator="none"), "UNKNOWN_PROPAGATOR", "propagator"),
        (badly_ranked(Event(kind=9, object="box")), "INVALID_REQUEST", "score[0].kind is no kind"),
        (badly_ranked(ABOVE, Event(object="box", other="bin")), "INVALID_REQUEST", "score[1].other is no"),
        (badly_ranked(Event(kind=3, object="cup")), "INVALID_REQUEST", "score[0].object names no body"),
        (
            badly_ranked(Event(kind=3, object="box", other="x")),
            "INVALID_REQUEST",
            "score[0].other must be empty",
        ),
        (
            badly_ranked(Event(kind=4, object="box", other="x")),
            "INVALID_REQUEST",
            "score[0].other is neither",
        ),
        (badly_ranked(ABOVE, propagator="cloud"), "NOT_SUPPORTED", "propagator must be monte_carlo or empty"),
        (badly_ranked(ABOVE, wanted_position_error=0.1), "NOT_SUPPORTED", "wanted_position_error is not for"),
    ],
)
def test_bad_requests(node, client, request_, code, words):
    response = ask(client, request_)
    assert response.result.error_code == ErrorCode[code], response.result.error_msg
    assert words in response.result.error_msg and not response.predictions


def endless(scores):
    """A request of millions of steps, most of them at rest, with a limit of its computation time."""
    request = ranked(scores, samples=20_000, max_computation_time=duration(0.3), horizon=duration(50.0))
    request.request.propagator = "monte_carlo"
    with_physics(request.request, sleep=False, dt=1e-5)
    return request


@pytest.mark.parametrize("scores", [0, 1])
def test_the_computation_time_runs_out(node, client, scores):
    response = ask(client, endless([ABOVE] * scores))
    assert response.result.error_code == ErrorCode.TIMEOUT
    assert len(response.predictions) == len(OVER)
    assert {entry.result.error_code for entry in response.predictions} == {ErrorCode.TIMEOUT}
    assert all(0.0 <= seconds(entry.prediction.time_reached) < 50.0 for entry in response.predictions)
