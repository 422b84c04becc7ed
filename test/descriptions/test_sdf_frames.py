"""Frames, includes and joints of SDF that reach across models."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics.descriptions.reading import read_description

COLLISION = "<collision name='c'><geometry><sphere><radius>0.1</radius></sphere></geometry></collision>"
LINK = f"<link name='l'>{COLLISION}</link>"


def described(folder, content, name="a.sdf"):
    (folder / name).write_text(f"<sdf version='1.10'>{content}</sdf>")
    return read_description(folder / name)


def pose(x, y, z, yaw):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_euler("z", yaw).as_matrix(), (x, y, z)
    return T


MODEL = pose(0, 3, 0, 0.7)
INNER = (
    "<model name='inner'><pose>0 0 1 0 0 0.4</pose><frame name='f'><pose>2 0 0 0 0 0</pose></frame></model>"
)
JOINT = """<joint name='j' type='revolute'><pose>0 0 2 0 0 0.1</pose><parent>world</parent><child>base</child>
    </joint>
    <link name='base'><pose>1 0 0 0 0 0.3</pose></link>"""


@pytest.mark.parametrize(
    ("others", "relative_to", "expected"),
    [
        (INNER, "inner", MODEL @ pose(0, 0, 1, 0.4) @ pose(0, 1, 0, 0.2)),
        (INNER, "inner::f", MODEL @ pose(0, 0, 1, 0.4) @ pose(2, 0, 0, 0) @ pose(0, 1, 0, 0.2)),
        (JOINT, "j", MODEL @ pose(1, 0, 0, 0.3) @ pose(0, 0, 2, 0.1) @ pose(0, 1, 0, 0.2)),
        ("<frame name='g' attached_to='h'/><frame name='h'><pose>5 0 0 0 0 0</pose></frame>", "g",
         MODEL @ pose(5, 0, 0, 0) @ pose(0, 1, 0, 0.2)),
    ],
)  # fmt: skip
def test_poses_relative_to_nested_frames_and_joints(tmp_path, others, relative_to, expected):
    link = f"<link name='l'><pose relative_to='{relative_to}'>0 1 0 0 0 0.2</pose>{COLLISION}</link>"
    found = described(tmp_path, f"<model name='m'><pose>0 3 0 0 0 0.7</pose>{others}{link}</model>")
    (link,) = (link for link in found.links if link.shapes)
    np.testing.assert_allclose(link.pose, expected, atol=1e-12)


def test_models_and_collisions_may_be_relative_to_frames(tmp_path):
    """A model beside another one, one whose placement frame is given a pose, and a shape beside a frame."""
    shape = COLLISION.replace("<geometry>", "<pose relative_to='f'>0 0 1 0 0 0</pose><geometry>")
    found = described(
        tmp_path,
        f"""<world name='w'><frame name='desk'><pose>1 0 0 0 0 0.5</pose></frame>
        <model name='a'><pose relative_to='desk'>2 0 0 0 0 0</pose>{LINK}</model>
        <model name='b'><pose relative_to='a'>0 1 0 0 0 0</pose>{LINK}</model>
        <model name='c' placement_frame='grip'><pose>7 0 0 0 0 0.2</pose>
          <frame name='grip'><pose>0 0 0.3 0 0 0.1</pose></frame>{LINK}</model>
        <model name='d'><frame name='f'><pose>0 4 0 0 0 0.6</pose></frame>
          <link name='l'><pose>1 0 0 0 0 0.3</pose>{shape}</link></model></world>""",
    )
    places = {link.name: link.pose for link in found.links}
    desk = pose(1, 0, 0, 0.5)
    np.testing.assert_allclose(places["a"], desk @ pose(2, 0, 0, 0), atol=1e-12)
    np.testing.assert_allclose(places["b"], desk @ pose(2, 1, 0, 0), atol=1e-12)
    grip = pose(0, 0, 0.3, 0.1)
    np.testing.assert_allclose(places["c"] @ grip, pose(7, 0, 0, 0.2), atol=1e-12)
    (link,) = (link for link in found.links if link.name == "d")
    np.testing.assert_allclose(
        link.pose @ link.shapes[0].pose, pose(0, 4, 0, 0.6) @ pose(0, 0, 1, 0), atol=1e-12
    )


PART = f"""<model name='part'><pose>9 0 0 0 0 0</pose><frame name='f'><pose>0 0 1 0 0 0.4</pose></frame>
    <link name='one'><pose relative_to='f'>1 0 0 0 0 0</pose>{COLLISION}</link>
    <link name='two'>{COLLISION}</link><link name='three'><pose relative_to='__model__'>0 1 0 0 0 0</pose>
    {COLLISION}</link></model>"""


@pytest.mark.parametrize(
    ("own", "place"), [("<pose>2 0 0 0 0 0.5</pose>", (2, 0, 0, 0.5)), ("", (9, 0, 0, 0))]
)
def test_included_models_may_be_merged(tmp_path, own, place):
    (tmp_path / "part.sdf").write_text(f"<sdf>{PART}</sdf>")
    include = f"<include merge='true'><uri>part.sdf</uri>{own}</include>"
    found = described(tmp_path, f"<model name='m'><pose>0 3 0 0 0 0.7</pose>{LINK}{include}</model>")
    places = {link.name: link.pose for link in found.links}
    assert set(places) == {"m::l", "m::one", "m::two", "m::three"} and not found.left_out
    outer = MODEL @ pose(*place)
    np.testing.assert_allclose(places["m::one"], outer @ pose(0, 0, 1, 0.4) @ pose(1, 0, 0, 0), atol=1e-12)
    np.testing.assert_allclose(places["m::two"], outer, atol=1e-12)
    np.testing.assert_allclose(places["m::three"], outer @ pose(0, 1, 0, 0), atol=1e-12)


def test_folders_name_their_newest_file_and_other_includes_say_why_not(tmp_path):
    folder = tmp_path / "part"
    folder.mkdir()
    for name in ("old", "new", "model"):
        (folder / f"{name}.sdf").write_text(f"<sdf><model name='{name}'>{LINK}</model></sdf>")
    (folder / "model.config").write_text(
        "<model><sdf version='1.10'>new.sdf</sdf><sdf version='1.9'>old.sdf</sdf></model>"
    )
    (tmp_path / "robot.urdf").write_text("<robot name='r'><link name='l'/></robot>")
    uris = "part", "robot.urdf", "https://fuel.gazebosim.org/1.0/x/models/y"
    found = described(
        tmp_path,
        "".join(f"<include><uri>{uri}</uri></include>" for uri in uris).join(("<world>", "</world>")),
    )
    assert [link.name for link in found.links] == ["new"]
    assert "is no SDF with a model" in found.left_out[0] and "download it" in found.left_out[1]


NESTED = f"<model name='inner'>{LINK}</model>"


@pytest.mark.parametrize(
    ("entries", "moves", "free"),
    [
        (NESTED, "", True),
        (f"{NESTED}<joint name='j' type='revolute'><parent>base</parent><child>inner::l</child></joint>",
         "is held by joints (j)", False),
        (f"{NESTED}<joint name='j' type='fixed'><parent>world</parent><child>inner::l</child></joint>",
         "", False),
        (f"{NESTED}<joint name='j' type='fixed'><parent>base</parent><child>inner::l</child></joint>",
         "is one of several links that move as one", False),
        (f"<static>1</static>{NESTED}<joint name='j'><parent>base</parent><child>inner::l</child></joint>",
         "", False),
    ],
)  # fmt: skip
def test_joints_of_outer_models_hold_links_of_inner_ones(tmp_path, entries, moves, free):
    found = described(tmp_path, f"<model name='m'><link name='base'/>{entries}</model>")
    (link,) = (link for link in found.links if link.shapes)
    assert (link.name, link.moves, link.free) == ("m::inner", moves, free)


def test_empty_collisions_are_no_shapes_and_gravity_is_named(tmp_path):
    empty = "<collision name='e'><geometry><empty/></geometry></collision>"
    visual = "<visual name='v'><geometry><box><size>1 1 1</size></box></geometry></visual>"
    links = f"<link name='a'>{COLLISION}{empty}</link><link name='b'>{empty}{visual}</link>"
    found = described(
        tmp_path, f"<world name='w'><gravity>0 0 -1.6</gravity><model name='m'>{links}</model></world>"
    )
    assert [len(link.shapes) for link in found.links] == [1, 0] and not found.left_out
    assert found.notes[0].startswith("m::a: has no <inertial>") and len(found.notes) == 2
    assert found.notes[1] == "gravity, 0 0 -1.6 m/s^2, is not imported: set it in the scene"


def test_friction_is_that_of_ode_or_bullet(tmp_path):
    surface = "<surface><friction>{}</friction></surface>"
    ode, bullet = "<ode><mu>0.3</mu></ode>", "<bullet><friction>0.8</friction></bullet>"
    for text, friction in ((ode, 0.3), (bullet, 0.8), (bullet + ode, 0.3), ("", None)):
        entry = COLLISION.replace("<geometry>", f"{surface.format(text)}<geometry>")
        found = described(tmp_path, f"<model name='m'><link name='l'>{entry}</link></model>")
        assert found.links[0].shapes[0].friction == friction
