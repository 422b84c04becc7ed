"""Bad requests get each their error code and field, and the node answers the next good one."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import KeyValue
from geometry_msgs.msg import Pose, Quaternion, Vector3
from in_process import answer_to
from running import NodeProcess
from scenes import (
    assert_answered,
    assert_same,
    diagonal,
    explicit,
    good_request,
    material_of,
    moving_object,
    packed,
    request_of,
    with_physics,
)
from shape_msgs.msg import Plane, SolidPrimitive

from unc_physics.checks.errors import ErrorCode
from unc_physics.ros.models import ModelLibrary
from unc_physics.ros.parameters import Settings
from unc_physics.shapes.library import find_model
from unc_physics_msgs.msg import BoxRegion, EnvironmentElement, JointCovariance, MaterialPair, ObjectState

NAN, INF = float("nan"), float("inf")
SETTINGS = Settings(zero_covariance="exact")
BOX, SPHERE, CYLINDER = SolidPrimitive.BOX, SolidPrimitive.SPHERE, SolidPrimitive.CYLINDER


def changed(path, value):
    """A good request with one field of its second object, or of itself, replaced."""
    request = good_request()
    places = {"@": request.scene.objects[1], "scene": request.scene, "physics": request.physics}
    first, _, rest = path.partition(".")
    message, rest = (places[first], rest) if first in places else (request, path)
    *parents, last = rest.split(".")
    for name in parents:
        message = getattr(message, name)
    setattr(message, last, value)
    return request


# rows of BAD: a request, its error's code, and the field; @ is the second object, # the first element


def field(path, value, code, named=None):
    return changed(path, value), code, named or path


def option(*pairs, code="INVALID_OPTION", named, **others):
    options = [KeyValue(key=key, value=value) for key, value in pairs]
    return good_request(propagator_options=options, **others), code, named


def physics(code, named="", **values):
    *_, key = values
    return with_physics(good_request(), **values), code, named or f"physics.{key}"


def element(given, code, place):
    return elements(given), code, f"#{place}"


def at_rest(field, value, named, code="INVALID_REQUEST", gravity=None):
    """In a world with the node's gravity an object at rest, with another field that contradicts it."""
    request = with_physics(changed("@.twist.twist.linear.x", 0.0), gravity=gravity)
    request.scene.objects[1].at_rest = True
    twist = request.scene.objects[1].twist.twist
    setattr({"x": twist.linear, "z": twist.angular}.get(field, request.scene.objects[1]), field, value)
    return request, code, named


def material(code, place, **values):
    request = good_request()
    request.scene.objects[1].material = material_of(**values)
    return request, code, f"@.material.{place}"


def element_material(code, place, **values):
    return element(floor(material=material_of(**values)), code, f".material.{place}")


def pair(code, named, other="right", **values):
    request = good_request()
    one = MaterialPair(object_a="left", object_b=other, material=material_of(**values))
    request.scene.pairs = [one]
    return request, code, named


def joint(ids, code, place, size=None):
    request = good_request()
    size = 12 * len(ids) if size is None else size
    request.scene.joint_covariance = JointCovariance(object_ids=ids, data=packed(np.eye(size)))
    return request, code, f"scene.joint_covariance.{place}"


def regions(*ids, code, named):
    request = good_request()
    request.regions = [BoxRegion(id=name, size=Vector3(x=1.0, y=1.0, z=1.0)) for name in ids]
    return request, code, named


def of_fixed(row):
    """The same row, for a fixed second object."""
    row[0].scene.objects[1].kind = ObjectState.FIXED
    return row


def with_explicit_step(row):
    return explicit(row[0]), *row[1:]


def elements(*given):
    request = good_request()
    request.scene.environment.elements = list(given)
    return request


def floor(coef=(0.0, 0.0, 1.0, 2.0), **others):
    return EnvironmentElement(plane=Plane(coef=coef), **others)


def solid(dimensions, kind=BOX, **others):
    return EnvironmentElement(primitive=SolidPrimitive(type=kind, dimensions=dimensions), **others)


def many(count, **others):
    return request_of(*[moving_object(str(k)) for k in range(count)], **others)


