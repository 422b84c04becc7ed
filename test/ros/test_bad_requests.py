"""Bad requests get each their error code, and the node answers the next good one."""

import shutil

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import KeyValue
from geometry_msgs.msg import Pose, Quaternion
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
from unc_physics.geometry.library import find_model
from unc_physics_msgs.msg import BoxRegion, EnvironmentElement, JointCovariance, ObjectState

NAN, INF = float("nan"), float("inf")
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


def wrong(path, value, code):
    return changed(path, value), code, path


def wrong_physics(code, **value):
    (key,) = value
    return physics(**value), code, f"physics.{key}"


def with_option(*pairs, **others):
    options = [KeyValue(key=key, value=value) for key, value in pairs]
    return good_request(propagator_options=options, **others)


def physics(**values):
    return with_physics(good_request(), **values)


def lopsided():
    covariance = diagonal(*[0.1] * 6)
    covariance[3] = 0.001
    return covariance


def indefinite():
    covariance = np.eye(6)
    covariance[0, 1] = covariance[1, 0] = 1.1
    return covariance.ravel()


def elements(*given):
    request = good_request()
    request.scene.environment.elements = list(given)
    return request


def floor(coef=(0.0, 0.0, 1.0, 2.0), **others):
    return EnvironmentElement(plane=Plane(coef=coef), **others)


def solid(dimensions, kind=BOX, **others):
    return EnvironmentElement(primitive=SolidPrimitive(type=kind, dimensions=dimensions), **others)


def with_material(thing, **values):
    thing.material = material_of(**values)
    return thing


def object_of(**material):
    request = good_request()
    with_material(request.scene.objects[1], **material)
    return request


def fixed_with_drag():
    request = changed("@.drag", 0.1)
    request.scene.objects[1].kind = ObjectState.FIXED
    return request


def with_joint(ids, size=None):
    request = good_request()
    size = 12 * len(ids) if size is None else size
    request.scene.joint_covariance = JointCovariance(object_ids=ids, data=packed(np.eye(size)))
    return request


def fixed_joint():
    request = with_joint(["left", "right"])
    request.scene.objects[1].kind = ObjectState.FIXED
    return request


def with_regions(*ids):
    request = good_request()
    for name in ids:
        region = BoxRegion(id=name)
        region.size.x = region.size.y = region.size.z = 1.0
        request.regions.append(region)
    return request


def massless():
    """An object without mass, of a model without mass."""
    request = changed("@.model", "massless")
    request.scene.objects[1].mass, request.scene.objects[1].spheres = 0.0, 0
    return request


def at_rest(speed=0.1, spin=0.0, fixed=False):
    """A request in whose world there is gravity, and an object at rest that moves, or turns."""
    request = good_request()
    with_physics(request, gravity=None)
    standing = request.scene.objects[1]
    standing.at_rest, standing.twist.angular.x = True, spin
    standing.twist.linear.x = speed
    standing.kind = ObjectState.FIXED if fixed else ObjectState.DYNAMIC
    if spin:
        standing.twist.linear.x = 0.0
    return request


def duplicate():
    return request_of(moving_object("twin"), moving_object("twin"))


