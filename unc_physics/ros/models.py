"""Models that objects refer to, and shapes in messages, which are packed in the background.

Packing a new mesh takes about a second, in a separate thread, for which a request waits. Streamed scenes omit
an object until it is packed.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import threading
from collections import OrderedDict
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from shape_msgs.msg import SolidPrimitive

from unc_physics_msgs.msg import ModelInfo, ModelList
from unc_physics_msgs.srv import LoadModel

from ..checks.errors import (
    DuplicateIdError,
    InvalidMeshError,
    InvalidModelError,
    InvalidRequestError,
    LimitExceededError,
    NotSupportedError,
    PredictionTimeoutError,
    UncPhysicsError,
    UnknownModelError,
)
from ..checks.names import suggestion
from ..checks.shown import counted, printable
from ..scene.entries import at_field
from ..scene.scene_file import cut_shape, load_shape
from ..shapes.library import list_models
from ..shapes.packing_file import HULL, SpherePacking, load_packing
from ..shapes.primitive_models import SPHERES, ball, primitive_model
from ..shapes.primitives import cone, prism
from .messages.environment import read_dimensions
from .messages.fields import point_message
from .services import LATCHED, BackgroundService

#: Longest time for which a request waits for a packing [s].
PACKING_TIMEOUT = 60.0
#: Largest number of triangles of a mesh.
MAX_TRIANGLES = 200_000
#: Largest number of spheres with which a mesh is packed.
MAX_SPHERES = 100_000
#: Time for cutting a mesh into convex pieces in the background [s]; afterwards it keeps its hull.
CUTTING_TIMEOUT = 60.0
_CACHED_SHAPES = 256
_SCALES = 1e-6, 1e6
_DEFAULT_MODEL_SPHERES = 1000


class ModelLibrary:
    """Models by name, of files and of shapes; for an unknown name the folder is scanned again.

    Parameters
    ----------
    models_dir : str
        Folder of the models; empty means the package's library.
    allow_paths : bool
        Whether a model may also be named by the path of its file (``.npz``).
    """

    def __init__(self, models_dir: str = "", allow_paths: bool = False):
        self._models_dir = models_dir or None
        self._allow_paths = allow_paths
        self._lock = threading.Lock()
        self._models: dict[str, Path | SpherePacking] = {}
        self.shape_packer = ShapePacker()
        self._scan()

    def discard(self) -> None:
        """End the packing of shapes."""
        self.shape_packer.close()

    def _scan(self):
        found = {}
        with contextlib.suppress(UnknownModelError):  # the folder may appear later
            found = list_models(self._models_dir)
        with self._lock:
            self._models = found | self._models

    @property
    def models(self) -> dict[str, Path | SpherePacking]:
        """Files or packings of the models by their names, sorted by name."""
        with self._lock:
            return dict(sorted(self._models.items()))

    def shape(self, model: str, spheres: int = 0, scale: float = 0.0) -> SpherePacking:
        """Return a model's first ``spheres`` (0: all), with lengths times ``scale`` (0: 1).

        Raises
        ------
        UnknownModelError, InvalidModelError
        """
        if scale and not _SCALES[0] <= scale <= _SCALES[1]:
            raise InvalidModelError(
                f"must be 0 or between {_SCALES[0]:g} and {_SCALES[1]:g}", field="scale", value=scale
            )
        found = self._find(model)
        if isinstance(found, SpherePacking):
            return cut_shape(found, spheres or None, scale or 1.0)
        return load_shape(str(found), spheres or None, scale or None)

    def _find(self, model):
        if model in self:
            return self._models[model]
        by_path = self._allow_paths and model.endswith(".npz")
        if by_path and os.path.isfile(model):
            return model
        known = self.models
        problem = f"is unknown{suggestion(model, known)}; the models are: {', '.join(known) or 'none'}"
        if by_path:
            problem = "is no file on the node's machine"
        elif model.endswith(".npz"):
            problem = "must be a name, as the parameter allow_model_paths is false"
        raise UnknownModelError(problem, field="model", value=model)

    def __contains__(self, model: str) -> bool:
        """Return whether a model is known by its name."""
        if model not in self._models:
            self._scan()
        return model in self._models

    def add(self, name: str, model: Path | SpherePacking) -> None:
        """Add a model; it replaces one of the same name."""
        with self._lock:
            self._models = self._models | {name: model}


class ShapePacker:
    """Packer of shapes in a separate thread, with a cache by the hash of the shape.

    A mesh that is neither convex nor a simple shape has its hull as its piece at first. Another thread cuts
    it into convex pieces if coacd is installed; afterwards the cache has the same spheres with these pieces.
    """

    def __init__(self):
        self._packer = ThreadPoolExecutor(1, thread_name_prefix="packing")
        self._cutter = ThreadPoolExecutor(1, thread_name_prefix="cutting")
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._packings: OrderedDict[str, Future[SpherePacking]] = OrderedDict()
        self._pieces: OrderedDict[str, dict] = OrderedDict()  # of the cutter's thread alone, by digest

    def close(self) -> None:
        """Cancel waiting packings, and stop cutting; a running packing continues."""
        self._stop.set()
        for executor in (self._packer, self._cutter):
            executor.shutdown(wait=False, cancel_futures=True)

    def of_mesh(self, message, spheres: int, field: str, wait: bool = True) -> SpherePacking:
        """Return the packing of a closed mesh.

        Parameters
        ----------
        message : shape_msgs/Mesh
            [m]
        spheres : int
            Number of spheres; 0 means `SPHERES`.
        field : str
            Name in error messages.
        wait : bool
            Whether to wait for the packing, at most `PACKING_TIMEOUT`.

        Raises
        ------
        InvalidMeshError, LimitExceededError
            If it does not enclose a solid, or is too large.
        PredictionTimeoutError
            If it is not packed after that time.
        UnknownModelError
            If it is not packed yet and ``wait`` is false.
        NotSupportedError
            If the node cannot pack meshes.
        """
        triangles = np.array([entry.vertex_indices for entry in message.triangles], np.int64).reshape(-1, 3)
        if len(triangles) > MAX_TRIANGLES:
            raise LimitExceededError(
                f"must be at most {MAX_TRIANGLES}", field=f"{field}.triangles", value=len(triangles)
            )
        vertices = np.array([(v.x, v.y, v.z) for v in message.vertices], float).reshape(-1, 3)
        if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(vertices):
            raise InvalidMeshError(
                f"must be indices of the {len(vertices)} vertices", field=f"{field}.triangles"
            )
        return self._packed(vertices, triangles, spheres or SPHERES, field, wait)

    def of_primitive(self, message, spheres: int, field: str, wait: bool = True) -> SpherePacking:
        """Return the packing of a primitive; arguments and errors are as in `of_mesh`."""
        size = read_dimensions(message, field)
        simple = _simple(message, size)
        if simple is not None:
            return simple.prefix(spheres) if spheres and len(simple) > 1 else simple
        with _needs_libraries(field):
            vertices, triangles = at_field(field, _mesh, message, size)
        return self._packed(vertices, triangles, spheres or SPHERES, field, wait)

    def _packed(self, vertices, triangles, spheres, field, wait):
        if spheres > MAX_SPHERES:
            raise LimitExceededError(f"must be at most {MAX_SPHERES}", field="spheres", value=spheres)
        digest = hashlib.sha256(vertices.astype("<f8").tobytes() + triangles.astype("<i8").tobytes())
        key = f"{digest.hexdigest()}_{spheres}"
        with self._lock:
            if key not in self._packings:
                name = f"mesh_{digest.hexdigest()[:12]}"
                shape = name, vertices, triangles
                self._packings[key] = self._packer.submit(self._pack, key, shape, spheres)
                while len(self._packings) > _CACHED_SHAPES:
                    self._packings.popitem(last=False)
            self._packings.move_to_end(key)
            future = self._packings[key]
        if not wait and not future.done():
            raise UnknownModelError("is being packed", field=field)
        try:
            return future.result(PACKING_TIMEOUT)
        except UncPhysicsError as error:
            raise error.at(field) from None
        except TimeoutError:
            raise PredictionTimeoutError(
                f"is still being packed after {PACKING_TIMEOUT:g} s; ask again", field=field
            ) from None

    def _pack(self, key, shape, spheres):
        """Return a packing, and have its mesh cut in the background if it has only its hull."""
        name, vertices, triangles = shape
        packing = _pack(name, vertices, triangles, spheres)
        if packing.pieces_kind == HULL and find_spec("coacd") is not None:
            with contextlib.suppress(RuntimeError):  # the node is closing
                self._cutter.submit(self._cut, key, packing, shape)
        return packing

    def _cut(self, key, packing, shape):
        """Put a packing with convex pieces in place of one with a hull; if cutting fails, the hull stays."""
        from ..shapes.mesh_pieces import mesh_pieces
        from ..shapes.solid_mesh import make_solid

        digest = key.partition("_")[0]
        if digest not in self._pieces:
            self._pieces[digest] = {}
            with contextlib.suppress(UncPhysicsError, OSError):  # TimeoutError is an OSError
                found = mesh_pieces(make_solid(*shape), seconds=CUTTING_TIMEOUT, threads=1, stop=self._stop)
                self._pieces[digest] = found.entries
            while len(self._pieces) > _CACHED_SHAPES:
                self._pieces.popitem(last=False)
        if self._pieces[digest]:
            better: Future[SpherePacking] = Future()
            better.set_result(replace(packing, **self._pieces[digest]))
            with self._lock:
                if key in self._packings:
                    self._packings[key] = better


class ModelTopics:
    """The service ``~/load_model`` and the latched topic ``~/models``."""

    def __init__(self, server):
        self._server = server
        self._packer = ThreadPoolExecutor(1)
        self._packing: dict[str, ModelInfo] = {}  # meshes that are being packed, or whose packing failed
        self._lock = threading.Lock()
        self._loading = threading.Lock()
        self._publisher = server.node.create_publisher(ModelList, "~/models", LATCHED)
        self._service = BackgroundService(server, LoadModel, "~/load_model", self._load)
        self._publish()

    def close(self):
        """Withdraw services and topic; a running packing continues."""
        self._service.close()
        self._server.node.destroy_publisher(self._publisher)
        self._packer.shutdown(wait=False, cancel_futures=True)

    def _infos(self):
        library = self._server.library
        with self._lock:
            infos = dict(self._packing)
        for name, model in library.models.items():
            infos.setdefault(name, _info(library, name, model))
        return [infos[name] for name in sorted(infos)]

    def _publish(self):
        message = ModelList(models=self._infos())
        message.header.stamp = self._server.node.get_clock().now().to_msg()
        message.header.frame_id = self._server.settings.world_frame
        self._publisher.publish(message)

    def _load(self, request, response):
        with self._server.errors_into(response.result), self._loading:
            response.model = self._read(request)
            self._publish()

    def _read(self, request):
        """Read a model file, or start to pack a mesh; return the model's entry."""
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
            library.shape(name)
            return _info(library, name, path)
        if request.spheres > MAX_SPHERES:
            raise LimitExceededError(f"must be at most {MAX_SPHERES}", field="spheres", value=request.spheres)
        name = request.name or path.stem
        self._refuse_taken(name, request.replace)
        with _needs_libraries("path"):
            from ..shapes.solid_mesh import load_solid

            solid, _ = load_solid(path)
        info = ModelInfo(
            name=name, status=ModelInfo.STATUS_PACKING, status_msg="is being packed", path=str(path)
        )
        with self._lock:
            self._packing[name] = info
        self._packer.submit(self._pack, name, path, solid, request.spheres or _DEFAULT_MODEL_SPHERES)
        return info

    def _refuse_taken(self, name, replaces):
        with self._lock:
            packing = self._packing.get(name)
        if packing is not None and packing.status == ModelInfo.STATUS_PACKING:
            raise DuplicateIdError("is being packed just now", field="name", value=name)
        if not replaces and name in self._server.library.models:
            raise DuplicateIdError(
                "is the name of a model; set replace to replace it", field="name", value=name
            )

    def _pack(self, name, path, solid, spheres):
        """Pack a mesh in the background, then publish the list of models."""
        try:
            from ..shapes.mesh_pieces import best_pieces
            from ..shapes.packing import pack_solid

            # one thread: predictions have priority
            found = best_pieces(solid, seconds=CUTTING_TIMEOUT, threads=1)
            pieces: dict[str, Any] = found.entries if found else {"pieces": ()}
            packing = pack_solid(solid, spheres, threads=1, **pieces).named(name)
            self._server.library.add(name, packing)
            with self._lock:
                del self._packing[name]
        except Exception as error:  # noqa: BLE001  (no mesh may end the node)
            reason = str(error) if isinstance(error, UncPhysicsError) else f"{type(error).__name__}: {error}"
            self._server.log.error(printable(f"model '{name}' could not be packed: {reason}"))
            with self._lock:
                self._packing[name] = ModelInfo(
                    name=name, status=ModelInfo.STATUS_FAILED, status_msg=reason, path=str(path)
                )
        self._publish()


