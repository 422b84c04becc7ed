"""Read files of actions: YAML with a scene, the actions of a robot, and events that count as success."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

from ..checks.errors import InvalidRequestError
from ..scene.belief import Belief
from ..scene.entries import at_field, check_keys
from ..scene.scene import Scene
from ..scene.scene_file import read_change, scene_from_dict
from ..scene.yaml_file import read_yaml
from .actions import Action
from .event_entries import read_event, read_events, read_region
from .events import Event

_KEYS = ("scene", "horizon", "regions", "score", "also", "actions")


class LoadedActions(NamedTuple):
    """Content of a file of actions."""

    scene: Scene
    belief: Belief
    horizon: float | None  # the file's own [s], or else the scene file's
    actions: dict[str, Action]
    score: Event
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
    for key in ("regions", "also"):
        if not isinstance(content.get(key) or [], list):
            raise InvalidRequestError("must be a list", field=key, value=content[key])
    found, folder = content["scene"], Path(path).parent
    if isinstance(found, str):
        file = folder / found
        found = read_yaml(file, "scene file")
        scene, belief, horizon = scene_from_dict(found, models_dir, file.parent)
    elif isinstance(found, dict):
        scene, belief, horizon = at_field("scene", scene_from_dict, found, models_dir, folder)
    else:
        raise InvalidRequestError("must be the path of a scene file, or its content", field="scene")
    regions = {}
    for k, entry in enumerate(content.get("regions") or []):
        region = read_region(entry, f"regions[{k}]")
        if region.name in regions:
            raise InvalidRequestError(
                "is the name of two regions", field=f"regions[{k}].name", value=region.name
            )
        regions[region.name] = region
    also = enumerate(content.get("also") or [])
    return LoadedActions(
        scene,
        belief,
        content.get("horizon", horizon),
        _actions(content["actions"], {body["name"]: body.get("origin") for body in found["bodies"]}),
        read_events(content["score"], regions, "score"),
        tuple(read_event(entry, regions, f"also[{k}]") for k, entry in also),
    )


def _actions(content, origins):
    """Return actions as changes of bodies and elements; ``origins`` are entries of the scene's bodies."""
    actions: dict[str, Action] = {}
    for name, things in _mapping(content, "actions", "names to changes").items():
        place = f"actions['{name}']"
        actions[str(name)] = {
            str(thing): _change(changes, f"{place}.{thing}", origins.get(thing))
            for thing, changes in _mapping(things, place, "bodies and elements to fields and values").items()
        }
    if not actions:
        raise InvalidRequestError("must name at least one action", field="actions")
    return actions


def _change(content, place, origin):
    """Return fields and their values; a position is that of the same point as in the scene."""
    found = {
        key: read_change(key, value, f"{place}.{key}")
        for key, value in _mapping(content, place, "fields to values").items()
    }
    if origin and "position" in found:
        found.setdefault("origin", origin)
    return found


def _mapping(content, field, what):
    if not isinstance(content, dict):
        raise InvalidRequestError(f"must be a mapping of {what}", field=field, value=content)
    return content
