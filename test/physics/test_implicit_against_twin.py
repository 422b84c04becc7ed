"""Each stage of the implicit step equals its plain NumPy twin."""

import numpy as np
import pytest
from plain_scenes import BALL, BLOCK, PLATE, state
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from twins import implicit_step as twin

from unc_physics import RigidBody, Scene, load_model
from unc_physics.physics import implicit_solver, implicit_step
from unc_physics.physics.compiled import kernel
from unc_physics.physics.contact_patch import (
    IMPACT_GAP,
    TILT,
    add_contacts,
    element_candidates,
    pair_candidates,
)
from unc_physics.physics.contact_row import (
    AXIS,
    BEND,
    COMPLIANCE,
    DIRECTION,
    FRICTION,
    GAP,
    MOMENT_I,
    MOMENT_J,
    RADIUS,
    RESTITUTION,
    SLIP_COMPLIANCE,
)
from unc_physics.physics.contact_search import ACTIVE_GAP, find_groups, update_pace
from unc_physics.physics.hull import hull_spheres
from unc_physics.physics.impact_time import time_to_impact
from unc_physics.physics.implicit_workspace import (
    CONTACTS,
    ELASTIC,
    FREE,
    LASTING,
    NOW,
    PLASTIC,
    implicit_workspace,
)
from unc_physics.scene.environment import Box, Capsule, Cylinder, Plane, Sphere
from unc_physics.scene.stiffness import with_stiffness

H = 1.0 / 240.0
THRESHOLD = 0.1  # m/s, above which closing is an impact


# -- wrappers: what kernels alone may call -----------------------------------------------------------


@kernel
def prepare(x, world, work):
    """All moving bodies as one group, with nothing remembered."""
    count = 0
    for i in range(len(x)):
        work.head[i] = -1
        if world.bodies.moving[i]:
            update_pace(x, i, world.bodies.radius[i], world.gravity, world.dt, work.numbers)
            work.members[count] = i
            count += 1
    find_groups(x, world, work)
    implicit_step.prepare_members(x, count, world, work)
    return count


@kernel
def candidates_of(x, i, j, horizon, world, work):
    limit = IMPACT_GAP if horizon == 0.0 else ACTIVE_GAP
    if j < 0:
        return element_candidates(x, i, -1 - j, limit, horizon, world, work)
    return pair_candidates(x, i, j, limit, horizon, world, work)


@kernel
def choose(x, i, j, found, world, work):
    work.counts[CONTACTS] = 0
    add_contacts(x, i, j, found, TILT, world, work)


@kernel
def find(x, count, horizon, world, work):
    implicit_step.find_contacts(x, count, horizon, world, work)
    implicit_step._read_velocities(x, count, work.members, work.velocity)


@kernel
def first_impact(left, world, work):
    return time_to_impact(left, 0.1, 0.0, work)


@kernel
def solve_impact(count, work):
    work.impulses[PLASTIC] = 0.0
    return implicit_solver.solve_impact(
        work.rows, work.twists, work.ids, work.counts, work.impulses, work.members, count, work.velocity, 0.1
    )


@kernel
def travel_in_contact(x, count, h, first_time, residual, world, work):
    implicit_step.travel_in_contact(x, count, h, h, 0.0, first_time, residual, world, 0.1, None, work)


@kernel
def travel_freely(x, i, h, world, work):
    implicit_step.travel_freely(x, i, h, h, world.decay, world, work.R)


# -- scenes ------------------------------------------------------------------------------------------


