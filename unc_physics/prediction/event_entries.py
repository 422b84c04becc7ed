"""Read events from files of actions and from the command line; make their JSON schema.

Keys are those of `EVENTS`. Each dataclass field of an event is an argument. It is required if it has no
default, and its type says how it is read.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields
from typing import Any, NamedTuple, get_type_hints

import yaml

from ..checks.array_field import OptionalArray
from ..checks.errors import InvalidRequestError
from ..checks.names import hint
from ..checks.validation import number
from ..scene.entries import at_field, check_keys, read_numbers
from ..scene.yaml_file import yaml_value
from .events import EVENTS, Event
from .regions import BoxRegion

REGION_KEYS = ("name", "size", "position", "orientation")


class _Type(NamedTuple):
    """JSON schema of an argument's type, and its reader, which takes the value, the place and the regions."""

    schema: dict[str, Any]
    read: Callable[[Any, str, Mapping[str, BoxRegion]], Any]


def read_events(content, regions: Mapping[str, BoxRegion], place: str) -> Event:
    """Return an event, or the conjunction of a list of events."""
    if not isinstance(content, list):
        return read_event(content, regions, place)
    if not content:
        raise InvalidRequestError("must name at least one event", field=place)
    found = read_event(content[0], regions, f"{place}[0]")
    for k, entry in enumerate(content[1:], 1):
        found = found & read_event(entry, regions, f"{place}[{k}]")
    return found


def read_event(entry, regions: Mapping[str, BoxRegion], place: str) -> Event:
    """Return the event of a mapping from its key to its object, or to its arguments; ``not`` negates it.

    The event may name ``regions``. Errors call the entry ``place``, and name the argument and its value.
    """
    if isinstance(entry, dict) and list(entry) == ["not"]:
        return ~read_event(entry["not"], regions, f"{place}.not")
    if not isinstance(entry, dict) or len(entry) != 1:
        known = ", ".join([*EVENTS, "not"])
        raise InvalidRequestError(f"must be a mapping with one key of {known}", field=place, value=entry)
    check_keys(entry, EVENTS, place)
    ((key, given),) = entry.items()
    place = f"{place}.{key}"
    arguments = _arguments(EVENTS[key])
    given = {"object": given} if isinstance(given, str) else given
    check_keys(given, arguments, place)
    given = {name: value for name, value in given.items() if value is not None}
    for name, (member, _) in arguments.items():
        if member.default is MISSING and name not in given:
            raise InvalidRequestError("must be given", field=f"{place}.{name}")
    read = {name: arguments[name][1].read(value, f"{place}.{name}", regions) for name, value in given.items()}
    return at_field(place, EVENTS[key], **read)


def event_from_text(text: str, place: str) -> Event:
    """Return the event of a text in YAML, as in ``upright: cup``."""
    try:
        return read_event(yaml_value(text), {}, place)
    except yaml.YAMLError:
        raise InvalidRequestError(
            "must be an event as in a file of actions, such as 'upright: cup'", field=place, value=text
        ) from None


def read_region(entry, place: str) -> BoxRegion:
    """Return the region of a mapping."""
    check_keys(entry, REGION_KEYS, place)
    if "name" not in entry or "size" not in entry:
        raise InvalidRequestError("must have a name and a size", field=place)
    return at_field(place, BoxRegion, **{key: value for key, value in entry.items() if value is not None})


def event_schema() -> dict[str, Any]:
    """Return the JSON schema of an event, which refers to itself as ``#/$defs/event``."""
    negation = {"$ref": "#/$defs/event", "description": "the event does not happen"}
    return {
        "type": "object",
        "additionalProperties": False,
        "minProperties": 1,
        "maxProperties": 1,
        "properties": {key: _schema(kind) for key, kind in EVENTS.items()} | {"not": negation},
    }


def _schema(kind: type[Event]) -> dict[str, Any]:
    """Return the JSON schema of the value of an event's key."""
    arguments = _arguments(kind)
    required = [name for name, (member, _) in arguments.items() if member.default is MISSING]
    whole = {
        "type": "object",
        "additionalProperties": False,
        "required": required,
        "properties": {name: _argument_schema(*argument) for name, argument in arguments.items()},
    }
    description = inspect.getdoc(kind) or ""
    described = {"description": " ".join(description.split("\n\n")[0].split()).replace("``", "")}
    return ({"anyOf": [_TEXT.schema, whole]} if required == ["object"] else whole) | described


def _argument_schema(member: Field, kind: _Type) -> dict[str, Any]:
    schema = kind.schema | ({"exclusiveMinimum": 0} if member.metadata.get("positive") else {})
    if member.default is not MISSING:
        schema = {"anyOf": [schema, {"type": "null"}]}
    return schema | {"description": member.metadata.get("description", member.name)}


def _arguments(kind: type[Event]) -> dict[str, tuple[Field, _Type]]:
    """Return the fields of a class of events with their types, by name."""
    types, found = get_type_hints(kind), {}
    for member in fields(kind):  # pyright: ignore[reportArgumentType]
        if types[member.name] not in _TYPES:
            raise TypeError(f"{kind.__name__}.{member.name} has a type that files cannot hold; see _TYPES")
        found[member.name] = member, _TYPES[types[member.name]]
    return found


def _text(value, place, regions):
    if not isinstance(value, str) or not value:
        raise InvalidRequestError("must be a non-empty text", field=place, value=value)
    return value


def _region(value, place, regions):
    if isinstance(value, dict):
        return read_region(value, place)
    if not isinstance(value, str) or value not in regions:
        problem = f"is none of the file's regions{hint(str(value), regions)}"
        raise InvalidRequestError(problem, field=place, value=value)
    return regions[value]


_TEXT = _Type({"type": "string", "minLength": 1}, _text)
_NUMBER = _Type({"type": "number"}, lambda value, place, regions: number(value, place))
#: Types of an event's fields that files can hold.
_TYPES: dict[Any, _Type] = {
    str: _TEXT,
    float: _NUMBER,
    float | None: _NUMBER,
    OptionalArray: _Type(
        {"$ref": "scene.schema.json#/$defs/vector"},
        lambda value, place, regions: read_numbers(value, (3,), place),
    ),
    BoxRegion: _Type({"anyOf": [_TEXT.schema, {"$ref": "#/$defs/region"}]}, _region),
}
