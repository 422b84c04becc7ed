"""Each stage of the implicit step equals its plain NumPy twin."""

from functools import partial

import numpy as np
import pytest
from plain_scenes import BALL, BLOCK, PLATE, packing, state, turned
from scipy.spatial.transform import Rotation
from twins import implicit_step as twin
from unc_physics.collision.contact_patch import (
    IMPACT_GAP,
    TILT,
    add_contacts,
    element_candidates,
    pair_candidates,
)
from unc_physics.collision.contact_row import (
    AXIS,
    COMPLIANCE,
    DIRECTION,
    FALL,
    FRICTION,
    GAP,
    MOMENT_I,
    MOMENT_J,
    RADIUS,
    RESTITUTION,
    SLIP_COMPLIANCE,
)
from unc_physics.collision.contact_search import ACTIVE_GAP, find_groups, update_pace
from unc_physics.collision.faces import flat_faces, over_face
from unc_physics.collision.hull import hull_spheres
from unc_physics.collision.implicit_workspace import (
    CONTACTS,
    ELASTIC,
    FREE,
    FREE_POSITION,
    FREE_QUATERNION,
    LASTING,
    NOW,
    PLASTIC,
    implicit_workspace,
)
from unc_physics.dynamics import implicit_solver, implicit_step
from unc_physics.dynamics.friction import weaken_with_speed
from unc_physics.dynamics.impact_time import impact_before, time_to_impact
from unc_physics.dynamics.implicit_world import Rollout

from unc_physics import RigidBody, Scene, load_model, rounded_box
from unc_physics.compiler import kernel
from unc_physics.scene.body import shape_of
from unc_physics.scene.environment import Box, Capsule, Cylinder, Plane, Sphere
from unc_physics.scene.stiffness import with_stiffness
from unc_physics.spatial.rotation import write_matrix

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
    add_contacts(x, i, j, found, TILT, False, world, work)


@kernel
def find(x, count, horizon, limit, world, work):
    implicit_step.find_contacts(x, count, 0.0, horizon, limit, False, world, work)
    implicit_step._read_velocities(x, count, work.members, work.velocity)


@kernel
def fastest_closing(x, count, world, work):
    return implicit_step.fastest_closing(x, count, world, work)


@kernel
def is_over(f, point, centers, faces):
    return over_face(f, (point[0], point[1], point[2]), centers, faces)


@kernel
def first_impact(left, world, work):
    return time_to_impact(left, 0.1, False, world, work)


@kernel
def solve_impact(count, slipperiness, work):
    work.impulses[PLASTIC] = 0.0
    weaken_with_speed(slipperiness, work)
    return implicit_solver.solve_impact(count, 0.1, work)


@kernel
def rollout(first_time, residual):
    nothing, never = np.zeros((0, 4), np.int32), np.zeros(1, np.int64)
    return Rollout(first_time, nothing, nothing, never, never, residual, np.uint64(0), 0.1, 0.1)


@kernel
def collide(x, count, first_time, residual, world, work):
    implicit_step.collide(x, count, 0.0, 0, rollout(first_time, residual), world, None, work)


@kernel
def travel_in_contact(x, count, h, touching, first_time, residual, world, work):
    implicit_step.travel_to_contacts(x, count, h, h, touching, world, work)
    implicit_step.push_apart(x, count, h, 0.0, rollout(first_time, residual), world, None, work)


@kernel
def travel_there_and_back(x, count, h, world, work):
    implicit_step.travel_to_contacts(x, count, h, h, True, world, work)
    first = impact_before(h, 0.1, False, world, work)
    implicit_step._travel_back(x, count, 0.0, world, work)
    return first


