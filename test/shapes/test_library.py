"""The model library, and what ships in it."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from unc_physics import primitive_model
from unc_physics.checks.errors import UnknownModelError
from unc_physics.shapes import household_meshes as meshes
from unc_physics.shapes import library, primitive_models
from unc_physics.shapes.library import find_model, list_models, load_model, models_dirs
from unc_physics.shapes.packing_file import save_packing
from unc_physics.shapes.recipes import RECIPES, recipe_solid
from unc_physics.shapes.solid_mesh import make_solid

MODELS = Path(library.__file__).resolve().parents[2] / "models"
INCH = 0.0254


def test_all_recipes_ship_and_nothing_else():
    assert sorted(path.stem for path in MODELS.glob("*.npz")) == sorted(RECIPES)
    assert sum(path.stat().st_size for path in MODELS.iterdir()) < 5e6


@pytest.mark.parametrize("name", RECIPES)
def test_shipped_models_are_packings(name):
    packing = load_model(name, MODELS)
    assert len(packing) == RECIPES[name].spheres >= 1000
    assert packing.name == name and packing.source and packing.licence and len(packing.mesh_sha256) == 64
    assert 0.01 < packing.mass < 10.0
    size = packing.bounds[1] - packing.bounds[0]
    assert np.all((size > 0.015) & (size < 0.5))
    first = 0 if RECIPES[name].largest_first else packing.radii.argmax()
    assert first < 400
    smallest_before = np.minimum.accumulate(packing.radii[first:])[:-1]
    assert np.mean(packing.radii[first + 1 :] > 1.01 * smallest_before) <= 0.001
    # A sphere can only overlap those whose centres lie within its own and the largest radius; take these by
    # size.
    touch = 1e-12 * packing.bounding_radius
    tree = cKDTree(packing.centers)
    order = np.argsort(packing.radii)[::-1]
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    near = tree.query_ball_point(packing.centers, 2.0 * packing.radii)  # the other is no larger
    for i, others in enumerate(near):
        others = np.array([j for j in others if rank[j] > rank[i]], dtype=int)
        gaps = np.linalg.norm(packing.centers[others] - packing.centers[i], axis=1) - packing.radii[others]
        assert np.all(gaps >= packing.radii[i] - touch)
    outside = np.maximum(packing.bounds[0] - packing.centers, packing.centers - packing.bounds[1]).max(axis=1)
    assert np.all(outside + packing.radii <= touch)


@pytest.mark.parametrize("name", ["mug", "bowl", "plate", "bin"])
def test_thin_walls_are_covered(name):
    assert load_model(name, MODELS).surface_gap <= 0.003


@pytest.mark.parametrize("name", ["bunny", "armadillo", "pin"])
def test_the_papers_models_have_ten_thousand_spheres(name):
    packing = load_model(name, MODELS)
    goals = {"bunny": (0.80, 0.878), "armadillo": (0.76, 0.85), "pin": (0.855, 0.91)}[name]
    assert len(packing) == 10_000
    assert packing.prefix(1000).fill >= goals[0]
    assert packing.fill >= goals[1]


@pytest.mark.parametrize("name", [name for name, recipe in RECIPES.items() if callable(recipe.mesh)])
def test_shipped_models_are_of_the_meshes_in_the_code(name):
    solid, about = recipe_solid(name)
    packing = load_model(name, MODELS)
    np.testing.assert_allclose(packing.inertia, solid.inertia, rtol=1e-9, atol=1e-12)
    assert packing.volume == pytest.approx(solid.volume, rel=1e-9)
    np.testing.assert_allclose(packing.origin, solid.origin, atol=1e-9)
    np.testing.assert_allclose(packing.bounds, solid.bounds, atol=1e-9)
    assert packing.mass == about["mass"]
    assert 300.0 < packing.mass / packing.volume < 3000.0


def test_pin_is_a_tenpin():
    vertices, faces = RECIPES["pin"].mesh()
    solid = make_solid("pin", vertices, faces)
    assert len(faces) >= 20_000
    assert np.ptp(vertices[:, 2]) == pytest.approx(15.0 * INCH)
    radius = np.linalg.norm(vertices[:, :2], axis=1)
    assert 2.0 * radius.max() == pytest.approx(4.766 * INCH, rel=2e-3)
    # the specification wants the centre of gravity between 5 40/64 and 5 60/64 inches up
    assert 5.0 + 40.0 / 64.0 <= -solid.origin[2] / INCH <= 5.0 + 60.0 / 64.0


def test_mug_has_one_handle():
    assert trimesh.Trimesh(*meshes.mug()).euler_number == 0


def test_lookup(tmp_path, monkeypatch):
    packing = load_model("brick", MODELS).prefix(3)
    save_packing(tmp_path / "mine.npz", packing)
    assert find_model("mine", tmp_path) == find_model(str(tmp_path / "mine.npz")) == tmp_path / "mine.npz"
    assert list(list_models(tmp_path)) == ["mine"]
    monkeypatch.setenv("UNC_PHYSICS_MODELS", str(tmp_path))
    assert len(load_model("mine")) == 3
    for unknown in ("yours", "bunny"):
        with pytest.raises(UnknownModelError, match=f"mine .got '{unknown}'") as caught:
            find_model(unknown)
        assert str(tmp_path) in str(caught.value)
    with pytest.raises(UnknownModelError, match="is no file"):
        find_model(str(tmp_path / "yours.npz"))


def test_search_order(tmp_path, monkeypatch):
    monkeypatch.delenv("UNC_PHYSICS_MODELS", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ros"))
    packing = load_model("brick", MODELS).prefix(3)
    for folder in (library.cache_dir(), tmp_path / "ros" / library.SHARE):
        folder.mkdir(parents=True)
        save_packing(folder / "only_here.npz", packing)
        save_packing(folder / "brick.npz", packing)
    assert models_dirs()[0] == MODELS and models_dirs()[-1] == library.cache_dir()
    assert find_model("only_here") == tmp_path / "ros" / library.SHARE / "only_here.npz"
    assert find_model("brick") == MODELS / "brick.npz"


def test_packing_a_shape_is_announced_once(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(primitive_models, "cache_dir", lambda: tmp_path / "models")
    monkeypatch.setattr(primitive_models, "SPHERES", 20)
    for _ in range(2):
        assert len(primitive_model("box", size=(0.051, 0.052, 0.053)).centers) <= 20
    assert caplog.text.count("Packing a box with 20 spheres") == 1