def massless():
    """An object without mass, of a model without mass."""
    row = field("@.model", "massless", "INVALID_MASS", "@.mass")
    row[0].scene.objects[1].mass, row[0].scene.objects[1].spheres = 0.0, 0
    return row


LOPSIDED, INDEFINITE = diagonal(*[0.1] * 6), np.eye(6)
LOPSIDED[3] = 0.001
INDEFINITE[0, 1] = INDEFINITE[1, 0] = 1.1
POSE, TWIST = "@.pose.covariance", "@.twist.covariance"
STEP = Duration(nanosec=10_000_000)
WITHOUT_CORRELATIONS = explicit(good_request(propagator="surrogate", return_joint_covariance=True))

BAD = [
    # objects
    (request_of(), "NO_OBJECTS", "scene.objects"),
    field("@.id", "left", "DUPLICATE_ID"),
    field("@.id", "", "INVALID_REQUEST"),
    field("@.id", "environment", "INVALID_REQUEST", "@.id is reserved"),
    field("@.kind", 9, "INVALID_REQUEST"),
    field("@.model", "Döner 🥙", "UNKNOWN_MODEL"),
    field("@.model", "", "INVALID_REQUEST", "@ must have exactly one of model"),
    field("@.model", "/tmp/model.npz", "UNKNOWN_MODEL", "@.model must be a name"),
    field("@.model", "text", "INVALID_MODEL"),
    field("@.model", "contradiction", "INVALID_MODEL"),
    field("@.spheres", 4_000_000_000, "INVALID_MODEL"),
    field("@.scale", -1.0, "INVALID_MODEL"),
    field("@.scale", NAN, "NOT_FINITE"),
    field("@.mass", -1.0, "INVALID_MASS"),
    field("@.mass", NAN, "NOT_FINITE"),
    massless(),
    field("@.drag", -0.1, "INVALID_REQUEST"),
    field("@.drag", NAN, "NOT_FINITE"),
    of_fixed(field("@.drag", 0.1, "INVALID_REQUEST", "@.drag must be absent")),
    at_rest("x", 0.1, "@.twist.twist.linear"),
    at_rest("z", 0.1, "@.twist.twist.angular"),
    at_rest("kind", ObjectState.FIXED, "@.at_rest"),
    at_rest("at_rest", True, "@.at_rest needs", "INVALID_OPTION", gravity=(0.0, 0.0, 0.0)),
    # what is known of them
    field("@.pose.pose.position.x", NAN, "NOT_FINITE", "@.pose.pose.position"),
    field("@.pose.pose.orientation.w", NAN, "NOT_FINITE", "@.pose.pose.orientation"),
    field("@.pose.pose.orientation.w", 0.0, "INVALID_ORIENTATION", "@.pose.pose.orientation"),
    field("@.pose.pose.orientation.x", 0.1, "INVALID_ORIENTATION", "@.pose.pose.orientation"),
    field("@.twist.twist.linear.y", INF, "NOT_FINITE", "@.twist.twist.linear"),
    field("@.twist.twist.angular.z", NAN, "NOT_FINITE", "@.twist.twist.angular"),
    field(POSE, np.full(36, NAN), "NOT_FINITE"),
    field(POSE, LOPSIDED, "INVALID_COVARIANCE"),
    field(POSE, -2.0 * diagonal(*[1.0] * 6), "INVALID_COVARIANCE", "variance"),
    field(TWIST, INDEFINITE.ravel(), "INVALID_COVARIANCE"),
    field("@.covariance", packed(np.eye(6)), "INVALID_COVARIANCE"),
    field("@.covariance", packed(-np.eye(12)), "INVALID_COVARIANCE"),
    field("@.covariance", packed([NAN] * 144), "NOT_FINITE"),
    field("@.mass_std", -0.1, "INVALID_COVARIANCE"),
    field("@.mass_std", NAN, "NOT_FINITE"),
    field("@.mass_std", 2.0, "INVALID_COVARIANCE"),
    field("@.center_of_mass_std.y", -0.1, "INVALID_COVARIANCE", "@.center_of_mass_std"),
    field("@.center_of_mass_std.z", NAN, "NOT_FINITE", "@.center_of_mass_std"),
    field("scene.common_pose_std", [0.0] * 5 + [-0.1], "INVALID_COVARIANCE", "scene.common_pose_std[5]"),
    field("scene.common_pose_std", [NAN] + [0.0] * 5, "NOT_FINITE"),
    field("scene.common_pose_origin.z", NAN, "NOT_FINITE", "scene.common_pose_origin"),
    joint(["left", "right", "stranger"], "INVALID_COVARIANCE", "object_ids[2]"),
    joint(["left", "left"], "DUPLICATE_ID", "object_ids[1]"),
    joint(["left"], "INVALID_COVARIANCE", "object_ids must name 'right'"),
    of_fixed(joint(["left", "right"], "INVALID_COVARIANCE", "object_ids[1]")),
    joint(["left", "right"], "INVALID_COVARIANCE", "data", size=12),
    # times
    field("horizon", Duration(), "INVALID_HORIZON"),
    field("horizon", Duration(sec=-1), "INVALID_HORIZON"),
    field("horizon", Duration(nanosec=1_000_000_000), "INVALID_HORIZON", "horizon.nanosec"),
    with_explicit_step(field("horizon", Duration(nanosec=1000), "INVALID_HORIZON")),
    field("trajectory_period", Duration(sec=-1, nanosec=500_000_000), "INVALID_HORIZON"),
    field("trajectory_period", Duration(nanosec=1000), "LIMIT_EXCEEDED"),
    with_explicit_step(field("trajectory_period", Duration(nanosec=2_000_000), "INVALID_HORIZON")),
    (request_of(moving_object(), trajectory_period=0.1, times=[STEP]), "INVALID_REQUEST", "times"),
    field("times", [Duration(nanosec=20_000_000), STEP], "INVALID_HORIZON", "times[1]"),
    field("times", [Duration(sec=-1)], "INVALID_HORIZON", "times[0]"),
    with_explicit_step(field("times", [Duration(nanosec=12_000_000)], "INVALID_HORIZON", "times[0]")),
    field("max_computation_time", Duration(sec=-1), "INVALID_REQUEST"),
    field(
        "max_computation_time",
        Duration(sec=1, nanosec=4_000_000_000),
        "INVALID_REQUEST",
        "max_computation_time.nanosec",
    ),
    # propagator
    field("propagator", "crystal_ball", "UNKNOWN_PROPAGATOR"),
    (many(100, return_samples=1000, trajectory_period=0.01), "LIMIT_EXCEEDED", "max_memory allows"),
    (WITHOUT_CORRELATIONS, "NOT_SUPPORTED", "return_joint_covariance"),
    option(("samples", "5"), propagator="monte_carlo", samples=7, named="samples is given twice"),
    option(("seed", "5"), propagator="monte_carlo", seed=7, named="seed is given twice"),
    option(("colour", "red"), named="colour"),
    option(("", "x"), named="propagator_options[0].key must not be"),
    option(("name", "x"), named="name"),
    option(("points", "many"), named="points"),
    option(("points", "full"), ("points", "minimal"), named="propagator_options[1].key"),
    # physics
    physics("INVALID_HORIZON", dt=0.0),
    physics("NOT_FINITE", dt=NAN),
    field("physics.dt", 0.1, "INVALID_REQUEST", "physics.dt needs has_dt beside it"),
    field("physics.sleep", True, "INVALID_REQUEST", "physics.sleep needs has_sleep"),
    field("@.material.friction", 0.3, "INVALID_REQUEST", "@.material.friction needs has_friction"),
    physics("NOT_FINITE", stiffness=NAN),
    physics("INVALID_OPTION", stiffness=-2.0),
    physics("INVALID_OPTION", "physics.stiffness must be absent with 'integrator: implicit'", stiffness=1e5),
    physics("INVALID_OPTION", stiffness_std=1e3),
    physics("NOT_FINITE", gravity=(0.0, 0.0, INF)),
    physics("INVALID_OPTION", damping=-1.0),
    physics("INVALID_OPTION", overlap="push"),
    physics("NOT_SUPPORTED", "overlap", overlap="reject"),  # by sigma points
    with_explicit_step(physics("INVALID_OPTION", overlap="project")),
    physics("INVALID_OPTION", friction=-0.5),
    physics("INVALID_OPTION", friction=0.0, friction_std=0.1),
    physics("INVALID_OPTION", friction_std=0.9),
    physics("INVALID_OPTION", restitution=1.5),
    physics("INVALID_OPTION", preset="lunar"),
    physics("INVALID_OPTION", rolling_friction=-1.0),
    physics("INVALID_OPTION", integrator="magic"),
    physics("INVALID_OPTION", "'implicit'", integrator="robust"),
    physics(
        "INVALID_OPTION",
        "physics.friction needs 'integrator: implicit', which the preset 'everyday' has",
        integrator="explicit",
    ),
    # materials
    pair("INVALID_REQUEST", "scene.pairs[0] must have one of friction"),
    pair("INVALID_REQUEST", "scene.pairs[0].material.friction", friction=-1.0),
    pair("NOT_SUPPORTED", "scene.pairs[0].material.name must be unset", name="wood"),
    pair("NOT_SUPPORTED", "scene.pairs[0].material.friction_std must", friction=0.3, friction_std=0.1),
    pair("INVALID_REQUEST", "scene.pairs[0] is neither a body nor", other="shelf", friction=0.3),
    with_explicit_step(pair("INVALID_OPTION", "scene.pairs", friction=0.3)),
    material("INVALID_REQUEST", "friction", friction=-1.0),
    material("NOT_FINITE", "restitution", restitution=NAN),
    material("INVALID_REQUEST", "restitution_std", restitution_std=0.1),  # without a restitution
    material("INVALID_REQUEST", "name must be one of aluminum, cardboard, concrete, glass", name="woood"),
    with_explicit_step(material("INVALID_OPTION", "friction", friction=0.3)),
    with_explicit_step(material("INVALID_OPTION", "name needs 'integrator: implicit'", name="wood")),
    element_material("INVALID_ENVIRONMENT", "restitution", restitution=2.0),
    element_material("INVALID_ENVIRONMENT", "name must be one of aluminum", name="Rubber"),
    with_explicit_step(element_material("INVALID_OPTION", "friction", friction=0.3)),
    # environment and regions
    element(floor([0.0, 0.0, 0.0, 1.0]), "INVALID_ENVIRONMENT", ".plane.coef"),
    element(floor([0.0, 0.0, NAN, 1.0]), "NOT_FINITE", ".plane.coef"),
    element(EnvironmentElement(), "INVALID_ENVIRONMENT", " must have exactly one of"),
    element(
        solid([1.0] * 3, plane=Plane(coef=[0.0, 0.0, 1.0, 2.0])),
        "INVALID_ENVIRONMENT",
        " must have exactly one of",
    ),
    element(solid([1.0, 1.0, 0.0]), "INVALID_ENVIRONMENT", ".primitive.dimensions[2]"),
    element(solid([1.0, 1.0]), "INVALID_ENVIRONMENT", ".primitive.dimensions"),
    element(solid([1.0, INF, 1.0]), "NOT_FINITE", ".primitive.dimensions"),
    element(
        solid([1.0] * 3, pose=Pose(orientation=Quaternion(w=0.0))), "INVALID_ORIENTATION", ".pose.orientation"
    ),
    element(solid([1.0] * 3, SPHERE), "INVALID_ENVIRONMENT", ".primitive.dimensions"),
    element(solid([0.0], SPHERE), "INVALID_ENVIRONMENT", ".primitive.dimensions[0]"),
    element(solid([1.0], CYLINDER), "INVALID_ENVIRONMENT", ".primitive.dimensions"),
    element(solid([1.0, -0.5], CYLINDER), "INVALID_ENVIRONMENT", ".primitive.dimensions[1]"),
    element(solid([INF, 0.5], CYLINDER), "NOT_FINITE", ".primitive.dimensions"),
    element(solid([1.0] * 3, 77), "INVALID_ENVIRONMENT", ".primitive.type"),
    element(floor(id="environment"), "INVALID_REQUEST", ".id is reserved"),
    element(floor(id="left"), "DUPLICATE_ID", ".id"),
    (elements(floor(id="element_1"), solid([1.0] * 3)), "DUPLICATE_ID", "scene.environment.elements[1].id"),
    field("scene.header.frame_id", "camera", "UNKNOWN_FRAME"),
    regions("", code="INVALID_ENVIRONMENT", named="regions[0].id"),
    regions("bin", "bin", code="DUPLICATE_ID", named="regions[1].id"),
    # what shows while it is computed
    (explicit(with_physics(good_request(horizon=1.0), stiffness=1e300)), "DIVERGED", "diverged"),
]
IDS = [f"{code}-{named}" for _, code, named in BAD]