@kernel
def write_matrices(x, R):
    for i in range(len(x)):
        write_matrix((x[i, 6], x[i, 7], x[i, 8], x[i, 9]), R, i)


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
        self.work = implicit_workspace(self.x, np.zeros((0, 0), np.float32), self.world, (256, 4096, 65536))
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
        first, (kind, sphere) = self.first_spheres, divmod(b, len(self.world.tree.radii))
        return int(a - first[i]), int(twin.KINDS * kind + sphere - first[j]) if j >= 0 else int(b)

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
        limit = IMPACT_GAP if horizon == 0.0 else ACTIVE_GAP
        find(self.x, self.count, horizon, limit, self.world, self.work)
        return self.found(self.x, horizon, limit)

    def found(self, x, horizon, limit):
        """(rows, twin's contacts for them) of the contacts at hand, which were found at state ``x``."""
        m, contacts = self.work.counts[CONTACTS], []
        for i, j, a, b in self.work.ids[:m]:
            here = {(c.a, c.b): c for c in twin.candidates(self.scene, x, i, j, horizon, limit)}
            contacts.append(here[self.spheres(i, j, a, b)])
        return self.work.rows[:m], contacts

    def remember(self, i, j, spheres, forces=0.0):
        """Let contacts of body i with body j, by their spheres, have carried normal forces [N]."""
        first = self.first_spheres
        for n, ((a, b), force) in enumerate(zip(spheres, np.broadcast_to(forces, len(spheres)), strict=True)):
            kind, sphere = divmod(b, twin.KINDS)
            partner = kind * len(self.world.tree.radii) + sphere + first[j] if j >= 0 else b
            self.work.old_contact[n] = i, j, a + first[i], partner
            self.work.old_force[n] = force, 0.0, 0.0, 0.0
            self.work.link[n] = n + 1 if n + 1 < len(spheres) else -1
        self.work.head[i] = 0


ELEMENTS = {
    "plane": Plane((0.1, -0.2, 1.0)),
    "box": Box((0.1, 0.06, 0.2), (0.03, 0.02, -0.1)),
    "face": Box((1.0, 1.0, 0.2), (0, 0, -0.1)),
    "sphere": Sphere(0.2, (0.02, 0.01, -0.2)),
    "cylinder": Cylinder(0.05, 0.4, (0, 0.01, -0.05), turned(0, np.pi / 2, 0)),
    "capsule": Capsule(0.05, 0.1, (0, 0.01, -0.05), turned(0, np.pi / 2, 0)),
}

FLAT = ("plane", "face")  # which only the hull of a body above them can touch


def on_element(name, seed=0):
    """A brick about to touch an element."""
    rng, element = np.random.default_rng(seed), ELEMENTS[name]
    body = RigidBody("b", load_model("brick").prefix(300), 0.7, friction=0.3, restitution=0.4)
    x = state((0, 0, 1), rng.normal(0, 0.5, 3), rng.normal(0, 2, 3), turned(*rng.normal(0, 0.01, 3)))
    for _ in range(50):  # down to the surface
        x[2] -= (element.surface(twin.centers(body, x))[0] - body.model.radii).min()
    return Stage(Scene.everyday([body], exact=True, environment=[element]), x)


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
    return Stage(Scene.everyday(bodies, exact=True, environment=[Plane((0, 0, 1), floor)]), x)


def stacked(seed=0):
    """A box of spheres about to slide on another one."""
    rng = np.random.default_rng(seed)
    bodies = [RigidBody("upper", BLOCK, 0.5, friction=0.8), RigidBody("lower", BLOCK, 1.5)]
    turn = Rotation.from_rotvec(rng.normal(0, 0.5, 3))  # of both, about the lower one's middle
    x = np.array([state((0, 0, 0), rng.normal(0, 0.2, 3), rng.normal(0, 1, 3)) for _ in bodies])
    x[0, :3] = turn.apply((0.002, 0.001, 0.04 + 2e-5))
    x[0, 6:10] = (turn * Rotation.from_rotvec((1e-4, -2e-4, 0.02))).as_quat()
    x[1, 6:10] = turn.as_quat()
    return Stage(Scene.everyday(bodies, exact=True, gravity=None), x)


def pressed(seed=0):
    """Two bricks whose faces slide on each other, as deep as free motion leads in a step."""
    rng, brick = np.random.default_rng(seed), load_model("brick").prefix(300)
    bodies = [RigidBody("upper", brick, 0.5), RigidBody("lower", brick, fixed=True)]
    height = 2.0 * (brick.centers[:, 2] + brick.radii).max() - 4e-4
    x = [state((*rng.normal(0, 0.01, 2), height), (0.4, 0.1, 0), rng.normal(0, 0.1, 3)), state()]
    x[0][6:10] = turned(*rng.normal(0, 1e-3, 2), rng.normal())
    return Stage(Scene.everyday(bodies, exact=True), x)


