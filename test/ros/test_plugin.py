"""A propagator of another package, `frozen` of docs/extending.md: warm, listed and answering as the node's
own.
"""

import numpy as np
import pytest
from example_extensions import environment, install
from running import NodeProcess
from scenes import assert_answered, good_request, position_of

from unc_physics_msgs.srv import GetCapabilities


@pytest.fixture(scope="module")
def node(tmp_path_factory):
    """A node where `frozen` is installed, made ready for it alone."""
    folder = tmp_path_factory.mktemp("frozen")
    install(folder, "frozen_propagator", "frozen")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", environment(folder)["PYTHONPATH"])
        with NodeProcess(
            "-p", "zero_covariance:=exact", "-p", "warm_up:=[frozen]", name="extended"
        ) as process:
            yield process


def test_it_answers(node, client):
    request = good_request(propagator="frozen", horizon=0.4, return_samples=3, return_probabilities=True)
    response = client.predict(request, node="extended")
    assert_answered(response)
    assert response.prediction.propagator == "frozen"
    for predicted, message in zip(response.prediction.objects, request.scene.objects, strict=True):
        assert np.allclose(
            position_of(predicted.states[-1].pose.pose), position_of(message.pose.pose), atol=1e-6
        )
        assert len(predicted.states[-1].pose_samples) == 3


def test_it_is_listed(node, client):
    response = client.call(GetCapabilities, "/extended/get_capabilities", GetCapabilities.Request())
    info = response.propagators[-1]
    assert (info.name, info.mean_update, info.cross_body_correlations) == ("frozen", info.MEAN_NOMINAL, False)
    assert info.description == "Mean and covariance stay as they are."
    (option,) = info.options
    assert (option.name, option.type, option.default_value) == ("scale", "float", "1.0")
    assert option.description == "factor on the covariance"
