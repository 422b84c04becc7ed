"""Every field of a request has its effect, and every field of an answer is filled, over real DDS."""

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import KeyValue
from geometry_msgs.msg import Point, Pose, Transform, Vector3, Wrench
from message_fields import paths, values_at
from scenes import (
    assert_answered,
    diagonal,
    explicit,
    material_of,
    moving_object,
    packed,
    request_of,
    with_physics,
)
from shape_msgs.msg import Mesh, MeshTriangle, Plane, SolidPrimitive
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from unc_physics.checks.errors import ErrorCode
from unc_physics_msgs.msg import (
    Action,
    BoxRegion,
    EnvironmentElement,
    JointCovariance,
    MaterialPair,
    ObjectState,
    Prediction,
    PredictionRequest,
)

FLOOR = "scene.environment.elements[]"
OBJECT = "scene.objects[]"
POSE, TWIST, START = "objects[].states[].pose", "objects[].states[].twist", "objects[].start"
#: Documented as ignored.
IGNORED = {"scene.joint_covariance.time_from_start"}
#: Tested in test_node_environment.py, as it depends on the node's environment.
OF_THE_NODE = {"scene.environment.complete"}


#: A pair has exactly known quantities; refused, see test_bad_requests.py.
UNSET_OF_A_PAIR = "name", "friction_std", "restitution_std"
UNSET_IN_PAIRS = {f"scene.pairs[].material.{name}" for name in UNSET_OF_A_PAIR}


def base():
    """A brick that falls on a floor and slides, and a can that falls onto it."""
    brick = moving_object("brick", "brick", (0.0, 0.0, 0.05), (0.4, 0.0, 0.0), spheres=40)
    can = moving_object("can", "can", (0.0, 0.0, 0.2), (0.0, 0.0, -0.5), spheres=40)
    for message in (brick, can):
        message.pose.covariance = diagonal(*[0.005] * 3, *[0.02] * 3)
        message.twist.twist.angular.z = 0.5
    request = request_of(
        brick, can, horizon=0.4, seed=5, return_probabilities=True, propagator="sigma_points"
    )
    floor = EnvironmentElement(id="floor", plane=Plane(coef=[0.0, 0.0, 1.0, 0.0]))
    request.scene.environment.elements = [floor]
    return with_physics(request, gravity=None)


def first(request):
    return request.scene.objects[0]


def floor(request):
    return request.scene.environment.elements[0]


def region(request):
    return request.regions[0]


def with_region(request):
    box = BoxRegion(id="bin", size=Vector3(x=1.0, y=1.0, z=1.0))
    request.regions, request.propagator, request.samples = [box], "monte_carlo", 300


def with_joint(request):
    joint = JointCovariance(object_ids=["brick", "can"], data=packed(1e-6 * np.eye(24)))
    request.scene.joint_covariance = joint


def as_box(request):
    floor(request).plane = Plane()
    floor(request).primitive = SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[2.0, 2.0, 0.1])


def as_primitive(request):
    first(request).model = ""
    first(request).primitive = SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[0.2, 0.1, 0.06])


def as_mesh_of(find):
    """A change that gives what ``find`` finds the shape of a low pyramid, which is an obstacle far away."""
    corners = [Point(), Point(x=0.1), Point(y=0.1), Point(z=0.05)]
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    triangles = [MeshTriangle(vertex_indices=np.array(face, np.uint32)) for face in faces]

    def change(request):
        message = find(request)
        if isinstance(message, ObjectState):
            message.model = ""
        else:
            message.plane, message.pose.position.x = Plane(), 9.0
        message.mesh = Mesh(vertices=corners, triangles=triangles)

    return change


def set_to(find, **fields):
    """A change that sets fields of what ``find`` finds in a request."""

    def change(request):
        for name, value in fields.items():
            setattr(find(request), name, value)

    return change


def physics(**values):
    return lambda request: with_physics(request, **values)


def at_rest(request):
    first(request).twist.twist.linear.x = first(request).twist.twist.angular.z = 0.0
    first(request).pose.pose.position.z = 0.001
    request.scene.objects.pop()


def material(find, **values):
    return lambda request: setattr(find(request), "material", material_of(**values))


def rolls(request):
    """A ball rolls on the floor."""
    first(request).model, first(request).pose.pose.position.z = "", 0.05
    first(request).primitive = SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[0.05])
    first(request).twist.twist.angular.y, first(request).twist.twist.angular.z = 8.0, 0.0
    request.scene.objects.pop()


def sampled(request):
    request.propagator, request.samples = "monte_carlo", 100


def itself(request):
    return request


