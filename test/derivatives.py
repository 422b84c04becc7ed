"""Derivatives of the implicit step by central differences, and by linearization.

A single contact of a ball is solved to round-off, so whole rollouts are differentiated. Several are solved to
a thousandth of the load, which is more than a difference can bear: their steps are solved again and again
from where the solver stopped, until nothing changes, and then differentiated.
"""

import numpy as np
from twins.states import boxminus, boxplus

from unc_physics import Belief, make_propagator
from unc_physics.collision.contact_row import FORCE
from unc_physics.collision.contact_search import ACTIVE_GAP, find_groups, update_pace
from unc_physics.collision.implicit_workspace import CONTACTS, LASTING, implicit_workspace
from unc_physics.compiler import kernel
from unc_physics.derivatives.rolling import TILTS
from unc_physics.dynamics import implicit_step
from unc_physics.dynamics.implicit_stages import (
    after_groups,
    before_contact,
    before_group,
    before_groups,
    before_travel,
)
from unc_physics.dynamics.implicit_world import Rollout
from unc_physics.dynamics.kinematic_bodies import begin_kinematic, end_kinematic, place_kinematic
from unc_physics.propagators.action_directions import directions
from unc_physics.propagators.implicit_linearization import linearized
from unc_physics.scene.stiffness import with_stiffness
from unc_physics.spatial.layout import Q
from unc_physics.spatial.rotation import write_matrix

CLOSE = 1e-5  # of the largest entry
ROUND_OFF_OF_DIFFERENCES = 2.0  # where they are taken over a nanometre
DIFFERENCE = 1e-9  # m or rad: far below the depth, by whose square the force goes


def difference(step, x, moving, length):
    """(12 M, 12 M): central differences of states (B, 13) by errors."""
    columns = []
    for k in range(12 * len(moving)):
        ends = []
        for sign in (1.0, -1.0):
            error = np.zeros((len(x), 12))
            error[moving[k // 12], k % 12] = sign * length
            ends.append(step(boxplus(x, error)))
        columns.append(boxminus(*ends)[moving].ravel() / (2.0 * length))
    return np.array(columns).T


def derivative(scene, x, time):
    """The same by linearization, of which the last columns are uncertain parameters of actions, if there are
    some.
    """
    propagator, size = make_propagator("linearization"), 12 * len(scene.moving)
    unit = np.tile(np.eye(12), (len(scene.moving), 1, 1))
    carry = propagator.init(scene, Belief(x, unit, scene.moving))
    np.testing.assert_allclose(carry.mean, x, atol=1e-12, err_msg="nothing to project away")
    parameters = carry.root[:, carry.root.shape[1] - len(scene.uncertain) :]
    carry = carry._replace(root=np.concatenate([np.eye(size), parameters], axis=1))
    return propagator.advance(carry, scene, round(time / scene.dt)).root


@kernel
def converge(x, root, time, world, work, method, times):
    """One step of all moving bodies as one group, solved ``times`` times, each from the one before.

    It ends at a time [s].
    """
    begin, columns, count = x.copy(), root.copy(), 0
    rest_steps = np.zeros(len(x), np.int64)
    rollout = Rollout(
        np.full((len(x), len(x) + len(world.environment.kind)), np.inf, np.float32),
        np.zeros((0, 4), np.int32),
        np.zeros((0, 4), np.float32),
        np.zeros(1, np.int64),
        rest_steps,
        np.zeros(len(x), np.float32),
        np.uint64(0),
        0.1,
        0.1,
    )
    force = np.zeros((len(work.rows), 3))
    for k in range(times):
        x[:], root[:], work.state[:] = begin, columns, begin
        count = 0
        for i in range(len(x)):
            work.head[i] = -1
            write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), work.R, i)
        begin_kinematic(x, time - world.dt, rest_steps, world, work)
        method.time[0] = time
        before_groups(method, x, time - world.dt, world, work)
        for i in range(len(x)):
            if work.moving[i]:
                update_pace(x, i, world.bodies.radius[i], world.gravity, world.dt, work.numbers)
                work.members[count] = i
                count += 1
        find_groups(x, world, work)
        place_kinematic(x, count, time - world.dt, world, work)
        implicit_step.prepare_members(x, count, world, work)
        before_group(method, count, world, work)
        implicit_step.find_contacts(x, count, 0.0, world.dt, ACTIVE_GAP, False, world, work)
        before_travel(method, x, count, world.dt, world.dt, 0.1, world, work)
        implicit_step.travel_to_contacts(x, count, world.dt, time, True, world, work)
        if k > 0:
            work.rows[:, FORCE : FORCE + 3] = force
        before_contact(method, x, count, world, work)
        implicit_step.push_apart(x, count, world.dt, time, rollout, world, method, work)
        end_kinematic(x, time, world, work)
        after_groups(method, x, time, world, work)
        force[:] = work.impulses[LASTING, :, :3] / world.dt
    return work.counts[CONTACTS]


def solved(scene, x, root, steps=1, times=400):
    """State and root after some converged steps."""
    x, root = x.copy(), root.copy()
    for k in range(steps):
        work = implicit_workspace(x, np.zeros((0, 0), np.float32), scene.world, (256, 4096, 65536))
        some, never = directions(scene, root.shape[1]), np.full(len(x), np.inf)
        method = linearized((root, never, some, TILTS), scene.world, work, 256)
        assert converge(x, root, (k + 1) * scene.dt, scene.world, work, method, times) > 0
    return x, root


def assert_derivative_of_steps(scene, x, steps, times=400):
    """Of converged steps of a state (B, 13)."""
    scene = with_stiffness(scene, x)
    size = 12 * len(scene.moving)
    root = solved(scene, x, np.eye(size), steps, times)[1]
    found = difference(
        lambda s: solved(scene, s, np.zeros((size, 1)), steps, times)[0], x, scene.moving, DIFFERENCE
    )
    np.testing.assert_allclose(
        root, found, rtol=0, atol=ROUND_OFF_OF_DIFFERENCES * CLOSE * np.abs(found).max()
    )
