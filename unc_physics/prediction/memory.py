"""How much memory a prediction takes, told before it begins."""

from __future__ import annotations

from ..checks.memory import require_memory
from ..physics.implicit_world import REMEMBERED_CONTACTS
from ..physics.layout import ERROR, STATE
from ..propagators.base import Propagator
from ..scene.belief import Belief
from ..scene.scene import Scene

_NUMBER, _SHORT = 8, 4  # bytes of a double and of a single
_COPIES = 2  # of what rollouts remember: each piece of a prediction begins with a copy
_MATRICES = 4  # as large as the joint covariance, while a belief is made of states
_PAIR = 150  # bytes of each pair of things in a rollout's workspace
_REMEMBERED = 32  # bytes of a contact that a rollout remembers


def check_memory(
    scene: Scene, belief: Belief, propagator: Propagator, times: int, keep_samples: int = 0
) -> None:
    """Refuse a prediction that takes more memory than there is.

    Parameters
    ----------
    scene : Scene
    belief : Belief
    propagator : Propagator
    times : int
        At how many times a belief is wanted.
    keep_samples : int
        Samples that are kept at each of them.

    Raises
    ------
    LimitExceededError
    """
    bodies, things = len(scene.bodies), len(scene.bodies) + len(scene.environment)
    rollouts = propagator.rollouts_for(scene, belief)
    remembered = _SHORT * bodies * things
    if scene.integrator == "implicit":
        remembered += bodies * (_REMEMBERED * REMEMBERED_CONTACTS + 10 * _NUMBER)
    state = _NUMBER * STATE * bodies
    errors = _NUMBER * ERROR * len(scene.moving)
    covariance = _NUMBER * (ERROR * len(scene.moving)) ** 2
    needed = rollouts * (_COPIES * (remembered + state) + 2 * errors + state)
    needed += (_MATRICES + times) * covariance + times * keep_samples * state
    needed += _PAIR * bodies * things
    what = f"{bodies} {'body' if bodies == 1 else 'bodies'} in {rollouts} rollouts, at {times} times,"
    if rollouts * bodies < times * (bodies + ERROR * keep_samples):
        require_memory(needed, what, "the number of times", times)
    elif propagator.own_sample_count is None:
        require_memory(needed, what, "the number of bodies", bodies)
    else:
        require_memory(needed, what, "samples", rollouts)
