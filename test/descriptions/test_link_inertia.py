"""Masses and inertias of links: what a shape can have, what follows from densities, and what is refused."""

import numpy as np
import pytest

from unc_physics import ErrorCode, UncPhysicsError, load_scene, load_world
from unc_physics.__main__ import main
from unc_physics.descriptions.link_solid import find_link, link_solid
from unc_physics.descriptions.reading import read_description

pytest.importorskip("yourdfpy")
CUBE = '<box size="0.085 0.085 0.085"/>'
UNIFORM = 0.2 * 0.085**2 / 6.0  # kg m^2, of that cube
REACH = 0.75 * 0.085**2  # m^2, square of the distance of a corner


def write_urdf(folder, inertial, geometry=CUBE):
    path = folder / "object.urdf"
    path.write_text(
        f'<robot name="r"><link name="cube"><inertial>{inertial}</inertial>'
        f"<collision><geometry>{geometry}</geometry></collision></link></robot>"
    )
    return path


def moments(xx, yy, zz, mass="0.2", more="", origin=""):
    values = {"ixx": xx, "iyy": yy, "izz": zz}
    given = " ".join(f'{key}="{value}"' for key, value in values.items())
    return f'<mass value="{mass}"/>{origin}<inertia {given} {more}/>'


def solid_of(path, name=None, **options):
    description = read_description(path)
    return link_solid(description.path, find_link(description, name), **options)


