"""MoveIt's planning scenes: with its own messages where they are installed, otherwise with stand-ins that
have the same fields.
"""

import re
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Pose, TransformStamped
from scenes import assert_answered, orientation_of, packed, position_of, tetrahedron
from scipy.spatial.transform import Rotation
from shape_msgs.msg import Plane, SolidPrimitive
from std_msgs.msg import Header

from unc_physics import load_model
from unc_physics.checks.errors import UncPhysicsError
from unc_physics.ros import request_of_planning_scene
from unc_physics.ros.messages.fields import pose_message
from unc_physics.ros.messages.frames import IDENTITY
from unc_physics.ros.messages.planning_scene import PlanningWorld
from unc_physics.ros.messages.scene import read_scene
from unc_physics.ros.models import ModelLibrary
from unc_physics_msgs.msg import Action, ObjectState

try:
    from moveit_msgs.msg import AttachedCollisionObject, CollisionObject, PlanningScene
except ImportError:

    def CollisionObject(**fields):
        """Those fields of moveit_msgs/CollisionObject that tell shapes and places."""
        shapes = {name: [] for name in ("primitives", "meshes", "planes")}
        shapes |= {f"{name}_poses": [] for name in ("primitive", "mesh", "plane")}
        empty = {"header": Header(), "pose": Pose(), "id": "", "operation": b"\x00"}
        return SimpleNamespace(**shapes | empty | fields)

    def AttachedCollisionObject(**fields):
        return SimpleNamespace(**{"link_name": "", "object": CollisionObject(), "weight": 0.0} | fields)

    def PlanningScene():
        octomap = SimpleNamespace(octomap=SimpleNamespace(data=[]))
        return SimpleNamespace(
            is_diff=False,
            fixed_frame_transforms=[],
            robot_state=SimpleNamespace(attached_collision_objects=[]),
            world=SimpleNamespace(collision_objects=[], octomap=octomap),
        )


TURN, SHIFT = Rotation.from_euler("xyz", [0.3, -0.5, 1.0]), np.array([0.4, 0.1, 0.9])
OWN, INNER = Rotation.from_euler("z", 0.7), Rotation.from_euler("x", -0.4)


def pose(position, turn):
    return pose_message(position, turn.as_quat())


def box(*size):
    return SolidPrimitive(type=SolidPrimitive.BOX, dimensions=packed(size))


def planning_scene():
    """A table in another frame, a bin of two boxes, a mesh, a floor, a box that moves, one in the hand."""
    scene = PlanningScene()
    camera = TransformStamped(header=Header(frame_id="base"), child_frame_id="camera")
    t, q = camera.transform.translation, camera.transform.rotation
    t.x, t.y, t.z = SHIFT.tolist()
    q.x, q.y, q.z, q.w = TURN.as_quat().tolist()
    scene.fixed_frame_transforms = [camera]
    base = Header(frame_id="base")
    scene.world.collision_objects = [
        CollisionObject(
            header=Header(frame_id="camera"),
            id="table",
            pose=pose((0.1, 0.2, 0.3), OWN),
            primitives=[box(1.0, 0.8, 0.1)],
            primitive_poses=[pose((0.0, 0.0, 0.5), INNER)],
        ),
        CollisionObject(header=base, id="bin", primitives=[box(1.0, 0.1, 0.5), box(0.1, 1.0, 0.5)]),
        CollisionObject(
            header=base, id="stone", meshes=[tetrahedron(0.1)], mesh_poses=[pose((2.0, 0.0, 0.0), OWN)]
        ),
        CollisionObject(
            header=base, id="floor", planes=[Plane(coef=[0.0, 0.0, 1.0, 0.5])], plane_poses=[Pose()]
        ),
        CollisionObject(
            header=base, id="box", pose=pose((0.0, 0.0, 3.0), OWN), primitives=[box(0.1, 0.1, 0.1)]
        ),
    ]
    held = CollisionObject(
        header=Header(frame_id="hand"),
        id="can",
        primitives=[box(0.05, 0.05, 0.1)],
        pose=pose((0.0, 0.0, 0.1), OWN),
    )
    scene.robot_state.attached_collision_objects = [
        AttachedCollisionObject(link_name="hand", object=held, weight=0.2)
    ]
    return scene