def _simple(message, size):
    """Return the model of a ball, box or cylinder, which no mesh is needed for; None for others."""
    if message.type == SolidPrimitive.SPHERE:
        return ball(size[SolidPrimitive.SPHERE_RADIUS])
    if message.type == SolidPrimitive.BOX:
        return primitive_model("box", size=size)
    if message.type == SolidPrimitive.CYLINDER:
        radius, length = size[SolidPrimitive.CYLINDER_RADIUS], size[SolidPrimitive.CYLINDER_HEIGHT]
        return primitive_model("cylinder", radius=radius, length=length)
    return None


def _mesh(message, size):
    """Return vertices and triangles of a prism or a cone."""
    if message.type == SolidPrimitive.PRISM:
        polygon = np.array([(point.x, point.y) for point in message.polygon.points], float).reshape(-1, 2)
        return prism(polygon, size[SolidPrimitive.PRISM_HEIGHT])
    return cone(size[SolidPrimitive.CONE_RADIUS], size[SolidPrimitive.CONE_HEIGHT])


def _pack(name, vertices, triangles, spheres):
    """Return the packing of a mesh."""
    with _needs_libraries("mesh"):
        from ..shapes.mesh_pieces import hull_pieces, simple_pieces
        from ..shapes.packing import pack_solid
        from ..shapes.solid_mesh import make_solid

        solid = make_solid(name, vertices, triangles)
        pieces: dict[str, Any] = {"pieces": ()}
        if simple := simple_pieces(solid):
            pieces = {"pieces": simple[0], "pieces_kind": simple[1]}
        else:
            with contextlib.suppress(InvalidMeshError):  # too flat
                pieces = hull_pieces(solid).entries
        return pack_solid(solid, spheres, threads=1, **pieces)


