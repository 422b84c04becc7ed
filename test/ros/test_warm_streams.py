"""What the first streamed messages need is compiled or loaded before the node is ready."""

import subprocess
import sys
from types import SimpleNamespace

import pytest
from numba.core import caching
from scenes import floor, measured
from shape_msgs.msg import SolidPrimitive

from unc_physics.prediction import warm_up as core
from unc_physics.prediction.request_checks import marks_of
from unc_physics.ros.detected import detected_object, settle_detected
from unc_physics.ros.messages.prediction import write_answer
from unc_physics.ros.messages.request import read_request
from unc_physics.ros.models import ModelLibrary
from unc_physics.ros.node_environment import NodeEnvironment
from unc_physics.ros.parameters import Settings
from unc_physics.ros.server import warm_up
from unc_physics.ros.streams import request_of
from unc_physics.ros.tracks import Tracks, warm_up_tracker
from unc_physics_msgs.msg import EnvironmentElement, Prediction, Scene

SECOND = 1_000_000_000  # ns


def seen(x, library, settings):
    """A detected can."""
    return detected_object(f"can {x}", "can", measured((x, 0, 0), 0.002), library, settings)


def stream(library, environment, settings):
    """Predict what was detected."""
    scene = Scene(objects=[seen(x, library, settings) for x in (0.0, 0.2)])
    scene, skipped = settle_detected(scene, environment.message, library, settings)
    assert not skipped
    frames = SimpleNamespace(to_world=lambda header: None)
    job = read_request(
        request_of(scene, settings), settings, library, frames, environment_of=environment.around
    )
    write_answer(Prediction(), scene.header, settings, job, job.run())


def track(library, environment, settings):
    """Track what was detected, and predict it."""
    tracks = Tracks(library, environment)
    for k in range(3):
        own = seen(0.0, library, settings)
        tracks.observe(SECOND + k * SECOND // 10, [own], {own.id}, settings)
    fork = tracks.fork()
    fork.arrive()
    fork.messages()
    job, prediction = fork.predict(marks_of(fork.scene, None, settings.horizons), settings)
    write_answer(Prediction(), Scene().header, settings, job, prediction)


def main(run):
    """Print the kernels that are looked for in the cache after the warm-up, before they are compiled."""
    settings, library, environment = Settings(track=run is track), ModelLibrary(), NodeEnvironment()
    box = EnvironmentElement(
        id="box", primitive=SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[0.1] * 3)
    )
    box.pose.position.x = 1.0
    environment.set([floor(), box])
    if run is track:
        core.warm_up(("monte_carlo",), settings.physics, warm_up_tracker)
    warm_up(settings.warm_up, settings, lambda *_: None)
    load, found = caching.Cache.load_overload, []

    def loading(cache, *arguments):
        found.append(cache._name)
        return load(cache, *arguments)

    caching.Cache.load_overload = loading
    run(library, environment, settings)
    library.discard()
    print(found)


@pytest.mark.parametrize("run", ["stream", "track"])
def test_first_messages_compile_nothing(run):
    command = [sys.executable, __file__, run]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip() == "[]"


if __name__ == "__main__":
    main({"stream": stream, "track": track}[sys.argv[1]])
