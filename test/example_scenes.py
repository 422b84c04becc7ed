"""Scenes that several tests use, as the content of scene files."""

import copy

import numpy as np
import pytest
from hypothesis import settings

from unc_physics import load_scene  # noqa: F401  (fails early, with a clear traceback, where the package is broken)
from unc_physics.scene.scene_file import scene_from_dict

TWO_BODIES = {
    "physics": "paper",
    "dt": 0.01,
    "horizon": 2.0,
    "stiffness": 1e4,
    "damping": 0.5,
    "bodies": [
        {
            "name": "left",
            "model": "bunny",
            "spheres": 10,
            "scale": 8.0,
            "mass": 1.5,
            "position": [-1.1, 0.1, 0.0],
            "orientation": [0.5, 0.5, -0.5, 0.5],
            "linear_velocity": [1.5, 0.0, 0.1],
            "angular_velocity": [0.2, -0.4, 0.3],
            "position_std": 0.03,
            "linear_velocity_std": [0.02, 0.01, 0.0],
        },
        {
            "name": "right",
            "model": "armadillo",
            "spheres": 10,
            "scale": 8.0,
            "mass": 0.8,
            "position": [1.0, 0.0, 0.1],
            "orientation": [0.0, 0.6, 0.0, 0.8],
            "linear_velocity": [-1.2, 0.1, 0.0],
            "angular_velocity": [0.1, 0.5, 0.0],
            "position_std": [0.02, 0.03, 0.04],
            "orientation_std": 0.03,
        },
    ],
}
FLOOR = {
    "name": "floor",
    "model": "pin",
    "spheres": 10,
    "scale": 12.0,
    "position": [0.0, 0.3, -2.0],
    "orientation": [0.6, 0.0, 0.0, 0.8],
    "fixed": True,
}


def examples(count):
    """So many random examples in the gate, and more where more are asked for (``--hypothesis-profile``)."""
    return count * settings().max_examples // settings.get_profile("tests").max_examples


def two_bodies():
    """A bunny and an armadillo about to collide."""
    return copy.deepcopy(TWO_BODIES)


def three_bodies():
    """The same, falling onto a fixed pin that stands second among the bodies."""
    content = two_bodies() | {"gravity": [0.3, 0.0, -5.0]}
    content["bodies"].insert(1, copy.deepcopy(FLOOR))
    return content


def undamped():
    """The two bodies without damping."""
    return two_bodies() | {"damping": 0.0}


def parts_of(carry):
    """All arrays and numbers of a carry, also of the tuples in it."""
    for part in carry:
        if isinstance(part, tuple):
            yield from parts_of(part)
        elif part is not None:
            yield np.asarray(part)


def everyday():
    """Two bodies that fall beside each other onto a floor, by the implicit step."""
    body = {"model": "brick", "spheres": 60, "mass": 0.5, "position_std": 0.01, "orientation_std": 0.05}
    return {
        "physics": "everyday",
        "exact": True,
        "horizon": 1.0,
        "environment": [{"plane": {"normal": [0, 0, 1]}}],
        "bodies": [
            body | {"name": "left", "position": [-0.06, 0.0, 0.2]},
            body | {"name": "right", "position": [0.06, 0.02, 0.3], "linear_velocity": [-0.3, 0.0, 0.0]},
        ],
    }


CONTENTS = {
    "two_bodies": two_bodies,
    "three_bodies": three_bodies,
    "undamped": undamped,
    "everyday": everyday,
}


@pytest.fixture(params=["two_bodies", "three_bodies"])
def content(request):
    """The content of a scene file: two bodies; three, of which one is fixed, with gravity."""
    return CONTENTS[request.param]()


@pytest.fixture(scope="session")
def loaded():
    """Loader of a scene by its name among `CONTENTS`: (scene, belief, horizon); one object for all tests."""
    made = {}

    def load(name):
        if name not in made:
            made[name] = scene_from_dict(CONTENTS[name]())
        return made[name]

    return load
