"""Solids: mass properties against closed forms, refusals, repairs."""

import numpy as np
import pytest
import trimesh
from example_meshes import MESHES, ball, joined, moved, raw, turned_inside_out

from unc_physics.checks.errors import InvalidMeshError
from unc_physics.geometry.solid_mesh import load_solid, make_solid, winding_number

ROUND_OFF = 1e-12


def test_box_has_the_closed_form():
    solid = make_solid("box", *raw(moved(trimesh.creation.box([1.0, 2.0, 3.0]), [5.0, -6.0, 7.0])))
    assert solid.volume == pytest.approx(6.0, rel=ROUND_OFF)
    np.testing.assert_allclose(solid.origin, [-5.0, 6.0, -7.0], rtol=ROUND_OFF)
    np.testing.assert_allclose(solid.inertia, np.diag([13.0, 10.0, 5.0]) / 12.0, atol=ROUND_OFF)
    np.testing.assert_allclose(solid.bounds, [[-0.5, -1.0, -1.5], [0.5, 1.0, 1.5]], atol=ROUND_OFF)
    assert solid.bounding_radius == pytest.approx(np.sqrt(3.5), rel=ROUND_OFF)


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
        (open_box, "closed holes with 1 triangles"),
        (one_face_turned, "turned 1 triangles"),
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


def test_winding_number():
    vertices, faces = MESHES["ball in a cavity"]()
    probes = np.array([[0.0, 0, 0], [0.45, 0, 0], [0.8, 0, 0], [2.0, 0, 0]])
    np.testing.assert_allclose(winding_number(vertices[faces], probes), [1.0, 0.0, 1.0, 0.0], atol=ROUND_OFF)


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


def test_parts_that_overlap_are_refused_and_united_by_a_repair(tmp_path):
    path = tmp_path / "cubes.stl"
    trimesh.Trimesh(*overlapping(0.2), process=False).export(path)
    with pytest.raises(InvalidMeshError, match=r"overlap: about [3-6]% of its volume .*\(a repair unites"):
        load_solid(path)
    solid, repairs = load_solid(path, repair=True)
    assert solid.volume == pytest.approx(1.0 + 0.25 * 0.3, rel=1e-6)
    assert repairs[-1] == "united 2 parts, which overlapped: the volume is 4.4% less"


def test_parts_that_share_an_edge_are_united(tmp_path):
    """A bracket: the ends of both boxes are flush, so that an edge has four triangles."""
    plate, post = trimesh.creation.box([0.1, 0.04, 0.02]), trimesh.creation.box([0.02, 0.04, 0.08])
    path = tmp_path / "bracket.stl"
    trimesh.util.concatenate([plate, moved(post, [-0.04, 0.0, 0.03])]).export(path)
    solid, repairs = load_solid(path, repair=True)
    assert solid.volume == pytest.approx(0.1 * 0.04 * 0.02 + 0.02 * 0.04 * 0.06, rel=1e-6)
    assert repairs[-1] == "united 2 parts, which overlapped: the volume is 11.1% less"


def test_parts_that_touch_are_no_overlap(tmp_path):
    """In single precision; a little overlap, 0.02 % of the volume, is none either."""
    for depth in (0.0, 0.001):
        path = tmp_path / "cubes.stl"
        trimesh.Trimesh(*overlapping(depth), process=False).export(path)
        solid, repairs = load_solid(path, repair=True)
        assert solid.volume == pytest.approx(1.125, rel=1e-6)
        assert not any("united" in repair for repair in repairs)
