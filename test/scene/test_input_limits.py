"""The largest number that a scene file may hold at a key, and the next larger one."""

import numpy as np
import pytest
from example_scenes import CONTENTS

from unc_physics import UncPhysicsError
from unc_physics.scene.scene_file import scene_from_dict

VARIANCE = 0.01


def covariance(row, column, value):
    P = VARIANCE * np.eye(12)
    P[row, column] = value
    return P.tolist()


def path(speed, turn=0.0):
    """Two poses, 0.01 s apart, between which a body moves uniformly."""
    end = {
        "position": [0.01 * speed, 0, 0],
        "orientation": [0, 0, np.sin(0.005 * turn), np.cos(0.005 * turn)],
    }
    velocity = {"linear_velocity": [speed, 0, 0], "angular_velocity": [0, 0, turn]}
    return [{"time": 0.0, "position": [0, 0, 0]} | velocity, {"time": 0.01} | end | velocity]


BODY, PLANE = ("bodies", 1), ("environment", 0)


@pytest.mark.parametrize(
    ("place", "most", "beyond", "code"),
    [
        (("dt",), 0.25, 0.2500001, "INVALID_HORIZON"),
        (("gravity",), [0, -1e6, 1e6], [0, -1.000001e6, 0], "LIMIT_EXCEEDED"),
        (("restitution",), 1.0, 1.000001, "INVALID_REQUEST"),
        (("restitution",), 0.0, -0.000001, "INVALID_REQUEST"),
        (("restitution_std",), 1.0, 1.000001, "INVALID_REQUEST"),
        (("friction_std",), 0.5, 0.500001, "INVALID_REQUEST"),
        (("gravity_direction_std",), np.pi, 3.1416, "INVALID_REQUEST"),
        (("impact_direction_std",), np.pi, 3.1416, "INVALID_REQUEST"),
        (("impact_point_std",), 10.0, 10.00001, "INVALID_REQUEST"),
        (("impact_friction_std",), 10.0, 10.00001, "INVALID_REQUEST"),
        ((*BODY, "mass"), 1e50, 1.000001e50, "INVALID_MASS"),
        ((*BODY, "mass"), 1e-50, 0.999999e-50, "INVALID_MASS"),
        ((*BODY, "mass_std"), 0.8, 0.800001, "INVALID_MASS"),
        ((*BODY, "spheres"), 10_000, 10_001, "INVALID_MODEL"),
        ((*BODY, "spheres"), 1, 0, "INVALID_MODEL"),
        ((*BODY, "position"), [0, -1e12, 1e12], [0, -1.000001e12, 0], "LIMIT_EXCEEDED"),
        ((*BODY, "orientation"), [0, 0, 0, 1.00099], [0, 0, 0, 1.00101], "INVALID_ORIENTATION"),
        ((*BODY, "orientation"), [0, 0.99901, 0, 0], [0, 0.99899, 0, 0], "INVALID_ORIENTATION"),
        ((*BODY, "orientation_std"), 2.0 * np.pi, 6.284, "INVALID_REQUEST"),
        ((*BODY, "covariance"), covariance(1, 4, 0.9e-10), covariance(1, 4, 1.1e-10), "INVALID_COVARIANCE"),
        ((*BODY, "covariance"), covariance(4, 4, -0.9e-10), covariance(4, 4, -1.1e-10), "INVALID_COVARIANCE"),
        ((*BODY, "trajectory"), path(99.9), path(100.1), "LIMIT_EXCEEDED"),
        ((*BODY, "trajectory"), path(0.0, 199.9), path(0.0, 200.1), "LIMIT_EXCEEDED"),
        ((*PLANE, "surface_tilt_std"), 0.5, 0.500001, "INVALID_ENVIRONMENT"),
    ],
)
def test_a_limit_is_the_most_that_is_allowed(place, most, beyond, code):
    def read(value):
        content = {"bodies": CONTENTS["two_bodies"]()["bodies"], "environment": [{"plane": {"offset": -9}}]}
        content |= {"friction": 0.5, "restitution": 0.5}
        inner = content
        if place[-1] in ("covariance", "trajectory"):
            content["bodies"][1] = {"name": "right", "model": "pin", "mass": 1.0}
        for key in place[:-1]:
            inner = inner[key]
        inner[place[-1]] = value
        return scene_from_dict(content)

    read(most)
    with pytest.raises(UncPhysicsError, match=place[-1]) as caught:
        read(beyond)
    assert caught.value.code.name == code
