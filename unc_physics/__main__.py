"""The command line: ``python -m unc_physics COMMAND``; each command's module is imported when it runs."""

from __future__ import annotations

import argparse
import sys

from . import __version__
from .checks.errors import UncPhysicsError
from .cli.geometry_commands import add_models_command, add_pack_command, add_show_command
from .cli.plugins import add_plugin_commands
from .cli.predict_command import add_predict_command
from .cli.propagators_command import add_propagators_command
from .cli.schema_command import add_schema_command


class OneSentenceParser(argparse.ArgumentParser):
    """A parser that says what is wrong with the arguments in one sentence, without repeating the usage."""

    def error(self, message):
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    parser = OneSentenceParser(
        prog="unc_physics",
        description="Predict where rigid objects will be, and how surely.",
        epilog="Bad input ends with one sentence on standard error and an exit status that tells its kind "
        "(unc_physics.ErrorCode).",
    )
    parser.add_argument("--version", action="version", version=f"unc_physics {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    add_predict_command(commands)
    add_propagators_command(commands)
    add_schema_command(commands)
    add_pack_command(commands)
    add_models_command(commands)
    add_show_command(commands)
    add_plugin_commands(commands)
    return parser


def main(arguments=None) -> int:
    """Run the command line; returns the exit status."""
    options = build_parser().parse_args(arguments)
    try:
        return options.run(options) or 0
    except UncPhysicsError as error:
        print(f"unc_physics: {error}", file=sys.stderr)
        return int(error.code)
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
