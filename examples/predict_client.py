"""Asks the node where a can on its way to a brick will be: the smallest client in Python.

Start the node first (`ros2 run unc_physics unc_physics_node`, or `python -m unc_physics.ros.node`), then run
this. The same scene, belief and arguments make `unc_physics.predict` answer without a node.
"""

import numpy as np

from unc_physics import Belief, BodyBelief, RigidBody, Scene, load_model
from unc_physics.ros import Client


def main() -> None:
    can = RigidBody("can", load_model("can").prefix(500))  # with the mass of its model
    brick = RigidBody("brick", load_model("brick").prefix(500), fixed=True)
    scene = Scene.everyday([can, brick])
    moves = BodyBelief(
        position=(-0.2, 0.0, 0.01),
        linear_velocity=(0.5, 0.0, 0.0),
        position_std=0.005,
        orientation_std=0.02,
        linear_velocity_std=0.05,
    )
    belief = Belief.of(scene, {"can": moves, "brick": BodyBelief()})

    with Client() as client:
        prediction = client.predict(scene, belief, "sigma_points", times=[0.1, 0.2, 0.3, 0.4, 0.5])
    path = prediction.trajectory("can")
    for time, position, std in zip(path.times, path.positions, path.position_stds, strict=True):
        print(f"{time:.1f} s: {row(position)} m +- {row(std)} m")


def row(vector: np.ndarray) -> str:
    """Three numbers to the millimetre."""
    return f"({', '.join(f'{value:.3f}' for value in vector)})"


if __name__ == "__main__":
    main()
