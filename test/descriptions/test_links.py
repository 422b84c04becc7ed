"""Links of a URDF as models: shape, scale, centre of mass, inertia and mass."""

import numpy as np
import pytest
from files import write_descriptions

from unc_physics import ErrorCode, UncPhysicsError, from_urdf, load_packing
from unc_physics.__main__ import main

pytest.importorskip("yourdfpy")
ROUND_OFF = 1e-9
SINGLE = 1e-7  # the mesh's file has single precision


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_descriptions(tmp_path_factory.mktemp("descriptions"))


@pytest.fixture(scope="module")
def hand(folder):
    return from_urdf(folder / "arm.urdf", "hand", spheres=60)


def test_a_link_is_the_union_of_its_shapes_about_the_files_centre_of_mass(hand):
    # a brick of 100 x 60 x 40 mm, and a box of 50 x 50 x 60 mm of which 10 mm stand in it
    assert hand.volume == pytest.approx(0.1 * 0.06 * 0.04 + 0.05 * 0.05 * 0.05, rel=SINGLE)
    np.testing.assert_allclose(hand.origin, [-0.1, 0.0, -0.02], atol=ROUND_OFF)
    np.testing.assert_allclose(hand.bounds, [[-0.05, -0.03, -0.04], [0.05, 0.03, 0.05]], atol=SINGLE)
    in_box = np.all((hand.centers >= hand.bounds[0]) & (hand.centers <= hand.bounds[1]), axis=1)
    assert in_box.all()


def test_mass_and_inertia_are_the_files_in_the_links_axes(hand):
    assert hand.mass == 2.0
    # the frame of the inertia is turned by a right angle about z
    np.testing.assert_allclose(hand.inertia, np.diag([0.002, 0.001, 0.0025]) / 2.0, atol=ROUND_OFF)


def test_uniform_density_is_the_shapes_own(folder):
    hand = from_urdf(folder / "arm.urdf", "hand", spheres=10, uniform=True, scale=2.0)
    brick, box = 0.1 * 0.06 * 0.04, 0.05 * 0.05 * 0.05
    height = box * 0.045 / (brick + box)
    np.testing.assert_allclose(hand.origin, [-0.2, 0.0, -2.0 * height], atol=SINGLE)
    assert hand.mass == pytest.approx(16.0)


def test_pack_takes_a_link(folder, tmp_path, capsys):
    out = tmp_path / "hand.npz"
    assert main(["pack", f"{folder / 'arm.urdf'}#hand", "-n", "20", "-o", str(out)]) == 0
    found = load_packing(out)
    assert (found.name, found.mass, len(found)) == ("hand", 2.0, 20)
    assert found.source == "link hand of arm.urdf"
    sizes = sorted(np.ptp(piece.points, axis=0).round(6).tolist() for piece in found.pieces)
    assert sizes == [[0.05, 0.05, 0.06], [0.1, 0.06, 0.04]], "a box, and a mesh of a box"
    assert "100 x 60 x 90" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("link", "said"),
    [
        ("", "must be named: there are base, post, hand, visual_only"),
        ("hnad", "is none with a shape; did you mean 'hand'"),
        ("frame", "has no shape"),
    ],
)
def test_a_link_that_is_not_there(folder, tmp_path, capsys, link, said):
    arguments = ["pack", f"{folder / 'arm.urdf'}#{link}", "-n", "5", "-o", str(tmp_path / "out.npz")]
    assert main(arguments) == ErrorCode.INVALID_REQUEST
    assert said in capsys.readouterr().err


ONE_LINK = (
    """<robot name="a"><link name="b">{}<collision><geometry>{}</geometry></collision></link></robot>"""
)
MISSING = ONE_LINK.format("", '<mesh filename="package://x/y.stl"/>')
FLAT = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="9" ixy="0" ixz="0" iyz="0"/></inertial>'
THIN = ONE_LINK.format(FLAT, '<box size="1 1 1"/>')
NEGATIVE = ONE_LINK.format("", '<box size="1 -1 1"/>')


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<robot><link", "is no XML"),
        ("<sdf/>", "its root is not <robot>"),
        ("<robot name='a'/>", "has no links|yourdfpy"),
        ("<!DOCTYPE a [<!ENTITY b 'c'>]><robot name='a'/>", "must define no entities"),
        ('<robot name="a"><xacro:macro/></robot>', "is a xacro file"),
        (MISSING, "the mesh package://x/y.stl is not found"),
        (THIN, "belongs to no solid.*--uniform"),
        (NEGATIVE, "size of a box must be positive"),
    ],
)
def test_bad_files_get_one_sentence(tmp_path, text, said):
    path = tmp_path / "bad.urdf"
    path.write_text(text)
    with pytest.raises(UncPhysicsError, match=said):
        from_urdf(path, spheres=5)


@pytest.mark.parametrize("suffix", ["glb", "stl", "obj", "ply"])
def test_meshes_of_all_usual_formats_with_a_hint_about_units(tmp_path, capsys, suffix):
    import trimesh

    mesh = tmp_path / f"part.{suffix}"
    trimesh.creation.box([20e3, 10e3, 5e3]).export(mesh)
    out = tmp_path / "part.npz"
    assert main(["pack", str(mesh), "-n", "5", "-o", str(out)]) == 0
    said = capsys.readouterr().err
    assert "is the mesh in millimetres, and not in metres? --scale 0.001" in said
    assert ("y up" in said) == (suffix == "glb")
    assert main(["pack", str(mesh), "-n", "5", "-o", str(out), "--scale", "1e-8"]) == 0
    assert "in metres already?" in capsys.readouterr().err
    np.testing.assert_allclose(load_packing(out).volume, 1e12 * 1e-24, rtol=1e-6)
