"""Read scene files: YAML with bodies, their uncertain states, and the physics."""

from __future__ import annotations

import dataclasses
import functools
import os
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..checks.errors import (
    InvalidEnvironmentError,
    InvalidHorizonError,
    InvalidMassError,
    InvalidModelError,
    InvalidOptionError,
    InvalidRequestError,
    NoObjectsError,
    UncPhysicsError,
)
from ..checks.names import one_of
from ..checks.validation import flag, integer, positive
from ..shapes.library import find_model
from ..shapes.packing_file import load_packing
from ..shapes.primitive_models import SIZES, primitive_model
from ..spatial.layout import ERROR
from .action_entries import read_path, read_wrenches
from .belief import Belief
from .body import RigidBody
from .body_belief import BodyBelief
from .entries import ORIENTATION, ROLL_PITCH_YAW, at_field, check_keys, read_orientation
from .environment import ELEMENTS, Element, quantities
from .materials import Surface
from .physics_keys import OVERLAPS, PHYSICS_KEYS
from .presets import EXACT_PRESETS, PRESETS, with_changes
from .scene import Scene
from .stiffness import AUTO, auto_stiffness
from .yaml_file import read_yaml

#: Key of a scene file that names a preset; other keys of the physics override it.
PRESET = "physics"
#: Key for the preset without uncertain materials and errors of impacts.
EXACT = "exact"
_COMMON_STD, _COMMON_ORIGIN = "common_pose_std", "common_pose_origin"
_SCENE_KEYS = (
    PRESET,
    EXACT,
    *PHYSICS_KEYS,
    "horizon",
    "bodies",
    "environment",
    "pairs",
    _COMMON_STD,
    _COMMON_ORIGIN,
)


def _fields(kind):
    """Return the names of a dataclass's fields."""
    return tuple(spec.name for spec in dataclasses.fields(kind))


_SURFACE_KEYS, _ELEMENT_KEYS = _fields(Surface), ("name", *_fields(Element))
_BELIEF_KEYS, _RIGID_KEYS = _fields(BodyBelief), _fields(RigidBody)
_BODY_KEYS = tuple(
    dict.fromkeys(("name", "model", "shape", "spheres", "scale", "mass", *_BELIEF_KEYS, *_RIGID_KEYS))
)


class LoadedScene(NamedTuple):
    """Content of a scene file: the scene, the belief at time 0, and the horizon [s] or None."""

    scene: Scene
    belief: Belief
    horizon: float | None


def load_scene(path: str | os.PathLike[str], models_dir: str | os.PathLike[str] | None = None) -> LoadedScene:
    """Read a scene file.

    Parameters
    ----------
    path : str or path-like
        YAML file; model paths in it are relative to its folder.
    models_dir : str or path-like, optional
        Folder that replaces the model library in the look-up of model names.

    Raises
    ------
    UncPhysicsError
        A subclass that names field and value, if the file does not describe a valid scene.
    """
    content = read_yaml(path, "scene file")
    try:
        return scene_from_dict(content, models_dir, folder=Path(path).parent)
    except UncPhysicsError as error:
        raise error.at(
            f"{Path(path).name}: {_by_name(error.field or '', content)}".removesuffix(": ")
        ) from error


def _by_name(field, content):
    """Return the place of an error with the name of the body or element in place of its index."""
    parts = re.fullmatch(r"(bodies|environment)\[(\d+)\](.*)", field, re.DOTALL)
    if parts is None:
        return field
    name = entry.get("name") if isinstance(entry := content[parts[1]][int(parts[2])], dict) else None
    names = [other.get("name") for other in content[parts[1]] if isinstance(other, dict)]
    return f"{parts[1]}[{name}]{parts[3]}" if isinstance(name, str) and names.count(name) == 1 else field


