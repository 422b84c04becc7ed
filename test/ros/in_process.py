"""What the node does with a request, in this process: it reads, computes and writes the answer."""

from unc_physics.checks.errors import UncPhysicsError
from unc_physics.ros.messages.fields import write_error
from unc_physics.ros.messages.frames import Frames
from unc_physics.ros.messages.prediction import write_answer
from unc_physics.ros.messages.request import TimeLimits, read_request
from unc_physics_msgs.srv import Predict

FRAMES = Frames()


def answer_to(request, settings, library, computed=lambda job: True):
    """The response to a request; its prediction is left empty for jobs that are not ``computed``."""
    response = Predict.Response()
    try:
        job = read_request(
            request, settings, library, FRAMES, limits=TimeLimits(settings.max_computation_time)
        )
        if computed(job):
            write_answer(response.prediction, request.scene.header, settings, job, job.run())
    except UncPhysicsError as error:
        write_error(response.result, error)
    return response