class Stage:
    """One rollout at the beginning of a step."""

    def __init__(self, scene, x):
        self.x = np.array(x, float).reshape(-1, 13)
        self.scene = with_stiffness(scene, self.x)
        self.world = self.scene.world
        self.work = implicit_workspace(self.x, np.zeros((0, 0), np.float32), self.world, 256, 4096, 65536)
        self.count = prepare(self.x, self.world, self.work)

    def candidates(self, i, j, horizon):
        """(spheres, gaps, predicted gaps), by the spheres' numbers in their own bodies."""
        found = candidates_of(self.x, i, j, horizon, self.world, self.work)
        ids, numbers = self.work.candidate_ids[:found], self.work.candidates[:found]
        return {
            self.spheres(i, j, a, b): tuple(row)
            for (a, b, _, _), row in zip(ids, numbers[:, 6:8], strict=True)
        }, found

    def spheres(self, i, j, a, b):
        """Numbers of two of the trees' spheres in their own bodies."""
        first = self.first_spheres
        return int(a - first[i]), int(b - first[j]) if j >= 0 else 0

    @property
    def first_spheres(self):
        models = list(dict.fromkeys(body.model for body in self.scene.bodies))
        begin = dict(zip(models, np.cumsum([0, *map(len, models)]), strict=False))
        return [begin[body.model] for body in self.scene.bodies]

    @property
    def hull(self):
        """Which spheres of a scene's only body can touch a plane."""
        return set(self.world.implicit.hull_sphere.tolist())

    def find(self, horizon):
        """Find all contacts: (rows, twin's contacts for them)."""
        find(self.x, self.count, horizon, self.world, self.work)
        m, contacts = self.work.counts[CONTACTS], []
        for i, j, a, b in self.work.ids[:m]:
            here = {(c.a, c.b): c for c in twin.candidates(self.scene, self.x, i, j, horizon)}
            contacts.append(here[self.spheres(i, j, a, b)])
        return self.work.rows[:m], contacts


def turned(*rotation_vector):
    return Rotation.from_rotvec(rotation_vector).as_quat()


ELEMENTS = {
    "plane": Plane((0.1, -0.2, 1.0)),
    "box": Box((0.1, 0.06, 0.2), (0.03, 0.02, -0.1)),
    "face": Box((1.0, 1.0, 0.2), (0, 0, -0.1)),
    "sphere": Sphere(0.2, (0.02, 0.01, -0.2)),
    "cylinder": Cylinder(0.05, 0.4, (0, 0.01, -0.05), turned(0, np.pi / 2, 0)),
    "capsule": Capsule(0.05, 0.1, (0, 0.01, -0.05), turned(0, np.pi / 2, 0)),
}

FLAT = ("plane", "face")  # of which the hull alone is asked


def on_element(name, seed=0):
    """A brick about to touch an element."""
    rng, element = np.random.default_rng(seed), ELEMENTS[name]
    body = RigidBody("b", load_model("brick").prefix(300), 0.7, friction=0.3, restitution=0.4)
    x = state((0, 0, 1), rng.normal(0, 0.5, 3), rng.normal(0, 2, 3), turned(*rng.normal(0, 0.01, 3)))
    for _ in range(50):  # down to the surface
        x[2] -= (element.surface(twin.centers(body, x))[0] - body.model.radii).min()
    return Stage(Scene.everyday([body], environment=[element]), x)


def pile(seed=0):
    """Two bricks, one on a can that is fixed, about to touch each other; on a floor."""
    rng = np.random.default_rng(seed)
    brick, can = load_model("brick").prefix(200), load_model("can").prefix(200)
    bodies = [
        RigidBody("a", brick, 0.5, friction=0.8),
        RigidBody("can", can, fixed=True, friction=0.2),
        RigidBody("b", brick, 1.5),
    ]
    x = np.array(
        [
            state((0, 0, 1), rng.normal(0, 0.1, 3), rng.normal(0, 1, 3), turned(*rng.normal(0, 0.3, 3)))
            for _ in bodies
        ]
    )
    x[1, 2] = 0.0
    x[1, 3:6] = x[1, 10:] = 0.0
    for k, below in ((0, 1), (2, 0)):
        for _ in range(60):
            away = twin.centers(bodies[k], x[k])[:, None] - twin.centers(bodies[below], x[below])[None]
            gap = (
                np.linalg.norm(away, axis=2) - bodies[k].model.radii[:, None] - bodies[below].model.radii
            ).min()
            x[k, 2] -= 0.9 * (gap - 5e-5)
    floor = min((twin.centers(b, s)[:, 2] - b.model.radii).min() for b, s in zip(bodies, x, strict=True))
    return Stage(Scene.everyday(bodies, environment=[Plane((0, 0, 1), floor)]), x)


