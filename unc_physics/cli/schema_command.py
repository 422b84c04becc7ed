"""The command ``schema``: print JSON schemas of scene files, action files and predictions."""

from __future__ import annotations

import json
from importlib.resources import files

SCHEMAS = ("scene", "actions", "prediction")


def add_schema_command(commands) -> None:
    """Add the parser of ``schema`` to the command line's subparsers."""
    parser = commands.add_parser(
        "schema",
        help="print the JSON schema of scene files, of files of actions or of predictions",
        description="JSON schema (draft 2020-12) of scene files, of the files of actions that 'rank' reads,"
        " or of what 'predict --json' prints.",
    )
    parser.add_argument(
        "what", choices=SCHEMAS, metavar=f"{{{','.join(SCHEMAS)}}}", help="format that the schema describes"
    )
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Print the schema."""
    print(schema_text(arguments.what), end="")
    return 0


def schema_text(what: str) -> str:
    """Return a schema as JSON; the schema of actions includes the scene schema and the registered events."""
    text = _read(what)
    if what != "actions":
        return text
    from ..prediction.event_entries import event_schema

    schema = json.loads(text)
    schema["$defs"] |= {"event": event_schema(), "scene": json.loads(_read("scene"))}
    return json.dumps(schema, indent=1) + "\n"


def _read(what):
    return (files("unc_physics") / "schemas" / f"{what}.schema.json").read_text(encoding="utf-8")