@pytest.fixture(scope="module")
def models_dir(tmp_path_factory):
    """The shipped models, and three files that are none, or have no mass."""
    folder = tmp_path_factory.mktemp("models")
    for name in ("bunny", "armadillo"):
        shutil.copy(find_model(name), folder)
    (folder / "text.npz").write_text("This is no archive.")
    np.savez(folder / "contradiction.npz", centers=np.zeros((3, 3)), radii=np.ones(2))
    np.savez(folder / "massless.npz", centers=np.eye(3), radii=np.ones(3))
    return folder


@pytest.fixture(scope="module")
def library(models_dir):
    return ModelLibrary(models_dir)


@pytest.fixture(scope="module")
def node(models_dir):
    with NodeProcess(zero_covariance="exact", models_dir=models_dir, name="strict") as process:
        yield process


@pytest.fixture(scope="module")
def predict(node, client):
    return lambda request: client.predict(request, node="strict")


@pytest.fixture(scope="module")
def answer_before(predict):
    response = predict(good_request(seed=1))
    assert_answered(response)
    return response


def assert_refused(response, code, named):
    named = named.replace("@", "scene.objects[1]").replace("#", "scene.environment.elements[0]")
    result = response.result
    assert (ErrorCode(result.error_code).name, named in result.error_msg) == (code, True), result.error_msg
    assert not response.prediction.objects
    assert "\n" not in result.error_msg


