"""Every field of a request has its effect, and every field of an answer is filled, over real DDS."""

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import KeyValue
from geometry_msgs.msg import Point, Transform, Vector3, Wrench
from message_fields import paths, values_at
from scenes import (
    assert_answered,
    diagonal,
    explicit,
    material_of,
    moving_object,
    packed,
    request_of,
    tetrahedron,
    with_physics,
)
from shape_msgs.msg import Plane, SolidPrimitive
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from unc_physics.checks.errors import ErrorCode
from unc_physics.ros import make_message
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


def put(message, path, value):
    """Set a field by its path, in which ``[]`` is the first entry, as `make_message` does."""
    first, _, rest = path.partition(".")
    name = first.removesuffix("[]")
    if rest:
        part = getattr(message, name)
        put(part[0] if first.endswith("[]") else part, rest, value)
        return
    made = make_message(type(message), **{name: value})
    for own in (name, f"has_{name}"):
        if hasattr(made, own):
            setattr(message, own, getattr(made, own))


def apply(change, request):
    """Change a request by a function, or set fields by their paths."""
    if callable(change):
        change(request)
    else:
        for path, value in change.items():
            put(request, path, value)


def first(request):
    return request.scene.objects[0]


def floor(request):
    return request.scene.environment.elements[0]


def with_region(request):
    request.regions = [make_message(BoxRegion, id="bin", size=(1, 1, 1))]
    request.propagator, request.samples = "monte_carlo", 300


def joint(*variances):
    """The joint covariance of both objects; its first variances."""
    C = 1e-6 * np.eye(24)
    C[range(len(variances)), range(len(variances))] = variances
    return JointCovariance(object_ids=["brick", "can"], data=packed(C))


def as_box(request):
    floor(request).plane = Plane()
    floor(request).primitive = SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[2.0, 2.0, 0.1])


def as_primitive(request):
    first(request).model = ""
    first(request).primitive = SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[0.2, 0.1, 0.06])


def as_mesh_of(find):
    """A change that gives what ``find`` finds the shape of a low pyramid, which is an obstacle far away."""

    def change(request):
        message = find(request)
        if isinstance(message, ObjectState):
            message.model = ""
        else:
            message.plane, message.pose.position.x = Plane(), 9.0
        message.mesh = tetrahedron(0.05)

    return change


def at_rest(request):
    first(request).twist.twist.linear.x = first(request).twist.twist.angular.z = 0.0
    first(request).pose.pose.position.z = 0.001
    request.scene.objects.pop()


def rolls(request):
    """A ball rolls on the floor."""
    first(request).model, first(request).pose.pose.position.z = "", 0.05
    first(request).primitive = SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[0.05])
    first(request).twist.twist.angular.y, first(request).twist.twist.angular.z = 8.0, 0.0
    request.scene.objects.pop()


def anytime(request, error="1000"):
    """Rollouts until the error of means is so small, 64 at most, but for other wishes."""
    options = {"runs": "64", "samples": "50", "error": error, "spread_error": "0", "probability_error": "0"}
    request.propagator = "auto"
    request.propagator_options = [KeyValue(key=key, value=value) for key, value in options.items()]


def asked(request):
    anytime(request)
    request.propagator_options = request.propagator_options[:-1]  # probabilities to the usual error


def path_from(*position):
    """The path of the can, down from there."""
    points = [
        MultiDOFJointTrajectoryPoint(
            transforms=[Transform(translation=Vector3(x=x, y=y, z=z))], time_from_start=Duration(sec=sec)
        )
        for sec, (x, y, z) in enumerate([position, (0.0, 0.0, 0.2)])
    ]
    return MultiDOFJointTrajectory(points=points)


def prescribed(request):
    path = path_from(0.0, 0.0, 0.3)
    request.actions = [Action(type=Action.TRAJECTORY, object="can", trajectory=path)]


def held(request):
    """The brick is held by the can until it is let go; a post stands beside."""
    prescribed(request)
    attached = make_message(Action, type=Action.ATTACHMENT, object="brick", attached_to="can", duration=0.2)
    request.actions.insert(0, attached)
    request.scene.objects.append(moving_object("post", "can", (2.0, 0.0, 0.0), spheres=40))
    request.scene.objects[-1].kind = ObjectState.FIXED


