"""The client of the node, with the types that its user may count on."""

from typing import Any, assert_type

import numpy as np

from unc_physics.ros import Client, environment, make_message, object_state, poses_of, prediction_request


def ask(message: Any) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    box = object_state("box", "salt_box", pose=(0, 0, 0.2), covariance=np.eye(6), at_rest=True)
    floor = environment(planes={"floor": (0, 0, 1, 0)}, boxes={"shelf": ((1, 1, 0.1), (0, 0, 0.5))})
    request = prediction_request([box], 1.0, floor, times=[0.5], samples=3)
    make_message(message, friction=0.4)
    with Client(server="/unc_physics", timeout=5.0) as client:
        assert_type(client, Client)
        client.rank(request, [], score=[], timeout=3.0)
        client.load_model("part.stl", name="part", spheres=500)
        client.reset(["box"])
        client.tracked(after=1.0)
        poses = poses_of(client.predict(request, timeout=10.0))
        client.predict(request, time_out=3.0)  # mistake
        prediction_request([box])  # mistake
        client.observe("box")  # mistake
    assert_type(poses["box"][0], np.ndarray)
    return poses