def anytime(request, error="1000"):
    """Rollouts until the error of means is so small, 64 at most, but for other wishes."""
    options = {"runs": "64", "samples": "50", "error": error, "spread_error": "0", "probability_error": "0"}
    request.propagator = "auto"
    request.propagator_options = [KeyValue(key=key, value=value) for key, value in options.items()]


def going_on(request):
    anytime(request, "1e-9")


def asked(request):
    anytime(request)
    request.propagator_options = request.propagator_options[:-1]  # probabilities to the usual error


def scene(request):
    return request.scene


def prescribed(request, position=(0.0, 0.0, 0.3)):
    """The can follows a path, down from there."""
    points = [
        MultiDOFJointTrajectoryPoint(
            transforms=[Transform(translation=Vector3(x=x, y=y, z=z))], time_from_start=Duration(sec=sec)
        )
        for sec, (x, y, z) in enumerate([position, (0.0, 0.0, 0.2)])
    ]
    path = MultiDOFJointTrajectory(points=points)
    request.actions = [Action(type=Action.TRAJECTORY, object="can", trajectory=path)]


def held(request):
    """The brick is held by the can until it is let go."""
    prescribed(request)
    until = Duration(nanosec=200_000_000)
    request.actions.append(Action(type=Action.ATTACHMENT, object="brick", attached_to="can", duration=until))


def pushed(request):
    force = Wrench(force=Vector3(x=3.0))
    time = Duration(nanosec=100_000_000)
    request.actions = [Action(type=Action.WRENCH, object="brick", wrench=force, duration=time)]


def action(request):
    return request.actions[0]


def attachment(request):
    return request.actions[1]


def pair(request):
    return request.scene.pairs[0]


def with_pair(request):
    slippery = material_of(friction=0.02)
    request.scene.pairs = [MaterialPair(object_a="brick", object_b="floor", material=slippery)]


def with_can_and_pair(request):
    with_pair(request)
    request.scene.pairs[0].object_a = "can"


def add_post(request):
    request.scene.objects.append(moving_object("post", "can", (2.0, 0.0, 0.0), spheres=40))
    request.scene.objects[-1].kind = ObjectState.FIXED


def act_on(request, name):
    request.actions[0].object = name


TENTH = Duration(nanosec=100_000_000)
ROTATED = Pose()
ROTATED.orientation.x, ROTATED.orientation.w = 0.1, float(np.sqrt(0.99))

