"""Solids: mass properties against closed forms, refusals, repairs."""

import re

import numpy as np
import pytest
import trimesh
from example_meshes import MESHES, ball, joined, moved, raw, turned_inside_out

from unc_physics.checks.errors import InvalidMeshError
from unc_physics.shapes.primitives import primitive
from unc_physics.shapes.solid_mesh import load_solid, make_solid, mesh_notes

ROUND_OFF = 1e-12


def test_box_has_the_closed_form():
    solid = make_solid("box", *raw(moved(trimesh.creation.box([1.0, 2.0, 3.0]), [5.0, -6.0, 7.0])))
    assert solid.volume == pytest.approx(6.0, rel=ROUND_OFF)
    np.testing.assert_allclose(solid.origin, [-5.0, 6.0, -7.0], rtol=ROUND_OFF)
    np.testing.assert_allclose(solid.inertia, np.diag([13.0, 10.0, 5.0]) / 12.0, atol=ROUND_OFF)
    np.testing.assert_allclose(solid.bounds, [[-0.5, -1.0, -1.5], [0.5, 1.0, 1.5]], atol=ROUND_OFF)
    assert solid.bounding_radius == pytest.approx(np.sqrt(3.5), rel=ROUND_OFF)


@pytest.mark.parametrize("kind", ["capsule", "cylinder"])
@pytest.mark.parametrize(
    ("radius", "length"), [(0.015, 0.1), (0.001, 1.0), (7e-4, 0.02), (1e-6, 1e-6), (50.0, 1e-3)]
)
def test_round_bodies_of_any_size_are_solids(kind, radius, length):
    solid = make_solid(kind, *primitive(kind, (radius, length)))
    ends = 4.0 / 3.0 * radius if kind == "capsule" else 0.0
    volume = np.pi * radius**2 * (length + ends)
    assert 0.999 * volume < solid.volume < volume


def test_components_and_cavities_add_up():
    one, two = make_solid("a", *raw(ball(1.0))), make_solid("b", *raw(ball(0.5)))
    pair = make_solid("pair", *MESHES["two balls"]())
    assert pair.volume == pytest.approx(one.volume + two.volume, rel=ROUND_OFF)
    np.testing.assert_allclose(-pair.origin, [2.0 * two.volume / pair.volume, 0.0, 0.0], atol=ROUND_OFF)
    inner = make_solid("inner", *raw(ball(0.6)))
    hollow = make_solid("hollow", *MESHES["hollow ball"]())
    assert hollow.volume == pytest.approx(one.volume - inner.volume, rel=ROUND_OFF)
    np.testing.assert_allclose(
        hollow.inertia * hollow.volume,
        one.inertia * one.volume - inner.inertia * inner.volume,
        atol=ROUND_OFF,
    )


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e3])
@pytest.mark.parametrize("offset", [0.0, 1e3])
def test_mass_properties_follow_scale_and_offset(scale, offset):
    vertices, faces = MESHES["torus"]()
    plain = make_solid("plain", vertices, faces)
    other = make_solid("other", (vertices + offset) * scale, faces)
    lost = 1e-11 if offset else ROUND_OFF  # coordinates far off carry fewer digits of the shape
    assert other.volume == pytest.approx(plain.volume * scale**3, rel=lost)
    np.testing.assert_allclose(other.inertia, plain.inertia * scale**2, atol=lost * scale**2)
    np.testing.assert_allclose(other.origin, (plain.origin - offset) * scale, atol=lost * scale)


def open_box():
    vertices, faces = raw(trimesh.creation.box())
    return vertices, faces[1:]


def one_face_turned():
    vertices, faces = raw(trimesh.creation.box())
    faces[0] = faces[0][::-1]
    return vertices, faces


def inside_out():
    return raw(turned_inside_out(ball(1.0)))


BAD = {
    "is open: 3 of its 18 edges": open_box,
    "is wound inconsistently: at 3 of its 18 edges": one_face_turned,
    "is inside out": inside_out,
    "a component .* that is inside out": lambda: joined(
        ball(1.0), turned_inside_out(moved(ball(0.5), [3.0, 0, 0]))
    ),
    "a component .* inside another": lambda: joined(ball(1.0), ball(0.5)),
    "encloses no volume": lambda: (np.eye(3), np.array([[0, 1, 2], [0, 2, 1]])),
    "has no triangles": lambda: (np.zeros((3, 3)), np.zeros((0, 3), dtype=int)),
    "one point": lambda: (np.ones((3, 3)), np.array([[0, 1, 2]])),
    "degenerate": lambda: (np.eye(3), np.array([[0, 0, 1], [1, 1, 2]])),
    "not finite": lambda: (np.full((3, 3), np.nan), np.array([[0, 1, 2]])),
}


