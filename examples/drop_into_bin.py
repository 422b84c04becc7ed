"""Which of several release poses over a bin keeps a salt box inside? Asks `~/predict_candidates`, and ranks.

Start the node first (`ros2 run unc_physics unc_physics_node`, or `python -m unc_physics.ros.node`), then run
this. The bin is made of five boxes on a floor. Each release pose is a candidate; all share the draws of the
gripper's inaccuracy, and the answer tells the probability that the salt box ends inside.
"""

import sys

import numpy as np
import rclpy
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Pose
from shape_msgs.msg import Plane, SolidPrimitive

from unc_physics_msgs.msg import (
    BoxRegion,
    Candidate,
    Environment,
    EnvironmentElement,
    ObjectState,
    Physics,
    PredictionRequest,
    Result,
    Scene,
)
from unc_physics_msgs.srv import PredictCandidates

OFFSETS = (
    0.0,
    0.08,
    0.12,
    0.14,
    0.16,
    0.20,
)  # m, of the release pose from the bin's centre, along its long side
HEIGHT = 0.17  # m, of the salt box's bottom above the bin's floor
LENGTH, WIDTH, RIM, WALL = 0.30, 0.20, 0.147, 0.004  # m, of the bin
TABLE = -0.5  # m, height of what is below the bin
SAMPLES = 300
HORIZON = Duration(nanosec=800_000_000)
PHYSICS = Physics(restitution=[0.2])  # the rest is the node's: a robot's world, with gravity and friction


def bin_of_boxes():
    """The bin and the floor below it as an environment."""
    along, across = 0.5 * (LENGTH - WALL), 0.5 * (WIDTH - WALL)
    boxes = {
        "bottom": ((LENGTH, WIDTH, WALL), (0.0, 0.0, -0.5 * WALL)),
        "left": ((WALL, WIDTH, RIM), (-along, 0.0, 0.5 * RIM)),
        "right": ((WALL, WIDTH, RIM), (along, 0.0, 0.5 * RIM)),
        "front": ((LENGTH - 2.0 * WALL, WALL, RIM), (0.0, -across, 0.5 * RIM)),
        "back": ((LENGTH - 2.0 * WALL, WALL, RIM), (0.0, across, 0.5 * RIM)),
    }
    floor = EnvironmentElement(id="floor", plane=[Plane(coef=[0.0, 0.0, 1.0, -TABLE])])
    walls = [
        EnvironmentElement(
            id=name, primitive=[SolidPrimitive(type=SolidPrimitive.BOX, dimensions=size)], pose=at(*position)
        )
        for name, (size, position) in boxes.items()
    ]
    return Environment(elements=[floor, *walls])


def inside():
    """The room that the bin encloses."""
    region = BoxRegion(id="inside", pose=at(0.0, 0.0, 0.5 * RIM))
    region.size.x, region.size.y, region.size.z = LENGTH, WIDTH, RIM
    return region


def at(x, y, z):
    """An upright pose."""
    pose = Pose()
    pose.position.x, pose.position.y, pose.position.z = x, y, z
    return pose


def salt_box(offset):
    """The salt box, held upright over the bin by a gripper that is sure to 1 cm and 0.05 rad."""
    box = ObjectState(id="salt_box", model="salt_box", spheres=100)  # with the mass of its model
    box.pose.pose = at(offset, 0.0, HEIGHT)
    box.pose.covariance = np.diag([0.01**2] * 3 + [0.05**2] * 3).ravel()
    box.twist.covariance = np.diag([1e-3**2] * 6).ravel()
    return box


def main():
    rclpy.init()
    node = rclpy.create_node("drop_into_bin")
    client = node.create_client(PredictCandidates, "/unc_physics/predict_candidates")
    if not client.wait_for_service(timeout_sec=10.0):
        sys.exit("no node answers on /unc_physics/predict_candidates")
    request = PredictionRequest(
        scene=Scene(objects=[salt_box(0.0)], environment=bin_of_boxes()),
        regions=[inside()],
        horizon=HORIZON,
        physics=PHYSICS,
        propagator="monte_carlo",
        samples=SAMPLES,
        seed=1,
    )
    candidates = [Candidate(id=f"{offset:.2f} m", objects=[salt_box(offset)]) for offset in OFFSETS]
    future = client.call_async(PredictCandidates.Request(request=request, candidates=candidates))
    rclpy.spin_until_future_complete(node, future)
    response = future.result()
    rclpy.try_shutdown()
    if response.result.error_code != Result.NONE:
        sys.exit(f"error {response.result.error_code}: {response.result.error_msg}")
    for entry in response.predictions:
        if entry.result.error_code != Result.NONE:
            sys.exit(f"{entry.candidate}: error {entry.result.error_code}: {entry.result.error_msg}")
    title = f"position after {seconds(HORIZON)} s [m]"
    print(f"{'release pose':14}{'inside':>8}{title:>30}{'std [m]':>24}")
    for entry in sorted(response.predictions, key=lambda entry: -probability(entry)):
        state = entry.prediction.objects[0].states[-1]
        p, std = state.pose.pose.position, np.sqrt(np.reshape(state.pose.covariance, (6, 6)).diagonal()[:3])
        print(
            f"{entry.candidate:14}{probability(entry):8.0%}     ({p.x:6.3f}, {p.y:6.3f}, {p.z:6.3f})"
            f"     ({std[0]:.3f}, {std[1]:.3f}, {std[2]:.3f})"
        )
    print(f"computed in {seconds(response.computation_time):.1f} s, {SAMPLES} samples each")


def seconds(duration):
    """A Duration in seconds."""
    return duration.sec + duration.nanosec / 1e9


def probability(entry):
    """The probability that a candidate's salt box ends inside."""
    (answer,) = entry.prediction.region_probabilities
    if not answer.probability.available:
        sys.exit("this propagator cannot tell the probability; Monte Carlo can")
    return answer.probability.probability


if __name__ == "__main__":
    main()
