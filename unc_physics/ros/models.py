"""The models that objects of a request can refer to by name."""

from __future__ import annotations

import contextlib
import functools
import os
import tempfile
import threading
from pathlib import Path

from ..checks.errors import InvalidModelError, LimitExceededError, UnknownModelError
from ..geometry.library import list_models
from ..geometry.packing_file import SpherePacking
from ..scene.body import tree_of
from ..scene.scene_file import load_shape
from .arriving_shapes import ArrivingShapes

_SCALES = 1e-6, 1e6


class ModelLibrary:
    """Files of models by name; a name that is not known yet is looked for in the folder again.

    A file is read once: one that changes later is read again when `add` names it.

    Parameters
    ----------
    models_dir : str
        Folder of the models; empty takes the package's library.
    allow_paths : bool
        Whether a model may also be named by the path of its file (``.npz``).
    """

    def __init__(self, models_dir: str = "", allow_paths: bool = False):
        self._models_dir = models_dir or None
        self._allow_paths = allow_paths
        self._lock = threading.Lock()
        self._paths: dict[str, Path] = {}
        self._shape = functools.lru_cache(maxsize=256)(load_shape)
        self.arriving = ArrivingShapes()
        self._scan()

    @functools.cached_property
    def packed(self) -> tempfile.TemporaryDirectory:
        """Folder of the meshes that are packed at run time."""
        return tempfile.TemporaryDirectory(prefix="unc_physics_models_")

    def discard(self) -> None:
        """Delete what was packed at run time."""
        self.arriving.close()
        if "packed" in self.__dict__:
            self.packed.cleanup()

    def _scan(self):
        found = {}
        with contextlib.suppress(UnknownModelError):  # a folder may be there later
            found = list_models(self._models_dir)
        with self._lock:
            for name, path in found.items():
                self._paths.setdefault(name, path)

    @property
    def paths(self) -> dict[str, Path]:
        """Names and files, sorted by name."""
        with self._lock:
            return dict(sorted(self._paths.items()))

    def shape(
        self, model: str, spheres: int = 0, scale: float = 0.0, max_spheres: int | None = None
    ) -> SpherePacking:
        """The packing of a model: its first ``spheres`` (0: all), its lengths times ``scale`` (0: 1).

        Raises
        ------
        UnknownModelError, InvalidModelError, LimitExceededError
        """
        if scale and not _SCALES[0] <= scale <= _SCALES[1]:
            raise InvalidModelError(
                f"must be 0 or between {_SCALES[0]:g} and {_SCALES[1]:g}", field="scale", value=scale
            )
        packing = self._shape(str(self._path(model)), spheres or None, scale or None)
        if max_spheres is not None and len(packing) > max_spheres:
            raise LimitExceededError(
                f"must be at most {max_spheres}; ask for fewer", field="spheres", value=len(packing)
            )
        return packing

    def _path(self, model):
        by_path = self._allow_paths and model.endswith(".npz") and model not in self._paths
        if by_path and os.path.isfile(model):
            return model
        if model not in self._paths:
            self._scan()
        with self._lock:
            if model not in self._paths:
                known = ", ".join(sorted(self._paths)) or "none"
                raise UnknownModelError(f"is unknown; the models are: {known}", field="model", value=model)
            return self._paths[model]

    def add(self, name: str, path: Path) -> None:
        """Let a name stand for a model file, whatever it stood for before."""
        with self._lock:
            self._paths[name] = path
        self._shape.cache_clear()

    def prepare(self, name: str) -> SpherePacking:
        """Read a model and build its sphere tree, so that the first request need not."""
        packing = self.shape(name)
        tree_of(packing)
        return packing