def difference(*objects, attached=(), is_diff=True):
    """A change of a planning scene, or a whole one."""
    scene = PlanningScene()
    scene.is_diff, scene.world.collision_objects = is_diff, list(objects)
    held = [AttachedCollisionObject(object=own) for own in attached]
    scene.robot_state.attached_collision_objects = held
    return scene


def block(name, operation=0, z=0.0, frame="world"):
    """A box that is added (0), removed, appended or moved (3)."""
    own = CollisionObject(header=Header(frame_id=frame), id=name, operation=bytes([operation]))
    own.pose.position.z = z
    if operation in (0, 2):
        own.primitives, own.primitive_poses = [box(1.0, 1.0, 0.1)], [Pose()]
    return own


def test_differences_of_a_planning_scene():
    add, remove, append, move = range(4)
    world = PlanningWorld()

    def place(frame):
        return IDENTITY._replace(translation=np.array([0.0, 0.0, float(frame == "lifted")]))

    for changed, expected in (
        (difference(block("table"), block("can", z=0.2), is_diff=False), {"table": 0.0, "can": 0.2}),
        (
            difference(block("can", move, z=0.3), block("wall", frame="lifted")),
            {"table": 0.0, "can": 0.3, "wall": 1.0},
        ),
        (difference(attached=[block("can")]), {"table": 0.0, "wall": 1.0}),
        (difference(block("table", append)), {"table/0": 0.0, "table/1": 0.0, "wall": 1.0}),
        (difference(block("table", remove)), {"wall": 1.0}),
        (difference(block("", remove)), {}),
        (difference(block("shelf", add)), {"shelf": 0.0}),
        (difference(block("table"), is_diff=False), {"table": 0.0}),
    ):
        world.update(changed)
        found, problems = world.elements(place)
        assert not problems
        assert {element.id: element.pose.position.z for element in found} == expected


HAND = {"hand": pose(SHIFT, TURN)}
PAGE = Path(__file__).parents[2] / "docs/how-to/moveit.md"


def test_what_a_planning_scene_holds():
    request = request_of_planning_scene(planning_scene(), objects={"box": 0.7}, frames=HAND)
    scene, (hold,) = request.scene, request.actions
    assert scene.header.frame_id == "base"
    box, can, hand = scene.objects
    table, first, second, stone, floor = scene.environment.elements
    assert [element.id for element in (table, first, second, stone, floor)] == [
        "table",
        "bin/0",
        "bin/1",
        "stone",
        "floor",
    ]
    expected = TURN.apply(OWN.apply([0.0, 0.0, 0.5]) + [0.1, 0.2, 0.3]) + SHIFT
    np.testing.assert_allclose(position_of(table.pose), expected)
    turned = Rotation.from_quat(orientation_of(table.pose))
    assert (turned.inv() * TURN * OWN * INNER).magnitude() < 1e-12
    assert position_of(stone.pose).tolist() == [2.0, 0.0, 0.0] and len(stone.mesh.triangles) == 4
    assert floor.plane.coef.tolist() == [0.0, 0.0, 1.0, 0.5]
    assert (box.id, box.mass) == ("box", 0.7)
    assert position_of(box.pose).tolist() == [0.0, 0.0, 3.0] and box.primitive.type == SolidPrimitive.BOX
    assert (can.id, can.mass) == ("can", 0.2)
    assert (hold.type, hold.object, hold.attached_to) == (Action.ATTACHMENT, "can", "hand")
    np.testing.assert_allclose(position_of(can.pose), TURN.apply([0.0, 0.0, 0.1]) + SHIFT)
    assert (hand.id, hand.kind, hand.primitive.type) == ("hand", ObjectState.FIXED, SolidPrimitive.SPHERE)
    np.testing.assert_allclose(position_of(hand.pose), SHIFT)
    assert hand.primitive.dimensions[0] == 0.01  # the box begins 5 cm from the link's origin


