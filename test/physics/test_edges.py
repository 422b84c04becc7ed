"""Bodies near edges: they stay where their centre of mass is over the support, and fall elsewhere.

The support is that of the solids, to 2 mm: the outermost spheres of a packing are inset by less than 1 mm.
"""

from functools import cache

import numpy as np
import pytest
from plain_scenes import G, run, state, turned
from scipy.integrate import solve_ivp
from scipy.spatial import ConvexHull
from unc_physics.collision.hull import hull_spheres, hull_volume

from unc_physics import (
    Belief,
    BodyBelief,
    RigidBody,
    Scene,
    load_model,
    make_propagator,
    predict,
    rounded_box,
)
from unc_physics.scene.body import shape_of
from unc_physics.scene.environment import Box, Plane
from unc_physics.scene.stiffness import with_stiffness
from unc_physics.shapes.packing import pack_solid
from unc_physics.shapes.primitive_models import primitive_model
from unc_physics.shapes.primitives import primitive
from unc_physics.shapes.solid_mesh import make_solid

TABLE = Box((0.4, 0.6, 0.02), (-0.2, 0.0, -0.01))  # its edge is at x = 0
STEPS = pytest.mark.parametrize("dt", [1 / 120, 1 / 240, 1 / 1000])
INSET = pytest.mark.parametrize("inset", [-2e-3, 2e-3])  # of the centre of mass from the edge [m]


@cache
def packed_box(size, count):
    return pack_solid(make_solid("box", *primitive("box", size)), count)


def drop(scene, name, time=0.8, **states):
    """Height by which a body falls [m]."""
    belief = Belief.of(scene, {key: BodyBelief(**values) for key, values in states.items()})
    body = predict(scene, belief, make_propagator("monte_carlo", samples=1), time)[name]
    return states[name]["position"][2] - body.position[2]


def assert_stands(height, inset):
    if inset > 0.0:
        assert abs(height) < 5e-4
    else:
        assert height > 0.02


@STEPS
@INSET
@pytest.mark.parametrize("count", [100, 300, 1000])
def test_a_box_on_a_box_tips_at_its_edge(count, inset, dt):
    lower, upper = packed_box((0.2, 0.1, 0.05), count), packed_box((0.1, 0.08, 0.06), count)
    bodies = [RigidBody("upper", upper, 0.3), RigidBody("lower", lower, 2.0)]
    scene = Scene.everyday(bodies, exact=True, environment=[Plane()], dt=dt)
    places = {
        "upper": {"position": (0.1 - inset, 0.01, 0.08), "orientation": turned(0, 0, 0.3)},
        "lower": {"position": (0, 0, 0.025)},
    }
    assert_stands(drop(scene, "upper", **places), inset)


@STEPS
@INSET
@pytest.mark.parametrize("turn", [0.0, 0.6])
@pytest.mark.parametrize("at_rest", [False, True])
@pytest.mark.parametrize("count", [100, 1000, 8])
def test_a_box_tips_at_the_edge_of_a_table(count, at_rest, turn, inset, dt):
    """A salt box, or the eight spheres of a rounded box."""
    model = rounded_box((0.1, 0.08, 0.122), 0.005) if count == 8 else load_model("salt_box")
    body = RigidBody("box", model.prefix(count), 0.5, at_rest=at_rest)
    scene = Scene.everyday([body], exact=True, environment=[TABLE], dt=dt)
    place = {"position": (-inset, 0, 0.061), "orientation": turned(0, 0, turn)}
    assert_stands(drop(scene, "box", box=place), inset)


def two_rounded_boxes(radius, dt):
    """Cubes of 10 cm, the lower one of which stands on a floor."""
    bodies = [RigidBody(name, rounded_box(0.1, radius), 1.0) for name in ("upper", "lower")]
    return Scene.everyday(bodies, exact=True, environment=[Plane()], dt=dt), {"position": (0, 0, 0.05)}


@STEPS
@pytest.mark.parametrize("radius", [0.5e-3, 1e-3, 2e-3, 5e-3])
@INSET
def test_rounded_boxes_carry_each_other_between_their_spheres(inset, radius, dt):
    """The edge of the flat face is inset by the radius."""
    scene, lower = two_rounded_boxes(radius, dt)
    upper = {"position": (0.05 - radius - inset, 0.01, 0.15)}
    assert_stands(drop(scene, "upper", upper=upper, lower=lower), inset)


