"""Commands of other packages, from entry points in the group ``unc_physics.commands``."""

from __future__ import annotations

import argparse
from importlib.metadata import entry_points

GROUP = "unc_physics.commands"


def add_plugin_commands(commands) -> None:
    """Add the parsers of installed packages' commands to the command line's subparsers.

    An entry point names a function that takes the subparsers and adds one. Its defaults include ``run``.
    """
    found = {point.name: point for point in entry_points(group=GROUP)}
    for point in found.values():
        point.load()(commands)
    if "evaluate" not in found:
        _add_missing_evaluate(commands)


def _add_missing_evaluate(commands):
    """Add a command ``evaluate`` that prints how to install its package."""
    parser = commands.add_parser(
        "evaluate",
        help="measure speed and error of all propagators (a package of its own, not installed)",
        add_help=False,
        prefix_chars="\0",  # accept options without parsing them
    )
    parser.add_argument("arguments", nargs="*", help=argparse.SUPPRESS)
    parser.set_defaults(run=_say_how_to_install)


def _say_how_to_install(arguments):
    from ..checks.errors import NotSupportedError

    raise NotSupportedError(
        "evaluate needs the package unc_physics_evaluation; from the repository: pip install ./evaluation"
    )