@pytest.mark.parametrize("reason", BAD)
def test_what_is_no_solid_is_refused_with_its_reason(reason):
    with pytest.raises(InvalidMeshError, match=reason):
        make_solid("bad", *BAD[reason]())


@pytest.mark.parametrize(
    ("mesh", "deed"),
    [
        (open_box, "closed holes with 1 triangle"),
        (one_face_turned, "turned 1 triangle"),
        (inside_out, "turned 320 triangles"),
    ],
)
def test_repair_makes_a_solid_and_says_how(tmp_path, mesh, deed):
    path = tmp_path / "mesh.off"
    trimesh.Trimesh(*mesh(), process=False).export(path)
    with pytest.raises(InvalidMeshError, match=r"\(a repair "):
        load_solid(path)
    solid, repairs = load_solid(path, repair=True)
    assert any(repair.startswith(deed) for repair in repairs), repairs
    whole = make_solid("whole", *(raw(ball(1.0)) if mesh is inside_out else raw(trimesh.creation.box())))
    assert solid.volume == pytest.approx(whole.volume, rel=1e-7)  # the file's decimals
    assert f", now {whole.volume:.4g}" in repairs[-1]


UNITS = {
    "centimetres": ("dae", '<unit name="centimeter" meter="0.01"/><up_axis>Z_UP</up_axis>', 0.01, ["0.01 m"]),
    "turned": ("dae", "<unit meter='2'/><up_axis>Y_UP</up_axis>", 2.0, ["2 m", "says Y_UP"]),
    "x up": ("dae", "<up_axis>X_UP</up_axis>", 1.0, ["says X_UP"]),
    "nothing said": ("dae", "", 1.0, ["says no up_axis, which means Y_UP"]),
    "millimetres": ("3mf", "", 0.001, ["3MF"]),
    "glTF": ("glb", "", 1.0, ["y up"]),
    "STL": ("stl", "", 1.0, []),
}


@pytest.mark.parametrize("name", UNITS)
def test_files_that_state_a_unit_are_read_in_metres_and_their_axes_are_named(tmp_path, name):
    suffix, asset, unit, said = UNITS[name]
    path = tmp_path / f"box.{suffix}"
    trimesh.creation.box([1.0, 2.0, 3.0]).export(path)
    if suffix == "dae":
        path.write_text(
            re.sub("<asset>.*?</asset>", f"<asset>{asset}</asset>", path.read_text(), flags=re.DOTALL)
        )
    solid, _ = load_solid(path)
    np.testing.assert_allclose(solid.bounds[1] - solid.bounds[0], unit * np.array([1.0, 2.0, 3.0]))
    notes = mesh_notes(path)
    assert len(notes) == len(said)
    for note, part in zip(notes, said, strict=True):
        assert part in note


@pytest.mark.parametrize("suffix", [".stl", ".off", ".obj", ".ply", ".glb"])
def test_formats(tmp_path, suffix):
    vertices, faces = MESHES["two balls"]()
    path = tmp_path / f"mesh{suffix}"
    trimesh.Trimesh(vertices, faces, process=False).export(path)
    solid, repairs = load_solid(path)
    assert repairs == []
    assert solid.volume == pytest.approx(
        make_solid("same", vertices, faces).volume, rel=1e-6
    )  # STL holds float32
    assert solid.name == "mesh" and len(solid.sha256) == 64


@pytest.mark.parametrize("content", [b"", b"no mesh", b"OFF\n1 2 3\n"])
def test_a_file_that_is_no_mesh_is_refused(tmp_path, content):
    path = tmp_path / "bad.off"
    path.write_bytes(content)
    with pytest.raises(InvalidMeshError, match="bad.off"):
        load_solid(path)
    with pytest.raises(InvalidMeshError, match="No such file"):
        load_solid(tmp_path / "missing.off")


@pytest.mark.parametrize(
    "content, words",
    [
        ("", "has no triangles"),
        (
            "solid|facet|outer loop|vertex nan 0 0|vertex 1 0 0|vertex 0 1 0|endloop|endfacet|endsolid|",
            "not finite numbers",
        ),
    ],
)
def test_a_repair_does_not_begin_without_triangles(tmp_path, content, words):
    path = tmp_path / "bad.stl"
    path.write_text(content.replace("|", "\n"))
    with pytest.raises(InvalidMeshError, match=words):
        load_solid(path, repair=True)


def test_a_needle_too_thin_for_its_inertia_is_refused():
    turned = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])
    with pytest.raises(InvalidMeshError, match="too thin for its size"):
        make_solid("needle", *raw(trimesh.creation.box([1.0, 1e-5, 1e-5], transform=turned)))