#: For each field of a request: a change of it, what of the answer changes with it, and what comes before.
EFFECTS = {
    "scene.header": (lambda request: setattr(request.scene.header.stamp, "sec", 7), "header"),
    f"{OBJECT}.id": (set_to(first, id="block"), "objects[].id"),
    f"{OBJECT}.kind": (set_to(first, kind=ObjectState.FIXED), "objects[].kind"),
    f"{OBJECT}.model": (set_to(first, model="salt_box"), "objects[].model"),
    f"{OBJECT}.scale": (set_to(first, scale=1.2), POSE),
    f"{OBJECT}.spheres": (set_to(first, spheres=20), POSE, explicit),
    f"{OBJECT}.mass": (set_to(first, mass=5.0), POSE),
    f"{OBJECT}.mass_std": (set_to(first, mass_std=0.3), "rollouts"),
    f"{OBJECT}.center_of_mass_std": (set_to(first, center_of_mass_std=Vector3(x=0.01)), POSE),
    f"{OBJECT}.inertia": (set_to(first, inertia=1e-2 * np.eye(3).ravel()), POSE),
    f"{OBJECT}.drag": (set_to(first, drag=1.0), POSE),
    f"{OBJECT}.material.name": (material(first, name="rubber"), POSE),
    f"{FLOOR}.material.name": (material(floor, name="rubber"), POSE),
    f"{OBJECT}.material.friction": (material(first, friction=0.05), POSE),
    f"{OBJECT}.material.friction_std": (
        material(first, friction=0.5, friction_std=0.2),
        "rollouts",
        material(first, friction=0.5),
    ),
    f"{OBJECT}.material.restitution": (material(first, restitution=0.9), TWIST),
    f"{OBJECT}.material.restitution_std": (
        material(first, restitution=0.5, restitution_std=0.2),
        "rollouts",
        material(first, restitution=0.5),
    ),
    f"{OBJECT}.pose": (lambda request: setattr(first(request).pose.pose.position, "y", 0.3), START),
    f"{OBJECT}.twist": (lambda request: setattr(first(request).twist.twist.linear, "y", 0.3), POSE),
    f"{OBJECT}.covariance": (set_to(first, covariance=packed(4e-6 * np.eye(12))), START),
    f"{OBJECT}.at_rest": (set_to(first, at_rest=True), START, at_rest),
    "actions[].type": (pushed, POSE),
    "actions[].object": (lambda request: act_on(request, "can"), POSE, pushed),
    "actions[].trajectory": (lambda request: prescribed(request, (0.1, 0.0, 0.3)), POSE, prescribed),
    "actions[].trajectory_std": (
        lambda request: setattr(request.actions[0], "trajectory_std", np.array([0.01, 0, 0, 0, 0, 0.1])),
        "rollouts",
        prescribed,
    ),
    "actions[].attached_to": (
        set_to(attachment, attached_to="post"),
        POSE,
        lambda request: (held(request), add_post(request)),
    ),
    "actions[].start": (set_to(attachment, start=TENTH), POSE, held),
    "actions[].duration": (set_to(attachment, duration=TENTH), POSE, held),
    "actions[].release_std": (set_to(attachment, release_std=TENTH), "rollouts", held),
    "actions[].wrench": (set_to(lambda request: action(request).wrench.torque, z=0.3), POSE, pushed),
    "actions[].body_axes": (set_to(action, body_axes=True), POSE, pushed),
    "scene.pairs[].object_a": (set_to(pair, object_a="can"), POSE, with_pair),
    "scene.pairs[].object_b": (set_to(pair, object_b="brick"), POSE, with_can_and_pair),
    **{
        f"scene.pairs[].material.{name}": (
            lambda request, name=name, value=value: (
                with_pair(request),
                setattr(pair(request), "material", material_of(**{name: value})),
            ),
            POSE,
            rolls if name == "rolling_friction" else itself,
        )
        for name, value in {
            "friction": 0.02,
            "restitution": 0.9,
            "torsional_friction": 0.02,
            "rolling_friction": 0.01,
        }.items()
    },
    f"{OBJECT}.material.rolling_friction": (material(first, rolling_friction=0.02), POSE, rolls),
    f"{FLOOR}.material.rolling_friction": (material(floor, rolling_friction=0.02), POSE, rolls),
    "physics.rolling_friction": (physics(rolling_friction=0.02), POSE, rolls),
    f"{OBJECT}.material.torsional_friction": (material(first, torsional_friction=0.02), POSE),
    f"{FLOOR}.material.torsional_friction": (material(floor, torsional_friction=0.02), POSE),
    f"{FLOOR}.surface_velocity": (
        lambda request: setattr(floor(request).surface_velocity.linear, "y", 0.3),
        POSE,
    ),
    f"{FLOOR}.id": (set_to(floor, id="table"), "events[].other"),
    f"{FLOOR}.pose": (set_to(floor, pose=ROTATED), POSE),
    f"{FLOOR}.plane": (set_to(floor, plane=Plane(coef=[0.0, 0.0, 1.0, 0.02])), POSE),
    f"{FLOOR}.primitive": (as_box, POSE),
    f"{FLOOR}.mesh": (as_mesh_of(floor), "objects[].model"),
    f"{OBJECT}.primitive": (as_primitive, "objects[].model"),
    f"{OBJECT}.mesh": (as_mesh_of(first), "objects[].model"),
    f"{FLOOR}.material.friction": (material(floor, friction=0.05), POSE),
    f"{FLOOR}.material.friction_std": (
        material(floor, friction=0.5, friction_std=0.2),
        "rollouts",
        material(floor, friction=0.5),
    ),
    f"{FLOOR}.material.restitution": (material(floor, restitution=0.9), TWIST),
    f"{FLOOR}.material.restitution_std": (
        material(floor, restitution=0.5, restitution_std=0.2),
        "rollouts",
        material(floor, restitution=0.5),
    ),
    "scene.common_pose_std": (
        set_to(scene, common_pose_std=np.array([0.0, 0.02, 0.0, 0.0, 0.0, 0.0])),
        START,
    ),
    "scene.common_pose_origin": (
        set_to(scene, common_pose_origin=Point(x=2.0)),
        START,
        set_to(scene, common_pose_std=np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.02])),
    ),
    "scene.joint_covariance.object_ids": (
        lambda request: setattr(request.scene.joint_covariance, "object_ids", ["can", "brick"]),
        START,
        lambda request: (with_joint(request), request.scene.joint_covariance.data.__setitem__(0, 9e-6)),
    ),
    "scene.joint_covariance.data": (
        lambda request: setattr(request.scene.joint_covariance, "data", packed(4e-6 * np.eye(24))),
        START,
        with_joint,
    ),
    "horizon": (set_to(itself, horizon=Duration(nanosec=300_000_000)), "time_reached"),
    "trajectory_period": (
        set_to(itself, trajectory_period=Duration(nanosec=100_000_000)),
        "objects[].states[].time_from_start",
    ),
    "times": (set_to(itself, times=[Duration(nanosec=123_456_789)]), "objects[].states[].time_from_start"),
    "physics.preset": (physics(preset="paper"), "physics.integrator"),
    "physics.integrator": (
        physics(integrator="explicit"),
        "physics.integrator",
        physics(friction=0.0, restitution=1.0),
    ),
    "physics.dt": (physics(dt=0.005), POSE),
    "physics.stiffness": (physics(stiffness=1e9), POSE, explicit),
    "physics.damping": (physics(damping=0.5), POSE),
    "physics.gravity": (physics(gravity=(0.1, 0.0, -9.0)), POSE),
    "physics.friction": (physics(friction=0.9), POSE),
    "physics.restitution": (physics(restitution=0.7), POSE),
    "physics.exact": (physics(exact=True), "physics.friction_std"),
    "physics.impact_friction_speed": (physics(impact_friction_speed=1.0), "physics.impact_friction_speed"),
    "physics.gyroscopic": (physics(gyroscopic=False), POSE),
    "physics.sleep": (physics(sleep=False), "physics.sleep"),
    "physics.overlap": (physics(overlap="keep"), "physics.overlap"),
    "physics.stiffness_std": (
        physics(stiffness_std=1e8),
        "physics.stiffness_std",
        lambda request: with_physics(explicit(request), stiffness=1e9),
    ),
    "physics.friction_std": (physics(friction_std=0.1), "physics.friction_std"),
    "physics.restitution_std": (physics(restitution_std=0.1), "physics.restitution_std"),
    "physics.gravity_direction_std": (physics(gravity_direction_std=0.02), "physics.gravity_direction_std"),
    "propagator": (set_to(itself, propagator="monte_carlo"), "propagator"),
    "propagator_options": (
        set_to(itself, propagator_options=[KeyValue(key="points", value="full")]),
        "rollouts",
    ),
    "samples": (set_to(itself, samples=30), "rollouts", set_to(itself, propagator="monte_carlo")),
    "seed": (set_to(itself, seed=6), "seed", set_to(itself, propagator="monte_carlo", samples=20)),
    "max_computation_time": (
        set_to(itself, max_computation_time=Duration(nanosec=100_000_000)),
        "time_reached",
        set_to(itself, propagator="monte_carlo", samples=5000),
    ),
    "wanted_position_error": (set_to(itself, wanted_position_error=1e-9), "rollouts", anytime),
    "wanted_rotation_error": (set_to(itself, wanted_rotation_error=1e-9), "rollouts", anytime),
    "wanted_probability_error": (set_to(itself, wanted_probability_error=0.2), "rollouts", asked),
    "time_budget": (set_to(itself, time_budget=Duration(nanosec=1)), "rollouts", going_on),
    "skip_invalid_objects": (
        set_to(itself, skip_invalid_objects=True),
        "skipped",
        lambda request: request.scene.objects.append(moving_object("x", "teapot", (5.0, 0.0, 0.0))),
    ),
    "regions[].id": (set_to(region, id="shelf"), "events[].other", with_region),
    "regions[].pose": (
        lambda request: setattr(region(request).pose.position, "x", 9.0),
        "events[].probability",
        with_region,
    ),
    "regions[].size": (
        set_to(region, size=Vector3(x=0.001, y=0.001, z=0.001)),
        "events[].probability",
        with_region,
    ),
    "return_probabilities": (set_to(itself, return_probabilities=False), "events[].object"),
    f"{FLOOR}.surface_tilt_std": (set_to(floor, surface_tilt_std=0.02), "rollouts"),
    "physics.impact_direction_std": (physics(impact_direction_std=0.05), POSE, sampled),
    "physics.impact_point_std": (physics(impact_point_std=0.003), POSE, sampled),
    "physics.impact_friction_std": (physics(impact_friction_std=0.2), POSE, sampled),
    "return_covariance": (set_to(itself, return_covariance=True), "objects[].states[].covariance"),
    "return_joint_covariance": (set_to(itself, return_joint_covariance=True), "joint_covariances[].data"),
    "return_modes": (set_to(itself, return_modes=True), "objects[].states[].mode_weights"),
    "return_samples": (set_to(itself, return_samples=3), "objects[].states[].pose_samples"),
}


