"""A node with nothing but empty services, which the node's latency is compared with.

``python -m unc_physics_evaluation.empty_service KIND`` runs it until SIGTERM: on the executor of
``rclpy.spin``, as most nodes are (``spin``), or on the one of the node of unc_physics (``own``).
"""

from __future__ import annotations

import sys

KINDS = ("spin", "own")


def serve(kind: str) -> None:
    """Serve ``~/call`` and ``~/canned`` until the end."""
    import rclpy
    from rclpy.executors import ExternalShutdownException
    from std_srvs.srv import Empty

    from unc_physics.ros.node import leave, spin_node
    from unc_physics_msgs.srv import Predict

    rclpy.init()
    node = rclpy.create_node(f"empty_{kind}")
    node.create_service(Empty, "~/call", lambda _, response: response)
    node.create_service(Predict, "~/canned", lambda request, _: canned_answer(request))
    try:
        if kind == "own":
            spin_node(node)
        else:
            rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    leave(0)


def canned_answer(request):
    """An answer to a request that nothing was calculated for."""
    from unc_physics_msgs.msg import PredictedObject, PredictedState
    from unc_physics_msgs.srv import Predict

    return Predict.Response(
        objects=[PredictedObject(id=message.id, states=[PredictedState()]) for message in request.objects]
    )


if __name__ == "__main__":
    serve(sys.argv[1])