def bent(turns):
    """A rod of radius 0.2 m that is bent round a circle of 1 m, so many turns."""
    rod = trimesh.creation.cylinder(radius=0.2, height=2.0 * np.pi * turns, sections=24)
    rod = rod.subdivide_to_size(0.3)
    x, y, z = rod.vertices.T
    return np.stack(
        [(1.0 + x) * np.cos(z), (1.0 + x) * np.sin(z), y + 0.1 * z / (2.0 * np.pi)], axis=1
    ), rod.faces[:, ::-1]


def test_a_surface_that_passes_through_itself_is_refused():
    """A quarter of a turn counts twice where the rod goes round 1.25 times, 0.1 m aside."""
    with pytest.raises(
        InvalidMeshError, match=r"passes through itself: about [1-4]\d% of its surface .* editor"
    ):
        make_solid("ring", *bent(1.25))
    true = 0.75 * 2.0 * np.pi * np.pi * 0.2**2
    assert make_solid("hook", *bent(0.75)).volume == pytest.approx(true, rel=0.03)


def overlapping(depth):
    """A cube of 1 m and one of 0.5 m beside it, which reaches so far into it, both turned."""
    turn = trimesh.transformations.rotation_matrix(0.7, [1.0, 2.0, 3.0])
    cubes = trimesh.creation.box([1.0] * 3), moved(trimesh.creation.box([0.5] * 3), [0.75 - depth, 0.0, 0.0])
    return joined(*(cube.apply_transform(turn) for cube in cubes))


def boxes(*sizes_and_places):
    return joined(*(moved(trimesh.creation.box(size), place) for size, place in sizes_and_places))


def bracket():
    """The ends of both boxes are flush, so that an edge has four triangles."""
    return boxes(([0.1, 0.04, 0.02], [0, 0, 0]), ([0.02, 0.04, 0.08], [-0.04, 0, 0.03]))


CUBE = [1.0, 1.0, 1.0]
UNIONS = {
    "turned": (lambda: overlapping(0.2), 1.0 + 0.25 * 0.3, "-4.4%"),
    "flush ends": (bracket, 0.1 * 0.04 * 0.02 + 0.02 * 0.04 * 0.06, "-11.1%"),
    "aligned": (lambda: boxes((CUBE, [0, 0, 0]), (CUBE, [0.4, 0, 0])), 1.4, "-30.0%"),
    "most of it common": (lambda: boxes((CUBE, [0, 0, 0]), (CUBE, [0.05, 0, 0])), 1.05, "-47.5%"),
    "aligned in a row": (
        lambda: boxes((CUBE, [0, 0, 0]), (CUBE, [0.4, 0, 0]), (CUBE, [0.8, 0, 0])),
        1.8,
        "-40.0%",
    ),
    "flush inside": (lambda: boxes((CUBE, [0, 0, 0]), ([0.5, 0.5, 0.5], [0.25, 0.25, 0.25])), 1.0, "-11.1%"),
}


@pytest.mark.parametrize("name", UNIONS)
def test_parts_that_overlap_are_refused_and_united_by_a_repair(tmp_path, name):
    """Also where they have faces in common, and where most of one part is in the other."""
    make, volume, change = UNIONS[name]
    path = tmp_path / "parts.stl"
    trimesh.Trimesh(*make(), process=False).export(path)
    with pytest.raises(InvalidMeshError, match=r"overlap: about \d+% of its volume .*\(a repair unites"):
        make_solid("parts", *make())
    solid, repairs = load_solid(path, repair=True)
    assert solid.volume == pytest.approx(volume, rel=1e-6)
    assert repairs[-2].startswith("united") and repairs[-1].endswith(f"({change})")


def test_parts_that_share_a_whole_face_are_one_solid_after_a_repair(tmp_path):
    """Their common wall goes; of a surface whose triangles have two sides, one side stays."""
    path = tmp_path / "row.stl"
    cube = trimesh.creation.box()
    mirrored = trimesh.Trimesh([1.0, 0.0, 0.0] - cube.vertices * [1.0, -1.0, -1.0], cube.faces[:, ::-1])
    trimesh.util.concatenate([cube, mirrored]).export(path)
    solid, _ = load_solid(path, repair=True)
    assert solid.volume == pytest.approx(2.0, rel=1e-6) and len(solid.corners) == 20
    trimesh.util.concatenate([cube, turned_inside_out(cube)]).export(path)
    solid, _ = load_solid(path, repair=True)
    assert solid.volume == pytest.approx(1.0, rel=1e-6) and len(solid.corners) == 12


def test_parts_that_touch_are_no_overlap(tmp_path):
    """In single precision; a little overlap, 0.02 % of the volume, is none either."""
    for depth in (0.0, 0.001):
        path = tmp_path / "cubes.stl"
        trimesh.Trimesh(*overlapping(depth), process=False).export(path)
        solid, repairs = load_solid(path, repair=True)
        assert solid.volume == pytest.approx(1.125, rel=1e-6)
        assert not any("united" in repair for repair in repairs)
