"""Bad requests get each their error code, and the node answers the next good one."""

import shutil

import numpy as np
import pytest
from diagnostic_msgs.msg import KeyValue
from geometry_msgs.msg import Pose, Quaternion
from running import NodeProcess
from scenes import assert_answered, assert_same, diagonal, explicit, good_request, moving_object, request_of
from shape_msgs.msg import Plane, SolidPrimitive

from unc_physics.checks.errors import ErrorCode
from unc_physics.geometry.library import find_model
from unc_physics_msgs.action import PredictLong
from unc_physics_msgs.msg import BoxRegion
from unc_physics_msgs.srv import LoadModel, Predict, PredictCandidates

NAN, INF = float("nan"), float("inf")


def changed(path, value):
    """A good request with one field of its second object, or of itself, replaced."""
    request = good_request()
    message = request.objects[1] if path.startswith("object.") else request
    *parents, last = path.removeprefix("object.").split(".")
    for name in parents:
        message = getattr(message, name)
    setattr(message, last, value)
    return request


def with_option(field, key, value, without=None, **others):
    request = good_request(**others)
    if without is not None:
        request.scene_options.append(KeyValue(key=without, value="null"))
    getattr(request, field).append(KeyValue(key=key, value=value))
    return request


def lopsided():
    covariance = diagonal(*[0.1] * 6)
    covariance[3] = 0.001
    return covariance


def indefinite():
    covariance = np.eye(6)
    covariance[0, 1] = covariance[1, 0] = 1.1
    return covariance.ravel()


def with_floor(coef):
    request = good_request()
    request.environment.planes.append(Plane(coef=coef))
    return request


def with_box(dimensions, kind=SolidPrimitive.BOX, poses=None, ids=()):
    request = good_request()
    request.environment.primitives.append(SolidPrimitive(type=kind, dimensions=dimensions))
    request.environment.primitive_poses = [Pose()] if poses is None else poses
    request.environment.ids = list(ids)
    return request


def with_regions(*ids):
    request = good_request()
    for name in ids:
        region = BoxRegion(id=name)
        region.size.x = region.size.y = region.size.z = 1.0
        request.regions.append(region)
    return request


def at_rest(spin=0.0, fixed=False):
    """A request in whose world there is gravity, and an object at rest; one that moves, unless it spins."""
    request = good_request()
    request.scene_options.clear()
    standing = request.objects[1]
    standing.at_rest, standing.fixed, standing.twist.twist.angular.x = True, fixed, spin
    if spin:
        standing.twist.twist.linear.x = 0.0
    return request


def duplicate():
    return request_of(moving_object("twin"), moving_object("twin"))