@contextlib.contextmanager
def _needs_libraries(field):
    """Raise `NotSupportedError` if a library is missing that a ``with`` block imports."""
    try:
        yield
    except ImportError as error:
        raise NotSupportedError(f"needs {error.name}, which the node lacks", field=field) from None


def _info(library, name, model):
    """Return the entry of a model; for an unreadable one, with the reason."""
    path = model if isinstance(model, Path) else ""
    try:
        return packing_info(library.shape(name), name, path)
    except UncPhysicsError as error:
        return ModelInfo(name=name, status=ModelInfo.STATUS_FAILED, status_msg=str(error), path=str(path))


def _pieces_text(packing):
    if packing.has_only_spheres:
        return "no pieces, only spheres: a small body can pass between them"
    return f"{counted(len(packing.pieces), 'piece')}: {packing.pieces_kind or 'of the file'}"


def packing_info(packing: SpherePacking, name: str, path: str | Path = "") -> ModelInfo:
    """Return the message that describes a model."""
    info = ModelInfo(name=name, status=ModelInfo.STATUS_READY, path=str(path))
    info.spheres = len(packing)
    info.status_msg = _pieces_text(packing)
    info.volume, info.fill = float(packing.volume), float(packing.fill)
    info.bounding_radius = float(packing.bounding_radius)
    low, high = packing.corners - packing.origin
    info.bounds_min, info.bounds_max = point_message(low), point_message(high)
    info.mass = packing.mass or 0.0
    info.center_of_mass = point_message(-packing.origin)
    info.inertia = np.array(packing.inertia.ravel())
    info.mesh_sha256 = packing.mesh_sha256 or ""
    return info