def scene_from_dict(content, models_dir=None, folder=None) -> LoadedScene:
    """Return the scene that the content of a scene file describes (`load_scene`)."""
    if isinstance(content, dict) and "scene" in content and "actions" in content:
        raise InvalidRequestError(
            "is a file of actions, which version 0.3 does not read: give 'rank' a scene file for each action,"
            " and the score as --event",
            field="scene file",
        )
    check_keys(content, _SCENE_KEYS, "scene")
    bodies = content.get("bodies")
    if bodies is None or bodies == []:
        raise NoObjectsError("must name at least one body", field="bodies")
    if not isinstance(bodies, list):
        raise InvalidRequestError("must be a list", field="bodies", value=bodies)
    options, environment = physics_options(content), _environment(content.get("environment"))
    read = [_body(body, f"bodies[{k}]", models_dir, folder) for k, body in enumerate(bodies)]
    rigid, mean = [body for body, _, _ in read], np.array([state for _, state, _ in read])
    options = with_chosen_stiffness(options, rigid, mean)
    pairs = [] if content.get("pairs") is None else content["pairs"]
    scene = Scene(rigid, environment=environment, pairs=pairs, **options)
    blocks = [P for body, _, P in read if body.free]
    belief = Belief(mean, np.array(blocks).reshape(-1, ERROR, ERROR), scene.moving)
    belief = _with_common_error(belief, content)
    belief.check_fits(scene)
    horizon = content.get("horizon")
    return LoadedScene(
        scene, belief, None if horizon is None else positive(horizon, "horizon", InvalidHorizonError)
    )


def _with_common_error(belief, content):
    """Return the belief with the shared error of all moving bodies, if the file has one."""
    std, origin = content.get(_COMMON_STD), content.get(_COMMON_ORIGIN)
    if std is None:
        if origin is not None:
            raise InvalidRequestError(f"needs {_COMMON_STD} beside it", field=_COMMON_ORIGIN, value=origin)
        return belief
    return belief.with_common_pose_std(std, (0.0, 0.0, 0.0) if origin is None else origin)


def physics_options(content) -> dict:
    """Return the physics of a scene file as arguments of `Scene`; the stiffness may be `AUTO`.

    The preset of the key `PRESET`, by default everyday, provides defaults. Null disables a law; for other
    keys null means unset. Files of version 0.2 without the key, which meant paper, are refused if they show
    it by a stiffness or damping.
    """
    content = _with_spreads(content)
    name, exact = content.get(PRESET), content.get(EXACT)
    if name is None:
        name, of_paper = "everyday", [key for key in ("stiffness", "damping") if content.get(key) is not None]
        if of_paper:
            raise InvalidOptionError(
                f"must be given beside {of_paper[0]}: 'physics: paper', which files of version 0.2 without it"
                " meant, or 'physics: everyday', the default from version 0.3 on",
                field=PRESET,
            )
    given = {key: physics_value(key, content[key]) for key in PHYSICS_KEYS if key in content}
    found = with_changes(preset(name, False if exact is None else flag(exact, EXACT)), given)
    if found.get("stiffness") == AUTO and found.get("integrator") == "implicit":
        raise InvalidOptionError(
            "must be absent with 'integrator: implicit', whose contacts are rigid; the paper's 'explicit' has"
            " it",
            field="stiffness",
            value=AUTO,
        )
    return found


def _with_spreads(content, field="", error: type[UncPhysicsError] = InvalidRequestError):
    """Return entries in which a mapping of mean and std became two, of the quantity and of its std."""
    result = dict(content)
    for key in ("friction", "restitution"):
        entry = content.get(key)
        if not isinstance(entry, dict):
            continue
        check_keys(entry, ("mean", "std"), f"{field}{key}", error)
        for part in ("mean", "std"):
            if entry.get(part) is None:
                raise error("must be given", field=f"{field}{key}.{part}")
        if content.get(f"{key}_std") is not None:
            raise error(f"must not be given beside {key}.std", field=f"{field}{key}_std")
        result |= {key: entry["mean"], f"{key}_std": entry["std"]}
    return result


def preset(name, exact=False) -> dict:
    """Return the preset with that name (key `PRESET`), exact or not; an empty one for None."""
    if name is None:
        return {}
    if not isinstance(name, str) or name not in PRESETS:
        raise InvalidOptionError(one_of(name, PRESETS), field=PRESET, value=name)
    return (EXACT_PRESETS if exact else PRESETS)[name]


def physics_value(key, value):
    """Return the checked value of a key of the physics; None for null."""
    if value is None and key == "overlap":
        raise InvalidOptionError(
            f"must be one of {', '.join(OVERLAPS)}; leave it out for the integrator's own",
            field=key,
            value="null",
        )
    if value is None or (key == "stiffness" and value == AUTO):
        return value
    return PHYSICS_KEYS[key].check(value, key)


