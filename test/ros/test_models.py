"""Models: listed, loaded and packed at run time; and what else the node offers."""

import fnmatch
import re
import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from running import Inbox, NodeProcess, wait_until
from scenes import assert_answered, moving_object, request_of

from unc_physics import PROPAGATORS
from unc_physics.checks.errors import ErrorCode, UnknownModelError
from unc_physics.ros.models import ModelLibrary
from unc_physics.shapes.library import find_model
from unc_physics_msgs.msg import ModelInfo, ModelList
from unc_physics_msgs.srv import GetCapabilities, LoadModel

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture(scope="module")
def node(tmp_path_factory):
    folder = tmp_path_factory.mktemp("models")
    shutil.copy(find_model("bunny"), folder)
    with NodeProcess(models_dir=folder, allow_model_paths=True, name="models") as process:
        yield process


@pytest.fixture
def load(node, client):
    return lambda **fields: client.call(LoadModel, "/models/load_model", LoadModel.Request(**fields))


@pytest.fixture
def listed(node, client):
    def names():
        with Inbox(client, ModelList, "/models/models", LATCHED) as inbox:
            return {model.name: model for model in inbox.next().models}

    return names


def test_the_list_of_models(listed):
    bunny = listed()["bunny"]
    assert bunny.status == ModelInfo.STATUS_READY
    assert bunny.spheres > 1000 and 0.0 < bunny.fill < 1.0 and bunny.mass > 0.0
    assert bunny.bounds_min.x < bunny.center_of_mass.x < bunny.bounds_max.x


def test_a_model_is_loaded_and_used(load, listed, client):
    loaded = load(path=str(find_model("can")), name="Dose")
    assert loaded.result.error_code == ErrorCode.NONE, loaded.result.error_msg
    assert loaded.model.name == "Dose" and "Dose" in listed()
    assert_answered(client.predict(request_of(moving_object(model="Dose")), node="models"))
    again = load(path=str(find_model("pin")), name="Dose")
    assert again.result.error_code == ErrorCode.DUPLICATE_ID
    assert load(path=str(find_model("pin")), name="Dose", replace=True).result.error_code == ErrorCode.NONE
    assert listed()["Dose"].spheres == load(path=str(find_model("pin")), name="Kegel").model.spheres
    with Inbox(client, ModelList, "/models/models", LATCHED) as inbox:
        assert {"Dose", "Kegel", "bunny"} <= {model.name for model in inbox.next().models}


@pytest.mark.parametrize(
    ("path", "code"),
    [
        ("", "INVALID_REQUEST"),
        ("/nowhere.npz", "INVALID_REQUEST"),
        ("/etc/passwd", "INVALID_MESH"),
        ("/dev/zero", "INVALID_REQUEST"),
        ("{tmp}/text.npz", "INVALID_MODEL"),
    ],
)
def test_files_that_are_no_models(load, listed, tmp_path, path, code):
    (tmp_path / "text.npz").write_text("no archive")
    response = load(path=path.format(tmp=tmp_path), name="none")
    assert ErrorCode(response.result.error_code).name == code, response.result.error_msg
    assert "none" not in listed()


def test_a_path_without_a_file_is_named(tmp_path):
    path = str(tmp_path / "nothing.npz")
    with pytest.raises(UnknownModelError, match=f"^model is no file on the node's machine .*{path}"):
        ModelLibrary(allow_paths=True).shape(path)
    with pytest.raises(UnknownModelError, match="^model must be a name, as .*allow_model_paths is false"):
        ModelLibrary().shape(path)
    with pytest.raises(UnknownModelError, match="^model is unknown; the models are: .*bunny"):
        ModelLibrary(allow_paths=True).shape("nothing")


