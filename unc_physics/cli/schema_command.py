"""The command ``schema``: print JSON schemas of scene files and predictions."""

from __future__ import annotations

from importlib.resources import files

SCHEMAS = ("scene", "prediction")


def add_schema_command(commands) -> None:
    """Add the parser of ``schema`` to the command line's subparsers."""
    parser = commands.add_parser(
        "schema",
        help="print the JSON schema of scene files or of predictions",
        description="JSON schema (draft 2020-12) of scene files, or of what 'predict --json' prints.",
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
    """Return a schema as JSON."""
    return (files("unc_physics") / "schemas" / f"{what}.schema.json").read_text(encoding="utf-8")
