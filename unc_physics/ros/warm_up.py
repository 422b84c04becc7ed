"""Compiles or loads kernels before the node's first request."""

from __future__ import annotations

import time
from collections.abc import Callable

from unc_physics_msgs.msg import Prediction

from ..prediction import warm_up as core
from .parameters import Settings
from .prediction_writer import Wanted
from .requests import Job, run, write_answer


def warm_up(settings: Settings, done: Callable[[str, float], object] = lambda name, seconds: None) -> None:
    """As `prediction.warm_up.warm_up`, with the node's physics and propagators; the answers are written.

    ``done`` is called with the name of each propagator that is warm, and the time it took [s].
    """
    begun = time.perf_counter()

    def answer(scene, belief, propagator, horizon):
        nonlocal begun
        wanted = Wanted(True, propagator.traits.cross_body, True, True)
        models = (core.MODEL,) * len(scene.bodies)
        job = Job(scene, belief, (), models, propagator, horizon, None, None, 1, 2, wanted, False, {})
        message = Prediction()
        write_answer(message, message.header, settings, job, run(job))
        begun, before = time.perf_counter(), begun
        done(propagator.name, begun - before)

    core.warm_up(filter(None, settings.warm_up), settings.physics | {"stiffness": settings.stiffness}, answer)
