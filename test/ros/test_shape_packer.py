"""Shapes in messages: meshes and primitives as objects, and as obstacles that are packed."""

import threading

import numpy as np
import pytest
import scenes
import trimesh
from geometry_msgs.msg import Point, Point32, Polygon
from scenes import material_of, moving_object, packed
from shape_msgs.msg import Mesh, SolidPrimitive

from unc_physics.checks.errors import ErrorCode, NoObjectsError, UncPhysicsError
from unc_physics.ros import models
from unc_physics.ros.messages.scene import read_scene
from unc_physics.ros.models import ModelLibrary
from unc_physics_msgs.msg import EnvironmentElement, ObjectState
from unc_physics_msgs.msg import Scene as SceneMessage

PHYSICS = {"dt": 0.01, "integrator": "implicit", "gravity": (0.0, 0.0, 0.0)}
SPHERES = 20


@pytest.fixture(autouse=True)
def no_time_to_cut(monkeypatch):
    monkeypatch.setattr(models, "CUTTING_TIMEOUT", 0.0)


@pytest.fixture
def library():
    made = ModelLibrary()
    yield made
    made.discard()


def mesh_message(mesh):
    return scenes.mesh_message(mesh.vertices, mesh.faces)


TORUS = trimesh.creation.torus(0.1, 0.03, major_sections=12, minor_sections=8)
TORUS.apply_translation([0.2, 0.0, 0.0])


def shaped(**fields):
    """An object without a model; also one without any shape."""
    message = ObjectState(**{"id": "thing", "mass": 1.0, "spheres": SPHERES} | fields)
    message.pose.pose.position.x = 1.0
    return message


def primitive(kind, *size, polygon=()):
    points = [Point32(x=x, y=y) for x, y in polygon]
    return SolidPrimitive(type=kind, dimensions=packed(size), polygon=Polygon(points=points))


def read(library, *objects, elements=(), **others):
    message = SceneMessage(objects=list(objects))
    message.environment.elements = list(elements)
    return read_scene(message, library, PHYSICS, **others)