ROD = '<cylinder radius="0.01" length="1"/>'
REFUSED = {
    "above m R^2": (moments(1, 1, 1), CUBE, "ixx is 1 kg m.2.*have at most 0.00108 kg m.2"),
    "just above m R^2": (moments(*[0.2 * REACH * 1.05] * 3), CUBE, "ixx is .*have at most"),
    "triangle inequality": (moments(1e-4, 2e-4, 4e-4), CUBE, r"izz, 0.0004 kg m.2, is more than ixx \+ iyy"),
    "with products": (moments(3e-4, 3e-4, 3e-4, more='ixy="2.9e-4"'), CUBE, "with ixy, ixz and iyz"),
    "negative": (moments(1e-4, -1e-4, 1e-4), CUBE, r"iyy must be positive \(got -0.0001\)"),
    "missing moments": ('<mass value="1"/><inertia ixx="1e-4"/>', CUBE, r"iyy must be positive \(got 0\)"),
    # a rod of 10 mm radius whose mass would be 0.1 m off its axis
    "about the axis of a rod": (moments(0.02, 0.02, 0.002), ROD, "need mass .* m off the centre along"),
    "centre of mass outside": (
        moments(2e-4, 2e-4, 2e-4, origin='<origin xyz="0.2 0 0"/>'),
        CUBE,
        "the centre of mass lies 0.15[78] m outside the shape",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_an_inertia_that_no_mass_inside_the_shape_has_is_refused(tmp_path, name):
    """The message has the moment, and an option that takes the inertia from the shape, which works."""
    inertial, geometry, said = REFUSED[name]
    path = write_urdf(tmp_path, inertial, geometry)
    with pytest.raises(UncPhysicsError, match=f"link cube of .*{said}.*--uniform, or uniform=True"):
        solid_of(path)
    assert solid_of(path, uniform=True).mass == pytest.approx(1.0 if name == "missing moments" else 0.2)
    world = load_world(path, spheres=4)
    assert not world.bodies and world.left_out[0].startswith("cube: link cube of")


@pytest.mark.parametrize(
    ("inertial", "said"),
    [
        (moments("nan", 1, 1), r"inertia/ixx must be 1 number, finite \(got 'nan'\)"),
        (moments(1, "inf", 1), "inertia/iyy must be 1 number, finite"),
        (moments(1, 1, "one"), r"inertia/izz must be 1 number \(got 'one'\)"),
        (moments(1, 1, 1, more='ixy="x"'), "inertia/ixy must be 1 number"),
        (moments(1, 1, 1, mass="heavy"), r"inertial/mass must be 1 number \(got 'heavy'\)"),
        (moments(1, 1, 1, mass="-2"), "inertial/mass must not be negative"),
        (moments(1, 1, 1, origin='<origin rpy="0 0"/>'), "inertial/origin rpy must be 3 numbers"),
    ],
)
def test_values_that_are_no_numbers_get_a_sentence(tmp_path, capsys, inertial, said):
    path = write_urdf(tmp_path, inertial)
    with pytest.raises(UncPhysicsError, match=said):
        solid_of(path, "cube")
    arguments = ["pack", str(path), "-n", "4", "-o", str(tmp_path / "out.npz")]
    assert main(arguments) == ErrorCode.INVALID_REQUEST
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize(
    ("ratio", "noted"),
    [
        (0.05, "0.05 times"),
        (0.09, "0.09 times"),
        (0.11, None),
        (1.0, None),
        (2.9, None),
        (3.1, "3.1 times"),
        (4.4, "4.4 times"),
    ],
)
def test_moments_far_from_the_shapes_get_a_line(tmp_path, ratio, noted):
    found = solid_of(write_urdf(tmp_path, moments(*[ratio * UNIFORM] * 3)))
    np.testing.assert_allclose(found.solid.inertia, ratio * UNIFORM / 0.2 * np.eye(3), rtol=1e-9)
    assert found.mass == 0.2 and len(found.notes) == (noted is not None)
    if noted:
        assert found.notes[0].startswith("cube: its moments of inertia are") and noted in found.notes[0]


def test_import_prints_the_line_and_takes_uniform(tmp_path, capsys):
    path, out = write_urdf(tmp_path, moments(*[0.05 * UNIFORM] * 3)), tmp_path / "scene.yaml"
    assert main(["import", str(path), "-o", str(out), "-n", "4"]) == 0
    shown = capsys.readouterr().out
    assert "1 body, 1 of which move" in shown and "note: cube: its moments of inertia are 0.05 times" in shown
    write_urdf(tmp_path, moments(1, 1, 1))
    assert main(["import", str(path), "-o", str(out), "-n", "4"]) == 0
    assert "left out: cube: " in capsys.readouterr().out
    assert main(["import", str(path), "-o", str(out), "-n", "4", "--uniform"]) == 0
    assert "left out" not in capsys.readouterr().out
    (body,) = load_scene(out)[0].bodies
    np.testing.assert_allclose(body.model.inertia * 0.2, UNIFORM * np.eye(3), rtol=1e-6)


BALL = "<geometry><sphere><radius>0.05</radius></sphere></geometry>"
CUBE_SDF = "<geometry><box><size>0.1 0.1 0.1</size></box></geometry>"
HEAVY = f"<pose>0.3 0 0 0 0 0</pose><density>2000</density>{CUBE_SDF}"
WATER = 4.0 / 3.0 * np.pi * 0.05**3 * 1000.0  # kg, of the ball
AUTO = {
    "water by default": ("", BALL, "", WATER, 0.0),
    "the link's density": ("<density>700</density>", BALL, "", 0.7 * WATER, 0.0),
    "the collision's density": ("", f"<density>500</density>{BALL}", "", 0.5 * WATER, 0.0),
    "the collision's first": (
        "<density>700</density>",
        f"<density>500</density>{BALL}",
        "",
        0.5 * WATER,
        0.0,
    ),
    "mass": ("<mass>3</mass>", BALL, "", 3.0, 0.0),
    "mass and density": ("<mass>3</mass><density>700</density>", BALL, "", 3.0, 0.0),
    "two collisions": ("", BALL, HEAVY, WATER + 2.0, 0.6 / (WATER + 2.0)),
    "two and a mass": ("<mass>5</mass>", BALL, HEAVY, 5.0, 0.6 / (WATER + 2.0)),
    "what is given is ignored": (
        "<pose>1 0 0 0 0 0</pose><inertia><ixx>9</ixx></inertia>",
        BALL,
        "",
        WATER,
        0.0,
    ),
}


@pytest.mark.parametrize("name", AUTO)
def test_automatic_inertia_follows_from_shapes_and_densities(tmp_path, name):
    """As SDF 1.11 says; a mass that is given scales the inertia, as from libsdformat 15.2 on."""
    inertial, first, second, mass, center = AUTO[name]
    collisions = "".join(
        f"<collision name='c{k}'>{text}</collision>" for k, text in enumerate((first, second)) if text
    )
    path = tmp_path / "auto.sdf"
    path.write_text(
        "<sdf version='1.11'><model name='m'><link name='l'>"
        f"<inertial auto='true'>{inertial}</inertial>{collisions}</link></model></sdf>"
    )
    found = solid_of(path)
    assert found.mass == pytest.approx(mass, rel=1e-9)
    np.testing.assert_allclose(found.solid.origin, [-center, 0, 0], atol=1e-9)
    own = 0.4 * 0.05**2
    if second:
        share = WATER / (WATER + 2.0)
        along = share * own + (1.0 - share) * 0.1**2 / 6.0
        across = along + share * (1.0 - share) * 0.3**2  # of the reduced mass
        expected = np.diag([along, across, across])
    else:
        expected = own * np.eye(3)
    np.testing.assert_allclose(found.solid.inertia, expected, rtol=1e-9, atol=1e-15)
    notes = read_description(path).notes
    assert len(notes) == ("ignored" in name)


@pytest.mark.parametrize(
    ("inertial", "mass", "noted"),
    [
        ("", 1.0, "m: has no <inertial>: mass 1 kg, as SDF says, and the inertia of its shape"),
        ("<inertial/>", 1.0, "m: has no <mass>: 1 kg, as SDF says"),
        ("<inertial><mass>0.4</mass></inertial>", 0.4, None),
    ],
)
def test_a_link_without_a_mass_has_one_kilogram_with_a_line(tmp_path, inertial, mass, noted):
    path = tmp_path / "plain.sdf"
    link = f"<link name='l'>{inertial}<collision name='c'>{BALL}</collision></link>"
    path.write_text(f"<sdf version='1.9'><model name='m'>{link}</model></sdf>")
    world = load_world(path)
    (body,) = world.bodies
    assert body.mass == mass and world.notes == ((noted,) if noted else ()) and not world.left_out
    assert len(body.model) == 1, "a ball is one sphere"
    np.testing.assert_allclose(body.model.inertia, 0.4 * 0.05**2 * np.eye(3), rtol=1e-9)


@pytest.mark.parametrize("value", ["0", "-1"])
@pytest.mark.parametrize(
    "entry", ["<inertial><mass>{}</mass></inertial>", "<inertial auto='1'><density>{}</density></inertial>"]
)
def test_masses_and_densities_are_positive(tmp_path, entry, value):
    path = tmp_path / "bad.sdf"
    link = f"<link name='l'>{entry.format(value)}<collision name='c'>{BALL}</collision></link>"
    path.write_text(f"<sdf version='1.11'><model name='m'>{link}</model></sdf>")
    with pytest.raises(UncPhysicsError, match=r"left out: m: (mass|density) must be positive"):
        solid_of(path, "m")
