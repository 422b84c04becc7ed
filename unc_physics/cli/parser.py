"""Command-line parser, with commands of other packages: entry points of the group `GROUP`."""

from __future__ import annotations

import argparse
from importlib.metadata import entry_points

from .. import __version__
from ..checks.names import removed
from ..checks.shown import printable
from .calibrate_command import add_calibrate_command
from .geometry_commands import add_models_command, add_pack_command, add_show_command
from .import_command import add_import_command
from .predict_command import add_predict_command
from .predict_many_command import add_predict_many_command
from .propagator_commands import add_propagators_command, add_warm_up_command
from .rank_command import add_rank_command
from .schema_command import add_schema_command
from .view_command import add_view_command

GROUP = "unc_physics.commands"


class OneSentenceParser(argparse.ArgumentParser):
    """Argument parser that reports errors in one sentence without usage."""

    def error(self, message):
        for word in message.split():
            if word.startswith("--") and (gone := removed(word.partition("=")[0])):
                message = f"{word} {gone}"
        self.exit(2, f"{self.prog}: {printable(message)}; see {self.prog} --help\n")


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    parser = OneSentenceParser(
        prog="unc_physics",
        description="Predict where rigid objects will be, and how certain that is.",
        epilog="Bad input ends with one sentence on standard error. The exit status is its error code "
        "(unc_physics.ErrorCode).",
    )
    parser.add_argument("--version", action="version", version=f"unc_physics {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    add_predict_command(commands)
    add_predict_many_command(commands)
    add_rank_command(commands)
    add_calibrate_command(commands)
    add_propagators_command(commands)
    add_schema_command(commands)
    add_pack_command(commands)
    add_import_command(commands)
    add_models_command(commands)
    add_show_command(commands)
    add_view_command(commands)
    add_warm_up_command(commands)
    _add_plugin_commands(commands)
    return parser


def _add_plugin_commands(commands) -> None:
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
        help="measure speed and error of all propagators (in another package, which is not installed)",
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