def test_a_mesh_is_an_object_of_its_shape(library):
    found = read(library, shaped(mesh=mesh_message(TORUS)))
    (body,) = found.scene.bodies
    assert len(body.model) == SPHERES and body.model.volume == pytest.approx(TORUS.volume)
    np.testing.assert_allclose(found.belief.mean[0, :3], [1.2, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(body.unit_inertia, TORUS.moment_inertia / TORUS.volume, atol=1e-9)
    assert found.models == (body.model.name,) and body.model.name.startswith("mesh_")
    again, other = (read(library, shaped(mesh=mesh_message(mesh))) for mesh in (TORUS, TORUS.copy()))
    assert again.scene.bodies[0].model is body.model is other.scene.bodies[0].model
    twice = shaped(mesh=mesh_message(TORUS), scale=2.0)
    assert read(library, twice).scene.bodies[0].model.volume == pytest.approx(8.0 * TORUS.volume)


@pytest.mark.parametrize(
    ("message", "mesh"),
    [
        (primitive(SolidPrimitive.BOX, 0.3, 0.2, 0.1), trimesh.creation.box((0.3, 0.2, 0.1))),
        (primitive(SolidPrimitive.SPHERE, 0.1), trimesh.creation.icosphere(5, 0.1)),
        (primitive(SolidPrimitive.CYLINDER, 0.3, 0.1), trimesh.creation.cylinder(0.1, 0.3, sections=512)),
        (
            primitive(SolidPrimitive.CONE, 0.4, 0.1),
            trimesh.creation.cone(0.1, 0.4, sections=512).apply_translation([0.0, 0.0, -0.2]),
        ),
        (
            primitive(SolidPrimitive.PRISM, 0.4, polygon=((0.0, 0.0), (0.0, 0.3), (0.2, 0.0))),
            trimesh.creation.extrude_triangulation(
                np.array([[0.0, 0.0], [0.2, 0.0], [0.0, 0.3]]), np.array([[0, 1, 2]]), 0.4
            ).apply_translation([0.0, 0.0, -0.2]),
        ),
    ],
    ids=["box", "sphere", "cylinder", "cone", "prism"],
)
def test_primitives_are_objects_of_their_shapes(library, message, mesh):
    """Volume, centre of mass and inertia are the solid's; what is round has the circle's area."""
    found = read(library, shaped(primitive=message))
    (body,) = found.scene.bodies
    size = mesh.extents.max()
    assert body.model.volume == pytest.approx(mesh.volume, rel=2e-3)
    np.testing.assert_allclose(body.model.origin, -mesh.center_mass, atol=1e-3 * size)
    np.testing.assert_allclose(body.unit_inertia, mesh.moment_inertia / mesh.volume, atol=1e-3 * size**2)
    reach = np.abs(body.model.centers) + body.model.radii[:, None]
    assert (reach <= np.abs(mesh.vertices - mesh.center_mass).max(axis=0) * 1.01).all()


def test_meshes_and_cones_are_obstacles(library):
    """Fixed bodies with the element's name, pose and material, after the objects."""
    cone = EnvironmentElement(id="cone", primitive=primitive(SolidPrimitive.CONE, 0.4, 0.1))
    cone.pose.position.z, cone.material = 0.2, material_of(friction=0.7)
    ring = EnvironmentElement(mesh=mesh_message(TORUS))
    post = EnvironmentElement(id="post", primitive=primitive(SolidPrimitive.CYLINDER, 0.4, 0.1))
    found = read(library, moving_object(), elements=[cone, post, ring])
    assert [body.name for body in found.scene.bodies] == ["left", "cone", "element_2"]
    assert [element.name for element in found.scene.environment] == ["post"]
    (_, packed_cone, packed_ring) = found.scene.bodies
    assert packed_cone.fixed and packed_cone.friction == 0.7 and packed_ring.fixed
    np.testing.assert_allclose(found.belief.mean[1, :3], [0.0, 0.0, 0.1], atol=1e-4)  # a quarter up
    np.testing.assert_allclose(found.belief.mean[2, :3], [0.2, 0.0, 0.0], atol=1e-9)
    with pytest.raises(UncPhysicsError, match=r"scene.environment.elements\[1\].id is the id of an object"):
        read(library, moving_object("post"), elements=[cone, post])


def test_a_packing_holds_up_nobody_else(library, monkeypatch):
    pack, go, packed_meshes = models._pack, threading.Event(), []

    def slow(*arguments):
        packed_meshes.append(arguments)
        go.wait()
        return pack(*arguments)

    monkeypatch.setattr(models, "_pack", slow)
    waiting = shaped(mesh=mesh_message(TORUS))
    with monkeypatch.context() as impatient:
        impatient.setattr(models, "PACKING_TIMEOUT", 0.01)
        with pytest.raises(UncPhysicsError, match="is still being packed after 0.01 s; ask again") as caught:
            read(library, waiting)
        assert caught.value.code == ErrorCode.TIMEOUT
    waited = []
    threads = [threading.Thread(target=lambda: waited.append(read(library, waiting))) for _ in range(3)]
    for thread in threads:
        thread.start()
    assert read(library, moving_object()).scene.bodies  # the others go on
    ball = primitive(SolidPrimitive.SPHERE, 0.1)
    streamed = read(library, moving_object(), waiting, shaped_as("ball", ball), skip_invalid_objects=True)
    assert [body.name for body in streamed.scene.bodies] == ["left", "ball"]
    assert streamed.skipped == {"thing": "scene.objects[1].mesh is being packed"}
    ring = EnvironmentElement(mesh=mesh_message(TORUS))
    elements = read(library, moving_object(), elements=[ring], skip_invalid_objects=True).scene.bodies
    assert [body.name for body in elements] == ["left"] and not waited
    go.set()
    for thread in threads:
        thread.join()
    assert len(waited) == 3 and len({found.scene.bodies[0].model for found in waited}) == 1
    assert len(packed_meshes) <= 2, "each mesh is packed once"
    streamed = read(library, waiting, skip_invalid_objects=True)
    assert [body.name for body in streamed.scene.bodies] == ["thing"]


def shaped_as(name, shape):
    message = shaped(primitive=shape)
    message.id = name
    return message


OPEN = TORUS.copy()
OPEN.update_faces(np.arange(len(OPEN.faces)) > 0)
AWAY = mesh_message(TORUS)
AWAY.triangles[0].vertex_indices[0] = 1000
SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
DART = ((0.0, 0.0), (1.0, -1.0), (0.2, 0.0), (1.0, 1.0))
STAR = tuple((float(np.cos(2.0 * a)), float(np.sin(2.0 * a))) for a in 2.0 * np.pi / 5.0 * np.arange(5))


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"mesh": mesh_message(OPEN)}, r"mesh is not closed|mesh .*edge"),
        ({"mesh": Mesh(vertices=[Point()])}, r"mesh has no triangles"),
        ({"mesh": AWAY}, r"mesh.triangles must be indices of the 96 vertices"),
        ({"mesh": mesh_message(TORUS), "model": "can"}, "must have exactly one of model, primitive and mesh"),
        (
            {"mesh": mesh_message(TORUS), "primitive": primitive(SolidPrimitive.SPHERE, 0.1)},
            "must have exactly one of model, primitive and mesh",
        ),
        ({}, "must have exactly one of model, primitive and mesh$"),
        ({"primitive": primitive(9, 1.0)}, r"primitive.type is no kind of primitive .*got 9"),
        ({"primitive": primitive(SolidPrimitive.CONE, 1.0)}, r"primitive.dimensions must"),
        ({"primitive": primitive(SolidPrimitive.BOX, 1.0, 0.0, 1.0)}, r"sions\[1\] must be positive"),
        ({"primitive": primitive(SolidPrimitive.PRISM, 1.0, polygon=SQUARE[:2])}, "at least three corners"),
        (
            {"primitive": primitive(SolidPrimitive.PRISM, 1.0, polygon=DART)},
            r"primitive.polygon must be convex",
        ),
        (
            {"primitive": primitive(SolidPrimitive.PRISM, 1.0, polygon=STAR)},
            r"primitive.polygon must be convex",
        ),
    ],
)
def test_bad_shapes_are_told_in_a_sentence(library, fields, words):
    message = shaped(**{key: value for key, value in fields.items() if key != "mass"})
    message.mass = fields.get("mass", 1.0)
    with pytest.raises(UncPhysicsError, match=r"^scene.objects\[0\]\.?.*(" + words + ")"):
        read(library, message)


