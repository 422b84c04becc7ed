"""Shapes that come in messages, as meshes or primitives: packed in the background, each once.

A request waits for the packing of a mesh that was never seen before, about a second, in a thread of its own;
the others go on. Streamed scenes leave the object out until it is packed.
"""

from __future__ import annotations

import functools
import hashlib
import threading
from collections import OrderedDict
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
from shape_msgs.msg import SolidPrimitive

from ..checks.errors import (
    InvalidEnvironmentError,
    InvalidMeshError,
    LimitExceededError,
    NotSupportedError,
    PredictionTimeoutError,
    UncPhysicsError,
    UnknownModelError,
)
from ..checks.validation import array, positive
from ..geometry.packing_file import SpherePacking
from ..geometry.primitives import primitive
from ..geometry.prisms import cone, prism
from ..scene.body import tree_of

#: Spheres of a shape for which a message names no number.
SPHERES = 300
#: Longest that a request waits for a packing [s].
WAIT = 60.0
#: Most triangles of a mesh.
TRIANGLES_LIMIT = 200_000
_KEPT = 256  # shapes, the latest ones
#: Number of dimensions of each kind of primitive.
DIMENSIONS = {
    SolidPrimitive.BOX: 3,
    SolidPrimitive.SPHERE: 1,
    SolidPrimitive.CYLINDER: 2,
    SolidPrimitive.CONE: 2,
    SolidPrimitive.PRISM: 1,
}


class ArrivingShapes:
    """Packs shapes in a thread of its own, and keeps what it packed by the hash of what came."""

    def __init__(self):
        self._packer = ThreadPoolExecutor(1, thread_name_prefix="packing")
        self._lock = threading.Lock()
        self._packings: OrderedDict[str, Future[SpherePacking]] = OrderedDict()

    def close(self) -> None:
        """Begin no further packing; one that runs is left to end."""
        self._packer.shutdown(wait=False, cancel_futures=True)

    def of_mesh(self, message, spheres: int, field: str, wait: bool = True) -> SpherePacking:
        """The packing of a closed mesh.

        Parameters
        ----------
        message : shape_msgs/Mesh
            [m]
        spheres : int
            How many; 0 takes `SPHERES`.
        field : str
            What errors call it.
        wait : bool
            Whether to wait for it, `WAIT` at most.

        Raises
        ------
        InvalidMeshError, LimitExceededError
            If it is no solid, or too large.
        PredictionTimeoutError
            If it is still being packed after that time.
        UnknownModelError
            If it is not packed yet, without waiting.
        NotSupportedError
            If the node cannot pack meshes.
        """
        triangles = np.array([entry.vertex_indices for entry in message.triangles], np.int64).reshape(-1, 3)
        if len(triangles) > TRIANGLES_LIMIT:
            raise LimitExceededError(
                f"must be at most {TRIANGLES_LIMIT}", field=f"{field}.triangles", value=len(triangles)
            )
        vertices = np.array([(v.x, v.y, v.z) for v in message.vertices], float).reshape(-1, 3)
        if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(vertices):
            raise InvalidMeshError(
                f"must be indices of the {len(vertices)} vertices", field=f"{field}.triangles"
            )
        return self._packed(vertices, triangles, spheres or SPHERES, field, wait)

    def of_primitive(self, message, spheres: int, field: str, wait: bool = True) -> SpherePacking:
        """The packing of a primitive; the arguments and errors are as those of `of_mesh`."""
        size = read_dimensions(message, field)
        if message.type == SolidPrimitive.SPHERE:
            return _ball(size[SolidPrimitive.SPHERE_RADIUS])
        try:
            vertices, triangles = _mesh(message, size)
        except InvalidMeshError as error:
            raise InvalidMeshError(error.problem, field=f"{field}.{error.field}", value=error.value) from None
        except ImportError as error:
            raise NotSupportedError(f"needs {error.name}, which the node lacks", field=field) from None
        return self._packed(vertices, triangles, spheres or SPHERES, field, wait)

    def _packed(self, vertices, triangles, spheres, field, wait):
        digest = hashlib.sha256(vertices.astype("<f8").tobytes() + triangles.astype("<i8").tobytes())
        key = f"{digest.hexdigest()}_{spheres}"
        with self._lock:
            if key not in self._packings:
                name = f"mesh_{digest.hexdigest()[:12]}"
                self._packings[key] = self._packer.submit(_pack, name, vertices, triangles, spheres)
                while len(self._packings) > _KEPT:
                    self._packings.popitem(last=False)
            self._packings.move_to_end(key)
            future = self._packings[key]
        if not wait and not future.done():
            raise UnknownModelError("is being packed", field=field)
        try:
            return future.result(WAIT)
        except UncPhysicsError as error:
            raise type(error)(error.problem, field=field, value=error.value) from None
        except TimeoutError:
            raise PredictionTimeoutError(
                f"is still being packed after {WAIT:g} s; ask again", field=field
            ) from None


def read_dimensions(message, field: str) -> tuple[float, ...]:
    """The dimensions of a primitive [m].

    Raises
    ------
    InvalidEnvironmentError
        If it is of no known kind, or they are not as many as its kind has, each above 0.
    """
    if message.type not in DIMENSIONS:
        raise InvalidEnvironmentError("is no kind of primitive", field=f"{field}.type", value=message.type)
    shape, field = (DIMENSIONS[message.type],), f"{field}.dimensions"
    size = array(message.dimensions, shape, field, InvalidEnvironmentError).tolist()
    return tuple(positive(value, f"{field}[{k}]", InvalidEnvironmentError) for k, value in enumerate(size))


def _mesh(message, size):
    """Vertices and triangles of a primitive."""
    if message.type == SolidPrimitive.BOX:
        return primitive("box", size)
    if message.type == SolidPrimitive.PRISM:
        polygon = np.array([(point.x, point.y) for point in message.polygon.points], float).reshape(-1, 2)
        return prism(polygon, size[SolidPrimitive.PRISM_HEIGHT])
    radius, height = size[SolidPrimitive.CYLINDER_RADIUS], size[SolidPrimitive.CYLINDER_HEIGHT]
    return (
        cone(radius, height)
        if message.type == SolidPrimitive.CONE
        else primitive("cylinder", (radius, height))
    )


@functools.lru_cache(maxsize=_KEPT)
def _ball(radius):
    """A ball is one sphere."""
    return SpherePacking(
        name="sphere",
        centers=np.zeros((1, 3)),
        radii=np.array([radius]),
        inertia=0.4 * radius**2 * np.eye(3),
        volume=4.0 / 3.0 * np.pi * radius**3,
        origin=np.zeros(3),
        bounding_radius=radius,
    )


def _pack(name, vertices, triangles, spheres):
    """The packing; also builds its sphere tree, so that the request need not."""
    try:
        from ..geometry.packing import pack_solid
        from ..geometry.solid_mesh import make_solid

        packing = pack_solid(make_solid(name, vertices, triangles), spheres, threads=1)
    except ImportError as error:
        raise NotSupportedError(f"needs {error.name}, which the node lacks, to be packed") from None
    tree_of(packing)
    return packing