@pytest.mark.parametrize(("request_", "code", "named"), BAD, ids=IDS)
def test_a_bad_request_gets_its_code_and_field(library, request_, code, named):
    assert_refused(answer_to(request_, SETTINGS, library), code, named)


@pytest.mark.parametrize(("request_", "code", "named"), BAD[::15], ids=IDS[::15])
def test_the_node_answers_so_and_the_next_good_request_as_before(
    predict, answer_before, request_, code, named
):
    assert_refused(predict(request_), code, named)
    assert_same(predict(good_request(seed=1)), answer_before)


@pytest.mark.parametrize(
    ("name", "limit", "make", "named"),
    [
        ("max_horizon", 2.5, lambda time: good_request(horizon=time), "horizon"),
        ("max_objects", 2, many, "scene.objects"),
        ("max_objects", 2, lambda n: elements(*[floor()] * n), "scene.environment.elements"),
        ("max_objects", 2, lambda n: regions(*map(str, range(n)), code="", named="")[0], "regions"),
    ],
)
def test_a_limit_is_the_most_that_is_allowed(library, name, limit, make, named):
    settings = replace(SETTINGS, **{name: limit})
    answers = [
        answer_to(make(value), settings, library, computed=lambda job: False)
        for value in (limit, limit + (1 if isinstance(limit, int) else 1e-9))
    ]
    assert answers[0].result.error_code == ErrorCode.NONE, answers[0].result.error_msg
    assert_refused(answers[1], "LIMIT_EXCEEDED", named)


def test_texts_of_any_script_are_ids(predict):
    names = ["Häschen", "兎", "🐰 \t", "a" * 10_000]
    objects = [moving_object(name, position=(float(k), 0.0, 0.0)) for k, name in enumerate(names)]
    response = predict(request_of(*objects))
    assert_answered(response)
    assert [predicted.id for predicted in response.prediction.objects] == names


@pytest.mark.parametrize(
    "request_",
    [
        good_request(trajectory_period=1e-7),
        good_request(return_samples=1000, trajectory_period=0.001),
        good_request(propagator="monte_carlo", samples=100_000, trajectory_period=0.005),
    ],
    ids=["states", "returned samples", "samples"],
)
def test_memory_is_limited(library, request_):
    settings = replace(SETTINGS, max_memory=64.0)
    response = answer_to(request_, settings, library, computed=lambda job: False)
    assert_refused(response, "LIMIT_EXCEEDED", "the parameter max_memory allows 64 MB")