def sliding_off(seed=0):
    """A brick whose lower face slides over the edge of a table, at x = 0, with contacts that carried load."""
    rng, brick = np.random.default_rng(seed), load_model("brick").prefix(300)
    low, tilt = (brick.radii - brick.centers[:, 2]).max(), rng.uniform(0.06, 0.15)
    turn = Rotation.from_rotvec((0, tilt, 0)) * Rotation.from_rotvec((0, 0, rng.normal(0, 0.02)))
    spin = np.array((0.0, rng.uniform(1.5, 3.0), 0.0))
    place = turn.apply((rng.uniform(0.03, 0.09), 0.0, low - rng.uniform(1e-5, 4e-5)))
    x = state(place, turn.apply((1.5, 0, 0)) + np.cross(spin, place), spin, turn.as_quat())
    body, table = RigidBody("b", brick, 0.5, restitution=0.0), Box((0.4, 0.6, 0.02), (-0.2, 0.0, -0.01))
    stage = Stage(Scene.everyday([body], exact=True, environment=[table]), x)
    loaded = [(c.a, c.b) for c in twin.candidates(stage.scene, stage.x, 0, -1, 0.0) if c.b > 0]
    stage.remember(0, -1, loaded)
    return stage, loaded


# -- finding contacts --------------------------------------------------------------------------------