def test_every_field_of_a_request_is_accounted_for():
    """Flags of optional numbers are set with their numbers."""
    found = set(paths(PredictionRequest))
    assert {path for path in found if not is_flag(path)} == {
        path for path in EFFECTS if not is_flag(path)
    } | IGNORED | OF_THE_NODE | UNSET_IN_PAIRS


def is_flag(path):
    return path.rpartition(".")[2].startswith("has_")


@pytest.fixture(scope="module")
def plain(node, client):
    """The answer to the request that all but a few changes begin from."""
    response = client.predict(base())
    assert_answered(response)
    return response


@pytest.mark.parametrize("path", EFFECTS)
def test_a_field_of_a_request_has_its_effect(predict, plain, path):
    change, where, *prepare = EFFECTS[path]
    request, before = base(), plain
    for prepared in prepare:
        prepared(request)
        before = predict(request)
    change(request)
    after = predict(request)
    if path not in {"max_computation_time", "time_budget"}:  # on a slow machine nothing is done in time
        assert after.result.error_code == ErrorCode.NONE, after.result.error_msg
    assert not same(values_at(before.prediction, where), values_at(after.prediction, where))


def same(one, other):
    """Whether values of a field are the same, to round-off."""
    one, other = ([number for value in values for number in flat(value)] for values in (one, other))
    if len(one) != len(other):
        return False
    if all(isinstance(value, float) for value in (*one, *other)):
        return np.allclose(one, other, rtol=1e-7, atol=1e-10)
    return one == other


