"""Model files: round trip, the contract for foreign ones, refusals, and never half a file."""

from dataclasses import replace

import numpy as np
import pytest

from unc_physics import load_model
from unc_physics.checks.errors import InvalidModelError
from unc_physics.shapes import packing_file
from unc_physics.shapes.packing_file import SpherePacking, load_packing, save_packing

ROUND_OFF = 1e-13


def example():
    return SpherePacking(
        name="example",
        centers=np.array([[0.1, 0.0, 0.0], [-0.3, 0.0, 0.2], [0.0, 0.4, 0.0]]),
        radii=np.array([0.2, 0.1, 0.05]),
        inertia=np.diag([0.02, 0.03, 0.04]),
        volume=0.1,
        origin=np.array([0.0, 0.1, -0.2]),
        bounding_radius=0.6,
        mesh_sha256="ab" * 32,
        mass=0.5,
        bounds=np.array([[-0.4, -0.1, -0.2], [0.3, 0.5, 0.3]]),
        surface_gap=0.01,
        source="here",
        licence="free",
    )


REACH = np.sqrt(0.3**2 + 0.2**2) + 0.1  # of its second sphere [m]


def skewed(by):
    """Moments that are no multiples of each other, and a matrix that is symmetric but for its first row."""
    inertia = np.diag([1.0, 2.0, 2.5])
    inertia[0, 1] = 2.5 * by
    return inertia


def arrays(packing):
    return {field: getattr(packing, field) for field in ("centers", "radii", "inertia", "origin", "bounds")}


def test_round_trip_and_equal_bytes(tmp_path):
    first, second = tmp_path / "a.npz", tmp_path / "b.npz"
    save_packing(first, example())
    save_packing(second, load_packing(first))
    assert first.read_bytes() == second.read_bytes()
    loaded = load_packing(first)
    for field, array in arrays(example()).items():
        np.testing.assert_array_equal(getattr(loaded, field), array)
    for field in (
        "name",
        "volume",
        "bounding_radius",
        "mesh_sha256",
        "mass",
        "surface_gap",
        "source",
        "licence",
    ):
        assert getattr(loaded, field) == getattr(example(), field)
    for array in arrays(loaded).values():
        assert array.flags.c_contiguous and not array.flags.writeable and array.dtype == np.float64


def test_a_file_of_spheres_only_gets_its_inertia_from_them(tmp_path):
    path = tmp_path / "pair.npz"
    np.savez(path, centers=[[1.0, 2.0, 3.0], [4.0, 2.0, 3.0]], radii=[1.0, 0.5])
    packing = load_packing(path)
    m = np.array([8.0, 1.0]) / 9.0
    reduced, own = m[0] * m[1] * 9.0, 0.4 * (m[0] + 0.25 * m[1])
    np.testing.assert_allclose(packing.inertia, np.diag([own, own + reduced, own + reduced]), atol=ROUND_OFF)
    np.testing.assert_allclose(packing.centers, [[-3.0 * m[1], 0, 0], [3.0 * m[0], 0, 0]], atol=ROUND_OFF)
    np.testing.assert_allclose(packing.origin, [-1.0 - 3.0 * m[1], -2.0, -3.0], atol=ROUND_OFF)
    assert packing.volume == pytest.approx(4.0 / 3.0 * np.pi * 1.125)
    assert packing.bounding_radius == pytest.approx(3.0 * m[0] + 0.5)
    assert packing.name == "pair" and packing.mass is None


def test_prefix_keeps_the_body():
    packing, part = example(), example().prefix(2)
    np.testing.assert_array_equal(part.centers, packing.centers[:2])
    np.testing.assert_array_equal(part.inertia, packing.inertia)
    assert (part.volume, part.mass, part.bounding_radius) == (
        packing.volume,
        packing.mass,
        packing.bounding_radius,
    )
    assert part.fill == pytest.approx(4.0 / 3.0 * np.pi * 0.009 / 0.1)
    assert part.surface_gap is None
    for k in (0, -1, 1.5, True):
        with pytest.raises(InvalidModelError, match="positive integer"):
            packing.prefix(k)
    with pytest.raises(InvalidModelError, match=r"more than the 3 spheres of model 'example' \(got 4\)"):
        packing.prefix(4)


