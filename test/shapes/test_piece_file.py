"""Pieces in model files: round trip, old files, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pieces_at_random import KINDS, piece, turn

from unc_physics import load_model, load_packing, primitive_model, save_packing
from unc_physics.checks.errors import LimitExceededError, UncPhysicsError
from unc_physics.shapes.packing_file import FORMAT_VERSION, SpherePacking
from unc_physics.shapes.piece_file import KEYS, PIECES_LIMIT, piece_entries, pieces_of_entries
from unc_physics.shapes.pieces import HalfSpace, Hull, Lathe, ball, box, cylinder

FIELDS = {Hull: ("points", "rounding", "normals"), Lathe: tuple(Lathe.__dataclass_fields__)}


def assert_equal(first, second):
    assert len(first) == len(second)
    for a, b in zip(first, second, strict=True):
        assert type(a) is type(b)
        for field in FIELDS[type(a)]:
            np.testing.assert_array_equal(getattr(a, field), getattr(b, field))
        for one, other in zip(getattr(a, "faces", ()), getattr(b, "faces", ()), strict=True):
            np.testing.assert_array_equal(one, other)


def model(pieces):
    return SpherePacking(
        "m", [[0.0, 0.0, 0.0]], [0.1], 0.004 * np.eye(3), 0.004, np.zeros(3), 0.1, pieces=pieces
    )


@given(st.lists(st.tuples(st.sampled_from(KINDS), st.integers(0, 999)), min_size=1, max_size=6))
@settings(deadline=None, max_examples=60)
def test_a_file_returns_the_same_bits(tmp_path_factory, drawn):
    pieces = []
    for kind, seed in drawn:
        rng = np.random.default_rng(seed)
        pieces.append(piece(kind, rng).moved(rng.normal(size=3), turn(rng)))
    path = tmp_path_factory.getbasetemp() / "pieces.npz"
    save_packing(path, model(pieces))
    assert_equal(pieces, load_packing(path).pieces)


def test_files_have_a_version_and_old_ones_load(tmp_path):
    path = tmp_path / "box.npz"
    save_packing(path, model([box((0.1, 0.1, 0.1))]))
    values = dict(np.load(path))
    assert values["format_version"] == FORMAT_VERSION and KEYS.keys() <= values.keys()
    old = {key: value for key, value in values.items() if key not in KEYS and key != "format_version"}
    np.savez(path, **old)
    loaded = load_packing(path)
    assert loaded.has_only_spheres and loaded.pieces[0].rounding == 0.1
    save_packing(path, loaded)
    assert not KEYS.keys() & np.load(path).keys()
    np.savez(path, **old, format_version=FORMAT_VERSION + 1)
    with pytest.raises(UncPhysicsError, match="format_version must be 1 to 2; a newer release"):
        load_packing(path)


def test_arcs_are_kept_scaled_and_missing_in_older_files(tmp_path):
    path = tmp_path / "bowl.npz"
    arcs = [[[0.04, 0.0, -0.6, 0.8], [0.05, 0.02, -0.8, 0.6]]]
    ring = Lathe([[0.04, 0.0], [0.06, 0.0], [0.05, 0.02]], half_angle=0.5, arcs=arcs)
    save_packing(path, model([ball(0.1), ring]))
    assert_equal(load_packing(path).pieces, [ball(0.1), ring])
    np.testing.assert_array_equal(ring.scaled(2.0).arcs[..., :2], 2.0 * ring.arcs[..., :2])
    np.testing.assert_array_equal(ring.scaled(2.0).arcs[..., 2:], ring.arcs[..., 2:])
    older = {key: value for key, value in np.load(path).items() if "arc" not in key}
    np.savez(path, **older)
    assert_equal(load_packing(path).pieces, [ball(0.1), replace(ring, arcs=())])
    with pytest.raises(UncPhysicsError, match="arcs must have normals of length 1"):
        Lathe([[0.04, 0.0], [0.06, 0.0], [0.05, 0.02]], arcs=np.ones((1, 2, 4)))


def test_spheres_without_inertia_take_the_pieces_to_their_centroid(tmp_path):
    path = tmp_path / "far.npz"
    np.savez(path, centers=[[1.0, 2.0, 3.0]], radii=[0.1], **piece_entries([ball(0.1, (1.0, 2.0, 3.0))]))
    assert_equal(load_packing(path).pieces, [ball(0.1)])


def test_prefix_keeps_pieces_and_scale_scales_them():
    mug = load_model("mug")
    assert mug.prefix(10).pieces is mug.pieces
    for a, b in zip(mug.scaled(0.5).pieces, mug.pieces, strict=True):
        if isinstance(a, Lathe):
            np.testing.assert_allclose(a.profile, 0.5 * b.profile, rtol=1e-15)
            np.testing.assert_allclose(a.origin, 0.5 * b.origin, rtol=1e-15)
        else:
            np.testing.assert_allclose(a.points, 0.5 * b.points, rtol=1e-15)
            assert a.rounding == 0.5 * b.rounding


@pytest.mark.parametrize(
    ("shape", "size", "expected"),
    [
        ("box", {"size": (0.1, 0.2, 0.3)}, box((0.1, 0.2, 0.3))),
        ("cylinder", {"radius": 0.1, "length": 0.2}, cylinder(0.1, 0.2)),
        ("capsule", {"radius": 0.1, "length": 0.2}, Hull([[0, 0, -0.1], [0, 0, 0.1]], 0.1)),
        ("sphere", {"radius": 0.1}, ball(0.1)),
    ],
)
def test_primitives_are_pieces_as_they_stand(shape, size, expected):
    assert_equal(primitive_model(shape, **size).pieces, [expected])


BOX = piece_entries([box((1.0, 1.0, 1.0)), cylinder(1.0, 1.0)])


def changed(key, at, value):
    array = np.array(BOX[key], float)
    array[at] = value
    return {**BOX, key: array}


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({k: v for k, v in BOX.items() if k != "piece_sector"}, "piece_sector is missing"),
        ({**BOX, "piece_kind": np.zeros((2, 2))}, r"piece_kind must have shape \(2,\)"),
        ({**BOX, "piece_origin": np.zeros((3, 3))}, r"piece_origin must have shape \(2, 3\)"),
        ({**BOX, "piece_kind": np.array(["a", "b"])}, "piece_kind must hold finite numbers"),
        (changed("piece_points", (0, 0), np.nan), "piece_points must hold finite numbers"),
        (changed("piece_kind", 1, 7), r"piece 1: piece_kind must be 0 \(hull\) or 1 \(lathe\)"),
        (changed("piece_sizes", 0, 9), "piece_sizes must have the sum 12"),
        (changed("piece_sizes", 0, 7.5), "piece_sizes must hold integers"),
        (changed("piece_face_corners", 0, 8), r"piece 0: faces\[0\] must be at least three indices of the 8"),
        (changed("piece_face_corners", 0, 1), "piece 0: faces must meet in pairs"),
        (changed("piece_points", 0, 0.4), "piece 0: faces must bound the convex hull of the points"),
        (changed("piece_rounding", 1, -1.0), "piece 1: rounding must not be negative"),
        (changed("piece_axes", (1, 0, 0), 2.0), "piece 1: axes must be a rotation matrix"),
        ({k: v for k, v in BOX.items() if k != "piece_arcs"}, "piece_arcs is missing"),
        (changed("piece_arc_counts", 1, 1), "piece_arc_counts must have the sum 0"),
        (changed("piece_sector", (1, 1), 3.0), "piece 1: half_angle must be pi"),
    ],
)
def test_bad_entries_are_named(entries, message):
    with pytest.raises(UncPhysicsError, match=message):
        pieces_of_entries(entries)


def test_limits(tmp_path):
    with pytest.raises(UncPhysicsError, match=r"pieces\[0\] must be a Hull or a Lathe"):
        model([HalfSpace()])
    with pytest.raises(LimitExceededError, match=f"pieces must be at most {PIECES_LIMIT}"):
        model([ball(0.1)] * (PIECES_LIMIT + 1))
    path = tmp_path / "bomb.npz"
    np.savez_compressed(path, **piece_entries([ball(0.1)]) | {"piece_kind": np.zeros(PIECES_LIMIT + 9999)})
    with pytest.raises(LimitExceededError, match="piece_kind"):
        load_packing(path)
