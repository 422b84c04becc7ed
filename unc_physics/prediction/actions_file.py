"""Read files of actions: YAML with a scene, the actions of a robot, and events that count as success."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..checks.errors import InvalidRequestError
from ..checks.validation import flag
from ..scene.action_entries import read_path, read_wrenches
from ..scene.belief import Belief
from ..scene.entries import at_field, check_keys
from ..scene.scene import Scene
from ..scene.scene_file import scene_from_dict
from ..scene.yaml_file import read_yaml
from .actions import Action
from .event_entries import read_event, read_events, read_region
from .events import Event

_KEYS = ("scene", "horizon", "regions", "score", "smallest_first", "also", "actions")
#: Readers of fields that are not just numbers.
_READ: dict[str, Callable[[Any, str], Any]] = {"trajectory": read_path, "wrenches": read_wrenches}


class LoadedActions(NamedTuple):
    """Content of a file of actions."""

    scene: Scene
    belief: Belief
    horizon: float | None  # the file's own [s], or else the scene file's
    actions: dict[str, Action]
    score: Event
    smallest_first: bool
    also: tuple[Event, ...]  # further events, whose probabilities are reported for each action


def load_actions(
    path: str | os.PathLike[str], models_dir: str | os.PathLike[str] | None = None
) -> LoadedActions:
    """Read a file of actions; the scene file that it names is relative to its folder.

    ``models_dir`` is as for `load_scene`; errors name the field and the value.
    """
    content = read_yaml(path, "actions file")
    if isinstance(content, dict) and "bodies" in content:
        problem = "is a scene file, which 'predict' and 'view' take; name it as 'scene' in a file of actions"
        raise InvalidRequestError(problem, field="actions file", value=str(path))
    check_keys(content, _KEYS, "actions file")
    for key in ("scene", "score", "actions"):
        if content.get(key) is None:
            raise InvalidRequestError("must be given", field=key)
    (scene, belief, horizon), origins = _scene(content["scene"], Path(path).parent, models_dir)
    regions = _regions(content.get("regions") or [])
    actions = content["actions"]
    if not isinstance(actions, dict) or not actions:
        raise InvalidRequestError("must be a mapping of names to changes", field="actions", value=actions)
    return LoadedActions(
        scene,
        belief,
        content.get("horizon", horizon),
        {str(name): _action(changes, origins, f"actions['{name}']") for name, changes in actions.items()},
        read_events(content["score"], regions, "score"),
        flag(content.get("smallest_first", False), "smallest_first"),
        tuple(
            read_event(entry, regions, f"also[{k}]")
            for k, entry in enumerate(_list(content.get("also"), "also"))
        ),
    )


def _scene(content, folder, models_dir):
    """Return the embedded or the named scene, and the ``origin`` of each body that gives one."""
    if isinstance(content, str):
        path = folder / content
        content = read_yaml(path, "scene file")
        loaded = scene_from_dict(content, models_dir, path.parent)
    elif isinstance(content, dict):
        loaded = at_field("scene", scene_from_dict, content, models_dir, folder)
    else:
        raise InvalidRequestError("must be the path of a scene file, or its content", field="scene")
    return loaded, {body["name"]: body["origin"] for body in content["bodies"] if body.get("origin")}


def _regions(entries):
    """Return regions by their names."""
    found = {}
    for k, entry in enumerate(_list(entries, "regions")):
        field = f"regions[{k}]"
        region = read_region(entry, field)
        if region.name in found:
            raise InvalidRequestError("is the name of two regions", field=f"{field}.name", value=region.name)
        found[region.name] = region
    return found


def _list(value, field):
    if value is None:
        return []
    if not isinstance(value, list):
        raise InvalidRequestError("must be a list", field=field, value=value)
    return value


def _action(changes, origins, field) -> Any:
    """Return changes by the names of bodies and elements, with lists of numbers as arrays."""
    if not isinstance(changes, dict):
        problem = "must be a mapping of bodies and elements to fields and their values"
        raise InvalidRequestError(problem, field=field, value=changes)
    for name, change in changes.items():
        if not isinstance(change, dict):
            raise InvalidRequestError(
                "must be a mapping of fields to values", field=f"{field}.{name}", value=change
            )
    found = {
        str(name): {key: _entry(key, value, f"{field}.{name}.{key}") for key, value in change.items()}
        for name, change in changes.items()
    }
    for name, origin in origins.items():  # a position is that of the point that the scene's positions are of
        if "position" in found.get(name, ()):
            found[name].setdefault("origin", origin)
    return found


def _entry(key, value, field):
    """Return the value of a field as in a scene file; a list of numbers becomes an array."""
    if value is not None and key in _READ:
        return _READ[key](value, field)
    plain = isinstance(value, list) and all(isinstance(entry, (int, float)) for entry in value)
    return np.array(value, float) if plain else value