BAD = {
    "no objects": (request_of(), "NO_OBJECTS", "objects"),
    "duplicate id": (duplicate(), "DUPLICATE_ID", "objects[1].id"),
    "empty id": (changed("object.id", ""), "INVALID_REQUEST", "objects[1].id"),
    "unknown model": (changed("object.model", "Döner 🥙"), "UNKNOWN_MODEL", "objects[1].model"),
    "model by path": (changed("object.model", "/tmp/model.npz"), "UNKNOWN_MODEL", "objects[1].model"),
    "too few spheres": (changed("object.spheres", 4_000_000_000), "INVALID_MODEL", "objects[1].spheres"),
    "negative scale": (changed("object.scale", -1.0), "INVALID_MODEL", "objects[1].scale"),
    "unknown propagator": (changed("propagator", "crystal_ball"), "UNKNOWN_PROPAGATOR", "propagator"),
    "NaN position": (
        changed("object.pose.pose.position.x", NAN),
        "NOT_FINITE",
        "objects[1].pose.pose.position",
    ),
    "infinite velocity": (
        changed("object.twist.twist.linear.y", INF),
        "NOT_FINITE",
        "objects[1].twist.twist.linear",
    ),
    "NaN spin": (
        changed("object.twist.twist.angular.z", NAN),
        "NOT_FINITE",
        "objects[1].twist.twist.angular",
    ),
    "NaN orientation": (changed("object.pose.pose.orientation.w", NAN), "NOT_FINITE", "orientation"),
    "NaN covariance": (
        changed("object.pose.covariance", np.full(36, NAN)),
        "NOT_FINITE",
        "objects[1].pose.covariance",
    ),
    "NaN mass": (changed("object.mass", NAN), "NOT_FINITE", "objects[1].mass"),
    "NaN horizon": (changed("horizon", NAN), "NOT_FINITE", "horizon"),
    "NaN scale": (changed("object.scale", NAN), "NOT_FINITE", "objects[1].scale"),
    "NaN period": (changed("trajectory_period", NAN), "NOT_FINITE", "trajectory_period"),
    "NaN time limit": (changed("max_computation_time", NAN), "NOT_FINITE", "max_computation_time"),
    "quaternion of zeros": (
        changed("object.pose.pose.orientation.w", 0.0),
        "INVALID_ORIENTATION",
        "orientation",
    ),
    "long quaternion": (changed("object.pose.pose.orientation.x", 0.1), "INVALID_ORIENTATION", "orientation"),
    "asymmetric": (
        changed("object.pose.covariance", lopsided()),
        "INVALID_COVARIANCE",
        "objects[1].pose.covariance",
    ),
    "indefinite": (
        changed("object.twist.covariance", indefinite()),
        "INVALID_COVARIANCE",
        "objects[1].twist.covariance",
    ),
    "negative variance": (
        changed("object.pose.covariance", -2.0 * diagonal(*[1.0] * 6)),
        "INVALID_COVARIANCE",
        "variance",
    ),
    "zero horizon": (changed("horizon", 0.0), "INVALID_HORIZON", "horizon"),
    "negative horizon": (changed("horizon", -1.0), "INVALID_HORIZON", "horizon"),
    "horizon below a step": (changed("horizon", 1e-9), "INVALID_HORIZON", "horizon"),
    "negative period": (changed("trajectory_period", -1.0), "INVALID_HORIZON", "trajectory_period"),
    "period below a step": (changed("trajectory_period", 0.002), "INVALID_HORIZON", "trajectory_period"),
    "zero mass": (changed("object.mass", 0.0), "INVALID_MASS", "objects[1].mass"),
    "negative mass": (changed("object.mass", -1.0), "INVALID_MASS", "objects[1].mass"),
    "horizon over the limit": (changed("horizon", 1e5), "LIMIT_EXCEEDED", "horizon"),
    "samples over the limit": (changed("samples", 1_000_000), "LIMIT_EXCEEDED", "samples"),
    "samples over the limit, by option": (
        with_option("propagator_options", "samples", "1000000", propagator="monte_carlo"),
        "LIMIT_EXCEEDED",
        "samples",
    ),
    "returned samples over the limit": (
        changed("return_samples", 4_000_000_000),
        "LIMIT_EXCEEDED",
        "return_samples",
    ),
    "states over the limit": (changed("trajectory_period", 1e-6), "LIMIT_EXCEEDED", "trajectory_period"),
    "steps over the limit": (with_option("scene_options", "dt", "1e-9"), "LIMIT_EXCEEDED", "horizon"),
    "too many objects": (
        request_of(*[moving_object(str(k)) for k in range(101)]),
        "LIMIT_EXCEEDED",
        "objects",
    ),
    "too large an answer": (
        request_of(*[moving_object(str(k)) for k in range(100)], return_samples=1000, trajectory_period=0.01),
        "LIMIT_EXCEEDED",
        "bytes",
    ),
    "negative time limit": (changed("max_computation_time", -1.0), "INVALID_REQUEST", "max_computation_time"),
    "unknown option": (with_option("propagator_options", "colour", "red"), "INVALID_OPTION", "colour"),
    "wrong option": (with_option("propagator_options", "points", "many"), "INVALID_OPTION", "points"),
    "unknown scene option": (with_option("scene_options", "weather", "fine"), "INVALID_OPTION", "weather"),
    "wrong scene option": (
        with_option("scene_options", "stiffness", "[1, 2]"),
        "INVALID_OPTION",
        "stiffness",
    ),
    "scene option that is no YAML": (
        with_option("scene_options", "stiffness", "{"),
        "INVALID_OPTION",
        "stiffness",
    ),
    "scene option twice": (
        with_option("scene_options", "gravity", "[0, 0, 1]"),
        "INVALID_OPTION",
        "scene_options[1].key",
    ),
    "zero time step": (with_option("scene_options", "dt", "0"), "INVALID_HORIZON", "dt"),
    "NaN stiffness": (with_option("scene_options", "stiffness", ".nan"), "NOT_FINITE", "stiffness"),
    "unknown frame": (changed("header.frame_id", "camera"), "UNKNOWN_FRAME", "header.frame_id"),
    "negative deviation of the mass": (
        changed("object.mass_std", -0.1),
        "INVALID_COVARIANCE",
        "objects[1].mass_std",
    ),
    "NaN deviation of the centre of mass": (
        changed("object.center_of_mass_std.z", NAN),
        "NOT_FINITE",
        "objects[1].center_of_mass_std.z",
    ),
    "negative shared error": (
        changed("common_pose_std", [0.0] * 5 + [-0.1]),
        "INVALID_COVARIANCE",
        "common_pose_std[5]",
    ),
    "NaN shared error": (changed("common_pose_std", [NAN] + [0.0] * 5), "NOT_FINITE", "common_pose_std"),
    "NaN origin of a shared error": (
        changed("common_pose_origin.z", NAN),
        "NOT_FINITE",
        "common_pose_origin",
    ),
    "at rest without gravity": (
        changed("object.at_rest", True),
        "INVALID_OPTION",
        "objects[1].at_rest needs",
    ),
    "at rest and moving": (at_rest(), "INVALID_REQUEST", "linear_velocity of body 'right'"),
    "at rest and turning": (at_rest(spin=0.1), "INVALID_REQUEST", "angular_velocity of body 'right'"),
    "at rest and fixed": (at_rest(fixed=True), "INVALID_REQUEST", "objects[1].at_rest"),
    "no way with overlap": (with_option("scene_options", "overlap", "push"), "INVALID_OPTION", "overlap"),
    "overlap rejected by sigma points": (
        with_option("scene_options", "overlap", "reject"),
        "NOT_SUPPORTED",
        "overlap",
    ),
    "overlap projected with the explicit step": (
        explicit(with_option("scene_options", "overlap", "project")),
        "INVALID_OPTION",
        "scene_options 'overlap'",
    ),
    "negative friction": (with_option("scene_options", "friction", "-0.5"), "INVALID_OPTION", "friction"),
    "restitution above 1": (
        with_option("scene_options", "restitution", "1.5"),
        "INVALID_OPTION",
        "restitution",
    ),
    "no integrator": (with_option("scene_options", "integrator", "magic"), "INVALID_OPTION", "integrator"),
    "no text for an integrator": (
        with_option("scene_options", "integrator", "[[1]]"),
        "INVALID_OPTION",
        "integrator",
    ),
    "no flag": (with_option("scene_options", "gyroscopic", "[[1]]"), "INVALID_OPTION", "gyroscopic"),
    "an integrator that is no more": (
        with_option("scene_options", "integrator", "robust"),
        "INVALID_OPTION",
        "'implicit'",
    ),
    "friction with the explicit step": (
        with_option("scene_options", "integrator", "explicit"),
        "INVALID_OPTION",
        "scene_options 'friction' needs 'integrator: implicit'",
    ),
    "no preset": (with_option("scene_options", "physics", "lunar"), "INVALID_OPTION", "physics"),
    "uncertain friction without friction": (
        with_option("scene_options", "friction_std", "0.1", without="friction"),
        "INVALID_OPTION",
        "friction_std",
    ),
    "friction more uncertain than it is": (
        with_option("scene_options", "friction_std", "0.9"),
        "INVALID_OPTION",
        "friction_std",
    ),
    "a propagator for another step": (good_request(propagator="surrogate"), "NOT_SUPPORTED", "implicit"),
    "plane without normal": (
        with_floor([0.0, 0.0, 0.0, 1.0]),
        "INVALID_ENVIRONMENT",
        "environment.planes[0].coef",
    ),
    "NaN plane": (with_floor([0.0, 0.0, NAN, 1.0]), "NOT_FINITE", "environment.planes[0].coef"),
    "box of no height": (
        with_box([1.0, 1.0, 0.0]),
        "INVALID_ENVIRONMENT",
        "environment.primitives[0].dimensions[2]",
    ),
    "box of two lengths": (
        with_box([1.0, 1.0]),
        "INVALID_ENVIRONMENT",
        "environment.primitives[0].dimensions",
    ),
    "infinite box": (with_box([1.0, INF, 1.0]), "NOT_FINITE", "environment.primitives[0].dimensions"),
    "box without pose": (with_box([1.0] * 3, poses=[]), "INVALID_ENVIRONMENT", "environment.primitive_poses"),
    "box without orientation": (
        with_box([1.0] * 3, poses=[Pose(orientation=Quaternion(w=0.0))]),
        "INVALID_ORIENTATION",
        "environment.primitive_poses[0].orientation",
    ),
    "cone": (
        with_box([1.0, 0.5], kind=SolidPrimitive.CONE),
        "NOT_SUPPORTED",
        "environment.primitives[0].type",
    ),
    "prism": (with_box([1.0], kind=SolidPrimitive.PRISM), "NOT_SUPPORTED", "environment.primitives[0].type"),
    "sphere of three lengths": (
        with_box([1.0] * 3, kind=SolidPrimitive.SPHERE),
        "INVALID_ENVIRONMENT",
        "environment.primitives[0].dimensions",
    ),
    "sphere of no radius": (
        with_box([0.0], kind=SolidPrimitive.SPHERE),
        "INVALID_ENVIRONMENT",
        "environment.primitives[0].dimensions[0]",
    ),
    "cylinder of one length": (
        with_box([1.0], kind=SolidPrimitive.CYLINDER),
        "INVALID_ENVIRONMENT",
        "environment.primitives[0].dimensions",
    ),
    "cylinder of negative radius": (
        with_box([1.0, -0.5], kind=SolidPrimitive.CYLINDER),
        "INVALID_ENVIRONMENT",
        "environment.primitives[0].dimensions[1]",
    ),
    "infinite cylinder": (
        with_box([INF, 0.5], kind=SolidPrimitive.CYLINDER),
        "NOT_FINITE",
        "environment.primitives[0].dimensions",
    ),
    "primitive of no kind": (
        with_box([1.0] * 3, kind=77),
        "INVALID_ENVIRONMENT",
        "environment.primitives[0].type",
    ),
    "too few names": (with_box([1.0] * 3, ids=["a", "b"]), "INVALID_ENVIRONMENT", "environment.ids"),
    "a name of all": (with_box([1.0] * 3, ids=["environment"]), "INVALID_ENVIRONMENT", "environment.ids[0]"),
    "an object's name for a box": (with_box([1.0] * 3, ids=["left"]), "DUPLICATE_ID", "environment.ids[0]"),
    "a region without name": (with_regions(""), "INVALID_ENVIRONMENT", "regions[0].id"),
    "too many regions": (with_regions(*map(str, range(101))), "LIMIT_EXCEEDED", "regions"),
    "two regions of one id": (with_regions("bin", "bin"), "DUPLICATE_ID", "regions[1].id"),
    "joint covariance without correlations": (
        explicit(good_request(propagator="surrogate", return_joint_covariance=True)),
        "NOT_SUPPORTED",
        "return_joint_covariance",
    ),
    "unreadable model": (changed("object.model", "text"), "INVALID_MODEL", "objects[1].model"),
    "inconsistent model": (changed("object.model", "contradiction"), "INVALID_MODEL", "objects[1].model"),
    "diverging": (
        explicit(with_option("scene_options", "stiffness", "1e300", horizon=1.0)),
        "DIVERGED",
        "diverged",
    ),
}


