"""Shapes of links: exact pieces and mass properties, meshes that are boxes, URDF 1.1."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from unc_physics import UncPhysicsError, load_scene, load_world
from unc_physics.__main__ import main
from unc_physics.checks.errors import NotSupportedError
from unc_physics.descriptions.link_solid import find_link, link_solid
from unc_physics.descriptions.parts import Shape
from unc_physics.descriptions.reading import read_description
from unc_physics.descriptions.shape_solid import shape_solid, simple_shape
from unc_physics.shapes import mesh_pieces as module
from unc_physics.shapes.mass_properties import mass_properties
from unc_physics.shapes.packing_file import HULL
from unc_physics.shapes.pieces import Hull, Lathe

pytest.importorskip("yourdfpy")
TURN = Rotation.from_euler("xyz", [0.3, -0.5, 1.1])
POSE = np.eye(4)
POSE[:3, :3], POSE[:3, 3] = TURN.as_matrix(), (1.0, 2.0, 3.0)
r, h = 0.1, 0.4
BALL, ROD = 4.0 / 3.0 * np.pi * r**3, np.pi * r**2 * h
#: Sizes, volume, moments about the own axes and height of the centre of mass, from closed forms.
SHAPES = {
    "box": ((0.1, 0.2, 0.3), 0.006, np.array([0.13, 0.1, 0.05]) / 12.0, 0.0, Hull),
    "sphere": ((r,), BALL, np.full(3, 0.4 * r**2), 0.0, Hull),
    "cylinder": ((r, h), ROD, [r**2 / 4 + h**2 / 12, r**2 / 4 + h**2 / 12, r**2 / 2], 0.0, Lathe),
    "capsule": ((r, h), ROD + BALL, None, 0.0, Hull),
    "ellipsoid": ((0.1, 0.2, 0.3), 8 * np.pi * 0.001, np.array([0.13, 0.1, 0.05]) / 5.0, 0.0, Hull),
    "spheroid": ((0.2, 0.1, 0.2), 16 / 3 * np.pi * 0.001, np.array([0.05, 0.08, 0.05]) / 5.0, 0.0, Lathe),
    "cone": ((r, h), ROD / 3, [0.15 * r**2 + 0.0375 * h**2] * 2 + [0.3 * r**2], -h / 4, Lathe),
}


@pytest.mark.parametrize("name", SHAPES)
def test_a_primitive_is_an_exact_piece_with_the_mass_properties_of_its_closed_form(name):
    size, volume, moments, height, kind = SHAPES[name]
    found = shape_solid(Shape("ellipsoid" if name == "spheroid" else name, POSE, size))
    assert found.properties.volume == pytest.approx(volume, rel=1e-9)
    np.testing.assert_allclose(found.properties.center, TURN.apply([0, 0, height]) + POSE[:3, 3], atol=1e-12)
    if moments is not None:
        expected = TURN.as_matrix() @ np.diag(moments) @ TURN.as_matrix().T
        np.testing.assert_allclose(found.properties.inertia, expected, atol=1e-9)
    (piece,) = found.pieces
    assert isinstance(piece, kind)
    own = mass_properties([piece])
    assert own.volume == pytest.approx(volume, rel=0.01), "a hull or profile of an ellipsoid lies inside"
    np.testing.assert_allclose(own.center, found.properties.center, atol=1e-6)
    outline = trimesh.Trimesh(found.vertices, found.faces)
    assert outline.is_volume and outline.volume == pytest.approx(volume, rel=0.01)


@pytest.mark.parametrize("kind", ["box", "cylinder", "cone", "ellipsoid"])
def test_sizes_are_positive(kind):
    size = (0.1, -0.2, 0.3) if kind in ("box", "ellipsoid") else (0.1, 0.0)
    with pytest.raises(UncPhysicsError, match=f"size of a {kind} must be positive"):
        shape_solid(Shape(kind, np.eye(4), size))


def write_sdf(folder, content):
    path = folder / "a.sdf"
    path.write_text(f"<sdf version='1.11'><world name='w'>{content}</world></sdf>")
    return path


def static_mesh(name, text, pose="0 0 0 0 0 0"):
    return (
        f"<model name='{name}'><static>1</static><pose>{pose}</pose><link name='l'><collision name='c'>"
        f"<geometry><mesh>{text}</mesh></geometry></collision></link></model>"
    )


def test_fixed_meshes_of_boxes_are_boxes_of_the_environment(tmp_path):
    """Whatever their size, scale, mirror image, tessellation and pose; with exact faces."""
    floor = trimesh.creation.box([100.0, 320.0, 0.1])
    floor.export(tmp_path / "floor.stl")
    top = trimesh.creation.box([1200.0, 800.0, 20.0]).subdivide().subdivide()
    top.apply_transform(trimesh.transformations.rotation_matrix(0.4, [0, 0, 1], [50.0, 0, 0]))
    top.export(tmp_path / "top.obj")
    content = static_mesh("floor", "<uri>floor.stl</uri>", "0 0 -0.05 0 0 0")
    content += static_mesh("top", "<uri>top.obj</uri><scale>0.001 0.001 0.001</scale>", "1 2 0.7 0 0 0.5")
    content += static_mesh("mirrored", "<uri>top.obj</uri><scale>-0.001 0.001 0.001</scale>")
    world = load_world(write_sdf(tmp_path, content))
    assert not world.bodies and not world.left_out
    floor, top, mirrored = world.environment
    np.testing.assert_allclose([floor.size, floor.position], [[100, 320, 0.1], [0, 0, -0.05]], atol=1e-6)
    np.testing.assert_allclose(top.size, [1.2, 0.8, 0.02], atol=1e-6)
    turn = Rotation.from_euler("z", 0.4)
    middle = np.array([0.05, 0, 0]) - turn.apply([0.05, 0, 0])  # of the mesh, turned about (50, 0, 0) mm
    np.testing.assert_allclose(
        top.position, Rotation.from_euler("z", 0.5).apply(middle) + [1, 2, 0.7], atol=1e-6
    )
    angle = Rotation.from_quat(top.orientation) * Rotation.from_euler("z", -0.9)
    assert angle.magnitude() < 1e-6
    np.testing.assert_allclose(mirrored.position, middle * [-1, 1, 1], atol=1e-6)


@pytest.mark.parametrize("cut", [False, True])
def test_other_meshes_are_cut_or_have_their_hull_with_a_note(tmp_path, cut, monkeypatch):
    plate, wall = trimesh.creation.box([0.1, 0.1, 0.01]), trimesh.creation.box([0.01, 0.1, 0.08])
    wall.apply_transform(trimesh.transformations.rotation_matrix(0.2, (0.0, 1.0, 0.0)))  # no boxes
    wall.apply_translation([0.035, 0.0, 0.04])
    trimesh.boolean.union([plate, wall], engine="manifold").export(tmp_path / "bracket.stl")
    halves = tuple(Hull(part.vertices) for part in (plate, wall))

    def pieces(solid, **_):
        if not cut:
            raise NotSupportedError("is not convex", field="mesh")
        return module.measured_pieces([h.moved(solid.origin, np.eye(3)) for h in halves], "cut", solid)

    monkeypatch.setattr(module, "mesh_pieces", pieces)
    world = load_world(write_sdf(tmp_path, static_mesh("part", "<uri>bracket.stl</uri>")), spheres=20)
    model = world.bodies[0].model
    assert len(model.pieces) == (2 if cut else 1)
    assert ("its shape is the convex hull, up to" in "".join(world.notes)) != cut
    if cut:
        assert model.pieces_error.max() < 1e-6
    else:
        assert model.pieces_kind == HULL and model.pieces_error.max() > 0.02


@pytest.mark.parametrize("name", ["hollow", "open", "prism", "ball", "bent plate"])
def test_other_meshes_are_no_boxes(name):
    box = trimesh.creation.box([1.0, 2.0, 3.0])
    plate = trimesh.creation.box([1.0, 1.0, 0.002])
    bend = 1e-5 * (np.arange(8) == 7)[:, None] * [0, 0, 1]  # m, as one of its corners
    hole = trimesh.creation.box([0.5, 0.5, 0.5])
    meshes = {
        "hollow": trimesh.util.concatenate([box, trimesh.Trimesh(hole.vertices, hole.faces[:, ::-1])]),
        "open": trimesh.Trimesh(box.vertices, box.faces[:-2], process=False),
        "prism": trimesh.creation.cylinder(1.0, 2.0, sections=6),
        "ball": trimesh.creation.icosphere(subdivisions=1),
        "bent plate": trimesh.Trimesh(plate.vertices + bend, plate.faces),
    }
    assert simple_shape(box.vertices, box.faces) is not None
    assert simple_shape(meshes[name].vertices, meshes[name].faces) is None


def test_fixed_meshes_of_round_shapes_are_elements_of_the_environment(tmp_path):
    motion = trimesh.transformations.rotation_matrix(0.7, [0, 1, 0])
    motion[:3, 3] = [0.1, 0.2, 0.3]
    meshes = {
        "ball": trimesh.creation.icosphere(subdivisions=3, radius=0.05),
        "post": trimesh.creation.cylinder(0.03, 0.4, sections=48).subdivide(),  # with corners on chords
        "pill": trimesh.creation.capsule(height=0.1, radius=0.02, count=[48, 48]),
    }
    for name, mesh in meshes.items():
        mesh.apply_translation(-mesh.center_mass)
        mesh.apply_transform(motion)
        mesh.export(tmp_path / f"{name}.stl")
    content = "".join(static_mesh(name, f"<uri>{name}.stl</uri>", "0 0 1 0 0 0") for name in meshes)
    world = load_world(write_sdf(tmp_path, content))
    assert not world.bodies and not world.left_out
    ball, post, pill = world.environment
    assert (ball.shape, post.shape, pill.shape) == ("sphere", "cylinder", "capsule")
    assert [ball.radius, post.radius, post.length] == pytest.approx([0.05, 0.03, 0.4], abs=1e-6)
    assert [pill.radius, pill.length] == pytest.approx([0.02, 0.1], abs=1e-5)
    for element in world.environment:
        assert element.position == pytest.approx([0.1, 0.2, 1.3], abs=1e-6)
    for element in (post, pill):
        axis = Rotation.from_quat(element.orientation).as_matrix()[:, 2]
        assert abs(axis @ motion[:3, 2]) == pytest.approx(1.0, abs=1e-8)


@pytest.mark.parametrize(
    ("scale", "edges"),
    [((0.1, 0.1, 0.1), (0.1, 0.2, 0.3)), ((0.1, 1, 2), (0.1, 2, 6)), ((-1, 1, 1), (1, 2, 3))],
)
def test_meshes_are_scaled_in_all_formats(tmp_path, scale, edges):
    """Along each axis and mirrored, of a solid that is no box, so that its volume has a sign."""
    mesh = trimesh.creation.icosphere(subdivisions=1, radius=0.5)
    mesh.apply_scale([1.0, 2.0, 3.0])
    mesh.export(tmp_path / "egg.stl")
    text = " ".join(map(str, scale))
    urdf = f'<mesh filename="egg.stl" scale="{text}"/>'
    (tmp_path / "a.urdf").write_text(
        f"<robot name='r'><link name='l'><collision><geometry>{urdf}</geometry></collision></link></robot>"
    )
    (tmp_path / "a.sdf").write_text(
        "<sdf><model name='l'><link name='l'><collision name='c'><geometry>"
        f"<mesh><uri>egg.stl</uri><scale>{text}</scale></mesh></geometry></collision></link></model></sdf>"
    )
    for name in ("a.urdf", "a.sdf"):
        description = read_description(tmp_path / name)
        solid, _, pieces, _ = link_solid(description.path, find_link(description, "l"))
        assert len(pieces) == 1, "it is convex"
        assert mass_properties(pieces).volume == pytest.approx(solid.volume, rel=0.01)
        np.testing.assert_allclose(solid.bounds[1] - solid.bounds[0], edges, rtol=1e-6)
        assert solid.volume == pytest.approx(mesh.volume * abs(np.prod(scale)), rel=1e-6)


def test_a_scale_of_zero_is_refused(tmp_path):
    trimesh.creation.box().export(tmp_path / "box.stl")
    shape = Shape("mesh", np.eye(4), file=tmp_path / "box.stl", scale=np.array([1.0, 0.0, 1.0]))
    with pytest.raises(UncPhysicsError, match="scale of a mesh must not be zero"):
        shape_solid(shape)


def test_units_axes_and_repairs_of_meshes_are_notes(tmp_path):
    """A COLLADA file in centimetres with y up; a mesh with a hole; the hull of a mesh, as SDF says."""
    dae = tmp_path / "egg.dae"
    egg = trimesh.creation.icosphere(subdivisions=1)
    egg.export(dae)
    dae.write_text(dae.read_text().replace("<up_axis>", '<unit meter="0.01"/><up_axis>'))
    trimesh.Trimesh(egg.vertices, egg.faces[1:]).export(tmp_path / "open.stl")
    bowl = trimesh.util.concatenate([egg, egg.copy().apply_translation([4.0, 0, 0])])
    bowl.export(tmp_path / "pair.stl")
    found = shape_solid(Shape("mesh", np.eye(4), file=dae))
    assert found.properties.volume == pytest.approx(egg.volume * 1e-6, rel=1e-6)
    assert [note.partition(": ")[0] for note in found.notes] == ["mesh egg.dae"] * 2
    assert "0.01 m" in found.notes[0] and "Y_UP" in found.notes[1]
    mended = shape_solid(Shape("mesh", np.eye(4), file=tmp_path / "open.stl"), repair=True)
    assert any("repair: closed holes" in note for note in mended.notes)
    assert "repair: volume in units of the mesh" in mended.notes[-1]
    hull = shape_solid(Shape("mesh", np.eye(4), file=tmp_path / "pair.stl", convex=True))
    assert (
        hull.properties.volume == pytest.approx(bowl.convex_hull.volume, rel=1e-6) and len(hull.pieces) == 1
    )


def urdf_link(folder, version, entries):
    path = folder / "a.urdf"
    path.write_text(f'<robot name="r" version="{version}"><link name="l">{entries}</link></robot>')
    description = read_description(path)
    return description, next(iter(description.links), None)


def test_urdf_1_1_has_quaternions_and_capsules(tmp_path):
    q = " ".join(map(str, TURN.as_quat()))
    entries = f"""<collision><origin xyz="1 2 3" quat_xyzw="{q}"/>
      <geometry><capsule radius="0.1" length="0.4"/></geometry></collision>
      <inertial><origin quat_xyzw="0 0 2 2"/><mass value="1"/></inertial>"""
    description, link = urdf_link(tmp_path, "1.1", entries)
    (shape,) = link.shapes
    assert (shape.kind, shape.size, description.left_out) == ("capsule", (0.1, 0.4), ())
    np.testing.assert_allclose(shape.pose, POSE, atol=1e-12)
    np.testing.assert_allclose(link.inertial.pose[:3, 0], [0, 1, 0], atol=1e-12)


def test_joints_may_have_quaternions(tmp_path):
    path = tmp_path / "a.urdf"
    q = " ".join(map(str, TURN.as_quat()))
    ball = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
    path.write_text(
        f"""<robot name="r" version="1.1"><link name="a"/><link name="b">{ball}</link>
        <joint name="j" type="fixed"><origin xyz="1 2 3" quat_xyzw="{q}"/><parent link="a"/><child link="b"/>
        </joint></robot>"""
    )
    np.testing.assert_allclose(read_description(path).links[1].pose, POSE, atol=1e-9)


@pytest.mark.parametrize(
    ("origin", "said"),
    [
        ('quat_xyzw="0 0 0 0"', "collision origin must not be zero|origin must not be zero"),
        ('quat_xyzw="0 0 1"', "origin quat_xyzw must be 4 numbers"),
        ('quat_xyzw="0 0 0 1" rpy="0 0 1"', "origin rpy must be absent beside quat_xyzw"),
        ('xyz="1 2"', "origin xyz must be 3 numbers"),
        ('rpy="a b c"', "origin rpy must be 3 numbers"),
    ],
)
def test_bad_origins_are_named(tmp_path, origin, said):
    entry = f'<collision><origin {origin}/><geometry><sphere radius="0.1"/></geometry></collision>'
    description, _ = urdf_link(tmp_path, "1.1", entry)
    with pytest.raises(UncPhysicsError, match=f"left out: l: ({said})"):
        find_link(description, "l")


MASS = '<inertial><mass value="0.3"/></inertial>'
SPHERE = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
FLOATING = '<joint name="j" type="{}"><parent link="a"/><child link="b"/></joint>'


@pytest.mark.parametrize(
    ("entries", "free", "moved"),
    [
        (f'<link name="b">{MASS}{SPHERE}</link>', {"b"}, set()),
        (f'<link name="b">{SPHERE}</link>', set(), set()),
        ('<link name="b"><inertial><mass value="0"/></inertial></link>', set(), set()),
        (f'<link name="world">{MASS}{SPHERE}</link>', set(), set()),
        (f'<link name="a"/><link name="b">{MASS}{SPHERE}</link>{FLOATING.format("floating")}', {"b"}, set()),
        (f'<link name="a"/><link name="b">{SPHERE}</link>{FLOATING.format("floating")}', set(), set()),
        (f'<link name="a"/><link name="b">{MASS}</link>{FLOATING.format("fixed")}', set(), set()),
        (f'<link name="a"/><link name="b">{MASS}</link>{FLOATING.format("continuous")}', set(), {"b"}),
    ],
)
def test_links_of_a_urdf_that_are_free(tmp_path, entries, free, moved):
    path = tmp_path / "a.urdf"
    path.write_text(f'<robot name="r">{entries}</robot>')
    links = read_description(path).links
    assert {link.name for link in links if link.free} == free
    assert {link.name for link in links if link.moves} == moved


def test_parts_of_the_same_name_are_all_there(tmp_path):
    """Two models of one name, and names that agree with those of shapes or of model files."""
    ball = "<geometry><sphere><radius>0.1</radius></sphere></geometry>"
    link = f"<link name='l'><collision name='c'>{ball}</collision></link>"
    two = (
        f"<link name='l'><collision name='c'>{ball}</collision><collision name='d'>{ball}</collision></link>"
    )
    content = f"""<model name='a'>{link}</model><model name='a'>{link}</model>
      <model name='b'><static>1</static>{two}</model><model name='b_0'><static>1</static>{link}</model>"""
    world = load_world(write_sdf(tmp_path, content))
    assert [body.name for body in world.bodies] == ["a", "a_2"] and set(world.beliefs) == {"a", "a_2"}
    assert [element.name for element in world.environment] == ["b_0", "b_1", "b_0_2"]
    assert sum("is the name of several parts" in note for note in world.notes) == 2


def test_model_files_of_bodies_do_not_replace_each_other(tmp_path):
    shape = "<geometry><sphere><radius>{}</radius></sphere></geometry>"
    model = f"<model name='{{}}'><link name='l'><collision name='c'>{shape}</collision></link></model>"
    path = write_sdf(tmp_path, model.format("a::b", 0.1) + model.format("a_b", 0.2))
    assert main(["import", str(path), "-o", str(tmp_path / "scene.yaml")]) == 0
    scene, _, _ = load_scene(tmp_path / "scene.yaml")
    assert [body.model.radii[0] for body in scene.bodies] == [0.1, 0.2]
