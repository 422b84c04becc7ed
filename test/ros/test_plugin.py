"""The propagator of docs/extending.md in a node: it is warm, listed, and answers as the built-in ones."""

import numpy as np
import pytest
from example_extensions import environment, install
from running import NodeProcess
from scenes import assert_answered, good_request, position_of

from unc_physics_msgs.srv import GetCapabilities


@pytest.fixture(scope="module")
def node(tmp_path_factory):
    """A node where `antithetic` is installed, made ready for it alone."""
    folder = tmp_path_factory.mktemp("antithetic")
    install(folder, "antithetic_propagator", "antithetic")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", environment(folder)["PYTHONPATH"])
        with NodeProcess(zero_covariance="exact", warm_up=["antithetic"], name="extended") as process:
            yield process


def test_it_answers(node, client):
    request = good_request(propagator="antithetic", horizon=0.4, return_samples=3, return_probabilities=True)
    response = client.predict(request, node="extended")
    assert_answered(response)
    assert response.prediction.propagator == "antithetic"
    built_in = client.predict(good_request(propagator="sigma_points", horizon=0.4), node="extended")
    for predicted, other in zip(response.prediction.objects, built_in.prediction.objects, strict=True):
        one, two = (position_of(found.states[-1].pose.pose) for found in (predicted, other))
        assert np.allclose(one, two, atol=0.02)
        assert len(predicted.states[-1].pose_samples) == 3
    assert response.prediction.rollouts == 200 and response.prediction.has_errors


def test_it_is_listed(node, client):
    response = client.call(GetCapabilities, "/extended/get_capabilities", GetCapabilities.Request())
    info = response.propagators[-1]
    assert (info.name, info.mean_update) == ("antithetic", info.MEAN_ESTIMATED)
    assert info.cross_body_correlations and not info.parameter_uncertainty
    assert info.description == "Monte Carlo with antithetic samples."
    pairs, seed = info.options
    assert (pairs.key, seed.key) == ("pairs", "seed")
    assert pairs.value == "int, default 100: number of pairs of samples"