def pushed(request):
    force = Wrench(force=Vector3(x=3.0))
    action = make_message(Action, type=Action.WRENCH, object="brick", wrench=force, duration=0.1)
    request.actions = [action]


def pair_of(name):
    """A change that makes the pair of an object and the floor slippery."""

    def change(request):
        slippery = material_of(friction=0.02)
        request.scene.pairs = [MaterialPair(object_a=name, object_b="floor", material=slippery)]

    return change


SAMPLED = {"propagator": "monte_carlo", "samples": 100}
TURNED = (0, 0, 0, 0.1, 0, 0, float(np.sqrt(0.99)))
#: For the fields of a material: a value, what of the answer changes with it, and what comes before.
OF_MATERIALS = {
    "friction": (0.05, POSE),
    "restitution": (0.9, TWIST),
    "torsional_friction": (0.02, POSE),
    "rolling_friction": (0.02, POSE, rolls),
}
#: For each field of a request: its value or another change, what of the answer changes with it, and what
#: comes before.
EFFECTS = {
    "scene.header": ({"scene.header.stamp.sec": 7}, "header"),
    f"{OBJECT}.id": ("block", "objects[].id"),
    f"{OBJECT}.kind": (ObjectState.FIXED, "objects[].kind"),
    f"{OBJECT}.model": ("salt_box", "objects[].model"),
    f"{OBJECT}.scale": (1.2, POSE),
    f"{OBJECT}.spheres": (20, POSE, explicit),
    f"{OBJECT}.mass": (5.0, POSE),
    f"{OBJECT}.mass_std": (0.3, "rollouts"),
    f"{OBJECT}.center_of_mass_std": ((0.01, 0, 0), POSE),
    f"{OBJECT}.inertia": (1e-2 * np.eye(3), POSE),
    f"{OBJECT}.drag": (1.0, POSE),
    f"{OBJECT}.pose": ({f"{OBJECT}.pose.pose.position.y": 0.3}, START),
    f"{OBJECT}.twist": ({f"{OBJECT}.twist.twist.linear.y": 0.3}, POSE),
    f"{OBJECT}.covariance": (4e-6 * np.eye(12), START),
    f"{OBJECT}.at_rest": (True, START, at_rest),
    f"{OBJECT}.primitive": (as_primitive, "objects[].model"),
    f"{OBJECT}.mesh": (as_mesh_of(first), "objects[].model"),
    f"{FLOOR}.id": ("table", "events[].other"),
    f"{FLOOR}.pose": (TURNED, POSE),
    f"{FLOOR}.plane": ((0, 0, 1, 0.02), POSE),
    f"{FLOOR}.primitive": (as_box, POSE),
    f"{FLOOR}.mesh": (as_mesh_of(floor), "objects[].model"),
    f"{FLOOR}.surface_velocity": ((0, 0.3, 0, 0, 0, 0), POSE),
    f"{FLOOR}.surface_tilt_std": (0.02, "rollouts"),
    **{f"{one}.material.name": ("rubber", POSE) for one in (OBJECT, FLOOR)},
    **{f"{one}.material.{name}": row for one in (OBJECT, FLOOR) for name, row in OF_MATERIALS.items()},
    **{
        f"{one}.material.{name}_std": (0.2, "rollouts", {f"{one}.material.{name}": 0.5})
        for one in (OBJECT, FLOOR)
        for name in ("friction", "restitution")
    },
    "scene.pairs[].object_a": ("can", POSE, pair_of("brick")),
    "scene.pairs[].object_b": ("brick", POSE, pair_of("can")),
    **{
        f"scene.pairs[].material.{name}": (
            10.0 * value if name == "friction" else value,
            POSE,
            *prepare,
            pair_of("brick"),
        )
        for name, (value, _, *prepare) in OF_MATERIALS.items()
    },
    "actions[].type": (pushed, POSE),
    "actions[].object": ("can", POSE, pushed),
    "actions[].trajectory": (path_from(0.1, 0.0, 0.3), POSE, prescribed),
    "actions[].trajectory_std": ((0.01, 0, 0, 0, 0, 0.1), "rollouts", prescribed),
    "actions[].attached_to": ("post", POSE, held),
    "actions[].start": (0.1, POSE, held),
    "actions[].duration": (0.1, POSE, held),
    "actions[].release_std": (0.1, "rollouts", held),
    "actions[].wrench": ({"actions[].wrench.torque.z": 0.3}, POSE, pushed),
    "actions[].body_axes": (True, POSE, pushed),
    "scene.common_pose_std": ((0, 0.02, 0, 0, 0, 0), START),
    "scene.common_pose_origin": (Point(x=2.0), START, {"scene.common_pose_std": (0, 0, 0, 0, 0, 0.02)}),
    "scene.joint_covariance.object_ids": (["can", "brick"], START, {"scene.joint_covariance": joint(9e-6)}),
    "scene.joint_covariance.data": (4e-6 * np.eye(24), START, {"scene.joint_covariance": joint()}),
    "horizon": (0.3, "time_reached"),
    "trajectory_period": (0.1, "objects[].states[].time_from_start"),
    "times": ([0.123456789], "objects[].states[].time_from_start"),
    "physics.preset": ("paper", "physics.integrator"),
    "physics.integrator": (
        "explicit",
        "physics.integrator",
        {"physics.friction": 0.0, "physics.restitution": 1.0},
    ),
    "physics.dt": (0.005, POSE),
    "physics.stiffness": (1e9, POSE, explicit),
    "physics.damping": (0.5, POSE),
    "physics.gravity": ((0.1, 0, -9), POSE),
    "physics.friction": (0.9, POSE),
    "physics.restitution": (0.7, POSE),
    "physics.rolling_friction": (0.02, POSE, rolls),
    "physics.exact": (True, "physics.friction_std"),
    "physics.gyroscopic": (False, POSE),
    "physics.stiffness_std": (
        1e8,
        "physics.stiffness_std",
        lambda request: with_physics(explicit(request), stiffness=1e9),
    ),
    **{
        f"physics.{name}": (value, f"physics.{name}")
        for name, value in {
            "impact_friction_speed": 1.0,
            "sleep": False,
            "overlap": "keep",
            "friction_std": 0.1,
            "restitution_std": 0.1,
            "gravity_direction_std": 0.02,
        }.items()
    },
    "physics.impact_direction_std": (0.05, POSE, SAMPLED),
    "physics.impact_point_std": (0.003, POSE, SAMPLED),
    "physics.impact_friction_std": (0.2, POSE, SAMPLED),
    "propagator": ("monte_carlo", "propagator"),
    "propagator_options": ([KeyValue(key="points", value="full")], "rollouts"),
    "samples": (30, "rollouts", SAMPLED),
    "seed": (6, "seed", SAMPLED),
    "max_computation_time": (0.1, "time_reached", SAMPLED | {"samples": 5000}),
    "wanted_position_error": (1e-9, "rollouts", anytime),
    "wanted_rotation_error": (1e-9, "rollouts", anytime),
    "wanted_probability_error": (0.2, "rollouts", asked),
    "time_budget": (1e-9, "rollouts", lambda request: anytime(request, "1e-9")),
    "skip_invalid_objects": (
        True,
        "skipped",
        lambda request: request.scene.objects.append(moving_object("x", "teapot", (5.0, 0.0, 0.0))),
    ),
    "regions[].id": ("shelf", "events[].other", with_region),
    "regions[].pose": ((9, 0, 0), "events[].probability", with_region),
    "regions[].size": ((0.001, 0.001, 0.001), "events[].probability", with_region),
    "return_probabilities": (False, "events[].object"),
    "return_covariance": (True, "objects[].states[].covariance"),
    "return_joint_covariance": (True, "joint_covariances[].data"),
    "return_modes": (True, "objects[].states[].mode_weights"),
    "return_samples": (3, "objects[].states[].pose_samples"),
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
    value, where, *prepare = EFFECTS[path]
    request, before = base(), plain
    for change in prepare:
        apply(change, request)
        before = predict(request)
    apply(value if callable(value) or isinstance(value, dict) else {path: value}, request)
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
