"""The sphere tree finds every overlapping pair of spheres."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from unc_physics import RigidBody, Scene, SpherePacking, load_model
from unc_physics.physics.paper import sphere_tree
from unc_physics.physics.paper.broad_phase import SINGLE_PRECISION
from unc_physics.physics.paper.workspace import workspace
from unc_physics.scene.body import shape_of

seeds = st.integers(0, 2**32 - 1)


def packing(centers, radii):
    reach = np.max(np.linalg.norm(centers, axis=1) + radii)
    return SpherePacking("packing", centers, radii, 0.4 * reach**2 * np.eye(3), 1.0, np.zeros(3), reach)


def found_pairs(world, bodies, R, t, pairs_at_once, at_once=sphere_tree.AT_ONCE):
    """All overlapping pairs by the candidates and the exact test; refuses a candidate that comes twice."""
    i, j = bodies
    slack = SINGLE_PRECISION * (world.bodies.radius[i] + world.bodies.radius[j])
    search = workspace(np.zeros((2, 13)), world).search
    if pairs_at_once:
        search = search._replace(
            pairs=search.pairs[:pairs_at_once].copy(), records=search.records[:pairs_at_once].copy()
        )
    search.stack[0] = world.bodies.root[i], world.bodies.root[j]
    top, pairs = 1, []
    while top > 0:
        found, top = sphere_tree.candidates(world.tree, R, tuple(t), slack, search, top, at_once)
        assert top <= len(search.stack) and found <= len(search.pairs)
        pairs += [tuple(pair) for pair in search.pairs[:found].tolist()]
    assert len(set(pairs)) == len(pairs), "a pair was found twice"
    if not pairs:
        return set()
    a, b = np.array(pairs).T
    d = np.linalg.norm(world.tree.centers[b] @ R.T + t - world.tree.centers[a], axis=1)
    return {
        pair for pair, hit in zip(pairs, d < world.tree.radii[a] + world.tree.radii[b], strict=True) if hit
    }


def brute_force(ci, ri, cj, rj, R, t, offset):
    d = np.linalg.norm((cj @ R.T + t)[None] - ci[:, None], axis=2)
    return {(i, j + offset) for i, j in np.argwhere(d < ri[:, None] + rj[None])}


def check(ci, ri, cj, rj, R, t, pairs_at_once=None):
    """Candidates and exact test against brute force; returns the number of overlapping pairs."""
    world = Scene([RigidBody("i", packing(ci, ri), 1.0), RigidBody("j", packing(cj, rj), 1.0)]).world
    first_of_j = len(world.tree.radii) - len(rj)  # equal bodies share their spheres
    expected = brute_force(ci, ri, cj, rj, R, t, first_of_j)
    for at_once in (1, sphere_tree.AT_ONCE):
        assert found_pairs(world, (0, 1), R, t, pairs_at_once, at_once) == expected
    swapped = found_pairs(world, (1, 0), np.ascontiguousarray(R.T), -R.T @ t, pairs_at_once)
    grazing = expected ^ {(i, j) for j, i in swapped}
    assert (
        len(grazing) <= 1
    )  # one pair that only just touches; the exact test rounds another way from the other side
    return len(expected)


def random_packing(rng, n):
    kind = rng.integers(5)
    centers = rng.standard_normal((n, 3))
    if kind == 0:  # flat
        centers[:, 2] = 0.0
    elif kind == 1:  # clusters with coincident centres
        centers = centers[rng.integers(max(1, n // 4), size=n)]
    elif kind == 2:  # on a line
        centers = centers[:, :1] * np.array([[1.0, 1.0, 0.0]])
    elif kind == 3:  # off the origin, as after a crude cut
        centers += rng.uniform(-5, 5, 3)
    return centers, 10.0 ** rng.uniform(-3, 0, n)


@given(seeds, st.integers(1, 120), st.integers(1, 120), st.integers(-6, 3))
def test_tree_equals_brute_force(seed, n, m, decade):
    rng = np.random.default_rng(seed)
    scale = 10.0**decade
    ci, ri = random_packing(rng, n)
    cj, rj = random_packing(rng, m)
    R = Rotation.random(rng=rng).as_matrix()
    t = (
        ci[rng.integers(n)]
        - R @ cj[rng.integers(m)]
        + rng.standard_normal(3) * rng.choice([0.0, 0.01, 1.0, 10.0])
    )
    check(scale * ci, scale * ri, scale * cj, scale * rj, R, scale * t)


@given(seeds)
def test_touching_spheres_are_never_missed(seed):
    """Poses at which two spheres overlap by less than single precision can tell."""
    rng = np.random.default_rng(seed)
    ci, ri = random_packing(rng, 40)
    cj, rj = random_packing(rng, 40)
    R = Rotation.random(rng=rng).as_matrix()
    i, j = rng.integers(40, size=2)
    direction = Rotation.random(rng=rng).apply([1, 0, 0])
    t = ci[i] + direction * (ri[i] + rj[j]) * (1.0 - 1e-12) - R @ cj[j]
    check(ci, ri, cj, rj, R, t)


@pytest.mark.parametrize("n, m", [(1, 1), (1, 100), (100, 1), (8, 9), (9, 8), (64, 65)])
def test_sizes_around_the_width_of_a_node(n, m):
    rng = np.random.default_rng(n * 1000 + m)
    hits = 0
    for _ in range(20):
        ci, ri = rng.standard_normal((n, 3)), rng.uniform(0.1, 1.0, n)
        cj, rj = rng.standard_normal((m, 3)), rng.uniform(0.1, 1.0, m)
        hits += check(ci, ri, cj, rj, Rotation.random(rng=rng).as_matrix(), rng.standard_normal(3))
    assert hits > 0


def test_all_spheres_coincide():
    centers, radii = np.zeros((50, 3)), np.full(50, 0.3)
    assert check(centers, radii, centers, radii, np.eye(3), np.array([0.1, 0, 0])) == 2500


def test_a_small_buffer_of_pairs_only_takes_more_rounds():
    rng = np.random.default_rng(1)
    ci, ri = rng.standard_normal((80, 3)), rng.uniform(0.3, 1.0, 80)
    assert check(ci, ri, ci, ri, np.eye(3), np.array([0.2, 0, 0]), pairs_at_once=sphere_tree.WIDTH**2) > 1000


def test_packings_with_the_same_spheres_share_their_tree():
    """Each was loaded for itself, as in scene files."""
    models = [load_model("pin").prefix(30) for _ in range(2)]
    scene = Scene([RigidBody(f"pin{k}", model) for k, model in enumerate(models)], stiffness=1e4)
    assert len(scene.world.tree.radii) == 30
    assert len(np.unique(scene.world.bodies.root)) == 1
    assert shape_of(models[0]) is shape_of(models[1])
    assert len({shape_of(other) for other in (*models, models[0].scaled(2.0), models[0].prefix(29))}) == 3
