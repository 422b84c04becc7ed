"""Read events from the command line.

Keys are those of `EVENTS`. Each dataclass field of an event is an argument. It is required if it has no
default, and its type says how it is read.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, Field, fields
from functools import cache
from typing import Any, get_type_hints

import yaml

from ..checks.array_field import OptionalArray
from ..checks.errors import InvalidRequestError
from ..checks.validation import number
from ..scene.entries import at_field, check_keys, read_numbers
from ..scene.yaml_file import yaml_value
from .events import EVENTS, Event
from .regions import BoxRegion


def read_event(entry, place: str) -> Event:
    """Return the event of a mapping from its key to its object, or to its arguments; ``not`` negates it.

    Errors call the entry ``place``, and name the argument and its value.
    """
    if isinstance(entry, dict) and list(entry) == ["not"]:
        return ~read_event(entry["not"], f"{place}.not")
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
    read = {name: arguments[name][1](value, f"{place}.{name}") for name, value in given.items()}
    return at_field(place, EVENTS[key], **read)


def event_from_text(text: str, place: str) -> Event:
    """Return the event of a text in YAML, as in ``upright: cup``."""
    try:
        return read_event(yaml_value(text), place)
    except yaml.YAMLError:
        raise InvalidRequestError(
            "must be an event in YAML, such as 'upright: cup'", field=place, value=text
        ) from None


def _region(entry, place):
    """Return the region of a mapping."""
    check_keys(entry, ("name", "size", "position", "orientation"), place)
    if "name" not in entry or "size" not in entry:
        raise InvalidRequestError("must have a name and a size", field=place)
    return at_field(place, BoxRegion, **{key: value for key, value in entry.items() if value is not None})


@cache
def _arguments(kind: type[Event]) -> dict[str, tuple[Field, Callable[[Any, str], Any]]]:
    """Return the fields of a class of events with their readers, by name."""
    types, found = get_type_hints(kind), {}
    for member in fields(kind):  # pyright: ignore[reportArgumentType]
        if types[member.name] not in _READERS:
            raise TypeError(f"{kind.__name__}.{member.name} has a type that YAML cannot hold; see _READERS")
        found[member.name] = member, _READERS[types[member.name]]
    return found


def _text(value, place):
    if not isinstance(value, str) or not value:
        raise InvalidRequestError("must be a non-empty text", field=place, value=value)
    return value


#: Readers of an event's fields by their types; each takes the value and the place.
_READERS: dict[Any, Callable[[Any, str], Any]] = {
    str: _text,
    float: number,
    float | None: number,
    OptionalArray: lambda value, place: read_numbers(value, (3,), place),
    BoxRegion: _region,
}
