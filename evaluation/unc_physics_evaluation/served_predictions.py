"""Predictions of one tree of the package, on request, for `experiments.same_bits`.

A process runs this file by its path, in the older of two trees. The package may be the one of either tree:
the file uses only what both offer.
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np

#: Options of propagators, where not their own.
OPTIONS = {"monte_carlo": {"samples": 12}, "surrogate": {"k_sigma": 3.0}}


def scenes():
    """Return scenes of the explicit step by name: (scene, belief, horizon [s])."""
    from unc_physics import Belief, Box, Plane, RigidBody, Scene, load_model, load_scene

    def belief(mean, position=0.01, rotation=0.02):
        P = np.zeros((len(mean), 12, 12))
        P[:, [0, 1, 2], [0, 1, 2]] = position**2
        P[:, [6, 7, 8], [6, 7, 8]] = rotation**2
        return Belief(mean, P)

    def states(*bodies):
        rows = np.zeros((len(bodies), 13))
        for row, (position, velocity, spin) in zip(rows, bodies, strict=True):
            row[0:3], row[3:6], row[10:13], row[9] = position, velocity, spin, 1.0
        return rows

    found = {}
    bunnies, bunnies_belief, horizon = load_scene("examples/scenes/two_bunnies.yaml")
    found["two bunnies"] = bunnies, bunnies_belief, horizon
    pin = load_model("pin").prefix(100)
    size = 0.5 / pin.bounding_radius
    pin = pin.scaled(size)
    pair = states(
        ((-0.6, 0.05, 0.0), (1.0, 0.0, 0.0), (0.5, 1.0, -2.0)),
        ((0.6, 0.0, 0.1), (-1.0, 0.0, 0.0), (0.0, -1.0, 1.0)),
    )
    pins = Scene([RigidBody("a", pin, 1.0), RigidBody("b", pin, 2.0)], dt=0.01, stiffness=2e4, damping=0.5)
    found["two pins"] = pins, belief(pair, 0.05, 0.05), 3.0
    third = np.concatenate([pair, states(((0.0, 0.1, -1.2), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))])
    fixed = [*pins.bodies, RigidBody("fixed", pin, fixed=True)]
    P = np.array(belief(pair, 0.03).covariance)
    onto = replace(pins, bodies=fixed, gravity=(0.2, 0.0, -3.0))
    found["onto a fixed body"] = onto, Belief(third, P, [0, 1]), 1.5
    floor = (Plane((0.0, 0.1, 1.0), -0.5), Box((1.0, 1.0, 0.2), (0.3, 0.0, -0.6)))
    ground = replace(pins, gravity=(0.0, 0.0, -5.0), environment=floor, stiffness=2e5, dt=0.005)
    found["plane and box"] = ground, belief(pair), 2.0
    found["all together"] = replace(ground, bodies=fixed), Belief(third, P, [0, 1]), 2.0
    found["a long flight"] = (
        replace(pins, environment=(Plane(offset=-100.0),)),
        belief(pair + 3.0 * np.eye(2, 13, 1)),
        3.0,
    )
    bunny = load_model("bunny").prefix(100)
    bunny = bunny.scaled(0.06 / bunny.bounding_radius)
    many = states(
        *(
            ((0.09 * (k % 2), 0.01 * k, 0.1 + 0.15 * k), (0.0, 0.0, -0.3), (0.0, 1.0, 0.2 * k))
            for k in range(5)
        )
    )
    walls = (Plane(), Box((0.02, 1.0, 1.0), (-0.2, 0.0, 0.5)), Box((0.02, 1.0, 1.0), (0.25, 0.0, 0.5)))
    pile = Scene(
        [RigidBody(f"bunny{k}", bunny, 0.3) for k in range(5)],
        dt=0.004,
        stiffness=2e6,
        damping=0.3,
        gravity=(0.0, 0.0, -9.81),
        environment=walls,
    )
    found["a pile"] = pile, belief(many, 0.004), 0.8
    apart = np.concatenate([pair, pair + 8.0 * np.eye(1, 13, 1)])
    four = [RigidBody(f"p{k}", pin, 1.0 + k) for k in range(4)]
    found["two pairs"] = replace(pins, bodies=four), belief(apart, 0.02), 2.0
    uncertain = [replace(pins.bodies[0], mass_std=0.2), replace(pins.bodies[1], center_of_mass_std=0.02)]
    found["uncertain parameters"] = (
        replace(
            pins, bodies=uncertain, stiffness_std=1e3, gravity=(0.0, 0.0, -0.1), gravity_direction_std=0.05
        ),
        belief(pair, 0.03),
        1.5,
    )
    return found


def cases(found):
    """Return the compatible pairs of a scene's and a propagator's name."""
    from unc_physics import PROPAGATORS

    return [
        (scene_name, name)
        for scene_name, (scene, *_) in found.items()
        for name, kind in PROPAGATORS.items()
        if not scene.uncertain or "mass" in kind.supports.parameters
    ]


def results(scene, belief, horizon, name):
    """Return every array of a prediction, and its probabilities, by name; `stability` judges statuses."""
    import unc_physics
    from unc_physics import make_propagator, predict

    events = unc_physics.encounters(scene)
    propagator = make_propagator(name, **OPTIONS.get(name, {}))
    prediction = predict(scene, belief, propagator, horizon, times=(0.5 * horizon,), events=events)
    arrays = {}
    for k, found in enumerate(prediction.beliefs):
        arrays[f"mean {k}"], arrays[f"covariance {k}"] = found.mean, found.covariance
    for field, part in prediction.carry._asdict().items():
        if field == "contact_history":
            arrays["first contacts"] = part.first_time
        elif isinstance(part, np.ndarray) and part.size:  # empty: of an option that is not used
            arrays[field] = part
    for k, event in enumerate(events):
        found, time = prediction.probability(event), prediction.contact_time(event)
        arrays[f"contact {k}"] = np.array([found.low, found.estimate, found.high, *(time or ())], float)
    return arrays


def serve():
    """Answer requests on standard input: one JSON object a line, with a case and a file for its arrays."""
    import numba

    numba.set_num_threads(1)
    found = scenes()
    print(json.dumps(cases(found)), flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        scene, belief, horizon = found[request["scene"]]
        np.savez(request["file"], **results(scene, belief, horizon, request["propagator"]))
        print("0", flush=True)


if __name__ == "__main__":
    serve()