def test_the_node_reads_it():
    """Without what is attached, which it does not serve."""
    message = planning_scene()
    message.robot_state.attached_collision_objects = []
    library = ModelLibrary()
    request = request_of_planning_scene(message, objects={"box": 0.7, "stone": 1.0}, models={"stone": "can"})
    found = read_scene(request.scene, library, {"dt": 0.01, "stiffness": 1e4, "gravity": (0.0, 0.0, 0.0)})
    library.discard()
    assert [body.name for body in found.scene.bodies] == ["stone", "box"]
    assert found.models == ("can", found.scene.bodies[1].model.name)
    assert found.scene.bodies[1].model.volume == pytest.approx(1e-3)
    assert [element.name for element in found.scene.environment] == ["table", "bin/0", "bin/1", "floor"]
    assert found.scene.environment[3].offset == pytest.approx(-0.5)


def test_a_model_stands_where_its_primitive_does():
    """The origin of the can is the middle of its bottom, that of a cylinder is half way up."""
    scene = planning_scene()
    cylinder = SolidPrimitive(type=SolidPrimitive.CYLINDER, dimensions=packed([0.11, 0.033]))
    lifted = pose((0.0, 0.0, 0.055), Rotation.identity())
    scene.world.collision_objects = [
        CollisionObject(
            header=Header(frame_id="base"), id="soup", primitives=[cylinder], primitive_poses=[lifted]
        )
    ]
    scene.robot_state.attached_collision_objects = []
    request = request_of_planning_scene(scene, objects={"soup": 0.4}, models={"soup": "can"})
    (soup,) = request.scene.objects
    can = load_model("can")
    top = can.centers[:, 2] + can.radii - can.origin[2]
    assert position_of(soup.pose)[2] == pytest.approx(0.055 - 0.5 * (top.max() + _bottom(can)), abs=1e-9)
    assert abs(position_of(soup.pose)[2]) < 1e-3  # it stands on the ground, and not 5.5 cm above it
    turned = pose((0.3, 0.0, 0.2), OWN * INNER)
    scene.world.collision_objects[0].primitive_poses = [turned]
    (soup,) = request_of_planning_scene(scene, objects={"soup": 0.4}, models={"soup": "can"}).scene.objects
    middle = (OWN * INNER).apply([0.0, 0.0, 0.5 * (top.max() + _bottom(can))])
    np.testing.assert_allclose(position_of(soup.pose) + middle, [0.3, 0.0, 0.2], atol=1e-4)


def _bottom(model):
    return (model.centers[:, 2] - model.radii - model.origin[2]).min()


def test_a_link_inside_of_what_it_holds_needs_a_shape():
    scene = planning_scene()
    scene.robot_state.attached_collision_objects[0].object.pose = pose((0.0, 0.0, 0.02), OWN)
    with pytest.raises(UncPhysicsError, match="link has its origin in an object .* give its shape in links"):
        request_of_planning_scene(scene, frames=HAND)
    request = request_of_planning_scene(scene, frames=HAND, links={"hand": box(0.01, 0.2, 0.01)})
    assert request.scene.objects[-1].primitive.type == SolidPrimitive.BOX


def removed(scene):
    scene.world.collision_objects[0].operation = b"\x01"


def with_octomap(scene):
    scene.world.octomap.octomap.data = [1]


def is_diff(scene):
    scene.is_diff = True


def one_pose_too_many(scene):
    scene.world.collision_objects[1].primitive_poses = [Pose()]


def bad_turn(scene):
    scene.world.collision_objects[0].pose.orientation.w = 3.0


def nothing(scene):
    pass


