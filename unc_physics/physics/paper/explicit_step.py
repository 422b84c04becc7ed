"""Explicit time step: drift, damping, gravity, contacts, kick, in this order (the paper's Eqs. 3 to 6).

`integrate` is the only loop over such steps. A propagator that computes more than the state adds its work in
the loop's stages (`compiler.stage`), the first functions of this module.
"""

from ...compiler import inner, stage
from ...spatial.layout import P, Q, V, W
from ...spatial.rotation import rotate, rotate_back, write_matrix
from ..actions import bound_pace, follows, push, write_on_path
from .broad_phase import near_pairs, update_separation_bound
from .contact_free import contact_free_step
from .element_contacts import next_element_contacts, open_element
from .free_motion import integrate_gyroscopic, integrate_position, integrate_rotation
from .narrow_phase import contact_sums, next_contacts, open_pair


@stage
def before_drift(method, x, step, world, work):
    """Called before each step; ``step`` is its number, and ``x`` (B, 13) and ``work.R`` precede the drift."""


@stage
def on_contacts(method, x, i, j, count, first, world, work):
    """Called with the first ``count`` recorded contacts of bodies i and j; ``first`` marks the first call."""


@stage
def after_pair(method, x, i, j, world, work):
    """Called after all contacts of bodies i and j, if there was at least one."""


@stage
def after_pairs(method, x, world, work):
    """Called after the contacts of all pairs."""


@stage
def on_element_contacts(method, x, i, e, t, count, first, world, work):
    """Called as `on_contacts`, for body i and element e; ``t`` is the body's position in its frame [m]."""


@stage
def after_element(method, x, i, e, world, work):
    """Called as `after_pair`, for body i and element e."""


@inner(noinline=True)
def integrate(x, first_time, world, environment, method, begin, steps, work):
    """Advance the state of one rollout.

    Parameters
    ----------
    x : (B, 13) array
        Changed in place.
    first_time : (B, B + E) float32 array
        `ContactHistory.first_time` of this rollout, changed in place.
    world : World
    environment : Environment or None
        Environment of the world.
    method : NamedTuple or None
        Data of a propagator for the loop's stages.
    begin, steps : int
        Number of steps done before, and of steps to do.
    work : Workspace
    """
    for step in range(begin, begin + steps):
        free = contact_free_step(x, world, environment, work)
        before_drift(method, x, step, world, work)
        drift(x, world, environment, work)
        if environment is not None:
            act(x, step, world, environment.actions, work)
        if free:
            continue
        time = (step + 1) * world.dt
        apply_pair_forces(x, first_time, time, world, method, work)
        after_pairs(method, x, world, work)
        if environment is not None:
            apply_element_forces(x, first_time, time, world, environment, method, work)
        work.touching[0] = kick(x, world, work)


@inner(forceinline=True)
def drift(x, world, environment, work):
    """Move all bodies freely for a step, then damp their velocities and apply gravity; update ``work.R``."""
    dt, decay, gravity = world.dt, world.decay, world.gravity
    for i in range(len(x)):
        if world.bodies.moving[i]:
            work.speed[i] = dt * integrate_pose(x, i, world, environment, work)
            work.travel[i] += work.speed[i]
            for k in range(3):
                x[i, V + k] = decay * x[i, V + k] + dt * gravity[k]
                x[i, W + k] *= decay


@inner
def act(x, step, world, actions, work):
    """Move prescribed bodies to their states at the step's end, and apply wrenches to velocities."""
    begin, end = step * world.dt, (step + 1) * world.dt
    for d in range(len(actions.kinematic)):
        j = actions.kinematic[d]
        if follows(j, actions):
            write_on_path(x, j, j, end, actions)
            write_matrix((x[j, Q], x[j, Q + 1], x[j, Q + 2], x[j, Q + 3]), work.R, j)
            pace, _ = bound_pace(j, begin, end, world.bodies.radius[j], actions)
            work.speed[j] = world.dt * pace
            work.travel[j] += work.speed[j]
    if len(actions.wrench_body) > 0:
        for i in range(len(x)):
            if world.bodies.moving[i]:
                push(x, i, begin, end, 1.0, world.bodies, work.R, actions)


@inner(forceinline=True)
def integrate_pose(x, i, world, environment, work):
    """Move body i freely for a step; return a bound on the speed of its points [m/s]."""
    if environment is not None:
        if environment.gyroscopic:
            pace = integrate_gyroscopic(x, i, world.dt, world.bodies, work.R)
            return pace + integrate_position(x, i, world.dt)
    pace = integrate_rotation(x, i, world.dt, world.bodies.radius, work.R)
    return pace + integrate_position(x, i, world.dt)


