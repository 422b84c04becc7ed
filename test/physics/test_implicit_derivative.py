"""Linearization on the implicit step against central differences of what it is the derivative of.

A single contact of a ball is solved to round-off, so whole rollouts are differentiated. Several are solved to
a thousandth of the load, which is more than a difference can bear: their steps are solved again and again
from where the solver stopped, until nothing changes, and then differentiated.
"""

import math

import numpy as np
import pytest
from plain_scenes import BALL, BLOCK, packing, run, state
from scipy.spatial.transform import Rotation
from twins.states import boxminus, boxplus

from unc_physics import Belief, RigidBody, Scene, make_propagator
from unc_physics.physics import implicit_step
from unc_physics.physics.compiled import kernel
from unc_physics.physics.contact_change import TILTS
from unc_physics.physics.contact_search import find_groups, update_pace
from unc_physics.physics.flight_derivative import Errors
from unc_physics.physics.implicit_derivative import ContactErrors
from unc_physics.physics.implicit_stages import before_group, before_travel
from unc_physics.physics.implicit_workspace import CONTACTS, FORCE, LASTING, implicit_workspace
from unc_physics.physics.layout import Q
from unc_physics.physics.rotation import write_matrix
from unc_physics.propagators.implicit_linearization import Linearized
from unc_physics.scene.environment import Plane, Sphere
from unc_physics.scene.stiffness import with_stiffness

CLOSE = 1e-5  # of the largest entry
FLOOR = Plane(name="floor")
CORNERS = packing(
    "corners",
    [(x, y, z) for x in (-0.06, 0.06) for y in (-0.04, 0.04) for z in (-0.01, 0.01)],
    [0.01] * 8,
    BLOCK.inertia,
)
CAN = packing("can", [(0, -0.05, 0), (0, 0.05, 0)], [0.03] * 2, np.diag([2.5e-3, 4e-4, 2.5e-3]))


def world(*bodies, environment=(FLOOR,), **physics):
    return Scene.everyday(bodies, environment=environment, **{"restitution": 0.0} | physics)


def turned(*rotation_vector):
    return Rotation.from_rotvec(rotation_vector).as_quat()


def ball(x=0.0, z=0.1, velocity=(1.0, 0.2, -0.5), spin=(3.0, -2.0, 5.0)):
    return state((x, 0, z), velocity, spin)


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
    """The same by linearization: a root of the unit covariance goes through it."""
    propagator = make_propagator("linearization")
    unit = np.tile(np.eye(12), (len(scene.moving), 1, 1))
    carry = propagator.init(scene, Belief(x, unit, scene.moving))
    start = np.linalg.inv(carry.root)
    np.testing.assert_allclose(carry.mean, x, atol=1e-12, err_msg="nothing to project away")
    return propagator.advance(carry, scene, round(time / scene.dt)).root @ start


@pytest.mark.parametrize(
    "bodies, x, time, more",
    [
        ([BLOCK], [state((0, 0, 1), (1, 0.2, 0), (3, -2, 5), turned(0.3, 0.2, 0.1))], 0.2, {}),
        ([BALL], [ball()], 0.2, {"restitution": 0.6, "friction": 0.1}),
        ([BALL], [ball(velocity=(0.3, 0.2, -0.5))], 0.2, {"restitution": 0.6, "friction": 0.9}),
        ([BALL], [ball()], 0.9, {"restitution": 0.8, "friction": 0.1}),
        ([BALL], [ball()], 0.15, {"friction": 0.1}),
        ([BALL], [ball(z=0.0501, velocity=(1, 0, 0), spin=(0, 5, 0))], 0.3, {"friction": 0.2}),
        ([BALL], [ball(z=0.0501, velocity=(0.5, 0, 0), spin=(0, 10, 0))], 0.3, {"friction": 0.5}),
        ([BALL], [ball(z=0.25)], 0.3, {"restitution": 0.5, "environment": [Sphere(0.1, (0.1, 0.05, 0))]}),
        (  # with much friction, normal and friction depend on each other, and are not solved well enough
            [CORNERS],
            [state((0, 0, 0.16), (0.2, 0, -0.5), (1, 2, 0), turned(0.5, 0.6, 0))],
            0.12,
            {"friction": 0.05},
        ),
        (
            [BALL, BALL],
            [ball(-0.08, 0.3, (1, 0.1, 0)), ball(0.08, 0.32, (-0.5, 0, 0))],
            0.2,
            {"restitution": 0.7, "gyroscopic": False, "damping": 0.3},
        ),
    ],
    ids=[
        "flight",
        "slips",
        "sticks",
        "thrice",
        "stays",
        "slides",
        "rolls",
        "on a sphere",
        "corner",
        "two balls",
    ],
)
def test_a_rollout_s_derivative_is_that_of_differences(bodies, x, time, more):
    x = np.array(x)
    scene = with_stiffness(world(*(RigidBody(f"b{k}", m, 0.3) for k, m in enumerate(bodies)), **more), x)
    found = difference(lambda s: run(scene, s, time), x, scene.moving, 1e-6)
    np.testing.assert_allclose(derivative(scene, x, time), found, rtol=0, atol=CLOSE * np.abs(found).max())


# -- several contacts --------------------------------------------------------------------------------


