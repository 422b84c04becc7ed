"""Links of SDF models: frames, includes, shapes, masses and what moves them, one model at a time."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics import load_world
from unc_physics.descriptions.parts import referred
from unc_physics.descriptions.reading import read_description

BALL = "<geometry><sphere><radius>0.1</radius></sphere></geometry>"
COLLISION = f"<collision name='c'>{BALL}</collision>"


def described(folder, content, name="a.sdf"):
    """The description of a file with this content."""
    path = folder / name
    path.write_text(f"<sdf version='1.9'>{content}</sdf>")
    return read_description(path)


def link_of(folder, entries, model="", name="m"):
    """The only link of a model, with these entries beside a shape."""
    (link,) = described(
        folder, f"<model name='{name}'>{model}<link name='l'>{entries}{COLLISION}</link></model>"
    ).links
    return link


def pose(position=(0, 0, 0), angles=(0, 0, 0)):
    """A transform of fixed-axis angles about x, y and z."""
    T = np.eye(4)
    T[:3, 3], T[:3, :3] = position, Rotation.from_euler("xyz", angles).as_matrix()
    return T


FRAMES = """<frame name="a" attached_to="b"><pose>0 0 1 0 0 0.5</pose></frame>
    <frame name="b"><pose>1 0 0 0.3 0 0</pose></frame><pose>0 3 0 0 0 0.7</pose>"""
QUATERNION = " ".join(map(str, Rotation.from_euler("xyz", [0.4, -0.2, 0.9]).as_quat()))
IN_MODEL, IN_B = pose((0, 3, 0), (0, 0, 0.7)), pose((0, 0, 1), (0, 0, 0.5))


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ("", IN_MODEL),
        ("<pose/>", IN_MODEL),
        ("<pose>1 2 3 0.4 -0.2 0.9</pose>", IN_MODEL @ pose((1, 2, 3), (0.4, -0.2, 0.9))),
        (
            "<pose degrees='true'>1 2 3 40 -20 90</pose>",
            IN_MODEL @ pose((1, 2, 3), np.radians((40, -20, 90))),
        ),
        (
            f"<pose rotation_format='quat_xyzw'>1 2 3 {QUATERNION}</pose>",
            IN_MODEL @ pose((1, 2, 3), (0.4, -0.2, 0.9)),
        ),
        ("<pose relative_to='__model__'>1 0 0 0 0 0</pose>", IN_MODEL @ pose((1, 0, 0))),
        (
            "<pose relative_to='a'>0 1 0 0 0 0.2</pose>",
            IN_MODEL
            @ pose((1, 0, 0), (0.3, 0, 0))
            @ pose((0, 0, 1), (0, 0, 0.5))
            @ pose((0, 1, 0), (0, 0, 0.2)),
        ),
    ],
)
def test_a_link_is_where_its_frames_say(tmp_path, entry, expected):
    np.testing.assert_allclose(link_of(tmp_path, entry, FRAMES).pose, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        (
            "<pose relative_to='c'>0 0 0 0 0 0</pose>",
            "relative_to names a frame that is not in its model (got 'c')",
        ),
        ("<pose relative_to='x'/>", "relative_to names a frame that is not in its model"),
        ("<pose>1 2 3</pose>", "pose must be 6 numbers (got '1 2 3')"),
        ("<pose>1 2 3 0 0 nan</pose>", "pose must be 6 numbers"),
        ("<pose rotation_format='quat_xyzw'>1 2 3 0 0 0</pose>", "pose must be 7 numbers"),
        ("<inertial><mass>much</mass></inertial>", "mass must be 1 number (got 'much')"),
        (
            "<inertial><mass>1</mass><inertia><ixx>a</ixx></inertia></inertial>",
            "inertia/ixx must be 1 number",
        ),
        (
            "<inertial><mass>1</mass><pose relative_to='y'/></inertial>",
            "relative_to is a frame that is not resolved",
        ),
        (
            "<collision name='d'><geometry><box><size>1 2</size></box></geometry></collision>",
            "box/size must be 3 numbers",
        ),
        (
            "<collision name='d'><geometry><box/></geometry></collision>",
            "box/size must be 3 numbers (got '')",
        ),
    ],
)
def test_a_link_that_cannot_be_read_is_left_out_with_the_reason(tmp_path, entry, said):
    circle = "<frame name='x' attached_to='x'/>"
    links = "".join(
        f"<link name='{name}'>{more}{COLLISION}</link>" for name, more in (("l", entry), ("k", ""))
    )
    found = described(tmp_path, f"<model name='m'>{circle}{links}</model>")
    assert [link.name for link in found.links] == ["m::k"]
    assert len(found.left_out) == 1 and found.left_out[0].startswith(f"m::l: {said}")


def test_missing_masses_and_moments_are_one(tmp_path):
    for entries, placed in (("", False), ("<pose>1 0 0 0 0 0</pose>", True)):
        found = link_of(tmp_path, f"<inertial>{entries}</inertial>").inertial
        assert found is not None and found.mass == 1.0 and (found.pose is not None) == placed
    entries = "<ixx>3</ixx><ixy>0.1</ixy><ixz>0.2</ixz><iyz>0.3</iyz><izz>5</izz>"
    own = link_of(
        tmp_path, f"<inertial><mass>2</mass><pose>1 0 0 0 0 0.5</pose><inertia>{entries}</inertia></inertial>"
    ).inertial
    assert own is not None and own.inertia is not None
    np.testing.assert_array_equal(own.inertia, [[3.0, 0.1, 0.2], [0.1, 1.0, 0.3], [0.2, 0.3, 5.0]])
    np.testing.assert_allclose(own.pose, pose((1, 0, 0), (0, 0, 0.5)))


def shape_of(folder, entries):
    found = described(
        folder, f"<model name='m'><link name='l'><collision name='c'>{entries}</collision></link></model>"
    )
    return found.links[0].shapes[0]


def test_shapes_have_sizes_surfaces_and_problems(tmp_path):
    (tmp_path / "a.stl").write_text("")
    for text, kind, size, problem in (
        ("<box><size>1 2 3</size></box>", "box", (1, 2, 3), ""),
        ("<cylinder><radius>0.1</radius><length>2</length></cylinder>", "cylinder", (0.1, 2), ""),
        ("<capsule><length>2</length><radius>0.1</radius></capsule>", "capsule", (0.1, 2), ""),
        ("<plane><size>9 9</size></plane>", "plane", (0, 0, 1), ""),
        ("<plane><normal>1 0 0</normal></plane>", "plane", (1, 0, 0), ""),
        ("<ellipsoid><radii>1 1 1</radii></ellipsoid>", "ellipsoid", (1, 1, 1), ""),
        ("<cone><radius>0.1</radius><length>2</length></cone>", "cone", (0.1, 2), ""),
        ("<mesh><uri>a.stl</uri></mesh>", "mesh", (), ""),
        ("<mesh><uri>b.stl</uri></mesh>", "mesh", (), "the mesh b.stl is not found"),
        (
            "<mesh><uri>a.stl</uri><submesh><name>b</name></submesh></mesh>",
            "mesh",
            (),
            "names a part of a mesh",
        ),
        ("", "nothing", (), "has no shape"),
        ("<box/><sphere/>", "nothing", (), "has no shape"),
    ):
        surface = "<surface><bounce><restitution_coefficient>0.3</restitution_coefficient></bounce></surface>"
        found = shape_of(tmp_path, f"<pose>1 0 0 0 0 0.2</pose><geometry>{text}</geometry>{surface}")
        assert (found.kind, found.size, found.problem) == (kind, size, problem)
        assert found.friction is None and found.restitution == (None if kind == "nothing" else 0.3)
        np.testing.assert_allclose(found.pose, pose((1, 0, 0), (0, 0, 0.2)))


JOINT = "<joint name='{}' type='{}'><parent>{}</parent><child>b</child></joint>"
FIXED = JOINT.format("j", "fixed", "a")
ONE, TWO = (f"<link name='{name}'>{COLLISION}</link>" for name in "ab")


@pytest.mark.parametrize(
    ("entries", "names", "moves", "free"),
    [
        (ONE, ["m"], "", True),
        (f"<static>true</static>{ONE}", ["m"], "", False),
        (f"<static>0</static>{ONE}", ["m"], "", True),
        (ONE + JOINT.format("j", "fixed", "world"), ["m"], "", False),
        (ONE + JOINT.format("j", "revolute", "world"), ["m"], "is held by joints (j)", False),
        (ONE + TWO, ["m::a", "m::b"], "", True),
        (
            ONE + TWO + JOINT.format("j", "fixed", "a"),
            ["m::a", "m::b"],
            "is one of several links that move as one",
            False,
        ),
        (f"<static>1</static>{ONE}{TWO}{FIXED}", ["m::a", "m::b"], "", False),
        (
            ONE + TWO + JOINT.format("j", "prismatic", "a") + JOINT.format("k", "ball", "a"),
            ["m::a", "m::b"],
            "is held by joints (j, k)",
            False,
        ),
    ],
)
def test_links_move_freely_unless_something_holds_them(tmp_path, entries, names, moves, free):
    links = described(tmp_path, f"<model name='m'>{entries}</model>").links
    assert [link.name for link in links] == names
    assert {(link.moves, link.free) for link in links} == {(moves, free)}


def test_models_in_models_and_included_ones_are_composed(tmp_path):
    """Their poses, names and whether they are static; the pose of an include replaces that of the model."""
    (tmp_path / "part").mkdir()
    inner = f"<model name='inner'><pose>0 0 1 0 0 0</pose><link name='l'>{COLLISION}</link></model>"
    part = f"<model name='part'><pose>9 9 9 0 0 0</pose>{inner}{ONE}</model>"
    (tmp_path / "part" / "model.sdf").write_text(f"<sdf>{part}</sdf>")
    (tmp_path / "broken.sdf").write_text("<sdf")
    turned = "<pose>1 0 0 0 0 1.5707963267948966</pose>"
    found = described(
        tmp_path,
        f"""<world name="w"><actor name="walker"/>
        <model name="outer"><static>true</static>{turned}{inner}
          <include><uri>part</uri><name>mine</name><pose>2 0 0 0 0 0</pose></include></model>
        <include><uri>part/model.sdf</uri></include>
        <include><uri>part</uri><name>still</name><static>true</static></include>
        <include><uri>broken.sdf</uri></include><include><uri>nowhere</uri></include></world>""",
    )
    places = {link.name: (link.pose[:3, 3].round(9).tolist(), link.free) for link in found.links}
    assert places == {
        "outer::inner": ([1, 0, 1], False),
        "outer::mine": ([1, 2, 0], False),
        "outer::mine::inner": ([1, 2, 1], False),
        "part": ([9, 9, 9], True),
        "part::inner": ([9, 9, 10], True),
        "still": ([9, 9, 9], False),
        "still::inner": ([9, 9, 10], False),
    }
    one, other, third = found.left_out
    assert one.startswith("include broken.sdf: description ") and "is no XML" in one
    assert (other, third) == ("include nowhere: is not found", "actor walker")


def test_includes_in_a_circle_end(tmp_path):
    (tmp_path / "a.sdf").write_text("<sdf><model name='m'><include><uri>a.sdf</uri></include></model></sdf>")
    found = read_description(tmp_path / "a.sdf")
    assert not found.links and len(found.left_out) == 1
    assert found.left_out[0] == "m::" * 6 + "include a.sdf: is not found"
    nested = "<model name='n'>" * 14 + ONE + "</model>" * 14
    assert described(tmp_path, nested).left_out == ("::".join("n" * 12) + ": nested too deep",)


def test_files_are_looked_for_beside_the_description_and_in_folders_of_ros(tmp_path, monkeypatch):
    base, ros, mesh = tmp_path / "robot" / "urdf", tmp_path / "ros", tmp_path / "robot" / "meshes" / "a.stl"
    for place in (base / "own.stl", mesh, ros / "share" / "pack" / "b.stl"):
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text("")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{ros}")
    for uri, expected in (
        ("own.stl", base / "own.stl"),
        ("../meshes/a.stl", base / "../meshes/a.stl"),
        ("other.stl", None),
        (f"file://{base / 'own.stl'}", base / "own.stl"),
        ("file:///nowhere.stl", None),
        ("package://robot/meshes/a.stl", mesh),
        ("model://pack/b.stl", ros / "share" / "pack" / "b.stl"),
        ("package://pack/c.stl", None),
        (f"http://{base / 'own.stl'}", None),
    ):
        assert referred(uri, base) == expected, uri


def test_a_plane_and_a_body_are_where_their_turned_link_puts_them(tmp_path):
    """And have the friction of the first shape that has one, and a restitution of at most 1."""
    surface = "<surface><friction><ode><mu>{}</mu></ode></friction>{}</surface>"
    bounce = "<bounce><restitution_coefficient>7</restitution_coefficient></bounce>"
    shapes = [
        f"<collision name='c'>{BALL}</collision>",
        f"<collision name='d'><pose>0.1 0 0 0 0 0</pose>{BALL}{surface.format(0.4, bounce)}</collision>",
        f"<collision name='e'><pose>0.2 0 0 0 0 0</pose>{BALL}{surface.format(0.9, '')}</collision>",
    ]
    plane = "<collision name='p'><geometry><plane><normal>0 0 2</normal></plane></geometry></collision>"
    described(
        tmp_path,
        f"""<model name="tilted"><static>1</static><pose>0 0 2 0.6 0 0</pose>
        <link name="l">{plane}</link></model><model name="body"><pose>1 2 3 0 0 0.5</pose><link name="l">
        <inertial><mass>2</mass><pose>0.3 0 0 0 0 0</pose></inertial>{"".join(shapes)}</link></model>""",
    )
    world = load_world(tmp_path / "a.sdf", spheres=6)
    (tilted,), (body,) = world.environment, world.bodies
    normal = Rotation.from_euler("x", 0.6).apply([0, 0, 1])
    np.testing.assert_allclose(tilted.normal, normal, atol=1e-12)
    assert tilted.offset == pytest.approx(normal[2] * 2.0)
    assert (body.mass, body.friction, body.restitution, body.fixed) == (2.0, 0.4, 1.0, False)
    found = world.beliefs["body"]
    turn = Rotation.from_euler("z", 0.5)
    np.testing.assert_allclose(found.position, turn.apply([0.3, 0, 0]) + [1, 2, 3], atol=1e-6)
    np.testing.assert_allclose(found.orientation, turn.as_quat(), atol=1e-12)