def with_chosen_stiffness(options, bodies, mean) -> dict:
    """Return arguments of `Scene` in which the stiffness is not `AUTO`.

    The explicit integrator takes the result of `auto_stiffness`, which limits penetration. The implicit one
    has no stiffness.
    """
    if options.get("stiffness") != AUTO:
        return options
    explicit = options.get("integrator", "explicit") == "explicit"
    kappa = auto_stiffness(bodies, mean, options.get("gravity", (0.0, 0.0, 0.0))) if explicit else None
    return options | {"stiffness": kappa}


def load_environment(path: str | Path) -> tuple[Element, ...]:
    """Return the elements of a file's key ``environment``; its other keys are ignored."""
    content = read_yaml(path, "environment file")
    if not isinstance(content, dict) or "environment" not in content:
        raise InvalidEnvironmentError("must have the key 'environment'", field=str(path))
    return _environment(content["environment"])


def _environment(content):
    """Return the elements that a list of mappings describes."""
    if content is None:
        return ()
    if not isinstance(content, list):
        raise InvalidEnvironmentError("must be a list", field="environment", value=content)
    return tuple(_element(element, f"environment[{k}]") for k, element in enumerate(content))


def _element(content, field):
    """Return an element; errors name the entry in the file."""
    error = InvalidEnvironmentError
    shapes = ", ".join(ELEMENTS)
    if isinstance(content, dict) and not any(kind in content for kind in ELEMENTS):
        other = [key for key in content if key not in _ELEMENT_KEYS]
        problem = f"has no shape '{str(other[0])[:50]}'" if other else "names no shape"
        raise error(f"{problem}; the shapes are {shapes}", field=field)
    check_keys(content, ("name", *ELEMENTS, *_ELEMENT_KEYS[1:]), field, error)
    kinds = [kind for kind in ELEMENTS if kind in content]
    if len(kinds) > 1:
        raise error(f"must be exactly one shape, not {' and '.join(kinds)}", field=field)
    kind, name = kinds[0], content.get("name", "")
    if not isinstance(name, str):
        raise error("must be a text", field=f"{field}.name", value=name)
    entries, place = content[kind], f"{field}.{kind}"
    known = quantities(ELEMENTS[kind])
    turned = ROLL_PITCH_YAW if ORIENTATION in known else ""
    check_keys(entries, (*known, turned) if turned else known, place, error)
    for spec in dataclasses.fields(ELEMENTS[kind]):
        if spec.name in known and spec.default is dataclasses.MISSING and entries.get(spec.name) is None:
            raise error("must be given", field=f"{place}.{spec.name}")
    given = {key: value for key, value in entries.items() if value is not None and key != ROLL_PITCH_YAW}
    if (orientation := read_orientation(entries, place, error)) is not None:
        given[ORIENTATION] = orientation
    content = _with_spreads(content, f"{field}.", error)
    given |= {key: content[key] for key in _ELEMENT_KEYS if content.get(key) is not None}
    try:
        return ELEMENTS[kind](**given)
    except UncPhysicsError as caught:
        key = caught.field or ""
        raise caught.at(f"{field if key.partition('[')[0] in _ELEMENT_KEYS else place}.{key}") from caught


def _body(content, field, models_dir, folder):
    """A body, its state (13,) and its covariance (12, 12)."""
    check_keys(content, _BODY_KEYS, field)
    _check_texts(content, field)
    fixed, trajectory = flag(content.get("fixed", False), f"{field}.fixed"), _trajectory(content, field)
    content = {key: value for key, value in content.items() if value is not None or key == "shape"}
    content = _with_spreads(content, f"{field}.")
    known = {key: content[key] for key in _BELIEF_KEYS if key in content and key != ROLL_PITCH_YAW}
    belief = at_field(field, BodyBelief, **known | {ORIENTATION: read_orientation(content, field)})
    if fixed:
        _check_fixed(content, field, belief)
    spheres = content.get("spheres")
    if "shape" in content:
        if not fixed and trajectory is None and "mass" not in content:
            raise InvalidMassError("must be given for a body with a shape", field=f"{field}.mass")
        model = _primitive(content, field, spheres)
    else:
        model = at_field(
            field, load_shape, content["model"], spheres, content.get("scale"), models_dir, folder
        )
    given: dict[str, Any] = {key: content[key] for key in _RIGID_KEYS if key in content}
    given |= {"model": model, "trajectory": trajectory}
    given["wrenches"] = read_wrenches(content.get("wrenches", []), f"{field}.wrenches")
    try:
        body = RigidBody(**given)
    except UncPhysicsError as error:
        place = (error.field or "").replace(f" of body '{content['name']}'", "")
        raise error.at(f"{field}.{place}") from error
    belief = belief.at_center_of_mass(model.origin)
    state = belief.state if trajectory is None else trajectory.states[0]
    return body, state, belief.covariance