@STEPS
def test_rounded_boxes_land_on_each_other(dt):
    """The upper one falls 2 cm, turned so that no spheres meet."""
    scene, lower = two_rounded_boxes(1e-3, dt)
    upper = {"position": (0.011, 0.007, 0.17), "orientation": turned(0, 0, 0.4)}
    assert drop(scene, "upper", upper=upper, lower=lower) == pytest.approx(0.02, abs=3e-4)


@STEPS
def test_a_box_tips_about_an_edge_with_its_energy_kept(dt):
    """Kinetic energy is ``m g`` times the drop, and the edge stays where it is on the face.

    Up to 39 degrees, so beyond the tilt up to which outlines have contacts.
    """
    model = packed_box((0.1, 0.08, 0.06), 300)
    body = RigidBody("box", model, 1.0, friction=3.0, restitution=0.0)
    table = Box((0.4, 0.6, 0.02), (-0.2, 0.0, -0.01), friction=3.0)
    scene = Scene.everyday([body], exact=True, environment=[table], dt=dt)
    x = state((0.01, 0, 0.03))
    scene = with_stiffness(scene, x.reshape(1, 13))
    for time, degrees in ((0.1, 15.1), (0.125, 25.0), (0.15, 38.5)):
        end = run(scene, x, time)[0]
        tilt = 2.0 * np.arctan2(end[7], end[9])
        assert np.degrees(tilt) == pytest.approx(degrees, abs=0.5)
        kinetic = 0.5 * (end[3:6] @ end[3:6] + end[10:] @ model.inertia @ end[10:])
        assert kinetic == pytest.approx(G * (0.03 - end[2]), rel=0.03)
        up, along = (np.sin(tilt), np.cos(tilt)), (np.cos(tilt), -np.sin(tilt))
        np.testing.assert_allclose([up @ end[[0, 2]], along @ end[[0, 2]]], [0.03, 0.01], atol=2e-4)


def pitch_off_an_edge(speed, friction, half, low, inertia):
    """Time and pitch rate of a box when it has slid off an edge, by the equations of a rigid body.

    Its friction shifts the load ahead, so it begins to tip before its centre of mass is over the edge, by
    ``friction * low``. There it has this ``speed``. ``half`` is half its length, ``low`` the height of its
    centre of mass, ``inertia`` that about the pitch axis, per unit mass.
    """

    def motion(_, y):
        """Rate of change of place, tilt and their rates, load per mass, and way past the edge."""
        tilt, v, w = y[2], y[3:5], y[5]
        along, up = np.array([np.cos(tilt), -np.sin(tilt)]), np.array([np.sin(tilt), np.cos(tilt)])
        force, beyond = up - friction * along, along @ y[:2]
        turn = (y[0] * force[1] - y[1] * force[0]) / inertia
        load = (low * w**2 - 2.0 * w * (along @ v) + G * up[1]) / (beyond * turn + up @ force)
        return np.concatenate([y[3:], load * force - (0.0, G), [load * turn]]), load, beyond

    def is_off(t, y):
        return min(motion(t, y)[1], half - motion(t, y)[2])

    is_off.terminal = True
    start = [-friction * low, low, 0.0, speed, 0.0, 0.0]
    found = solve_ivp(lambda t, y: motion(t, y)[0], (0.0, 2.0), start, events=is_off, rtol=1e-9, atol=1e-11)
    return found.t[-1], found.y[5, -1]


@pytest.mark.parametrize("dt, tolerance", [(1 / 120, 0.09), (1 / 240, 0.05), (1 / 1000, 0.01)])
@pytest.mark.parametrize("speed", [1.3, 2.0])
@pytest.mark.parametrize("count", [300, 1000, 4000])
@pytest.mark.parametrize("name", ["salt_box", "brick"])
def test_a_box_slides_off_an_edge(name, count, speed, dt, tolerance):
    """With the pitch rate of a rigid box."""
    model, friction, way = load_model(name).prefix(count), 0.3, 0.03
    half = (model.centers[:, 0] + model.radii).max()
    low = (model.radii - model.centers[:, 2]).max()
    way -= friction * low
    start = np.sqrt(speed**2 + 2.0 * friction * G * way)
    time, rate = pitch_off_an_edge(speed, friction, half, low, model.inertia[1, 1])
    body = RigidBody("box", model, 0.5, friction=friction, restitution=0.0)
    table = Box((0.4, 0.6, 0.02), (-0.2, 0.0, -0.01), friction=friction)
    scene = Scene.everyday([body], exact=True, environment=[table], dt=dt)
    x = state((-way - friction * low, 0, low), (start, 0, 0))
    x = run(scene, x, time + (start - speed) / (friction * G) + 0.05)[0]
    assert x[11] == pytest.approx(rate, rel=tolerance)


