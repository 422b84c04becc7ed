"""Which of several release poses over a bin keeps a salt box inside? Asks the node about all, and ranks.

Start the node first (`ros2 run unc_physics unc_physics_node`, or `python -m unc_physics.ros.node`), then run
this. The bin is made of five boxes on a floor. Each release pose is an action; all share the draws of the
gripper's inaccuracy, and those that clearly lose get few of them.
"""

import numpy as np

from unc_physics import Belief, BodyBelief, Box, BoxRegion, InRegion, Plane, RigidBody, Scene, load_model
from unc_physics.ros import Client

OFFSETS = 0.0, 0.08, 0.12, 0.14, 0.16, 0.20  # m, of the release pose from the bin's centre, along it
HEIGHT = 0.17  # m, of the salt box's bottom above the bin's floor
LENGTH, WIDTH, RIM, WALL = 0.30, 0.20, 0.147, 0.004  # m, of the bin
TABLE = -0.5  # m, height of what is below the bin
SAMPLES = 300
HORIZON = 0.8  # s

ALONG, ACROSS = 0.5 * (LENGTH - WALL), 0.5 * (WIDTH - WALL)
BIN = [
    Plane(name="floor", offset=TABLE),
    Box((LENGTH, WIDTH, WALL), (0.0, 0.0, -0.5 * WALL), name="bottom"),
    Box((WALL, WIDTH, RIM), (-ALONG, 0.0, 0.5 * RIM), name="left"),
    Box((WALL, WIDTH, RIM), (ALONG, 0.0, 0.5 * RIM), name="right"),
    Box((LENGTH - 2.0 * WALL, WALL, RIM), (0.0, -ACROSS, 0.5 * RIM), name="front"),
    Box((LENGTH - 2.0 * WALL, WALL, RIM), (0.0, ACROSS, 0.5 * RIM), name="back"),
]
INSIDE = BoxRegion("inside", (LENGTH, WIDTH, RIM), (0.0, 0.0, 0.5 * RIM))


def main() -> None:
    box = load_model("salt_box").prefix(100)
    scene = Scene.everyday([RigidBody("salt_box", box)], environment=BIN, restitution=0.2)
    actions = {}
    for offset in OFFSETS:  # held upright by a gripper that is sure to 1 cm and 0.05 rad
        held = BodyBelief(
            position=(offset, 0.0, HEIGHT) - box.origin,  # beliefs are about centres of mass
            position_std=0.01,
            orientation_std=0.05,
            linear_velocity_std=1e-3,
            angular_velocity_std=1e-3,
        )
        actions[f"{offset:.2f} m"] = {"salt_box": held}
    belief = Belief.of(scene, actions["0.00 m"])

    with Client() as client:
        score = InRegion("salt_box", INSIDE)
        ranking = client.rank(scene, belief, actions, score, HORIZON, rollouts=SAMPLES, seed=1)
    print(f"{'release pose':14}{'inside':>8}{'interval':>14}{'rollouts':>10}{'std of the centre [m]':>24}")
    for action in ranking:
        share = action.score
        interval = f"{share.low:8.0%} -{share.high:4.0%}"
        std = row(action.prediction["salt_box"].position_std)
        print(f"{action.name:14}{share.estimate:8.0%}{interval}{action.rollouts:10}{std:>24}")


def row(vector: np.ndarray) -> str:
    """Three numbers to the millimetre."""
    return f"({', '.join(f'{value:.3f}' for value in vector)})"


if __name__ == "__main__":
    main()