def flat(value):
    """Numbers and texts of a value; a Duration as one number."""
    if hasattr(value, "get_fields_and_field_types"):
        return [part for name in value.get_fields_and_field_types() for part in flat(getattr(value, name))]
    if isinstance(value, (str, bool)):
        return [value]
    if np.ndim(value) or isinstance(value, (list, tuple)):
        return [part for entry in value for part in flat(entry)]
    return [float(value)]


#: Fields of an answer that stay empty or zero in this version.
NOT_FILLED = {"physics.preset", "events[].negated", *(f"pairs[].material.{name}" for name in UNSET_OF_A_PAIR)}


def rich_requests():
    """Requests whose answers together fill all fields."""
    asked = base()
    with_region(asked)
    place = asked.scene.objects[0].pose.pose.position  # beside the can, and high enough to fall
    place.x, place.z = 0.3, 0.35
    with_physics(asked, friction_std=0.1, restitution_std=0.05, damping=0.1, gravity_direction_std=0.01)
    with_physics(asked, impact_direction_std=0.01, impact_point_std=1e-3, impact_friction_std=0.1)
    asked.scene.header.stamp.sec = 3
    asked.scene.objects[0].material = material_of(torsional_friction=0.004)
    asked.scene.objects.append(moving_object("x", "teapot", (5.0, 0.0, 0.0)))
    asked.scene.objects[1].kind = ObjectState.FIXED
    asked.trajectory_period, asked.horizon = Duration(nanosec=200_000_000), Duration(sec=1)
    asked.skip_invalid_objects = asked.return_covariance = asked.return_joint_covariance = True
    asked.return_modes, asked.return_samples = True, 2
    overlapping = base()
    overlapping.scene.objects[0].pose.pose.position.z = -0.03
    overlapping.scene.objects[1].pose.pose.position.z = -0.02
    overlapping.scene.objects[1].kind = ObjectState.FIXED
    for message in overlapping.scene.objects:
        message.pose.covariance = diagonal(*[1e-3] * 6)
    sunk = base()  # deeper in the floor than its belief says, so that it is moved out
    sunk.scene.objects.pop()
    sunk.scene.objects[0].pose.pose.position.z = -0.013
    sunk.scene.objects[0].pose.covariance = diagonal(*[2e-3] * 6)
    sunk.propagator, sunk.samples = "cloud", 50
    stiff = with_physics(explicit(base()), stiffness=1e9, stiffness_std=1e7)
    return asked, overlapping, sunk, stiff


def test_every_field_of_an_answer_is_filled(predict):
    answers = [predict(request) for request in rich_requests()]
    for answer in answers:
        assert_answered(answer)
    empty = {
        path
        for path in paths(Prediction)
        if not any(any(flat(value)) for answer in answers for value in values_at(answer.prediction, path))
    }
    assert empty == NOT_FILLED


def test_an_answer_s_physics_may_be_sent_back(predict, plain):
    request = base()
    request.physics = plain.prediction.physics
    again = predict(request)
    assert_answered(again)
    assert again.prediction.physics == plain.prediction.physics
    states = [answer.prediction.objects[0].states[-1] for answer in (again, plain)]
    assert same(*([state.pose] for state in states))