#: By what is wrong: a request, its error and the field; @ is the second object, # the first element.
BAD = {
    "no objects": (request_of(), "NO_OBJECTS", "scene.objects"),
    "duplicate id": (duplicate(), "DUPLICATE_ID", "@.id"),
    "empty id": wrong("@.id", "", "INVALID_REQUEST"),
    "unknown model": wrong("@.model", "Döner 🥙", "UNKNOWN_MODEL"),
    "model by path": (changed("@.model", "/tmp/model.npz"), "UNKNOWN_MODEL", "@.model must be a name"),
    "too few spheres": wrong("@.spheres", 4_000_000_000, "INVALID_MODEL"),
    "negative scale": wrong("@.scale", -1.0, "INVALID_MODEL"),
    "unknown propagator": wrong("propagator", "crystal_ball", "UNKNOWN_PROPAGATOR"),
    "NaN position": (changed("@.pose.position.x", NAN), "NOT_FINITE", "@.pose.position"),
    "infinite velocity": (changed("@.twist.linear.y", INF), "NOT_FINITE", "@.twist.linear"),
    "NaN spin": (changed("@.twist.angular.z", NAN), "NOT_FINITE", "@.twist.angular"),
    "NaN orientation": (changed("@.pose.orientation.w", NAN), "NOT_FINITE", "orientation"),
    "NaN covariance": wrong("@.belief.pose_covariance", np.full(36, NAN), "NOT_FINITE"),
    "NaN mass": wrong("@.mass", NAN, "NOT_FINITE"),
    "NaN scale": wrong("@.scale", NAN, "NOT_FINITE"),
    "quaternion of zeros": (changed("@.pose.orientation.w", 0.0), "INVALID_ORIENTATION", "orientation"),
    "long quaternion": (changed("@.pose.orientation.x", 0.1), "INVALID_ORIENTATION", "orientation"),
    "asymmetric": wrong("@.belief.pose_covariance", lopsided(), "INVALID_COVARIANCE"),
    "indefinite": wrong("@.belief.twist_covariance", indefinite(), "INVALID_COVARIANCE"),
    "negative variance": (
        changed("@.belief.pose_covariance", -2.0 * diagonal(*[1.0] * 6)),
        "INVALID_COVARIANCE",
        "variance",
    ),
    "horizon of too many nanoseconds": (
        changed("horizon", Duration(nanosec=1_000_000_000)),
        "INVALID_HORIZON",
        "horizon.nanosec",
    ),
    "time limit of too many nanoseconds": (
        changed("max_computation_time", Duration(sec=1, nanosec=4_000_000_000)),
        "INVALID_REQUEST",
        "max_computation_time.nanosec",
    ),
    "zero horizon": wrong("horizon", Duration(), "INVALID_HORIZON"),
    "negative horizon": wrong("horizon", Duration(sec=-1), "INVALID_HORIZON"),
    "horizon below an explicit step": (
        explicit(changed("horizon", Duration(nanosec=1000))),
        "INVALID_HORIZON",
        "horizon",
    ),
    "negative period": wrong("trajectory_period", Duration(sec=-1, nanosec=500_000_000), "INVALID_HORIZON"),
    "period below an explicit step": (
        explicit(changed("trajectory_period", Duration(nanosec=2_000_000))),
        "INVALID_HORIZON",
        "trajectory_period",
    ),
    "times and a period": (
        request_of(moving_object(), trajectory_period=0.1, times=[Duration(nanosec=10_000_000)]),
        "INVALID_REQUEST",
        "times",
    ),
    "times that descend": (
        changed("times", [Duration(nanosec=20_000_000), Duration(nanosec=10_000_000)]),
        "INVALID_HORIZON",
        "times[1]",
    ),
    "a negative time": (changed("times", [Duration(sec=-1)]), "INVALID_HORIZON", "times[0]"),
    "a time between the explicit integrator's steps": (
        explicit(changed("times", [Duration(nanosec=12_000_000)])),
        "INVALID_HORIZON",
        "times[0]",
    ),
    "negative mass": wrong("@.mass", -1.0, "INVALID_MASS"),
    "horizon over the limit": wrong("horizon", Duration(sec=100_000), "LIMIT_EXCEEDED"),
    "samples over the limit": wrong("samples", 1_000_000, "LIMIT_EXCEEDED"),
    "samples over the limit, by option": (
        with_option(("samples", "1000000"), propagator="monte_carlo"),
        "LIMIT_EXCEEDED",
        "samples",
    ),
    "returned samples over the limit": wrong("return_samples", 4_000_000_000, "LIMIT_EXCEEDED"),
    "states over the limit": wrong("trajectory_period", Duration(nanosec=1000), "LIMIT_EXCEEDED"),
    "steps over the limit": (physics(dt=1e-9), "LIMIT_EXCEEDED", "horizon"),
    "too many objects": (
        request_of(*[moving_object(str(k)) for k in range(101)]),
        "LIMIT_EXCEEDED",
        "scene.objects",
    ),
    "too large an answer": (
        request_of(*[moving_object(str(k)) for k in range(100)], return_samples=1000, trajectory_period=0.01),
        "LIMIT_EXCEEDED",
        "bytes",
    ),
    "negative time limit": wrong("max_computation_time", Duration(sec=-1), "INVALID_REQUEST"),
    "unknown option": (with_option(("colour", "red")), "INVALID_OPTION", "colour"),
    "option without a name": (
        with_option(("", "x")),
        "INVALID_OPTION",
        "propagator_options[0].key must not be",
    ),
    "option called name": (with_option(("name", "x")), "INVALID_OPTION", "name"),
    "samples twice": (
        with_option(("samples", "5"), propagator="monte_carlo", samples=7),
        "INVALID_OPTION",
        "samples is given twice",
    ),
    "wrong option": (with_option(("points", "many")), "INVALID_OPTION", "points"),
    "option twice": (
        with_option(("points", "full"), ("points", "minimal")),
        "INVALID_OPTION",
        "propagator_options[1].key",
    ),
    "zero time step": wrong_physics("INVALID_HORIZON", dt=0.0),
    "NaN time step": wrong_physics("NOT_FINITE", dt=NAN),
    "NaN stiffness": wrong_physics("NOT_FINITE", stiffness=NAN),
    "negative stiffness": wrong_physics("INVALID_OPTION", stiffness=-2.0),
    "infinite gravity": wrong_physics("NOT_FINITE", gravity=(0.0, 0.0, INF)),
    "negative damping": wrong_physics("INVALID_OPTION", damping=-1.0),
    "unknown frame": wrong("scene.header.frame_id", "camera", "UNKNOWN_FRAME"),
    "negative deviation of the mass": wrong("@.belief.mass_std", -0.1, "INVALID_COVARIANCE"),
    "NaN deviation of the centre of mass": wrong("@.belief.center_of_mass_std.z", NAN, "NOT_FINITE"),
    "negative shared error": (
        changed("scene.common_pose_std", [0.0] * 5 + [-0.1]),
        "INVALID_COVARIANCE",
        "scene.common_pose_std[5]",
    ),
    "NaN shared error": wrong("scene.common_pose_std", [NAN] + [0.0] * 5, "NOT_FINITE"),
    "NaN origin of a shared error": (
        changed("scene.common_pose_origin.z", NAN),
        "NOT_FINITE",
        "scene.common_pose_origin",
    ),
    "at rest without gravity": (
        with_physics(at_rest(speed=0.0), gravity=(0.0, 0.0, 0.0)),
        "INVALID_OPTION",
        "@.at_rest needs",
    ),
    "at rest and moving": (at_rest(), "INVALID_REQUEST", "@.twist.linear"),
    "at rest and turning": (at_rest(speed=0.0, spin=0.1), "INVALID_REQUEST", "@.twist.angular"),
    "at rest and fixed": (at_rest(fixed=True), "INVALID_REQUEST", "@.at_rest"),
    "no way with overlap": wrong_physics("INVALID_OPTION", overlap="push"),
    "overlap rejected by sigma points": (physics(overlap="reject"), "NOT_SUPPORTED", "overlap"),
    "overlap projected with the explicit step": (
        explicit(physics(overlap="project")),
        "INVALID_OPTION",
        "physics.overlap",
    ),
    "negative friction": (physics(friction=-0.5), "INVALID_OPTION", "physics.friction must not be"),
    "restitution above 1": wrong_physics("INVALID_OPTION", restitution=1.5),
    "no integrator": wrong_physics("INVALID_OPTION", integrator="magic"),
    "an integrator that is no more": (physics(integrator="robust"), "INVALID_OPTION", "'implicit'"),
    "friction with the explicit step": (
        physics(integrator="explicit"),
        "INVALID_OPTION",
        "physics.friction needs 'integrator: implicit', which the preset 'everyday' has",
    ),
    "no preset": wrong_physics("INVALID_OPTION", preset="lunar"),
    "uncertain friction without friction": (
        physics(friction_std=0.1, friction=0.0),
        "INVALID_OPTION",
        "physics.friction_std",
    ),
    "friction more uncertain than it is": wrong_physics("INVALID_OPTION", friction_std=0.9),
    "an uncertain stiffness that is chosen": wrong_physics("INVALID_OPTION", stiffness_std=1e3),
    "negative friction of an object": (object_of(friction=-1.0), "INVALID_REQUEST", "@.material.friction"),
    "NaN restitution of an object": (object_of(restitution=NAN), "NOT_FINITE", "@.material.restitution"),
    "uncertain restitution of an object that has none": (
        object_of(restitution_std=0.1),
        "INVALID_REQUEST",
        "@.material.restitution_std",
    ),
    "friction of an object with the explicit step": (
        explicit(object_of(friction=0.3)),
        "INVALID_OPTION",
        "@.material.friction",
    ),
    "a material that is not in the table": (
        object_of(name="woood"),
        "INVALID_REQUEST",
        "@.material.name must be one of aluminum, cardboard, concrete, glass, plastic, rubber, steel, wood",
    ),
    "an element's material that is not in the table": (
        elements(with_material(floor(), name="Rubber")),
        "INVALID_ENVIRONMENT",
        "#.material.name must be one of aluminum",
    ),
    "a material with the explicit step": (
        explicit(object_of(name="wood")),
        "INVALID_OPTION",
        "@.material.name needs 'integrator: implicit'",
    ),
    "negative drag": wrong("@.drag", -0.1, "INVALID_REQUEST"),
    "drag that is no number": wrong("@.drag", NAN, "NOT_FINITE"),
    "drag of a fixed object": (fixed_with_drag(), "INVALID_REQUEST", "@.drag must be absent"),
    "restitution of an element above 1": (
        elements(with_material(floor(), restitution=2.0)),
        "INVALID_ENVIRONMENT",
        "#.material.restitution",
    ),
    "friction of an element with the explicit step": (
        explicit(elements(with_material(floor(), friction=0.3))),
        "INVALID_OPTION",
        "#.material.friction",
    ),
    "no kind of object": wrong("@.kind", 9, "INVALID_REQUEST"),
    "a model without mass": (massless(), "INVALID_MASS", "@.mass"),
    "a whole covariance of another size": wrong(
        "@.belief.covariance", packed(np.eye(6)), "INVALID_COVARIANCE"
    ),
    "a whole covariance that is none": wrong(
        "@.belief.covariance", packed(-np.eye(12)), "INVALID_COVARIANCE"
    ),
    "a NaN in a whole covariance": wrong("@.belief.covariance", packed([NAN] * 144), "NOT_FINITE"),
    "a joint covariance of a stranger": (
        with_joint(["left", "right", "stranger"]),
        "INVALID_COVARIANCE",
        "scene.joint_covariance.object_ids[2]",
    ),
    "a joint covariance of one twice": (
        with_joint(["left", "left"]),
        "DUPLICATE_ID",
        "scene.joint_covariance.object_ids[1]",
    ),
    "a joint covariance without an object": (
        with_joint(["left"]),
        "INVALID_COVARIANCE",
        "scene.joint_covariance.object_ids must name 'right'",
    ),
    "a joint covariance of what is fixed": (
        fixed_joint(),
        "INVALID_COVARIANCE",
        "scene.joint_covariance.object_ids[1]",
    ),
    "a joint covariance of another size": (
        with_joint(["left", "right"], 12),
        "INVALID_COVARIANCE",
        "scene.joint_covariance.data",
    ),
    "plane without normal": (elements(floor([0.0, 0.0, 0.0, 1.0])), "INVALID_ENVIRONMENT", "#.plane.coef"),
    "NaN plane": (elements(floor([0.0, 0.0, NAN, 1.0])), "NOT_FINITE", "#.plane.coef"),
    "an element of no shape": (
        elements(EnvironmentElement()),
        "INVALID_ENVIRONMENT",
        "# must have exactly one of",
    ),
    "an element of two shapes": (
        elements(solid([1.0] * 3, plane=Plane(coef=[0.0, 0.0, 1.0, 2.0]))),
        "INVALID_ENVIRONMENT",
        "# must have exactly one of",
    ),
    "box of no height": (
        elements(solid([1.0, 1.0, 0.0])),
        "INVALID_ENVIRONMENT",
        "#.primitive.dimensions[2]",
    ),
    "box of two lengths": (elements(solid([1.0, 1.0])), "INVALID_ENVIRONMENT", "#.primitive.dimensions"),
    "infinite box": (elements(solid([1.0, INF, 1.0])), "NOT_FINITE", "#.primitive.dimensions"),
    "box without orientation": (
        elements(solid([1.0] * 3, pose=Pose(orientation=Quaternion(w=0.0)))),
        "INVALID_ORIENTATION",
        "#.pose.orientation",
    ),
    "sphere of three lengths": (
        elements(solid([1.0] * 3, SPHERE)),
        "INVALID_ENVIRONMENT",
        "#.primitive.dimensions",
    ),
    "sphere of no radius": (
        elements(solid([0.0], SPHERE)),
        "INVALID_ENVIRONMENT",
        "#.primitive.dimensions[0]",
    ),
    "cylinder of one length": (
        elements(solid([1.0], CYLINDER)),
        "INVALID_ENVIRONMENT",
        "#.primitive.dimensions",
    ),
    "cylinder of negative radius": (
        elements(solid([1.0, -0.5], CYLINDER)),
        "INVALID_ENVIRONMENT",
        "#.primitive.dimensions[1]",
    ),
    "infinite cylinder": (elements(solid([INF, 0.5], CYLINDER)), "NOT_FINITE", "#.primitive.dimensions"),
    "primitive of no kind": (elements(solid([1.0] * 3, 77)), "INVALID_ENVIRONMENT", "#.primitive.type"),
    "two elements of one id": (
        elements(floor(id="element_1"), solid([1.0] * 3)),
        "DUPLICATE_ID",
        "scene.environment.elements[1].id",
    ),
    "too many elements": (
        elements(*[solid([1.0] * 3)] * 201),
        "LIMIT_EXCEEDED",
        "scene.environment.elements",
    ),
    "a name of all": (elements(floor(id="environment")), "INVALID_REQUEST", "#.id is reserved"),
    "a name of all for an object": (changed("@.id", "environment"), "INVALID_REQUEST", "@.id is reserved"),
    "an object's name for an element": (elements(floor(id="left")), "DUPLICATE_ID", "#.id"),
    "a region without name": (with_regions(""), "INVALID_ENVIRONMENT", "regions[0].id"),
    "too many regions": (with_regions(*map(str, range(101))), "LIMIT_EXCEEDED", "regions"),
    "two regions of one id": (with_regions("bin", "bin"), "DUPLICATE_ID", "regions[1].id"),
    "joint covariance without correlations": (
        explicit(good_request(propagator="surrogate", return_joint_covariance=True)),
        "NOT_SUPPORTED",
        "return_joint_covariance",
    ),
    "unreadable model": wrong("@.model", "text", "INVALID_MODEL"),
    "inconsistent model": wrong("@.model", "contradiction", "INVALID_MODEL"),
    "diverging": (explicit(with_physics(good_request(horizon=1.0), stiffness=1e300)), "DIVERGED", "diverged"),
}


@pytest.fixture(scope="module")
def models_dir(tmp_path_factory):
    """The shipped models, and two files that are none."""
    folder = tmp_path_factory.mktemp("models")
    for name in ("bunny", "armadillo"):
        shutil.copy(find_model(name), folder)
    (folder / "text.npz").write_text("This is no archive.")
    np.savez(folder / "contradiction.npz", centers=np.zeros((3, 3)), radii=np.ones(2))
    np.savez(folder / "massless.npz", centers=np.eye(3), radii=np.ones(3))
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
    named = named.replace("@", "scene.objects[1]").replace("#", "scene.environment.elements[0]")
    response = predict(request)
    result = response.result
    assert (ErrorCode(result.error_code).name, named in result.error_msg) == (code, True), result.error_msg
    assert not response.prediction.objects
    assert "\n" not in result.error_msg
    assert_same(predict(good_request(seed=1)), answer_before)


def test_texts_of_any_script_are_ids(predict):
    names = ["Häschen", "兎", "🐰 \t", "a" * 10_000]
    objects = [moving_object(name, position=(float(k), 0.0, 0.0)) for k, name in enumerate(names)]
    response = predict(request_of(*objects))
    assert_answered(response)
    assert [predicted.id for predicted in response.prediction.objects] == names
