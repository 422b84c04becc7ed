"""Detect steps without contacts in advance, to skip the search; for scenes with an environment."""

from ...compiler import inner
from ...spatial.layout import P, V, W
from ..actions import follows
from .broad_phase import may_touch, near_pairs
from .element_contacts import element_distance

_MOST_STEPS = 64  # largest number of steps ahead
UNKNOWN = -1  # number of contact-free steps ahead, at the start of a rollout


@inner(forceinline=True)
def contact_free_step(x, world, environment, work):
    """Return whether no contact is possible in the step that begins.

    Results do not depend on the answer. Without surroundings it is always False, as this test would cost as
    much as the search for pairs.
    """
    if environment is None:
        return False
    else:
        if len(environment.actions.wrench_body) > 0:
            return False
        if work.contact_free_steps[0] > 0:
            work.contact_free_steps[0] -= 1
            return True
        # recent contacts are still near; only a new rollout has to test
        if work.touching[0] and work.contact_free_steps[0] != UNKNOWN:
            return False
        work.contact_free_steps[0] = 0
        return _look_ahead(x, world, environment, work)


@inner(noinline=True)
def _look_ahead(x, world, environment, work):
    """Return whether no contact is possible in this step; store the number of further ones in ``work``."""
    ahead = work.contact_free_steps
    steps = ahead[1]
    if not _apart_for(x, world, environment, 1, work):
        ahead[1] = 1
        return False
    if steps == 1 or _apart_for(x, world, environment, steps, work):
        ahead[0], ahead[1] = steps - 1, min(2 * steps, _MOST_STEPS)
    else:
        ahead[1] = steps // 2
    return True


@inner
def _apart_for(x, world, environment, steps, work):
    """Return whether no contact is possible for a number of steps.

    The answer for one step depends only on the state. True for several steps implies True for each of them.
    """
    _write_reach(x, world, environment.actions, steps * world.dt, work)
    near, moving, reach = work.near, world.bodies.moving, work.reach
    for i in range(len(x)):
        if moving[i]:
            for e in range(len(environment.kind)):
                if element_distance(environment, e, x[i, P], x[i, P + 1], x[i, P + 2]) < reach[i]:
                    return False
    for k in range(near_pairs(x, reach, work.max_travel, moving, work)):
        # for several steps the exact test rarely pays: pairs with a separation bound are excluded already
        if steps > 1 or may_touch(x, near[k, 0], near[k, 1], world, work):
            return False
    return True


@inner
def _write_reach(x, world, actions, time, work):
    """Write the reach of bodies without contacts during ``time``, and bounds of their points' travel."""
    radius, moving, reach, max_travel = world.bodies.radius, world.bodies.moving, work.reach, work.max_travel
    fall = time * (abs(world.gravity[0]) + abs(world.gravity[1]) + abs(world.gravity[2]))
    for i in range(len(x)):
        reach[i], max_travel[i] = radius[i], 0.0
        if moving[i]:
            travel = time * (fall + abs(x[i, V]) + abs(x[i, V + 1]) + abs(x[i, V + 2]))
            reach[i] += travel
            max_travel[i] = travel + time * radius[i] * (abs(x[i, W]) + abs(x[i, W + 1]) + abs(x[i, W + 2]))
        elif follows(i, actions):
            for k in range(actions.path[i, 0], actions.path[i, 1]):
                most = time * (actions.pace[k, 0] + radius[i] * actions.pace[k, 1])
                max_travel[i] = max(max_travel[i], most)
            reach[i] += max_travel[i]
