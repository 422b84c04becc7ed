"""Command-line parser."""

from __future__ import annotations

import argparse

from .. import __version__
from ..checks.shown import printable
from .calibrate_command import add_calibrate_command
from .geometry_commands import add_models_command, add_pack_command, add_show_command
from .import_command import add_import_command
from .plugins import add_plugin_commands
from .predict_command import add_predict_command
from .propagators_command import add_propagators_command
from .rank_command import add_rank_command
from .schema_command import add_schema_command
from .view_command import add_view_command
from .warm_up_command import add_warm_up_command


class OneSentenceParser(argparse.ArgumentParser):
    """Argument parser that reports errors in one sentence without usage."""

    def error(self, message):
        self.exit(2, f"{self.prog}: {printable(message)}; see {self.prog} --help\n")


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    parser = OneSentenceParser(
        prog="unc_physics",
        description="Predict where rigid objects will be, and how certain that is.",
        epilog="Bad input ends with one sentence on standard error and an exit status that tells its kind "
        "(unc_physics.ErrorCode).",
    )
    parser.add_argument("--version", action="version", version=f"unc_physics {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    add_predict_command(commands)
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
    add_plugin_commands(commands)
    return parser