@STEPS
@pytest.mark.parametrize("speed", [0.8, 1.5, 2.0])
@pytest.mark.parametrize("gap", [1e-3, 0.01, 0.02, 0.04])
@pytest.mark.parametrize("length", [0.12, 0.3])
def test_a_box_slides_over_a_gap_between_two_tables(length, gap, speed, dt):
    """Its centre of mass is over a table at all times, as it is longer than two gaps."""
    friction, begin = 0.3, -0.5 * length - 0.05
    tables = [Box((2.0, 0.6, 0.04), (s * (1.0 + 0.5 * gap), 0.0, -0.02)) for s in (-1, 1)]
    box = RigidBody("box", primitive_model("box", size=(length, 0.08, 0.03)), 0.5)
    scene = Scene.everyday([box], environment=tables, exact=True, friction=friction, dt=dt)
    x = run(scene, state((begin, 0.0, 0.015), (speed, 0.0, 0.0)), 1.2)[0]
    assert x[0] - begin == pytest.approx(speed**2 / (2.0 * friction * G), rel=0.01)
    assert abs(x[8]) < 1e-3


@STEPS
def test_a_box_stops_at_a_step_of_a_millimetre(dt):
    step = [Box((2.0, 0.6, 0.04), (-1.0, 0.0, -0.02)), Box((2.0, 0.6, 0.04), (1.0, 0.0, -0.019))]
    box = RigidBody("box", primitive_model("box", size=(0.12, 0.08, 0.03)), 0.5)
    scene = Scene.everyday([box], environment=step, exact=True, friction=0.3, restitution=0.0, dt=dt)
    assert run(scene, state((-0.1, 0.0, 0.015), (1.0, 0.0, 0.0)), 0.5)[0, 0] < -0.05


@STEPS
def test_a_small_box_falls_into_a_bin(dt):
    """Its opening is no face, although spheres of the rim touch a plane."""
    small = rounded_box(0.03, 1e-3)
    scene = Scene.everyday(
        [RigidBody("small", small, 0.1), RigidBody("bin", load_model("bin"), fixed=True)], exact=True, dt=dt
    )
    top = (load_model("bin").centers[:, 2] + load_model("bin").radii).max()
    fallen = drop(scene, "small", small={"position": (0, 0, top + 0.016)}, bin={"position": (0, 0, 0)})
    assert fallen > 0.1


@pytest.mark.parametrize(
    "name, solid", [("salt_box", True), ("brick", True), ("can", False), ("mug", False), ("bin", False)]
)
def test_faces_of_convex_bodies_have_outlines(name, solid):
    """Their corners are those of the hull of the places where spheres touch the face."""
    model = load_model(name).prefix(300)
    faces = shape_of(model).faces
    assert (faces.corners > 0).all() if solid else (faces.corners == 0).all()
    for k, normal in enumerate(faces.normal if solid else ()):
        touching = np.flatnonzero((faces.of_sphere == k).any(axis=1))
        flat = model.centers[touching] @ faces.across[k].T
        corners = model.centers[faces.outline[k, : faces.corners[k]]] @ faces.across[k].T
        sides = np.roll(corners, -1, axis=0) - corners
        after = np.roll(sides, -1, axis=0)
        assert (sides[:, 0] * after[:, 1] > sides[:, 1] * after[:, 0]).all()  # counter-clockwise
        assert ConvexHull(corners).volume == pytest.approx(ConvexHull(flat).volume, rel=1e-6)
        assert np.cross(*faces.across[k]) == pytest.approx(normal)


@pytest.mark.parametrize("size, radius", [(0.1, 1e-3), ((0.3, 0.2, 0.01), 5e-3), ((0.05, 0.1, 0.2), 0.02)])
def test_the_volume_of_a_hull_is_that_of_the_solid(size, radius):
    model = rounded_box(size, radius)
    hull = hull_spheres(np.array(model.centers), np.array(model.radii))
    shape = shape_of(model)
    volume = hull_volume(shape.centers[hull], shape.radii[hull], shape.faces.normal)
    assert volume == pytest.approx(model.volume, rel=0.015)