@kernel
def converge(x, root, world, work, method, times):
    """One step of all moving bodies as one group, solved ``times`` times, each from the one before."""
    begin, columns, count = x.copy(), root.copy(), 0
    residual = np.zeros(len(x), np.float32)
    first_time = np.full((len(x), len(x) + len(world.surroundings.kind)), np.inf, np.float32)
    force = np.zeros((len(work.rows), 3))
    for k in range(times):
        x[:], root[:] = begin, columns
        count = 0
        for i in range(len(x)):
            work.head[i] = -1
            write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), work.R, i)
            if world.bodies.moving[i]:
                update_pace(x, i, world.bodies.radius[i], world.gravity, world.dt, work.numbers)
                work.members[count] = i
                count += 1
        find_groups(x, world, work)
        implicit_step.prepare_members(x, count, world, work)
        implicit_step.find_contacts(x, count, world.dt, world, work)
        if k > 0:
            work.rows[:, FORCE : FORCE + 3] = force
        method.time[0] = 0.0
        before_group(method, count, world, work)
        before_travel(method, x, count, world.dt, world.dt, 0.1, world, work)
        implicit_step.travel_in_contact(
            x, count, world.dt, world.dt, 0.0, first_time, residual, world, 0.1, method, work
        )
        force[:] = work.impulses[LASTING, :, :3] / world.dt
    return work.counts[CONTACTS]


def solved(scene, x, root, steps=1, times=400):
    """State and root after some converged steps."""
    x, root, count, columns = x.copy(), root.copy(), len(x), root.shape[1]
    for _ in range(steps):
        work = implicit_workspace(x, np.zeros((0, 0), np.float32), scene.world, 256, 4096, 65536)
        shape = (len(root) + 12, columns)
        block = np.where(scene.world.bodies.moving, np.cumsum(scene.world.bodies.moving) - 1, len(root) // 12)
        errors = Errors(
            np.zeros(shape),
            np.zeros(shape),
            block,
            np.zeros(columns),
            np.zeros(columns),
            np.zeros((3, columns)),
            np.zeros((1, 3, 3)),
        )
        contacts = ContactErrors(
            np.zeros(256),
            np.zeros((256, 11)),
            TILTS.copy(),
            np.zeros(count, np.int64),
            np.zeros((6 * count, 6 * count + columns)),
            np.zeros(count, bool),
            np.zeros(columns + 1),
        )
        method = Linearized(root, root.copy(), errors, contacts, np.full(count, np.inf), np.zeros(1))
        assert converge(x, root, scene.world, work, method, times) > 0
    return x, root


SLOPE = 0.3  # rad
INCLINE = Plane((-math.sin(SLOPE), 0, math.cos(SLOPE)), name="incline")
DEPTH = 2.5e-5  # m, about as deep as the block lies
DIFFERENCE = 1e-9  # m or rad: far below the depth, by whose square the force goes


def assert_derivative_of_steps(scene, x, steps):
    scene = with_stiffness(scene, x)
    size = 12 * len(x)
    root = solved(scene, x, np.eye(size), steps)[1]
    found = difference(lambda s: solved(scene, s, np.zeros((size, 1)), steps)[0], x, scene.moving, DIFFERENCE)
    ROUND_OFF_OF_DIFFERENCES = 2.0  # they are taken over a nanometre
    np.testing.assert_allclose(
        root, found, rtol=0, atol=ROUND_OFF_OF_DIFFERENCES * CLOSE * np.abs(found).max()
    )


@pytest.mark.parametrize(
    "velocity, spin, slope, friction, steps",
    [
        ((0, 0, 0), (0, 0, 0), 0.0, 0.5, 1),
        ((0, 0, 0), (0, 0, 0), 0.0, 0.5, 3),
        ((1, 0.2, 0), (0, 0, 1), 0.0, 0.3, 3),
        # Only one step: in the next, contacts lie a micrometre deeper than others, so that friction at one
        # holds what turns about another. By how much is left to the order in which they are solved, which a
        # nanometre changes.
        ((0, 0, 0), (0, 0, 0), SLOPE, 0.5, 1),
        ((-0.3, 0.1, 0), (0, 0, 0), SLOPE, 0.2, 3),
    ],
    ids=["lies", "lies on", "slides", "holds on an incline", "slides on an incline"],
)
def test_a_block_s_steps_have_the_derivative_of_differences(velocity, spin, slope, friction, steps):
    tilt = Rotation.from_rotvec((0, -slope, 0))
    x = state(tilt.apply((0, 0, 0.02 - DEPTH)), tilt.apply(velocity), spin, tilt.as_quat())[None]
    scene = world(
        RigidBody("block", BLOCK, 0.5),
        environment=[INCLINE if slope else FLOOR],
        friction=friction,
        gyroscopic=False,
    )
    assert_derivative_of_steps(scene, x, steps)


@pytest.mark.parametrize(
    "spin, friction", [((0, 10, 0), 0.3), ((0, 5, 0.1), 0.1)], ids=["rolls", "rolls and slips"]
)
def test_a_can_s_steps_have_the_derivative_of_differences(spin, friction):
    x = state((0, 0, 0.03 - DEPTH), (0.3, 0, 0), spin)[None]
    scene = world(RigidBody("can", CAN, 0.5), friction=friction, gyroscopic=False)
    assert_derivative_of_steps(scene, x, 6)


@pytest.mark.parametrize("friction", [0.0, 0.05, 0.3])
def test_what_moves_on_another_has_the_derivative_of_differences(friction):
    """Where it is a single sphere; several that lie on several others are two faces, not what they are."""
    low = state((0, 0, 0.05 - 1.5 * DEPTH), (0.3, 0, 0))
    high = state((0.01, 0, 0.05 - 3.0 * DEPTH + math.sqrt(0.0099)), (0.3, 0.1, 0), (0, 1, 0))
    bodies = [RigidBody(name, BALL, 0.5) for name in ("low", "high")]
    scene = world(*bodies, friction=friction, gyroscopic=False)
    assert_derivative_of_steps(scene, np.array([low, high]), 3)
