"""Read YAML files with limits on their size and errors that name the place."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import yaml
from yaml.composer import ComposerError

from ..checks.errors import InvalidRequestError, LimitExceededError
from ..checks.shown import shown
from ..checks.validation import instance

#: Limits of entries and nesting levels; a thousand bodies with full covariances have 200 000 entries.
_ENTRIES, _LEVELS = 300_000, 50
_CHARACTERS = 20_000_000  # most of a file
_INT, _FLOAT = "tag:yaml.org,2002:int", "tag:yaml.org,2002:float"
#: Parser messages in plainer words.
_PROBLEMS = {
    "mapping values are not allowed in this context": "there is a ':' where none can be",
    "found unexpected end of stream": "the file ends too early",
}
#: Opening signs of multi-line items, by their names in the parser's errors.
_OPENED = {"flow sequence": "the [", "flow mapping": "the {", "quoted scalar": "the quote"}
_OCTAL = re.compile(r"[-+]?0[0-7_]+")
#: Numbers that YAML 1.2 and JSON have, and PyYAML reads as texts.
_MORE_FLOATS = re.compile(
    r"(?:[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)[eE][-+]?[0-9]+|[-+]?(?:inf|Infinity)|nan|NaN)$", re.ASCII
)

# libyaml, if PyYAML was built with it, is ten times as fast
_SafeLoader: type[yaml.SafeLoader] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_SafeLoader):
    """YAML loader that refuses duplicate keys and numbers of base 60 and 8.

    Plain YAML silently keeps the last of duplicate keys.
    """

    def construct_scalar(self, node):
        base = 60 if node.tag in (_INT, _FLOAT) and ":" in node.value else 0
        if node.tag == _INT and _OCTAL.fullmatch(node.value):
            base = 8
        if base:
            problem = (
                f"{node.value} is a number of base {base} to YAML; write it out, or in quotes if it is a text"
            )
            raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
        return super().construct_scalar(node)

    def construct_yaml_float(self, node):
        value = self.construct_scalar(node)
        if _MORE_FLOATS.match(value):
            return float(value)
        return super().construct_yaml_float(node)

    def construct_object(self, node, deep=False):
        try:
            return super().construct_object(node, deep)
        except (TypeError, ValueError, OverflowError, LookupError, AttributeError):
            # an invalid date, an integer of thousands of digits, or a value that does not fit its tag
            value = shown(node.value) if isinstance(node, yaml.ScalarNode) else node.tag.split(":")[-1]
            problem = f"{value} has a value that cannot be read"
            raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark) from None

    def construct_mapping(self, node, deep=False):
        lines = {}
        for key, _ in node.value if isinstance(node, yaml.MappingNode) else ():
            if isinstance(key, yaml.ScalarNode):
                if key.value in lines:
                    problem = f"the key '{key.value}' is given twice, first in line {lines[key.value]}"
                    raise yaml.constructor.ConstructorError(None, None, problem, key.start_mark)
                lines[key.value] = key.start_mark.line + 1
        return super().construct_mapping(node, deep)


_Loader.add_constructor(_FLOAT, _Loader.construct_yaml_float)
_Loader.add_implicit_resolver(_FLOAT, _MORE_FLOATS, list("-+.0123456789inIN"))


def yaml_value(text: str) -> Any:
    """Return the value of a short text in YAML; raises `yaml.YAMLError`."""
    return yaml.load(text, _Loader)


def _check_size(text):
    """Raise an error if aliases expand to more entries than allowed, before they are expanded."""
    entries, levels, begun, sizes = 0, 0, [], {}
    for event in yaml.parse(text, _Loader):
        if isinstance(event, yaml.CollectionEndEvent):
            levels -= 1
            anchor, before = begun.pop()
            sizes[anchor] = entries - before
            continue
        if not isinstance(event, yaml.NodeEvent):
            continue
        problem = None
        entries += 1
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                problem = f"found undefined alias '{event.anchor}'"
            entries += sizes.get(event.anchor, 0)
        else:
            sizes[event.anchor] = 1
        if isinstance(event, yaml.CollectionStartEvent):
            levels += 1
            begun.append((event.anchor, entries - 1))
        if levels > _LEVELS:
            problem = f"it is nested more than {_LEVELS} levels deep"
        elif entries > _ENTRIES:
            problem = f"it has more than {_ENTRIES} entries, those of aliases counted each time"
        if problem:
            raise yaml.constructor.ConstructorError(None, None, problem, event.start_mark)


def read_yaml(path: str | os.PathLike[str], kind: str) -> Any:
    """Return the content of a YAML file; ``kind`` names it in errors.

    Raises `InvalidRequestError` or `LimitExceededError` if the file cannot be read or is not YAML.
    """
    instance(path, (str, os.PathLike), "path")
    path = Path(path)
    try:
        with path.open(encoding="utf-8") as stream:
            text = stream.read(_CHARACTERS + 1)
    except (OSError, ValueError) as error:  # ValueError: not UTF-8, or an invalid path
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise InvalidRequestError(f"cannot be read: {reason}", field=f"{kind} {path}") from None
    if len(text) > _CHARACTERS:
        raise LimitExceededError(f"must have at most {_CHARACTERS} characters", field=f"{kind} {path}")
    try:
        _check_size(text)
        return yaml.load(text, _Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        place = f" in line {mark.line + 1}" if mark else ""
        reason, problem = "", "is not valid YAML"
        if isinstance(error, ComposerError):  # a second document, or an undefined alias
            reason = f": {', '.join(filter(None, (error.context, error.problem)))}"
            problem = "cannot be read"
        elif isinstance(error, yaml.constructor.ConstructorError):
            reason, problem = f": {error.problem}", "cannot be read"
        elif isinstance(error, yaml.MarkedYAMLError) and mark:
            reason = f": {_syntax(error, text)}"
        raise InvalidRequestError(f"{problem}{place}{reason}", field=f"{kind} {path}") from None


def _syntax(error, text) -> str:
    """Return what the parser expected, and where the unfinished item began."""
    mark, began = error.problem_mark, error.context_mark
    line = next(iter(text.split("\n")[mark.line :]), "")
    if line[mark.column : mark.column + 1] == "\t":
        return "it has a tab; indent with spaces"
    problem = _PROBLEMS.get(error.problem, error.problem or "").replace(
        "did not find expected", "there is no"
    )
    if began is None or began.line >= mark.line:
        return problem
    opened = next((sign for kind, sign in _OPENED.items() if kind in (error.context or "")), None)
    first = began.line + 1
    above = f"{opened} of line {first} is not closed" if opened else f"line {first} begins what goes on here"
    return f"{problem}; the fault may stand above, where {above}"