def test_a_mesh_is_packed_in_the_background(load, listed, client, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    mesh = tmp_path / "block.stl"
    trimesh.creation.box((0.1, 0.2, 0.3)).export(mesh)
    response = load(path=str(mesh), spheres=30)
    assert (response.result.error_code, response.model.status) == (ErrorCode.NONE, ModelInfo.STATUS_PACKING)
    wait_until(lambda: listed()["block"].status != ModelInfo.STATUS_PACKING)
    assert (listed()["block"].status, listed()["block"].spheres) == (ModelInfo.STATUS_READY, 30), listed()[
        "block"
    ]
    assert listed()["block"].volume == pytest.approx(0.006)
    assert_answered(client.predict(request_of(moving_object(model="block")), node="models"))


def test_capabilities(node, client):
    response = client.call(GetCapabilities, "/models/get_capabilities", GetCapabilities.Request())
    assert [info.name for info in response.propagators] == list(PROPAGATORS)
    for info in response.propagators:
        assert info.description and info.uncertainty
        options = PROPAGATORS[info.name].options()
        assert [option.key for option in info.options] == list(options)
        for option, default in zip(info.options, options.values(), strict=True):
            assert re.fullmatch(rf"[a-z].*, default {re.escape(str(default))}: .+", option.value)
        assert tuple(info.integrators) == PROPAGATORS[info.name].integrators
    assert response.default_propagator in PROPAGATORS
    assert (response.world_frame, response.max_objects) == ("world", 200)
    assert (response.max_horizon.sec, response.max_computation_time.sec) == (60, 30)
    assert response.physics.gravity.z == -9.81
    assert response.physics.stiffness == response.physics.STIFFNESS_AUTO
    request = request_of(moving_object())
    request.physics = response.physics  # what it tells may be sent back as it is
    answer = client.predict(request, node="models")
    assert_answered(answer)
    assert answer.prediction.physics.stiffness == response.physics.STIFFNESS_AUTO  # contacts are rigid
    assert answer.prediction.physics.friction == response.physics.friction


def advertised(graph):
    """Names below ~ of the node's topics, services and actions, as far as discovery has found them."""
    own = graph.get_service_names_and_types_by_node("models", "/")
    own += graph.get_publisher_names_and_types_by_node("models", "/")
    own += graph.get_subscriber_names_and_types_by_node("models", "/")
    names = {name.removeprefix("/models/") for name, _ in own if name.startswith("/models/")}
    return {
        re.split("/_action|/_service_event", name)[0]
        for name in names
        if not re.search(r"parameter|type_description", name)
    }


POLICY = ET.parse(Path(__file__).resolve().parents[2] / "config" / "sros2_policy.xml")


def permitted(kind, **permission):
    """Names that the policy permits the node, as patterns, with the name of the node here."""
    (attribute, value) = next(iter(permission.items()))
    profile = POLICY.find("./enclaves/enclave[@path='/unc_physics']/profiles/profile")
    names = [
        entry.text for group in profile.findall(kind) if group.get(attribute) == value for entry in group
    ]
    return [name.replace("~", "/models") if name.startswith("~") else f"/{name}" for name in names]


@pytest.mark.parametrize(
    ("kind", "permission", "listed_by"),
    [
        ("topics", "publish", "get_publisher_names_and_types_by_node"),
        ("topics", "subscribe", "get_subscriber_names_and_types_by_node"),
        ("services", "reply", "get_service_names_and_types_by_node"),
        ("services", "request", "get_client_names_and_types_by_node"),
    ],
)
def test_the_policy_permits_what_the_node_does(node, client, kind, permission, listed_by):
    patterns = permitted(kind, **{permission: "ALLOW"})
    wait_until(lambda: "predict_long" in advertised(client.node))
    names = {name for name, _ in getattr(client.node, listed_by)("models", "/")}
    own = {name for name in names if "/_action/" not in name}
    assert permitted("actions", execute="ALLOW") == ["/models/predict_long"]
    assert not [name for name in own if not any(fnmatch.fnmatch(name, pattern) for pattern in patterns)]


def test_a_client_of_the_policy_may_not_load_models():
    profile = POLICY.find("./enclaves/enclave[@path='/unc_physics_client']/profiles/profile")
    names = {entry.text for group in profile for entry in group}
    assert "/unc_physics/predict" in names and not any("load" in name or "set_" in name for name in names)


def test_services_tell_who_called_them(node, client):
    """By service introspection, which ros2 service echo shows."""

    def is_request(event):
        """The subscription may be discovered between a request's event and that of its response."""
        return event.info.event_type == event.info.REQUEST_RECEIVED

    kind, name = GetCapabilities, "/models/get_capabilities"
    with Inbox(client, kind.Event, f"{name}/_service_event") as inbox:
        event = inbox.answer(lambda: client.call(kind, name, kind.Request()), is_request)
        assert not event.request


def test_every_topic_service_and_action_is_in_the_document(node, client):
    text = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "ros.md").read_text()
    wait_until(lambda: "models" in client.node.get_node_names())
    expected = {"predict", "predict_long", "scene", "predictions", "models"}
    wait_until(lambda: expected <= advertised(client.node))  # the parts of a node are discovered one by one
    assert not [name for name in advertised(client.node) if f"`~/{name}`" not in text]