@pytest.mark.parametrize(
    ("mass", "words"),
    [
        (0.0, "must be given, since the {} of object 'thing' has none"),
        (-1.0, "must be positive"),
        (float("nan"), "must be finite"),
        (1e300, "must be between"),
    ],
)
def test_a_mass_is_checked_before_its_shape_is_packed(library, monkeypatch, mass, words):
    box = primitive(SolidPrimitive.BOX, 0.31, 0.2, 0.1)
    with monkeypatch.context() as patch:
        patch.setattr(models, "_pack", lambda *_: pytest.fail("packed"))
        for name, shape in (("primitive", box), ("mesh", mesh_message(TORUS))):
            message = shaped(**{name: shape})
            message.mass = mass
            with pytest.raises(UncPhysicsError, match=rf"^scene.objects\[0\].mass {words.format(name)}"):
                read(library, message)
    if not mass:
        fixed = shaped(primitive=box, kind=ObjectState.FIXED)
        fixed.mass = mass
        assert read(library, moving_object(), fixed).scene.bodies[1].fixed


def test_limits_and_what_an_obstacle_cannot_have(library, monkeypatch):
    with pytest.raises(UncPhysicsError, match=r"objects\[0\].spheres must be at most 100000"):
        read(library, shaped(mesh=mesh_message(TORUS), spheres=100_001))
    monkeypatch.setattr(models, "MAX_TRIANGLES", 10)
    with pytest.raises(UncPhysicsError, match=r"mesh.triangles must be at most 10"):
        read(library, shaped(mesh=mesh_message(TORUS)))
    cone = EnvironmentElement(primitive=primitive(SolidPrimitive.CONE, 0.4, 0.1), surface_tilt_std=0.1)
    with pytest.raises(UncPhysicsError, match=r"elements\[0\].surface_tilt_std is for planes"):
        read(library, moving_object(), elements=[cone])
    cone.surface_tilt_std, cone.mesh = 0.0, mesh_message(TORUS)
    with pytest.raises(UncPhysicsError, match=r"elements\[0\] must have exactly one of"):
        read(library, moving_object(), elements=[cone])
    with pytest.raises(NoObjectsError):
        read(library)


def test_a_mesh_has_its_hull_at_once_and_convex_pieces_later(library, monkeypatch):
    pytest.importorskip("coacd")
    monkeypatch.setattr(models, "CUTTING_TIMEOUT", 300.0)
    first = library.shape_packer.of_mesh(mesh_message(TORUS), SPHERES, "mesh")
    assert first.pieces_kind == models.HULL and len(first.pieces) == 1
    library.shape_packer._cutter.submit(lambda: None).result()  # after the cut
    later = library.shape_packer.of_mesh(mesh_message(TORUS), SPHERES, "mesh")
    assert later.pieces_kind == "convex decomposition" and len(later.pieces) > 4
    assert later.pieces_error.max() < 0.5 * first.pieces_error.max()
    np.testing.assert_array_equal(later.centers, first.centers)
    again = library.shape_packer.of_mesh(mesh_message(TORUS), SPHERES + 1, "mesh")
    library.shape_packer._cutter.submit(lambda: None).result()
    assert (
        again.pieces_kind == models.HULL
    )  # each number of spheres begins with the hull, and gets the same pieces
    assert library.shape_packer.of_mesh(mesh_message(TORUS), SPHERES + 1, "mesh").pieces is later.pieces


def test_a_mesh_that_is_not_cut_keeps_its_hull(library, monkeypatch):
    monkeypatch.setattr(models, "find_spec", lambda _: None)
    for _ in range(2):
        found = library.shape_packer.of_mesh(mesh_message(TORUS), SPHERES, "mesh")
        assert found.pieces_kind == models.HULL and found.pieces_error.max() > 0.02


def test_convex_meshes_and_primitives_are_exact_at_once(library):
    box = trimesh.creation.box((0.3, 0.2, 0.1))
    assert library.shape_packer.of_mesh(mesh_message(box), SPHERES, "mesh").pieces_kind == "box"
    message = primitive(SolidPrimitive.CYLINDER, 0.3, 0.1)
    assert library.shape_packer.of_primitive(message, SPHERES, "primitive").pieces_kind == "cylinder"
