"""What messages are made of: their fields by path, and values for each type of field."""

import importlib
import re

OWN = "unc_physics_msgs"


def message_type(name):
    """The class of a message's type, as fields name it: ``package/Name``."""
    package, _, name = name.partition("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def element_type(kind):
    """The type of an array's elements, and how many it may hold; for others the type itself and None."""
    found = re.fullmatch(r"sequence<([\w/]+)(?:, (\d+))?>|([\w/]+)\[(\d+)\]", kind)
    if found is None:
        return kind, None
    return found[1] or found[3], int(found[2] or found[4] or 2)


def paths(message):
    """Paths of all fields, down into this package's own messages: ``scene.objects[].id`` and so on."""
    for name, kind in message.get_fields_and_field_types().items():
        element, count = element_type(kind)
        here = name if count is None else f"{name}[]"
        if element.startswith(f"{OWN}/"):
            yield from (f"{here}.{path}" for path in paths(message_type(element)))
        else:
            yield name


def values_at(message, path):
    """All values that a message has at a path."""
    first, _, rest = path.partition(".")
    value = getattr(message, first.removesuffix("[]"))
    parts = value if first.endswith("[]") else [value]
    return [found for part in parts for found in values_at(part, rest)] if rest else list(parts)
