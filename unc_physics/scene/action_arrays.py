"""Convert the actions of bodies to arrays for the kernels (`physics.paper.actions`)."""

from __future__ import annotations

import numpy as np

from ..physics.actions import Actions, no_actions

#: Density of air at 20 degrees C and sea level [kg/m^3].
AIR_DENSITY = 1.2


def actions_of(bodies, environment) -> Actions:
    """Return the actions on ``bodies`` in an ``environment`` as arrays."""
    names = [body.name for body in bodies]
    paths = [k for k, body in enumerate(bodies) if body.trajectory is not None]
    held = [k for k, body in enumerate(bodies) if body.attached_to is not None]
    pushed = [(k, wrench) for k, body in enumerate(bodies) for wrench in body.wrenches]
    slowed = [k for k, body in enumerate(bodies) if body.drag]
    actions = no_actions(len(bodies))
    if paths:
        own = [bodies[k].trajectory for k in paths]
        ends = np.cumsum([0, *(len(path.times) for path in own)])
        ranges = actions.path.copy()
        ranges[paths] = np.column_stack([ends[:-1], ends[1:]])
        actions = actions._replace(
            path=ranges,
            time=np.concatenate([path.times for path in own]),
            pose=np.concatenate([path.states for path in own]),
            turn=np.concatenate([path.turns for path in own]),
            pace=np.concatenate([path.paces for path in own]),
        )
    for k in held:
        actions.carrier[k] = names.index(bodies[k].attached_to)
        actions.held[k] = bodies[k].attached_at, bodies[k].released
    if pushed or slowed:
        none, always = [0.0] * 6, [-np.inf, np.inf]
        actions = actions._replace(
            wrench_body=np.array([*(k for k, _ in pushed), *slowed]),
            wrench=np.array(
                [*([*wrench.force, *wrench.torque] for _, wrench in pushed), *([none] * len(slowed))]
            ),
            wrench_time=np.array(
                [*([wrench.start, wrench.end] for _, wrench in pushed), *([always] * len(slowed))]
            ),
            wrench_local=np.array([*(wrench.body_axes for _, wrench in pushed), *([False] * len(slowed))]),
            wrench_drag=np.array(
                [*([0.0] * len(pushed)), *(0.5 * AIR_DENSITY * bodies[k].drag for k in slowed)]
            ),
        )
    moves = [element.moving_surface for element in environment]
    if any(row.any() for row in moves):
        actions = actions._replace(surface=np.array(moves))
    return actions._replace(kinematic=np.array([*paths, *held], np.int64))
