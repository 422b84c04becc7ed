"""The models: which there are, as a service and as a topic, and more of them at run time."""

from __future__ import annotations

import os
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from geometry_msgs.msg import Point
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from unc_physics_msgs.msg import ModelInfo, ModelList
from unc_physics_msgs.srv import ListModels, LoadModel

from ..checks.errors import (
    DuplicateIdError,
    InvalidRequestError,
    LimitExceededError,
    NotSupportedError,
    UncPhysicsError,
)
from ..checks.shown import printable
from ..geometry.packing_file import load_packing, save_packing
from .background import BackgroundService

_LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
_DEFAULT_SPHERES = 1000


class ModelTopics:
    """``~/list_models``, ``~/load_model`` and the topic ``~/models``, which late subscribers get, too."""

    def __init__(self, server):
        self._server = server
        self._packer = ThreadPoolExecutor(1)
        self._packing: dict[str, ModelInfo] = {}  # meshes that are being packed, or that could not be
        self._lock = threading.Lock()
        self._loading = threading.Lock()
        self._publisher = server.node.create_publisher(ModelList, "~/models", _LATCHED)
        self._services = [
            BackgroundService(server, ListModels, "~/list_models", self._list),
            BackgroundService(server, LoadModel, "~/load_model", self._load),
        ]
        self._publish()

    def close(self):
        """Take services and topic back; a packing that runs is left to end."""
        for service in self._services:
            service.close()
        self._server.node.destroy_publisher(self._publisher)
        self._packer.shutdown(wait=False, cancel_futures=True)

    def _infos(self):
        library = self._server.library
        with self._lock:
            infos = dict(self._packing)
        for name, path in library.paths.items():
            infos.setdefault(name, _info(library, name, path))
        return [infos[name] for name in sorted(infos)]

    def _publish(self):
        message = ModelList(models=self._infos())
        message.header.stamp = self._server.node.get_clock().now().to_msg()
        message.header.frame_id = self._server.settings.world_frame
        self._publisher.publish(message)

    def _list(self, _, response):
        response.models = self._infos()

    def _load(self, request, response):
        with self._server.errors_into(response.result), self._loading:
            response.model = self._read(request)
            self._publish()

    def _read(self, request):
        """Read a model file, or start to pack a mesh; the model's entry."""
        if not self._server.settings.allow_model_paths:
            raise NotSupportedError(
                "is not taken, as the parameter allow_model_paths is false", field="path", value=request.path
            )
        path = Path(request.path).expanduser()
        if not request.path or not os.path.isfile(path):
            raise InvalidRequestError("is no file on the node's machine", field="path", value=request.path)
        library = self._server.library
        if path.suffix == ".npz":
            packing = load_packing(path)
            name = request.name or packing.name or path.stem
            self._refuse_taken(name, request.replace)
            library.add(name, path)
            library.prepare(name)
            return _info(library, name, path)
        limit = self._server.settings.max_spheres
        if request.spheres > limit:
            raise LimitExceededError(f"must be at most {limit}", field="spheres", value=request.spheres)
        name = request.name or path.stem
        self._refuse_taken(name, request.replace)
        solid = _solid(path)
        info = ModelInfo(
            name=name, status=ModelInfo.STATUS_PACKING, status_msg="is being packed", path=str(path)
        )
        with self._lock:
            self._packing[name] = info
        self._packer.submit(self._pack, name, path, solid, request.spheres or min(_DEFAULT_SPHERES, limit))
        return info

    def _refuse_taken(self, name, replace):
        with self._lock:
            packing = self._packing.get(name)
        if packing is not None and packing.status == ModelInfo.STATUS_PACKING:
            raise DuplicateIdError("is being packed just now", field="name", value=name)
        if not replace and name in self._server.library.paths:
            raise DuplicateIdError(
                "is the name of a model; set replace to replace it", field="name", value=name
            )

    def _pack(self, name, path, solid, spheres):
        """Pack a mesh in the background and publish the list again."""
        try:
            from ..geometry.packing import pack_solid

            # one thread: packing may take its time, predictions may not
            packing = pack_solid(solid, spheres, threads=1)
            handle, file = tempfile.mkstemp(suffix=".npz", dir=self._server.library.packed.name)
            os.close(handle)
            save_packing(file, packing)
            self._server.library.add(name, Path(file))
            self._server.library.prepare(name)
            with self._lock:
                del self._packing[name]
        except Exception as error:  # noqa: BLE001  (whatever a mesh holds, the node lives on)
            reason = str(error) if isinstance(error, UncPhysicsError) else f"{type(error).__name__}: {error}"
            self._server.log.error(printable(f"model '{name}' could not be packed: {reason}"))
            with self._lock:
                self._packing[name] = ModelInfo(
                    name=name, status=ModelInfo.STATUS_FAILED, status_msg=reason, path=str(path)
                )
        self._publish()


def _solid(path):
    """What a mesh encloses; whoever asks for what is none should know at once."""
    try:
        from ..geometry.solid_mesh import load_solid

        solid, _ = load_solid(path)
    except ImportError as error:
        raise NotSupportedError(
            f"is no model (.npz), and to read a mesh the node lacks {error.name}",
            field="path",
            value=str(path),
        ) from None
    return solid


def _info(library, name, path):
    """What is known about a model; one that cannot be read says why."""
    info = ModelInfo(name=name, status=ModelInfo.STATUS_READY, path=str(path))
    try:
        packing = library.shape(name)
    except UncPhysicsError as error:
        info.status, info.status_msg = ModelInfo.STATUS_FAILED, str(error)
        return info
    info.spheres = len(packing)
    info.volume, info.fill = float(packing.volume), float(packing.fill)
    info.bounding_radius = float(packing.bounding_radius)
    radii = packing.radii[:, None]
    info.bounds_min = _point((packing.centers - radii).min(axis=0) - packing.origin)
    info.bounds_max = _point((packing.centers + radii).max(axis=0) - packing.origin)
    info.mass = packing.mass or 0.0
    info.center_of_mass = _point(-packing.origin)
    info.inertia = np.array(packing.inertia.ravel())
    info.mesh_sha256 = packing.mesh_sha256 or ""
    return info


def _point(v):
    x, y, z = v.tolist()
    return Point(x=x, y=y, z=z)