def _check_texts(content, field):
    """Raise an error for a body without a name, or without a model and a shape."""
    for key in ("name",) if "shape" in content else ("name", "model"):
        if not isinstance(content.get(key), str) or not content[key]:
            other = ", or give a shape" if key == "model" else ""
            raise InvalidRequestError(
                f"must be a non-empty text{other}", field=f"{field}.{key}", value=content.get(key)
            )


def _check_fixed(content, field, belief):
    """Raise an error for a belief or standard deviations that a fixed body cannot have."""
    problem = "must be zero or absent: the body is fixed"
    try:
        at_field(field, belief.check_fixed)
    except InvalidRequestError as error:
        if content.get("covariance") is None:
            raise
        raise InvalidRequestError(problem, field=f"{field}.covariance") from error
    for key in ("mass_std", "center_of_mass_std"):
        if np.any(content.get(key, 0.0)):
            raise InvalidRequestError(problem, field=f"{field}.{key}", value=content[key])


def _primitive(content, field, spheres):
    """Return the model of a body with the key ``shape``: a mapping of the shape's name to its sizes."""
    for key in ("model", "scale"):
        if content.get(key) is not None:
            raise InvalidRequestError(
                "must be absent beside shape", field=f"{field}.{key}", value=content[key]
            )
    place, given = f"{field}.shape", content["shape"]
    if not isinstance(given, dict) or len(given) != 1:
        raise InvalidRequestError(
            f"must be a mapping with one key of {', '.join(SIZES)}", field=place, value=given
        )
    check_keys(given, SIZES, place)
    ((kind, sizes),) = given.items()
    check_keys(sizes, SIZES[kind], f"{place}.{kind}")
    lengths = {key: value for key, value in sizes.items() if value is not None}
    packing = at_field(f"{place}.{kind}", primitive_model, kind, **lengths)
    return at_field(field, cut_shape, packing, spheres)


def _trajectory(content, field):
    """Return the path of a body, or None."""
    if content.get("trajectory") is None:
        return None
    for key in _BELIEF_KEYS:
        if content.get(key) is not None:
            raise InvalidRequestError(
                "must be absent: the body's trajectory says where it is", field=f"{field}.{key}"
            )
    return read_path(content["trajectory"], f"{field}.trajectory")


def load_shape(model, spheres=None, scale=None, models_dir=None, folder=None):
    """Return a packing from the library or a file, cut to its first ``spheres``, by default all, and scaled.

    The same arguments give the same object while the file is unchanged, so that its sphere tree is built
    once.
    """
    if folder is not None and model.endswith(".npz") and not model.startswith("~"):
        model = str(Path(folder) / model)
    path = find_model(model, models_dir)
    scale = 1.0 if scale is None else positive(scale, "scale", InvalidModelError)
    return cut_shape(_load_packing(path, path.stat().st_mtime_ns), spheres, scale)


def cut_shape(packing, spheres, scale=1.0):
    """Return the first spheres of a packing, scaled; the same arguments give the same object."""
    if spheres == AUTO:
        raise InvalidModelError(
            f"must be a positive integer; '{AUTO}' is gone since version 0.3, whose everyday scenes use exact"
            " shapes: leave it out",
            field="spheres",
            value=spheres,
        )
    if spheres is not None:
        spheres = integer(spheres, "spheres", low=1, error=InvalidModelError)
    return _cached_cut(packing, spheres, scale)


@functools.lru_cache(maxsize=256)
def _cached_cut(packing, spheres, scale):
    return (packing if spheres is None else packing.prefix(spheres)).scaled(scale)


@functools.lru_cache(maxsize=64)
def _load_packing(path, changed):
    return load_packing(path)
