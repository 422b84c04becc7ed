"""Which of several release poses over a bin keeps a salt box inside? Asks the node about all, and ranks.

Start the node first (`ros2 run unc_physics unc_physics_node`, or `python -m unc_physics.ros.node`), then run
this. The bin is made of five boxes on a floor. Each release pose is a candidate; all share the draws of the
gripper's inaccuracy, and those that clearly lose get few of them.
"""

import numpy as np

from unc_physics.ros import Client, environment, make_message, object_state, poses_of, prediction_request
from unc_physics_msgs.msg import BoxRegion, Candidate, Event, Physics

OFFSETS = 0.0, 0.08, 0.12, 0.14, 0.16, 0.20  # m, of the release pose from the bin's centre, along it
HEIGHT = 0.17  # m, of the salt box's bottom above the bin's floor
LENGTH, WIDTH, RIM, WALL = 0.30, 0.20, 0.147, 0.004  # m, of the bin
TABLE = -0.5  # m, height of what is below the bin
SAMPLES = 300
HORIZON = 0.8  # s

ALONG, ACROSS = 0.5 * (LENGTH - WALL), 0.5 * (WIDTH - WALL)
BIN = environment(
    planes={"floor": (0.0, 0.0, 1.0, -TABLE)},
    boxes={
        "bottom": ((LENGTH, WIDTH, WALL), (0.0, 0.0, -0.5 * WALL)),
        "left": ((WALL, WIDTH, RIM), (-ALONG, 0.0, 0.5 * RIM)),
        "right": ((WALL, WIDTH, RIM), (ALONG, 0.0, 0.5 * RIM)),
        "front": ((LENGTH - 2.0 * WALL, WALL, RIM), (0.0, -ACROSS, 0.5 * RIM)),
        "back": ((LENGTH - 2.0 * WALL, WALL, RIM), (0.0, ACROSS, 0.5 * RIM)),
    },
)
INSIDE = make_message(BoxRegion, id="inside", size=(LENGTH, WIDTH, RIM), pose=(0.0, 0.0, 0.5 * RIM))
STD = np.array([0.01, 0.01, 0.01, 0.05, 0.05, 0.05])  # m, rad: how exactly a gripper holds it


def main() -> None:
    candidates = [Candidate(id=f"{offset:.2f} m", objects=[held(offset)]) for offset in OFFSETS]
    request = prediction_request(
        [held(0.0)],
        HORIZON,
        BIN,
        physics=make_message(Physics, restitution=0.2),
        regions=[INSIDE],
        samples=SAMPLES,
        seed=1,
    )
    score = Event(kind=Event.IN_REGION, object="salt_box", other="inside")
    with Client() as client:
        answer = client.rank(request, candidates, score=[score])
    print(f"{'release pose':14}{'inside':>8}{'interval':>14}{'rollouts':>10}{'std of the position [m]':>26}")
    for entry in answer.predictions:
        _, covariances = poses_of(entry.prediction)["salt_box"]
        interval = f"{entry.score_low:8.0%} -{entry.score_high:4.0%}"
        std = row(np.sqrt(covariances[-1].diagonal()[:3]))
        print(f"{entry.candidate:14}{entry.score:8.0%}{interval}{entry.prediction.rollouts:10}{std:>26}")


def held(offset: float):
    """The salt box, held upright over the bin by a gripper."""
    return object_state("salt_box", "salt_box", (offset, 0.0, HEIGHT), STD**2, twist_covariance=[1e-6] * 6)


def row(vector: np.ndarray) -> str:
    """Three numbers to the millimetre."""
    return f"({', '.join(f'{value:.3f}' for value in vector)})"


if __name__ == "__main__":
    main()