@pytest.fixture(scope="module")
def models_dir(tmp_path_factory):
    """The shipped models, and two files that are none."""
    folder = tmp_path_factory.mktemp("models")
    for name in ("bunny", "armadillo"):
        shutil.copy(find_model(name), folder)
    (folder / "text.npz").write_text("This is no archive.")
    np.savez(folder / "contradiction.npz", centers=np.zeros((3, 3)), radii=np.ones(2))
    return folder


@pytest.fixture(scope="module")
def node(models_dir):
    with NodeProcess(
        "-p", "zero_covariance:=exact", "-p", f"models_dir:={models_dir}", name="strict"
    ) as process:
        yield process


@pytest.fixture(scope="module")
def predict(node, client):
    return lambda request: client.predict(request, node="strict")


@pytest.fixture(scope="module")
def answer_before(predict):
    response = predict(good_request(seed=1))
    assert_answered(response)
    return response


@pytest.mark.parametrize("case", BAD)
def test_a_bad_request_gets_its_code_and_the_next_good_one_its_answer(predict, answer_before, case):
    request, code, named = BAD[case]
    response = predict(request)
    assert (ErrorCode(response.error_code).name, named in response.error_msg) == (code, True), (
        response.error_msg
    )
    assert not response.objects
    assert "\n" not in response.error_msg
    assert_same(predict(good_request(seed=1)), answer_before)


def test_texts_of_any_script_are_ids(predict):
    names = ["Häschen", "兎", "🐰 \t", "a" * 10_000]
    objects = [moving_object(name, position=(float(k), 0.0, 0.0)) for k, name in enumerate(names)]
    response = predict(request_of(*objects))
    assert_answered(response)
    assert [predicted.id for predicted in response.objects] == names


@pytest.mark.parametrize(
    "interface", [Predict.Response, PredictCandidates.Response, LoadModel.Response, PredictLong.Result]
)
def test_error_constants_are_those_of_the_core(interface):
    codes = {name: getattr(interface, name) for name in dir(interface) if name.isupper()}
    assert {name: codes.get(name) for name in ErrorCode.__members__} == {
        code.name: code.value for code in ErrorCode
    }
