"""The client of the node, with the types that its user may count on."""

from concurrent.futures import Future
from typing import assert_type

import numpy as np

from unc_physics import Belief, BoxRegion, InRegion, Prediction, Scene
from unc_physics.ros import Client


def ask(scene: Scene, belief: Belief) -> Prediction:
    with Client(server="/unc_physics", timeout=5.0) as client:
        assert_type(client, Client)
        region = BoxRegion("bin", size=(0.4, 0.3, 0.2))
        inside = InRegion("box", region)
        prediction = client.predict(scene, belief, "sigma_points", 1.0, times=[0.5], events=[inside])
        assert_type(prediction, Prediction)
        assert_type(prediction["box"].position, np.ndarray)
        assert_type(client.predict_async(scene, belief, horizon=1.0, samples=3), Future[Prediction])
        assert_type(client.predict_candidates(scene, {"a": belief}, horizon=1.0), dict[str, Prediction])
        long = client.predict_long(
            scene, belief, horizon=1.0, progress=lambda done, steps: print(done, steps)
        )
        assert_type(long, Prediction)
        client.predict_async(scene, belief, sample=3)  # mistake
        client.predict(scene, belief, horizn=1.0)  # mistake
    return prediction