# -- finding contacts --------------------------------------------------------------------------------


@pytest.mark.parametrize("horizon", [0.0, H])
@pytest.mark.parametrize("name", ELEMENTS)
def test_candidates_at_an_element_are_all_that_come_near(name, horizon):
    stage = on_element(name)
    found, _ = stage.candidates(0, -1, horizon)
    expected = {
        (c.a, c.b): (c.gap, c.predicted) for c in twin.candidates(stage.scene, stage.x, 0, -1, horizon)
    }
    if name in FLAT:
        expected = {spheres: gaps for spheres, gaps in expected.items() if spheres[0] in stage.hull}
    assert found.keys() == expected.keys() and found
    for spheres, gaps in found.items():
        np.testing.assert_allclose(gaps, expected[spheres], atol=1e-12)


@pytest.mark.parametrize("horizon", [0.0, H])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("pair", [(0, 1), (0, 2)])
def test_candidates_of_two_bodies_are_all_pairs_that_come_near(pair, seed, horizon):
    stage = pile(seed)
    found, _ = stage.candidates(*pair, horizon)
    expected = {
        (c.a, c.b): (c.gap, c.predicted) for c in twin.candidates(stage.scene, stage.x, *pair, horizon)
    }
    assert found.keys() == expected.keys() and found
    for spheres, gaps in found.items():
        np.testing.assert_allclose(gaps, expected[spheres], atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("case", [*ELEMENTS, "pair"])
def test_a_patch_is_reduced_to_its_supports(case, seed):
    stage, j = (pile(seed), 2) if case == "pair" else (on_element(case, seed), -1)
    _, count = stage.candidates(0, j, H)
    choose(stage.x, 0, j, count, stage.world, stage.work)
    chosen = {stage.spheres(0, j, a, b) for _, _, a, b in stage.work.ids[: stage.work.counts[CONTACTS]]}
    found = twin.candidates(stage.scene, stage.x, 0, j, H)
    assert chosen == twin.reduced([c for c in found if case not in FLAT or c.a in stage.hull], stage.x[0])


@pytest.mark.parametrize("make", [pile, lambda: on_element("cylinder")], ids=["pile", "cylinder"])
def test_rows_have_the_contacts_jacobians(make):
    stage = make()
    rows, contacts = stage.find(H)
    J, inverse_mass = twin.jacobian(contacts, stage.x), twin.inverse_mass(stage.scene, stage.x)
    own = np.einsum("ij,jk,ik->i", J, inverse_mass, J).reshape(-1, 3)
    assert len(contacts) > 0
    for k, (row, c) in enumerate(zip(rows, contacts, strict=True)):
        for d in range(3):
            expected = J[3 * k + d].reshape(-1, 6)
            np.testing.assert_allclose(row[DIRECTION + AXIS * d :][:3], expected[c.i, :3], atol=1e-12)
            np.testing.assert_allclose(row[MOMENT_I + AXIS * d :][:3], expected[c.i, 3:], atol=1e-12)
            if c.j >= 0:
                np.testing.assert_allclose(row[MOMENT_J + AXIS * d :][:3], -expected[c.j, 3:], atol=1e-12)
        assert row[GAP] == pytest.approx(c.gap, abs=1e-12) and row[RADIUS] == pytest.approx(c.radius)
        assert row[COMPLIANCE] == pytest.approx(own[k, 0]) and row[SLIP_COMPLIANCE] == pytest.approx(
            own[k, 1:].max()
        )
        assert row[BEND] == pytest.approx(twin.bend(c, stage.x), abs=1e-9)
        for column, values in (
            (FRICTION, stage.world.implicit.friction),
            (RESTITUTION, stage.world.implicit.restitution),
        ):
            assert row[column] == pytest.approx(twin.mean_of(values, c, len(stage.x)))


@pytest.mark.parametrize("model", ["salt_box", "can", "mug", "bowl", "bottle", "bunny"])
def test_the_hull_touches_every_plane_that_the_packing_touches(model):
    packing = load_model(model).prefix(500)
    kept = hull_spheres(np.array(packing.centers), np.array(packing.radii))
    directions = np.random.default_rng(0).normal(size=(5000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    heights = packing.centers @ directions.T + packing.radii[:, None]
    assert 0 < len(kept) < len(packing) and (np.diff(kept) > 0).all()
    np.testing.assert_allclose(
        heights[kept].max(axis=0), heights.max(axis=0), atol=1e-7 * packing.bounding_radius
    )


# -- lasting contacts --------------------------------------------------------------------------------


def lasting_law(stage, rows, contacts, before, h):
    """The twin's law for contacts that a kernel found, at the velocities before and without contacts."""
    J = twin.jacobian(contacts, before)
    start, free = twin.velocities(before), stage.work.velocity[FREE, :, :6].ravel()
    fall = np.array([twin.fall(stage.scene, c, before) for c in contacts])
    open_after = rows[:, GAP] + h * ((J @ start)[::3] + 0.5 * h * fall) > 0.0
    fast = (rows[:, GAP] > twin.TOUCHING) & (-(J @ free)[::3] > THRESHOLD) & open_after
    return twin.Lasting(
        J,
        twin.inverse_mass(stage.scene, before),
        free,
        (J @ start)[::3],
        rows[:, GAP],
        rows[:, BEND],
        stage.scene.stiffness * np.pi * rows[:, RADIUS],
        rows[:, FRICTION],
        h,
        np.where(fast, 0.0, stage.scene.dt),
    )


def travel(stage, h=H):
    """Let a stage's contacts act; returns (law, impulses, state before)."""
    rows, contacts = stage.find(h)
    before, residual = stage.x.copy(), np.zeros(len(stage.x))
    first_time = np.full((len(stage.x), len(stage.x) + 1), np.inf)
    travel_in_contact(stage.x, stage.count, h, first_time, residual, stage.world, stage.work)
    m = len(contacts)
    return lasting_law(stage, rows, contacts, before, h), stage.work.impulses[LASTING, :m, :3].copy(), before


def resting(name, depth=2e-5, velocity=(0.02, 0.01, 0.0), spin=(0, 0, 0.1)):
    """Something that lies on a floor and slides a little."""
    models = {"ball": BALL, "block": BLOCK, "plate": PLATE}
    body = RigidBody("b", models[name], 0.7)
    low = (body.model.centers[:, 2] - body.model.radii).min()
    return Stage(Scene.everyday([body], environment=[Plane()]), state((0, 0, -low - depth), velocity, spin))


CASES = {
    **{name: lambda name=name: resting(name) for name in ("ball", "block", "plate")},
    "rolling": lambda: resting("ball", velocity=(1, 0, 0), spin=(0, 20, 0)),
    "sticking": lambda: resting("block", velocity=(0, 0, 0), spin=(0, 0, 0)),
    "sliding": lambda: resting("block", velocity=(1, 0.5, 0)),
    "pile": lambda: pile(1),
}


@pytest.mark.parametrize("case", CASES)
def test_lasting_contacts_obey_their_law(case):
    law, impulses, _ = travel(CASES[case]())
    load = impulses[:, 0].max()
    assert load > 0.0
    assert np.abs(law.own_residual(impulses)).max() < 1e-3 * load
    assert np.abs(law.residual(impulses)).max() < 5e-3 * load
    assert (np.linalg.norm(impulses[:, 1:], axis=1) <= law.friction * impulses[:, 0] * (1.0 + 1e-9)).all()


@pytest.mark.parametrize(
    "case, tolerance",
    [
        ("ball", 1e-6),
        ("rolling", 1e-6),
        ("block", 1e-3),
        ("plate", 1e-3),
        ("sticking", 1e-3),
        ("sliding", 1e-3),
    ],
)
def test_lasting_contacts_move_bodies_as_a_general_solver_says(case, tolerance):
    """One contact is solved exactly, several to the sweeps' tolerance."""
    stage = CASES[case]()
    law, impulses, _ = travel(stage)
    found, missed = twin.solution(law, impulses[:, 0].max())
    assert missed < 1e-7
    expected = law.free + law.inverse_mass @ law.J.T @ found.ravel()
    change = np.abs(expected - law.free).max()
    np.testing.assert_allclose(twin.velocities(stage.x), expected, rtol=0, atol=tolerance * change)


@pytest.mark.parametrize("case", CASES)
def test_bodies_in_contact_travel_by_the_mean_of_their_velocities(case):
    stage = CASES[case]()
    law, impulses, before = travel(stage)
    ends = (law.free + law.inverse_mass @ law.J.T @ impulses.ravel()).reshape(-1, 6)
    for k in stage.scene.moving:
        if not stage.work.loaded[k]:
            continue
        np.testing.assert_allclose(np.concatenate([stage.x[k, 3:6], stage.x[k, 10:]]), ends[k], atol=1e-10)
        pose = twin.travelled(before[k], ends[k], H)
        np.testing.assert_allclose(stage.x[k, :3], pose[:3], atol=1e-12)
        assert abs(pose[3:] @ stage.x[k, 6:10]) == pytest.approx(1.0, abs=1e-12)


# -- impacts -----------------------------------------------------------------------------------------


def falling(name, e, mu, seed):
    """Something that touches a floor, tilted, and falls, slides and spins."""
    rng = np.random.default_rng(seed)
    body = RigidBody("b", {"ball": BALL, "block": BLOCK, "plate": PLATE}[name], 0.7)
    x = state(
        (0, 0, 0), (*rng.normal(0, 1, 2), -1.5), rng.normal(0, 3, 3), turned(*rng.normal(0, 1e-4, 2), 0.3)
    )
    x[2] -= (twin.centers(body, x)[:, 2] - body.model.radii).min() - 1e-5
    return Stage(Scene.everyday([body], environment=[Plane()], friction=mu, restitution=e), x)


def meeting(name, e, mu, seed):
    """Two of them meet in the air."""
    rng = np.random.default_rng(seed)
    model = {"ball": BALL, "block": BLOCK, "plate": PLATE}[name]
    bodies = [RigidBody("a", model, 0.7), RigidBody("b", model, 0.2)]
    x = np.array(
        [
            state(
                (0, 0, 2 * k),
                rng.normal(0, 0.3, 3) - (0, 0, k),
                rng.normal(0, 2, 3),
                turned(*rng.normal(0, 0.5, 3)),
            )
            for k in range(2)
        ]
    )
    for _ in range(80):
        away = twin.centers(bodies[1], x[1])[:, None] - twin.centers(bodies[0], x[0])[None]
        x[1, 2] -= 0.9 * ((np.linalg.norm(away, axis=2) - model.radii[:, None] - model.radii).min() - 1e-5)
    return Stage(Scene.everyday(bodies, gravity=None, friction=mu, restitution=e), x)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("e, mu", [(0.0, 0.5), (0.5, 0.2), (1.0, 0.0), (1.0, 1.0)])
@pytest.mark.parametrize("name", ["ball", "block", "plate"])
@pytest.mark.parametrize("make", [falling, meeting])
def test_an_impact_obeys_its_law_as_a_general_solver_s_does(make, name, e, mu, seed):
    stage = make(name, e, mu, seed)
    rows, contacts = stage.find(0.0)
    assert contacts
    J, before = twin.jacobian(contacts, stage.x), twin.velocities(stage.x)
    closing, inverse_mass = -(J @ before)[::3], twin.inverse_mass(stage.scene, stage.x)
    target = np.where(closing > THRESHOLD, rows[:, RESTITUTION] * closing, 0.0)
    elastic, plastic = (
        twin.Impact(J, inverse_mass, before, goal, rows[:, FRICTION])
        for goal in (target, np.zeros_like(target))
    )
    solve_impact(stage.count, stage.work)
    m, after = len(contacts), stage.work.velocity[NOW, :, :6].ravel()
    own, without = stage.work.impulses[ELASTIC, :m, :3], stage.work.impulses[PLASTIC, :m, :3]
    np.testing.assert_allclose(after, before + inverse_mass @ J.T @ own.ravel(), atol=1e-9)
    limit = rows[:, FRICTION] * own[:, 0]
    assert (np.linalg.norm(own[:, 1:], axis=1) <= limit * (1.0 + 1e-6) + 1e-12).all()
    energies = [twin.kinetic_energy(stage.scene, stage.x, v) for v in (before, after)]
    assert energies[1] <= energies[0] * (1.0 + 1e-9)
    if without.any():  # more would have gained energy
        assert energies[1] == pytest.approx(energies[0], rel=1e-6)
        assert np.abs(plastic.residual(without)).max() < 1e-3 * without.max()
    else:
        assert np.abs(elastic.residual(own)).max() < 1e-3 * own.max()
    if m > 2 and mu > 0.0:
        return  # more contacts than needed share the load, and so friction's moment, in many ways
    ends = []
    for law in (elastic, plastic):
        impulses, missed = twin.solution(law, own.max())
        assert missed < 1e-6
        ends.append(before + inverse_mass @ J.T @ impulses.ravel())
    expected = twin.blended(stage.scene, stage.x, before, *ends)
    tolerance = 1e-6 if name == "ball" else 1e-3  # whose directions do not depend on each other
    np.testing.assert_allclose(after, expected, rtol=0, atol=tolerance * np.abs(expected - before).max())


@pytest.mark.parametrize("seed", range(10))
def test_the_time_of_an_impact_is_where_a_parabola_reaches_the_surface(seed):
    rng = np.random.default_rng(seed)
    stage = falling("block", 0.5, 0.5, seed)
    stage.x[0, 2] += rng.uniform(0.0, 0.008)
    stage = Stage(stage.scene, stage.x)
    _, contacts = stage.find(H)
    speeds = (twin.jacobian(contacts, stage.x) @ twin.velocities(stage.x))[::3]
    accelerations = [twin.fall(stage.scene, c, stage.x) for c in contacts]
    expected = twin.time_to_impact([c.gap for c in contacts], speeds, accelerations, H, THRESHOLD)
    assert first_impact(H, stage.world, stage.work) == pytest.approx(expected, rel=1e-9)


# -- flight ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("spin", [(0.1, 0.2, 0.1), (2, 9, 1), (30, 50, -20)])
def test_flight_is_a_parabola_that_keeps_the_angular_momentum(spin):
    scene = Scene.everyday([RigidBody("p", PLATE, 0.4)])
    stage = Stage(scene, state((1, 2, 3), (0.3, -0.2, 4), spin, turned(0.3, 0.2, -0.5)))
    s = stage.x[0].copy()
    travel_freely(stage.x, 0, H, stage.world, stage.work)
    y, g, inertia = stage.x[0], scene.gravity, 0.4 * PLATE.inertia
    np.testing.assert_allclose(y[:3], s[:3] + H * s[3:6] + 0.5 * H * H * g, rtol=1e-14)
    np.testing.assert_allclose(y[3:6], s[3:6] + H * g, rtol=1e-14)

    def momentum(s):
        R = Rotation.from_quat(s[6:10]).as_matrix()
        return R @ inertia @ R.T @ s[10:]

    np.testing.assert_allclose(momentum(y), momentum(s), atol=1e-12 * np.linalg.norm(momentum(s)))

    def turning(t, vector):
        R = (Rotation.from_rotvec(vector) * Rotation.from_quat(s[6:10])).as_matrix()
        w, angle = R @ np.linalg.solve(inertia, R.T @ momentum(s)), np.linalg.norm(vector)
        cross = np.cross(vector, w)  # the derivative of a rotation vector
        more = 1 / 12 if angle < 1e-4 else (1 - 0.5 * angle / np.tan(0.5 * angle)) / angle**2
        return w - 0.5 * cross + more * np.cross(vector, cross)

    fine = solve_ivp(turning, (0, H), np.zeros(3), rtol=1e-12, atol=1e-14).y[:, -1]
    apart = (Rotation.from_rotvec(fine) * Rotation.from_quat(s[6:10])).inv() * Rotation.from_quat(y[6:10])
    assert apart.magnitude() < 0.06 * np.linalg.norm(H * np.array(spin)) ** 3  # the midpoint rule's order