@pytest.mark.parametrize("horizon", [0.0, H])
@pytest.mark.parametrize(
    "make, pair",
    [(partial(on_element, name), (0, -1)) for name in ELEMENTS]
    + [(partial(pile, seed), (0, k)) for seed in range(3) for k in (1, 2)]
    + [(partial(make, seed), (0, 1)) for make in (stacked, pressed) for seed in range(3)],
)
def test_candidates_are_all_spheres_that_come_near(make, pair, horizon):
    """Of a body and an element, of which flat ones meet the hull alone, or of two bodies."""
    stage = make()
    found, _ = stage.candidates(*pair, horizon)
    expected = {
        (c.a, c.b): (c.gap, c.predicted)
        for c in twin.candidates(stage.scene, stage.x, *pair, horizon)
        if make.args[0] not in FLAT or c.a in stage.hull
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


@pytest.mark.parametrize("spin", [0.01, 2.0])
@pytest.mark.parametrize("case", ["box", "pair"])
def test_contacts_that_carried_load_count_as_deeper_unless_the_body_rolls(case, spin):
    stage, j = (pile(6), 1) if case == "pair" else (on_element(case, 1), -1)
    stage.x[:, 10:] *= spin / np.linalg.norm(stage.x[0, 10:])
    found = twin.candidates(stage.scene, stage.x, 0, j, H)
    loaded = {(c.a, c.b) for c in found} - twin.reduced(found, stage.x[0])
    assert loaded
    stage.remember(0, j, sorted(loaded))
    _, count = stage.candidates(0, j, H)
    choose(stage.x, 0, j, count, stage.world, stage.work)
    chosen = {stage.spheres(0, j, a, b) for _, _, a, b in stage.work.ids[: stage.work.counts[CONTACTS]]}
    bonus = twin.loaded_bonus(stage.scene, stage.x, 0, j)
    assert chosen == twin.reduced(found, stage.x[0], loaded, bonus)
    assert (bonus > 0.0) == (spin < 1.0)


@pytest.mark.parametrize(
    "make", [pile, stacked, lambda: on_element("cylinder")], ids=["pile", "stacked", "cylinder"]
)
def test_rows_have_the_contacts_jacobians(make):
    stage = make()
    rows, contacts = stage.find(H)
    J, inverse_mass = twin.jacobian(contacts, stage.x), twin.inverse_mass(stage.scene, stage.x)
    own = np.einsum("ij,jk,ik->i", J, inverse_mass, J).reshape(-1, 3)
    assert len(contacts) > 0
    assert make is not stacked or any(c.on_face for c in contacts)
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
        assert row[FALL] == pytest.approx(twin.fall(stage.scene, c, stage.x), abs=1e-9)
        for column, values in (
            (FRICTION, stage.world.implicit.friction),
            (RESTITUTION, stage.world.implicit.restitution),
        ):
            assert row[column] == pytest.approx(twin.mean_of(values, c, len(stage.x)))


@pytest.mark.parametrize("seed", range(5))
def test_nothing_closes_faster_than_the_bound(seed):
    stage = pile(seed)
    _, contacts = stage.find(H)
    speeds = (twin.jacobian(contacts, stage.x) @ twin.velocities(stage.x))[::3]
    falls = np.array([twin.fall(stage.scene, c, stage.x) for c in contacts])
    bound = fastest_closing(stage.x, stage.count, stage.world, stage.work)
    assert max(-speeds.min(), -(speeds + H * falls).min()) < bound < np.inf


# -- flat faces --------------------------------------------------------------------------------------


def model_named(name):
    made = {"block": BLOCK, "plate of nine": PLATE, "ball": BALL}
    if name in made:
        return made[name]
    if name == "eight balls":
        return rounded_box((0.2, 0.3, 0.4), 0.05).prefix(8)
    return load_model(name).prefix(300)


def found_faces(model):
    """(normal, spheres that touch) of each face that the package finds."""
    centers, radii = np.array(model.centers), np.array(model.radii)
    faces = flat_faces(centers, radii, hull_spheres(centers, radii), model.volume)
    return [
        twin.Face(n, np.flatnonzero((faces.of_sphere == k).any(axis=1))) for k, n in enumerate(faces.normal)
    ]


def is_same(first, second):
    """Whether two faces have one normal, as far as spheres within the tolerance determine it."""
    return np.linalg.norm(first.normal - second.normal) < 1e-4


@pytest.mark.parametrize(
    "name, count",
    [("salt_box", 6), ("brick", 6), ("rounded_box", 6), ("block", 6), ("eight balls", 6)]
    + [("plate of nine", 2), ("bunny", 0), ("ball", 0)],
)
def test_flat_faces_are_the_planes_that_several_spheres_touch(name, count):
    model = model_named(name)
    found, expected = found_faces(model), twin.flat_faces(model)
    assert len(found) == len(expected) == count
    touched = np.bincount(np.concatenate([[], *(face.touching for face in expected)]).astype(int))
    for face in expected:
        (same,) = (other for other in found if is_same(face, other))
        np.testing.assert_allclose(same.normal, face.normal, atol=1e-6)
        # the largest sphere in a cube touches all its faces, of which three are kept
        assert {s for s in set(same.touching) ^ set(face.touching) if touched[s] <= 3} == set()


@pytest.mark.parametrize("name, count", [("can", 5), ("mug", 2)])
def test_faces_of_round_bodies_are_found(name, count):
    """A can of few spheres stands on both ends and lies on three pairs of its rims' spheres; a mug stands on
    its bottom and on its rim.

    A mug's lip is round, so its rim's plane is known only to the tolerance. One sphere may be in or out.
    """
    model = load_model(name).prefix(120)
    found, expected = found_faces(model), twin.flat_faces(model)
    assert len(expected) == len(found) == count
    for face in expected:
        (same,) = (other for other in found if is_same(face, other))
        np.testing.assert_allclose(same.normal, face.normal, atol=2e-5)
        is_rim = name == "mug" and face.normal[2] > 0.0
        assert len(set(same.touching) ^ set(face.touching)) <= is_rim


@pytest.mark.parametrize("name", ["brick", "can", "block"])
def test_a_point_is_over_a_face_inside_the_places_where_spheres_touch_it(name):
    model, rng = model_named(name), np.random.default_rng(0)
    centers, faces = np.array(model.centers), shape_of(model).faces
    for k, face in enumerate(twin.faces_in_use(model)):
        points = rng.uniform(1.2 * centers.min(axis=0), 1.2 * centers.max(axis=0), (100, 3))
        expected = twin.is_over(face, points, centers).tolist()
        assert [is_over(k, point, centers, faces) for point in points] == expected
        assert len(set(expected)) == 2


@pytest.mark.parametrize("seed", range(5))
def test_a_sphere_over_a_face_keeps_its_distance_from_the_face(seed):
    """Of two boxes that slide on each other: gap, normal and the gap's speed are those of a plane, unless the
    spheres are so far beside each other that the plane is much nearer.
    """
    stage, horizon, step = stacked(seed), 1e-3, 1e-6
    x, centers, radius, half = stage.x.copy(), np.array(BLOCK.centers), 0.01, 0.02
    found, count = stage.candidates(0, 1, horizon)

    def moved(time):
        """Centres of both boxes' spheres, places and rotations after a time."""
        turns = [Rotation.from_rotvec(time * s[10:]) * Rotation.from_quat(s[6:10]) for s in x]
        places = [s[:3] + time * s[3:6] for s in x]
        return [p + q.apply(centers) for p, q in zip(places, turns, strict=True)], places, turns

    def heights(time, a, b):
        """Of the upper box's sphere over the lower box, and of the lower box's sphere under the upper box."""
        spheres, places, turns = moved(time)
        over = turns[1].inv().apply(spheres[0][a] - places[1])[2] - half - radius
        return np.array([over, -turns[0].inv().apply(spheres[1][b] - places[0])[2] - half - radius])

    spheres, _, turns = moved(0.0)
    up = [turn.apply((0.0, 0.0, 1.0)) for turn in (turns[1], turns[0])]
    planes = 0
    for (a, b), normal in zip(found, stage.work.candidates[:count, :3], strict=True):
        gap, predicted = found[a, b]
        own = np.linalg.norm(spheres[0][a] - spheres[1][b]) - 2.0 * radius
        both = heights(0.0, a, b)
        if both.max() < own - 1.5e-4:
            assert gap == pytest.approx(own, abs=1e-12)
        elif gap != pytest.approx(own, abs=1e-12):  # at the edges no sphere is over a face, or one alone
            best = abs(both - gap).argmin()
            planes += best == both.argmax()
            assert gap == pytest.approx(both[best], abs=1e-12)
            speed = (heights(step, a, b) - heights(-step, a, b))[best] / (2.0 * step)
            assert (predicted - gap) / horizon == pytest.approx(speed, abs=1e-7)
            np.testing.assert_allclose(turns[0].apply(normal), up[best], atol=1e-12)
    assert planes > 10


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


def free_state(stage, before):
    """State (B, 13) at an interval's end without contacts, as the step recorded it."""
    x = before.copy()
    for k in stage.scene.moving:
        x[k, :3] = stage.work.numbers[k, FREE_POSITION:][:3]
        x[k, 6:10] = stage.work.numbers[k, FREE_QUATERNION:][:4]
        x[k, 3:6], x[k, 10:] = np.split(stage.work.velocity[FREE, k, :6], 2)
    return x


def lasting_law(stage, contacts, before, h, forces=0.0):
    """The twin's law for contacts that a step found, from the state ``before`` and the last step's forces."""
    x = free_state(stage, before)
    J, start, free = twin.jacobian(contacts, x), twin.velocities(before), twin.velocities(x)
    stiffness = stage.scene.stiffness * np.pi * np.array([c.radius for c in contacts])
    speeds = (J @ free)[::3]
    limit = twin.lasting_limit(stage.scene, h)
    lead, lowest = twin.leads(stage.scene, contacts, x, J, limit)
    push, rolling = twin.rolling_contacts(stage.scene, contacts, before, x, J, lead, lowest, h)
    mean = 0.5 * ((J @ start)[::3] + speeds) - rolling
    gaps = np.array([c.gap for c in contacts])
    gaps = twin.counted_gaps(gaps, mean, np.sqrt(forces / stiffness), h)
    friction = [twin.mean_of(stage.world.implicit.friction, c, len(x)) for c in contacts]
    return twin.Lasting(
        J,
        push,
        twin.inverse_mass(stage.scene, x),
        free,
        gaps,
        rolling,
        stiffness,
        np.array(friction),
        h,
        np.where(gaps > 0.0, 0.0, 0.5 * stage.scene.dt),
    )


def travel(stage, h=H, touching=True):
    """Let a stage's contacts act; returns (twin's contacts, impulses, state before)."""
    before, residual = stage.x.copy(), np.zeros(len(stage.x))
    first_time = np.full((len(stage.x), len(stage.x) + 1), np.inf)
    travel_in_contact(stage.x, stage.count, h, touching, first_time, residual, stage.world, stage.work)
    _, contacts = stage.found(free_state(stage, before), 0.0, twin.lasting_limit(stage.scene, h))
    return contacts, stage.work.impulses[LASTING, : len(contacts), :3].copy(), before


def resting(name, depth=2e-5, velocity=(0.02, 0.01, 0.0), spin=(0, 0, 0.1)):
    """Something that lies on a floor and slides a little."""
    models = {"ball": BALL, "block": BLOCK, "plate": PLATE}
    body = RigidBody("b", models[name], 0.7)
    low = (body.model.centers[:, 2] - body.model.radii).min()
    return Stage(
        Scene.everyday([body], exact=True, environment=[Plane()]), state((0, 0, -low - depth), velocity, spin)
    )


CASES = {
    **{name: lambda name=name: resting(name) for name in ("ball", "block", "plate")},
    "rolling": lambda: resting("ball", velocity=(1, 0, 0), spin=(0, 20, 0)),
    "sticking": lambda: resting("block", velocity=(0, 0, 0), spin=(0, 0, 0)),
    "sliding": lambda: resting("block", velocity=(1, 0.5, 0)),
    "pile": lambda: pile(1),
}


@pytest.mark.parametrize("case", [*CASES, "falling"])
def test_without_contacts_bodies_end_where_they_fly(case):
    stage = pile(2) if case == "falling" else CASES[case]()
    expected = stage.x.copy()
    contacts, _, before = travel(stage, touching=case != "falling")
    for k in stage.scene.moving:
        write_matrices(before, stage.work.R)
        travel_freely(expected, k, H, stage.world, stage.work)
    np.testing.assert_array_equal(free_state(stage, before), expected)
    if case == "falling":
        assert not contacts
        np.testing.assert_array_equal(stage.x, expected)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("case", [*ELEMENTS, "pile"])
def test_lasting_contacts_are_those_of_the_end_without_contacts(case, seed):
    stage = pile(seed) if case == "pile" else on_element(case, seed)
    stage.x[list(stage.scene.moving), 5] = -0.3
    contacts, _, before = travel(stage)
    x = free_state(stage, before)
    # a box's face counts as flat for bodies whose sphere centres are all above it; a plane always does
    centers = twin.centers(stage.scene.bodies[0], x[0])
    is_flat = case == "plane" or (case == "face" and (centers[:, 2] > 0.0).all())
    expected = set()
    for i in stage.scene.moving:
        partners = [-1, *(j for j in range(len(x)) if j > i or stage.scene.bodies[j].fixed and j != i)]
        for j in partners:
            found = twin.candidates(stage.scene, x, i, j, 0.0, twin.lasting_limit(stage.scene, H))
            found = [c for c in found if not is_flat or c.a in stage.hull]
            tilt = twin.patch_tilt(x, i, j, H)
            expected |= {(i, j, a, b) for a, b in twin.reduced(found, x[i], tilt=tilt)}
    assert {c[:4] for c in contacts} == expected
    assert contacts and not np.array_equal(x, before)


@pytest.mark.parametrize("case", CASES)
def test_lasting_contacts_obey_their_law(case):
    stage = CASES[case]()
    contacts, impulses, before = travel(stage)
    law = lasting_law(stage, contacts, before, H)
    load = impulses[:, 0].max()
    assert load > 0.0
    assert np.abs(law.own_residual(impulses)).max() < 1e-3 * load
    assert np.abs(law.residual(impulses)).max() < 0.03 * load  # sweeps end at a speed, not at an impulse
    assert (np.linalg.norm(impulses[:, 1:], axis=1) <= law.friction * impulses[:, 0] * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("e", [0.5, 0.9])
@pytest.mark.parametrize("seed", range(5))
def test_free_motion_is_undone_where_a_contact_closed_on_it(seed, e):
    stage = falling("block", e, 0.5, seed)
    stage.x[0, 2] += np.random.default_rng(seed).uniform(0.0, 0.008)
    stage = Stage(stage.scene, stage.x)
    before, R = stage.x.copy(), stage.work.R.copy()
    first = travel_there_and_back(stage.x, stage.count, H, stage.world, stage.work)
    np.testing.assert_array_equal(stage.x, before)
    np.testing.assert_allclose(stage.work.R, R, atol=1e-15)
    x, limit = free_state(stage, before), twin.lasting_limit(stage.scene, H)
    _, contacts = stage.found(x, 0.0, limit)
    speeds = (twin.jacobian(contacts, x) @ twin.velocities(x))[::3]
    falls = np.array([twin.fall(stage.scene, c, x) for c in contacts])
    slowest = np.full(len(contacts), twin.impact_speed(e, THRESHOLD))
    gaps = np.array([c.gap for c in contacts])
    assert first == pytest.approx(twin.first_closing(gaps, speeds, falls, H, slowest), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("explained", [False, True])
def test_overlap_that_no_force_explains_is_pushed_out_slowly(explained):
    """Explained overlap gives its energy back; other overlap goes at 5 cm/s at most."""
    stage = resting("plate", depth=1e-3, velocity=(0, 0, 0), spin=(0, 0, 0))
    stiffness = stage.scene.stiffness * np.pi * PLATE.radii[0]
    force = stiffness * 5e-4**2 if explained else 0.0
    stage.remember(0, -1, [(a, 0) for a in range(9)], force)
    contacts, impulses, before = travel(stage)
    law = lasting_law(stage, contacts, before, H, force)
    assert len(contacts) > 3
    assert np.abs(law.own_residual(impulses)).max() < 1e-3 * impulses[:, 0].max()
    if not explained:
        assert 0.0 < stage.x[0, 2] - before[0, 2] < 0.5 * 0.1 * H


def test_spheres_ahead_of_a_rolling_line_are_damped_with_its_speed():
    """Between two spheres of a roller's rim nothing changes the depth of the deepest."""
    a = 2.0 * np.pi * np.arange(400) / 400
    rims = np.concatenate(
        [np.column_stack([0.04 * np.cos(a), 0 * a + z, 0.04 * np.sin(a)]) for z in (-0.05, 0.05)]
    )
    roller = RigidBody("r", packing("r", rims, [0.002] * 800, 1e-3 * np.eye(3)), 0.5)
    start = state((0, 0, 0.042 - 2e-5), (0.5, 0, 0), (0, 0.5 / 0.042, 0), turned(0, 0.003, 0))
    stage = Stage(Scene.everyday([roller], exact=True, environment=[Plane()]), start)
    contacts, impulses, before = travel(stage)
    law = lasting_law(stage, contacts, before, H)
    assert np.count_nonzero(law.rolling) >= 2 and not np.array_equal(law.J, law.push)
    assert np.abs(law.own_residual(impulses)).max() < 1e-3 * impulses[:, 0].max()


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
    contacts, impulses, before = travel(stage)
    law = lasting_law(stage, contacts, before, H)
    found, missed = twin.solution(law, impulses[:, 0].max())
    assert missed < 1e-7
    expected = law.ends(found)
    change = np.abs(expected - law.free).max()
    np.testing.assert_allclose(twin.velocities(stage.x), expected, rtol=0, atol=tolerance * change)


@pytest.mark.parametrize("case", CASES)
def test_bodies_in_contact_travel_by_the_mean_of_their_velocities(case):
    stage = CASES[case]()
    contacts, impulses, before = travel(stage)
    law = lasting_law(stage, contacts, before, H)
    ends = law.ends(impulses).reshape(-1, 6)
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
    return Stage(Scene.everyday([body], exact=True, environment=[Plane()], friction=mu, restitution=e), x)


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
    return Stage(Scene.everyday(bodies, exact=True, gravity=None, friction=mu, restitution=e), x)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "e, mu, half_speed",
    [(0.0, 0.5, np.inf), (0.5, 0.2, np.inf), (1.0, 0.0, np.inf), (1.0, 1.0, np.inf), (0.2, 0.5, 1.5)],
)
@pytest.mark.parametrize("name", ["ball", "block", "plate"])
@pytest.mark.parametrize("make", [falling, meeting])
def test_an_impact_obeys_its_law_as_a_general_solver_s_does(make, name, e, mu, half_speed, seed):
    stage = make(name, e, mu, seed)
    rows, contacts = stage.find(0.0)
    assert contacts
    J, before = twin.jacobian(contacts, stage.x), twin.velocities(stage.x)
    closing, inverse_mass = -(J @ before)[::3], twin.inverse_mass(stage.scene, stage.x)
    target = np.where(closing > twin.impact_speed(e, THRESHOLD), e * closing, 0.0)
    friction = twin.impact_friction(rows[:, FRICTION], closing, half_speed)
    elastic, plastic = (
        twin.Impact(J, inverse_mass, before, goal, friction) for goal in (target, np.zeros_like(target))
    )
    solve_impact(stage.count, 1.0 / half_speed, stage.work)
    m, after = len(contacts), stage.work.velocity[NOW, :, :6].ravel()
    own, without = stage.work.impulses[ELASTIC, :m, :3], stage.work.impulses[PLASTIC, :m, :3]
    np.testing.assert_allclose(after, before + inverse_mass @ J.T @ own.ravel(), atol=1e-9)
    limit = friction * own[:, 0]
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


@pytest.mark.parametrize("e", [0.5, 0.9])
@pytest.mark.parametrize("seed", range(10))
def test_the_time_of_an_impact_is_where_a_parabola_reaches_the_surface(seed, e):
    rng = np.random.default_rng(seed)
    stage = falling("block", e, 0.5, seed)
    if e > twin.LIVELY:  # slow enough for what is no impact with less restitution
        stage.x[0, 3:6] *= 0.03
    stage.x[0, 2] += rng.uniform(0.0, 0.008) * (0.03 if e > twin.LIVELY else 1.0)
    stage = Stage(stage.scene, stage.x)
    _, contacts = stage.find(H)
    speeds = (twin.jacobian(contacts, stage.x) @ twin.velocities(stage.x))[::3]
    falls = [twin.fall(stage.scene, c, stage.x) for c in contacts]
    slowest = [twin.impact_speed(e, THRESHOLD)] * len(contacts)
    expected = twin.time_to_impact([c.gap for c in contacts], speeds, falls, H, slowest)
    assert first_impact(H, stage.world, stage.work) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_spheres_of_a_face_that_slides_over_an_edge_close_along_its_normal(seed):
    """Without this rule they have an impact."""
    stage, loaded = sliding_off(seed)
    _, contacts = stage.find(H)
    slowest, times = np.full(len(contacts), THRESHOLD), []
    speeds = (twin.jacobian(contacts, stage.x) @ twin.velocities(stage.x))[::3]
    falls, gaps = np.array([twin.fall(stage.scene, c, stage.x) for c in contacts]), [c.gap for c in contacts]
    for known in ([], loaded):
        rate = twin.speeds_across_edges(stage.scene, stage.x, contacts, speeds, falls, 0.0, known, THRESHOLD)
        times.append(twin.time_to_impact(gaps, rate, falls, H, slowest))
    assert times[0] < times[1]
    assert first_impact(H, stage.world, stage.work) == pytest.approx(times[1], rel=1e-9)


def cradle(e, gap):
    """A ball hits a row of balls that are a gap apart; without gravity and friction."""
    bodies = [RigidBody(f"b{k}", BALL, 0.1 + 0.05 * k) for k in range(5)]
    x = np.array([state((k * (0.1 + gap), 0, 0), (float(k == 0), 0, 0)) for k in range(5)])
    x[0, 0] = -0.1 - 1e-5 + x[1, 0]
    return Stage(Scene.everyday(bodies, exact=True, gravity=None, friction=None, restitution=e), x)


def falling_on_two(e):
    """A block falls on one of two blocks that lie on a floor, next to each other."""
    bodies = [RigidBody(f"b{k}", BLOCK, 0.4) for k in range(3)]
    x = [state((k * 0.1601, 0, 0.02 + 1.5e-5)) for k in (0, 1)]
    x.append(state((0.02, 0.02, 0.06 + 2.5e-5), (0, 0, -1)))
    return Stage(Scene.everyday(bodies, exact=True, environment=[Plane()], restitution=e), x)


@pytest.mark.parametrize("e", [0.3, 0.69, 0.7, 1.0])
@pytest.mark.parametrize("case", ["apart", "touching", "blocks"])
def test_rigid_contacts_act_at_once_and_elastic_ones_in_sequence(case, e):
    """An impact changes exactly the velocities of bodies that it reaches, by the law of its contacts."""
    stage = falling_on_two(e) if case == "blocks" else cradle(e, {"apart": 1e-4, "touching": 5e-6}[case])
    _, contacts = stage.find(0.0)
    before = twin.velocities(stage.x)
    speeds = (twin.jacobian(contacts, stage.x) @ before)[::3]
    reached = twin.in_impact(contacts, speeds, np.full(len(contacts), e), THRESHOLD, stage.scene.moving)
    first_time, residual = np.full((len(stage.x), len(stage.x) + 1), np.inf), np.zeros(len(stage.x))
    collide(stage.x, stage.count, first_time, residual, stage.world, stage.work)
    _, taken = stage.found(stage.x, 0.0, IMPACT_GAP)
    assert {c[:4] for c in taken} == {contacts[k][:4] for k in reached} and taken
    own = stage.work.impulses[ELASTIC, : len(taken), :3]
    J, inverse_mass = twin.jacobian(taken, stage.x), twin.inverse_mass(stage.scene, stage.x)
    np.testing.assert_allclose(twin.velocities(stage.x), before + inverse_mass @ J.T @ own.ravel(), atol=1e-9)
    for c, impulse in zip(taken, own, strict=True):
        pair = (c.i, c.j if c.j >= 0 else len(stage.x) - 1 - c.j)
        if impulse[0] > 0.0:
            assert first_time[min(pair), max(pair)] == 0.0
    assert np.isfinite(first_time).sum() == len({c[:2] for c, i in zip(taken, own, strict=True) if i[0] > 0})
