"""Estimate the memory of a prediction before it begins."""

from __future__ import annotations

from ..checks.memory import require_memory
from ..collision.implicit_workspace import REMEMBERED_CONTACTS
from ..propagators.base import PointPairs, Propagator, Samples
from ..scene.belief import Belief
from ..scene.scene import Scene
from ..spatial.layout import ERROR, STATE

_NUMBER, _SHORT = 8, 4  # bytes of a double and of a single
_COPIES = 2  # of what rollouts remember: each piece of a prediction begins with a copy
_MATRICES = 4  # as large as the joint covariance, while a belief is made of states
_PAIR = 150  # bytes of each pair of things in a rollout's workspace
_REMEMBERED = 32  # bytes of a contact that a rollout remembers
_USUAL_CONTACTS = 8  # of a body, that each time's state holds


def check_memory(scene: Scene, belief: Belief, propagator: Propagator, times: int) -> None:
    """Raise `LimitExceededError` if a prediction at so many ``times`` takes more memory than there is."""
    bodies, things = len(scene.bodies), len(scene.bodies) + len(scene.environment)
    rollouts = _most_rollouts(scene, belief, propagator)
    state = _NUMBER * STATE * bodies
    remembered = _SHORT * bodies * things
    kept = remembered + state
    if scene.integrator == "implicit":
        remembered += bodies * (_REMEMBERED * REMEMBERED_CONTACTS + 10 * _NUMBER)
        kept += bodies * (_REMEMBERED * _USUAL_CONTACTS + 10 * _NUMBER)
    errors = _NUMBER * ERROR * len(scene.moving)
    covariance = _NUMBER * (ERROR * len(scene.moving)) ** 2
    of_times = times * (covariance + rollouts * kept)
    needed = rollouts * (_COPIES * (remembered + state) + 2 * errors + state)
    needed += _MATRICES * covariance + _PAIR * bodies * things
    what = f"{bodies} {'body' if bodies == 1 else 'bodies'} in {rollouts} rollouts, at {times} times,"
    if of_times > needed:
        require_memory(needed + of_times, what, "the number of times", times)
    elif not isinstance(propagator, Samples):
        require_memory(needed + of_times, what, "the number of bodies", bodies)
    else:
        require_memory(needed + of_times, what, "samples", rollouts)


def _most_rollouts(scene, belief, propagator):
    """Return the most states that the propagator holds at a time."""
    if isinstance(propagator, PointPairs):
        return propagator.point_count(scene, belief)
    return propagator.own_sample_count if isinstance(propagator, Samples) else 1
