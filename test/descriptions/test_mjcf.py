"""MJCF: bodies, geoms, masses and joints as MuJoCo compiles them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics import UncPhysicsError, load_scene, load_world
from unc_physics.__main__ import main
from unc_physics.descriptions.link_solid import find_link, link_solid
from unc_physics.descriptions.reading import read_description

mujoco = pytest.importorskip("mujoco")

SCENE = """<mujoco><compiler angle="degree"/><option gravity="0 0 -3"/>
<default><geom friction="0.6 0.01 0.001"/><default class="tool"><geom density="500"/></default></default>
<asset><mesh name="wedge" vertex="0 0 0  1 0 0  0 1 0  0 0 1  0.2 0.2 0.2" scale="0.2 0.2 0.2"/></asset>
<worldbody>
  <geom name="floor" type="plane" size="0 0 1" friction="0.9 0 0"/>
  <body name="table" pos="1 0 0.7" euler="0 0 90"><geom type="box" size="0.5 0.3 0.02" condim="1"/>
    <body name="drawer" pos="0.1 0 0"><joint name="pull" type="slide" axis="1 0 0"/>
      <geom type="cylinder" size="0.05 0.1"/></body></body>
  <body name="hammer" pos="0 1 2" euler="0 90 0" childclass="tool"><freejoint name="fly"/>
    <geom type="capsule" size="0.02 0.1" pos="0 0 0.1"/>
    <body name="head" pos="0 0 0.25" euler="90 0 0"><joint name="swing" type="hinge" axis="0 1 0"/>
      <geom type="box" size="0.05 0.05 0.1" mass="0.5"/>
      <geom type="sphere" size="0.3" mass="0" contype="0" conaffinity="0"/></body></body>
  <body name="wedge" pos="5 0 1"><freejoint/><geom type="mesh" mesh="wedge"/></body>
  <body name="egg" pos="6 0 1"><freejoint/><geom type="ellipsoid" size="0.1 0.1 0.2"/></body>
</worldbody>
<actuator><motor joint="pull"/></actuator>
</mujoco>"""


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("mjcf") / "scene.xml"
    path.write_text(SCENE)
    return path


def compiled(path):
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def test_fixed_bodies_are_the_environment_and_free_ones_move(path):
    world = load_world(path, spheres=4)
    assert [element.name for element in world.environment] == ["world", "table", "drawer"]
    floor, table, drawer = world.environment
    assert (floor.offset, floor.friction, table.friction, drawer.friction) == (0.0, 0.9, 0.0, 0.6)
    np.testing.assert_allclose(table.size, [1.0, 0.6, 0.04], atol=1e-12)
    np.testing.assert_allclose(drawer.position, [1.0, 0.1, 0.7], atol=1e-12)
    assert (drawer.radius, drawer.length) == (0.05, 0.2)
    assert [body.name for body in world.bodies] == ["hammer", "wedge", "egg"]
    assert all(body.friction == 0.6 and not body.fixed for body in world.bodies)
    assert world.left_out == ("1 actuators: not imported",)
    assert world.notes == (
        "drawer: the joint pull is kept at its start",
        "head: the joint swing is kept at its start",
        "gravity, 0 0 -3 m/s^2, is not imported: set it in the scene",
    )


def test_mass_centre_and_inertia_are_those_of_the_compiled_tree(path):
    """MuJoCo's composite inertia of the free tree, about its common centre of mass in world axes."""
    model, data = compiled(path)
    body = model.body("hammer").id
    world = load_world(path, spheres=4)
    hammer = world.bodies[0]
    assert hammer.mass == pytest.approx(model.body_subtreemass[body], rel=1e-12)
    np.testing.assert_allclose(world.beliefs["hammer"].position, data.subtree_com[body], atol=1e-9)
    expected = np.zeros((3, 3))
    for k in (body, model.body("head").id):
        R, arm = data.ximat[k].reshape(3, 3), data.xipos[k] - data.subtree_com[body]
        expected += R @ np.diag(model.body_inertia[k]) @ R.T
        expected += model.body_mass[k] * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    turn = Rotation.from_quat(world.beliefs["hammer"].orientation).as_matrix()
    np.testing.assert_allclose(turn @ hammer.model.inertia @ turn.T * hammer.mass, expected, atol=1e-12)
    assert len(hammer.model.pieces) == 2, "the geom that does not collide is not there"


def test_meshes_are_their_hulls_and_primitives_exact(path):
    description = read_description(path)
    wedge = link_solid(path, find_link(description, "wedge"))
    # the tetrahedron (0, 0.2, 0.2, 0.2) holds the fifth point
    assert wedge.solid.volume == pytest.approx(0.2**3 / 6.0, rel=1e-6)
    np.testing.assert_allclose(-wedge.solid.origin, [0.05] * 3, atol=1e-7)
    assert len(wedge.pieces) == 1 and not wedge.notes
    egg = link_solid(path, find_link(description, "egg"))
    assert egg.solid.volume == pytest.approx(4.0 / 3.0 * np.pi * 0.002, rel=1e-9)
    assert egg.mass == pytest.approx(1000.0 * egg.solid.volume, rel=1e-9)


def test_joints_can_be_set(path):
    world = load_world(path, spheres=4, configuration={"pull": 0.2})
    np.testing.assert_allclose(world.environment[2].position, [1.0, 0.3, 0.7], atol=1e-12)
    assert world.notes[0] == "drawer: the joint pull is kept at the given position"
    with pytest.raises(UncPhysicsError, match="is no hinge or slide joint of the model; did you mean 'pull'"):
        read_description(path, {"pul": 0.2})


def test_import_writes_a_scene(path, tmp_path, capsys):
    out = tmp_path / "scene.yaml"
    assert main(["import", str(path), "-o", str(out), "-n", "4", "--joint", "swing=0.1"]) == 0
    shown = capsys.readouterr().out
    assert "3 elements of the environment and 3 bodies, 3 of which move" in shown
    assert "note: head: the joint swing is kept at the given position" in shown
    scene, _, _ = load_scene(out)
    assert [body.name for body in scene.bodies] == ["hammer", "wedge", "egg"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<mujoco><worldbody><geom type='box'/></worldbody></mujoco>", "is no MJCF that MuJoCo compiles"),
        ("<mujoco><worldbody><body><geom type='mesh' mesh='a'/></body></worldbody></mujoco>", "mesh"),
        ("<model/>", r"must have the root <robot> \(URDF\), <sdf> or <mujoco> \(MJCF\)"),
        ("<mujoco", "is no XML"),
    ],
)
def test_bad_files_get_one_sentence(tmp_path, text, said):
    path = tmp_path / "bad.xml"
    path.write_text(text)
    with pytest.raises(UncPhysicsError, match=said):
        read_description(path)


def test_xml_is_read_by_its_root(tmp_path):
    (tmp_path / "a.xml").write_text(
        "<robot name='r'><link name='l'><collision><geometry><sphere radius='1'/></geometry></collision>"
        "</link></robot>"
    )
    (tmp_path / "b.xml").write_text("<sdf><model name='m'><link name='l'/></model></sdf>")
    assert [read_description(tmp_path / name).links[0].name for name in ("a.xml", "b.xml")] == ["l", "m"]
    (tmp_path / "c.mjcf").write_text("<robot/>")
    with pytest.raises(UncPhysicsError, match="its root is not <mujoco>"):
        read_description(tmp_path / "c.mjcf")
