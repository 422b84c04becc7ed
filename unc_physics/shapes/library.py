"""The model library: finds packings by name."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

from ..checks.errors import UnknownModelError
from ..checks.names import suggestion
from ..checks.validation import instance
from .packing_file import SpherePacking, load_packing

#: Endings of files of which `pack` makes models.
MESHES = (".3mf", ".dae", ".glb", ".gltf", ".obj", ".off", ".ply", ".sdf", ".stl", ".urdf", ".xml")
SHARE = Path("share") / "unc_physics" / "models"
_CHECKOUT = Path(__file__).resolve().parents[2]


def cache_dir() -> Path:
    """Return the user's folder for packings too large to ship: ``$XDG_CACHE_HOME/unc_physics/models``."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "unc_physics" / "models"


def models_dirs(models_dir=None) -> list[Path]:
    """Return the folders that are searched for models, in the order of the search.

    If ``models_dir`` or the environment variable ``UNC_PHYSICS_MODELS`` is set, this is the only folder.
    Otherwise they are the source checkout's ``models``, the share folders of each ROS prefix
    (``AMENT_PREFIX_PATH``, overlays first) and of the Python installation, and the user's cache.
    """
    chosen = models_dir or os.environ.get("UNC_PHYSICS_MODELS")
    if chosen:
        try:
            return [Path(chosen).expanduser()]
        except RuntimeError:  # no such home
            return [Path(chosen)]
    prefixes = [*filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)), sys.prefix]
    folders = [_CHECKOUT / "models"] if (_CHECKOUT / "models" / "bunny.npz").is_file() else []
    folders += [Path(prefix) / SHARE for prefix in prefixes]
    return [folder for folder in dict.fromkeys([*folders, cache_dir()]) if folder.is_dir()]


def list_models(models_dir: str | os.PathLike[str] | None = None) -> dict[str, Path]:
    """Return the files of all models in the library by their names, sorted by name.

    Raises
    ------
    UnknownModelError
        If the chosen folder does not exist.
    """
    found: dict[str, Path] = {}
    for folder in models_dirs(models_dir):
        if not folder.is_dir():
            raise UnknownModelError("is no folder", field="folder of models", value=str(folder))
        for path in sorted(folder.glob("*.npz")):
            found.setdefault(path.stem, path)
    return dict(sorted(found.items()))


def find_model(name_or_path, models_dir=None) -> Path:
    """Return the file of a model, given by its name in the library or by a path that ends in ``.npz``.

    Raises `UnknownModelError` if there is none; the message lists the known models and the folders searched.
    """
    instance(name_or_path, (str, os.PathLike), "name_or_path")
    text = os.fspath(name_or_path)
    if text.endswith(".npz") or os.sep in text:
        if not text.endswith(".npz"):
            raise UnknownModelError(
                "must be a model's name, or the path of a file that ends in .npz; the command pack makes"
                " one of a mesh",
                field="model",
                value=text,
            )
        try:
            path = Path(text).expanduser()
            if path.is_file():
                return path
        except (OSError, RuntimeError, ValueError):  # no such home, a name too long, a null character
            pass
        raise UnknownModelError("is no file", field="model", value=text)
    for folder in models_dirs(models_dir):
        with suppress(OSError, ValueError):  # a name too long, a null character
            if (path := folder / f"{text}.npz").is_file():
                return path
    try:
        models = list_models(models_dir)
    except UnknownModelError as error:
        raise UnknownModelError(
            f"cannot be looked up: {error.value} is no folder", field="model", value=text
        ) from None
    if text.lower().endswith(MESHES):
        raise UnknownModelError(
            "is a mesh, and no model; the command pack makes a model of it", field="model", value=text
        )
    folders = ", ".join(str(folder) for folder in models_dirs(models_dir)) or "no folder"
    known = ", ".join(models) or "none"
    raise UnknownModelError(
        f"is unknown; the models in {folders} are: {known}{suggestion(text, models)}",
        field="model",
        value=text,
    )


def load_model(
    name_or_path: str | os.PathLike[str], models_dir: str | os.PathLike[str] | None = None
) -> SpherePacking:
    """Load a model by its name in the library or by the path of its file.

    Raises
    ------
    UnknownModelError
        If there is no such model.
    InvalidModelError
        If its file is unreadable or inconsistent.
    """
    return load_packing(find_model(name_or_path, models_dir))