def test_scale():
    packing, double = example(), example().scaled(2.0)
    np.testing.assert_array_equal(double.centers, 2.0 * packing.centers)
    np.testing.assert_array_equal(double.radii, 2.0 * packing.radii)
    np.testing.assert_array_equal(double.origin, 2.0 * packing.origin)
    np.testing.assert_array_equal(double.inertia, 4.0 * packing.inertia)
    assert double.volume == 8.0 * packing.volume and double.bounding_radius == 2.0 * packing.bounding_radius
    assert double.mass == 8.0 * packing.mass and double.fill == pytest.approx(packing.fill)
    for s in (0.0, -1.0, np.nan, np.inf, "2"):
        with pytest.raises(InvalidModelError, match="scale"):
            packing.scaled(s)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"centers": None}, "has no 'centers'"),
        ({"radii": None}, "has no 'radii'"),
        ({"centers": np.zeros((3, 2))}, r"centers must have shape \(n, 3\) \(got \(3, 2\)\)"),
        ({"centers": np.zeros((2, 3))}, "as many rows as radii has entries, 3"),
        ({"radii": np.array([0.2, -0.1, 0.05])}, r"radii\[1\] must be positive \(got -0.1\)"),
        ({"radii": np.zeros(0), "centers": np.zeros((0, 3))}, "radii is empty"),
        ({"radii": np.array([0.2, np.nan, 0.05])}, r"radii\[1\] is not a finite number"),
        ({"centers": np.full((3, 3), np.inf)}, r"centers\[0\]\[0\] is not a finite number"),
        ({"radii": np.array(["a", "b", "c"])}, "radii must hold real numbers"),
        ({"inertia": skewed(0.9e-9)}, None),
        ({"inertia": skewed(1.1e-9)}, "inertia is not symmetric"),
        ({"inertia": np.diag([1.0, 1.0, -1.0])}, "principal moment that is not positive"),
        ({"inertia": np.diag([1.0, 1.0, 2.0 + 1.9e-9])}, None),
        ({"inertia": np.diag([1.0, 1.0, 2.0 + 2.1e-9])}, "belongs to no solid"),
        *(({"inertia": s * REACH**2 * np.eye(3)}, None) for s in (0.99e12, 1.01e-12)),
        *(({"inertia": s * REACH**2 * np.eye(3)}, "out of all proportion") for s in (1.01e12, 0.99e-12)),
        ({"inertia": np.eye(2)}, r"inertia must have shape \(3, 3\)"),
        ({"volume": -1.0}, "volume must be positive"),
        ({"bounding_radius": REACH * (1.0 - 0.9e-9)}, None),
        ({"bounding_radius": REACH * (1.0 - 1.1e-9)}, "bounding_radius is less than the spheres' reach"),
        ({"origin": np.zeros(2)}, r"origin must have shape \(3,\)"),
        ({"mass": 0.0}, "mass must be positive"),
    ],
)
def test_inconsistent_files_are_refused_by_name_field_and_value(tmp_path, change, message):
    path = tmp_path / "bad.npz"
    values = {**arrays(example()), "volume": 0.1, "bounding_radius": 0.6, **change}
    np.savez(path, **{key: value for key, value in values.items() if value is not None})
    if message is None:
        load_packing(path)
        return
    with pytest.raises(InvalidModelError, match=message) as caught:
        load_packing(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, OSError])
def test_an_interrupted_write_leaves_the_old_file(tmp_path, monkeypatch, interruption):
    path = tmp_path / "model.npz"
    save_packing(path, example())
    before = path.read_bytes()

    def fail(stream, **_):
        stream.write(b"half a file")
        raise interruption

    monkeypatch.setattr(packing_file.np, "savez_compressed", fail)
    with pytest.raises(interruption):
        save_packing(path, example().scaled(2.0))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_distances_of_pieces_are_kept_and_scaled(tmp_path):
    mug = load_model("mug")
    assert mug.pieces_kind == "recipe" and mug.pieces_error[3] < 7e-4
    loaded = load_packing(save_packing(tmp_path / "mug.npz", mug.scaled(0.5)))
    assert loaded.pieces_kind == "recipe"
    np.testing.assert_allclose(loaded.pieces_error, 0.5 * mug.pieces_error, rtol=1e-12)
    with pytest.raises(InvalidModelError, match="pieces_error must not be negative"):
        replace(mug, pieces_error=-mug.pieces_error)


@pytest.mark.parametrize("name", ["armadillo", "bunny"])
def test_scans_are_cut_into_hulls(name):
    model = load_model(name)
    mean, _, outside, inside = model.pieces_error
    assert model.pieces_kind == "convex decomposition" and 2 < len(model.pieces) <= 32
    assert mean < 1e-3 and outside < 1e-3 and inside < 5e-3
