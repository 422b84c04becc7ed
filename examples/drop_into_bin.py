"""Which of several release poses over a bin keeps a salt box inside? Asks `~/predict_candidates`, and ranks.

Start the node first (`ros2 run unc_physics unc_physics_node`, or `python -m unc_physics.ros.node`), then run this.
Each release pose is a candidate; all share the draws of the gripper's inaccuracy. A candidate's probability is the
share of its Monte Carlo samples whose centre of mass ends inside the bin.
"""

import sys

import numpy as np
import rclpy
from diagnostic_msgs.msg import KeyValue

from unc_physics_msgs.msg import Candidate, ObjectState
from unc_physics_msgs.srv import ListModels, PredictCandidates

OFFSETS = (0.0, 0.08, 0.12, 0.14, 0.16, 0.20)  # m, of the release pose from the bin's centre, along its long side
HEIGHT = 0.17  # m, of the box's bottom above the bin's floor; the rim is at 0.147
HALF_BIN = np.array([0.15, 0.10])  # m
RIM = 0.147  # m
SAMPLES = 100
HORIZON = 0.8  # s
# thin walls of small spheres need a stiff contact and short steps; damping stands for what the impact swallows
PHYSICS = {"dt": "0.0005", "stiffness": "3e8", "damping": "3.0"}


def salt_box(offset):
    """The box, held upright over the bin by a gripper that is sure to 1 cm and 0.05 rad."""
    box = ObjectState(id="salt_box", model="salt_box", spheres=300, use_model_mass=True)
    box.pose.pose.position.x, box.pose.pose.position.z = offset, HEIGHT
    box.pose.covariance = np.diag([0.01**2] * 3 + [0.05**2] * 3).ravel()
    box.twist.covariance = np.diag([1e-3**2] * 6).ravel()
    return box


def share_inside(poses, center_of_mass):
    """The share of poses of the box's origin with which its centre of mass is in the bin."""
    inside = 0
    for pose in poses:
        q = pose.orientation
        axis, w = np.array([q.x, q.y, q.z]), q.w
        twice = 2.0 * np.cross(axis, center_of_mass)
        turned = center_of_mass + w * twice + np.cross(axis, twice)
        x, y, z = turned + [pose.position.x, pose.position.y, pose.position.z]
        inside += bool(abs(x) < HALF_BIN[0] and abs(y) < HALF_BIN[1] and 0.0 < z < RIM)
    return inside / len(poses)


def main():
    rclpy.init()
    node = rclpy.create_node("drop_into_bin")

    def call(kind, name, request):
        client = node.create_client(kind, f"/unc_physics/{name}")
        if not client.wait_for_service(timeout_sec=10.0):
            sys.exit(f"no node answers on /unc_physics/{name}")
        future = client.call_async(request)
        rclpy.spin_until_future_complete(node, future)
        return future.result()

    models = {model.name: model for model in call(ListModels, "list_models", ListModels.Request()).models}
    com = models["salt_box"].center_of_mass
    request = PredictCandidates.Request(
        objects=[salt_box(0.0), ObjectState(id="bin", model="bin", fixed=True)],
        candidates=[Candidate(id=f"{offset:.2f} m", objects=[salt_box(offset)]) for offset in OFFSETS],
        horizon=HORIZON, propagator="monte_carlo", samples=SAMPLES, return_samples=SAMPLES, seed=1,
        scene_options=[KeyValue(key=key, value=value) for key, value in PHYSICS.items()],
    )
    response = call(PredictCandidates, "predict_candidates", request)
    rclpy.try_shutdown()
    if response.error_code != PredictCandidates.Response.NONE:
        sys.exit(f"error {response.error_code}: {response.error_msg}")
    print(f"{'release pose':14}{'inside':>8}{'position after ' + str(HORIZON) + ' s [m]':>30}{'std [m]':>24}")
    ranked = []
    for entry in response.predictions:
        state = entry.prediction.objects[0].states[-1]
        p, std = state.pose.pose.position, np.sqrt(np.reshape(state.pose.covariance, (6, 6)).diagonal()[:3])
        ranked.append((share_inside(state.pose_samples, np.array([com.x, com.y, com.z])), entry.candidate, p, std))
    for share, name, p, std in sorted(ranked, key=lambda row: -row[0]):
        print(f"{name:14}{share:8.0%}     ({p.x:6.3f}, {p.y:6.3f}, {p.z:6.3f})     ({std[0]:.3f}, {std[1]:.3f}, {std[2]:.3f})")
    print(f"computed in {response.computation_time:.1f} s, {SAMPLES} samples each")


if __name__ == "__main__":
    main()