@pytest.mark.parametrize(
    ("change", "arguments", "words"),
    [
        (is_diff, {}, "is_diff must be false; ask for the whole planning scene"),
        (with_octomap, {}, "world.octomap is not read"),
        (removed, {}, r"world.collision_objects\[0\].operation must be ADD"),
        (one_pose_too_many, {}, r"collision_objects\[1\].primitive_poses must be as many as primitives, 2"),
        (bad_turn, {}, r"collision_objects\[0\].pose.orientation must"),
        (nothing, {"frames": {}}, r"collision_objects\[0\].object.header.frame_id is no frame .*hand"),
        (nothing, {"objects": {"cup": 1.0}}, "objects is no object of the planning scene .*cup"),
        (nothing, {"models": {"cup": "can"}}, "models is no object of the planning scene .*cup"),
        (nothing, {"objects": {"bin": 1.0}}, r"collision_objects\[1\] moves, and must then be one"),
        (nothing, {"objects": {"floor": 1.0}}, r"collision_objects\[3\] moves, and must then be one"),
        (nothing, {"objects": {"box": 0.0}}, "mass of 'box' must be positive"),
        (nothing, {"objects": {"can": -1.0}}, r"attached_collision_objects\[0\].weight must be positive"),
    ],
)
def test_what_cannot_be_read_is_told_in_a_sentence(change, arguments, words):
    scene = planning_scene()
    change(scene)
    with pytest.raises(UncPhysicsError, match=words):
        request_of_planning_scene(scene, **{"frames": HAND} | arguments)


def test_an_octomap_may_be_left_out():
    scene = planning_scene()
    with_octomap(scene)
    found = request_of_planning_scene(scene, frames=HAND, ignore_octomap=True)
    assert len(found.scene.environment.elements) == 6


def test_the_page_s_snippets_run(node):
    """A service answers in place of move_group; the page's node asks it, converts, and predicts a release."""
    services = pytest.importorskip("moveit_msgs.srv", reason="needs moveit_msgs")
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    def answer(request, response):
        response.scene = whole
        return response

    base = Header(frame_id="world")
    held = CollisionObject(
        header=Header(frame_id="panda_hand"),
        id="can",
        primitives=[box(0.06, 0.06, 0.1)],
        pose=pose((0, 0, -0.1), OWN),
    )
    whole = PlanningScene()
    whole.world.collision_objects = [
        CollisionObject(header=base, id="table", primitives=[box(1, 1, 0.1)], pose=pose((0, 0, -0.05), OWN)),
        CollisionObject(
            header=base, id="box", primitives=[box(0.1, 0.06, 0.16)], pose=pose((0.3, 0.2, 0.09), OWN)
        ),
    ]
    whole.robot_state.attached_collision_objects = [
        AttachedCollisionObject(link_name="panda_hand", object=held, weight=0.3)
    ]
    context = rclpy.Context()
    rclpy.init(context=context)
    move_group = rclpy.create_node("move_group", context=context)
    move_group.create_service(services.GetPlanningScene, "/get_planning_scene", answer)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(move_group)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    level = Rotation.identity()
    found = {"hand_pose": pose((0.0, 0.0, 0.4), level), "hand_box": box(0.05, 0.05, 0.05)}
    try:
        for snippet in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL):
            exec(snippet, found)  # noqa: S102
        answered = found["answer"]
        assert_answered(answered)
        places = {own.id: own.states[-1].pose.pose.position for own in answered.prediction.objects}
        assert places.keys() == {"box", "can", "panda_hand"}
        assert places["panda_hand"].z == pytest.approx(0.4)
        assert places["can"].z < 0.1  # released, it lies on the table
        assert places["box"].z == pytest.approx(0.0, abs=0.02)
    finally:
        executor.shutdown()
        context.try_shutdown()
        thread.join(5.0)
        if "node" in found:
            found["node"].destroy_node()
            rclpy.try_shutdown()
