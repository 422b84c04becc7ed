"""The command ``propagators``: list propagators and their options."""

from __future__ import annotations


def add_propagators_command(commands) -> None:
    """Add the parser of ``propagators`` to the command line's subparsers."""
    parser = commands.add_parser(
        "propagators",
        help="list the propagators and their options",
        description="List the propagators, those of other packages included: what each is, and its options.",
    )
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Print the propagators and their options."""
    from ..propagators.registry import PROPAGATORS

    for name, cls in PROPAGATORS.items():
        print(f"{name}: {cls.description()}")
        for option in cls.described_options():
            print(f"    {option.name}: {option.as_text()}")
    return 0