@inner(noinline=True)
def apply_pair_forces(x, first_time, time, world, method, work):
    """Apply all contact forces between bodies."""
    for k in range(near_pairs(x, world.bodies.radius, work.zero_travel, world.bodies.moving, work)):
        i, j = work.near[k, 0], work.near[k, 1]
        t_ij, slack, top = open_pair(x, i, j, world, work)
        touching = False
        while top > 0:
            count, top = next_contacts(world.tree, work.R_ij, t_ij, slack, work.search, top)
            if count > 0:
                apply_contact_force(x, i, j, count, world.stiffness, work)
                on_contacts(method, x, i, j, count, not touching, world, work)
                touching = True
        if touching:
            note_contact(first_time, i, j, time)
            after_pair(method, x, i, j, world, work)
        else:
            update_separation_bound(i, j, t_ij, slack, work.speed[i] + work.speed[j], world, work)


@inner(forceinline=True)
def apply_contact_force(x, i, j, count, stiffness, work):
    """Add the forces of the first ``count`` recorded contacts to the wrenches on bodies i and j."""
    force, moment = contact_sums(work.search.records, count)
    fx, fy, fz = rotate(work.R[i], force[0], force[1], force[2])
    mx, my, mz = rotate(work.R[i], moment[0], moment[1], moment[2])
    fx, fy, fz = stiffness * fx, stiffness * fy, stiffness * fz
    mx, my, mz = stiffness * mx, stiffness * my, stiffness * mz
    dx, dy, dz = x[j, P] - x[i, P], x[j, P + 1] - x[i, P + 1], x[j, P + 2] - x[i, P + 2]
    on_i, on_j = work.wrench[i], work.wrench[j]
    on_i[0] -= fx
    on_i[1] -= fy
    on_i[2] -= fz
    on_i[3] -= mx
    on_i[4] -= my
    on_i[5] -= mz
    on_j[0] += fx
    on_j[1] += fy
    on_j[2] += fz
    # the opposite forces, with the lever arm from body j's centre of mass
    on_j[3] += mx - (dy * fz - dz * fy)
    on_j[4] += my - (dz * fx - dx * fz)
    on_j[5] += mz - (dx * fy - dy * fx)
    work.touched[i] = work.touched[j] = True


@inner(noinline=True)
def apply_element_forces(x, first_time, time, world, environment, method, work):
    """Apply all contact forces of elements of the environment on moving bodies."""
    for i in range(len(x)):
        if world.bodies.moving[i]:
            for e in range(len(environment.kind)):
                t, top = open_element(x, i, e, world, environment, work)
                touching = False
                while top > 0:
                    count, top = next_element_contacts(
                        world.tree, environment, e, work.R_ij, t, world.bodies.radius[i], work.search, top
                    )
                    if count > 0:
                        apply_element_force(i, count, world.stiffness, work)
                        on_element_contacts(method, x, i, e, t, count, not touching, world, work)
                        touching = True
                if touching:
                    note_contact(first_time, i, len(x) + e, time)
                    after_element(method, x, i, e, world, work)


@inner
def apply_element_force(i, count, stiffness, work):
    """Add contact forces as `apply_contact_force`, for body i and an element of the environment."""
    force, moment = contact_sums(work.search.records, count)
    fx, fy, fz = rotate(work.R[i], force[0], force[1], force[2])
    mx, my, mz = rotate(work.R[i], moment[0], moment[1], moment[2])
    on_i = work.wrench[i]
    on_i[0] -= stiffness * fx
    on_i[1] -= stiffness * fy
    on_i[2] -= stiffness * fz
    on_i[3] -= stiffness * mx
    on_i[4] -= stiffness * my
    on_i[5] -= stiffness * mz
    work.touched[i] = True


@inner(forceinline=True)
def note_contact(first_time, i, j, time):
    """Record that body i touches body j, or element j - B."""
    first_time[i, j] = min(first_time[i, j], time)


@inner(forceinline=True)
def kick(x, world, work):
    """Apply wrenches to the velocities of touched bodies and clear them; return whether there were any."""
    any_touched = False
    for i in range(len(x)):
        if not work.touched[i]:
            continue
        any_touched = True
        work.touched[i] = False
        f = work.wrench[i]
        if world.bodies.moving[i]:
            a = world.dt * world.bodies.inverse_mass[i]
            x[i, V] += a * f[0]
            x[i, V + 1] += a * f[1]
            x[i, V + 2] += a * f[2]
            bx, by, bz = rotate_back(work.R[i], f[3], f[4], f[5])
            bx, by, bz = rotate(world.bodies.inverse_inertia[i], bx, by, bz)
            wx, wy, wz = rotate(work.R[i], bx, by, bz)
            x[i, W] += world.dt * wx
            x[i, W + 1] += world.dt * wy
            x[i, W + 2] += world.dt * wz
        for k in range(6):
            f[k] = 0.0
    return any_touched
