"""Rollouts of a batch of states: the only loop over samples."""

from ..compiler import kernel
from ..compiler.threads import in_threads
from ..compiler.time_limit import limited
from . import contact_history as histories
from .explicit_step import integrate
from .implicit_rollout import advance_implicit
from .workspace import workspace

#: Body steps, over all samples, that take less time than starting another thread.
_FEW_STEPS = 400


def rollout(states, contact_history, world, begin, steps):
    """Advance a batch of states in place.

    Rollouts are computed independently, so the result does not depend on the number of threads
    (`numba.set_num_threads`).

    Parameters
    ----------
    states : (N, B, 13) float64, C order
        One scene state per sample.
    contact_history : ContactHistory
        History of these rollouts (`contact_history.fresh`); updated in place.
    world : World
    begin : int
        Number of steps done before.
    steps : int
    """
    world = limited(world)
    each = max(states.shape[1] * steps, 1)
    if len(states) * each <= _FEW_STEPS:
        advance(states, contact_history, world, begin, steps)
        return
    in_threads(
        len(states),
        lambda some: advance(states[some], histories.samples(contact_history, some), world, begin, steps),
        fewest=_FEW_STEPS // each,
    )


def simulate(states, world, steps):
    """Advance a batch of states (N, B, 13) in place, as new rollouts."""
    rollout(states, histories.fresh(len(states), world), world, 0, steps)


def advance(states, contact_history, world, begin, steps):
    """Advance a batch as `rollout` does, in the calling thread, by the world's integrator."""
    if world.implicit is None:
        advance_explicit(states, contact_history.first_time, world, world.environment, begin, steps)
    else:
        advance_implicit(states, contact_history.first_time, contact_history.solver, world, begin, steps)


@kernel
def advance_explicit(states, first_time, world, environment, begin, steps):
    """Advance states (N, B, 13) and first contacts (N, B, B + E) in place by explicit steps."""
    for n in range(len(states)):
        integrate(
            states[n], first_time[n], world, environment, None, begin, steps, workspace(states[n], world)
        )
