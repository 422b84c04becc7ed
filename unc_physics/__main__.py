# PYTHON_ARGCOMPLETE_OK
"""Command line ``python -m unc_physics COMMAND``; each command's module is imported when it runs."""

from __future__ import annotations

import os
import sys
import warnings

from .programs import dying_at_interrupt

INTERRUPTED, PIPE_CLOSED = 130, 141  # exit status after SIGINT or SIGPIPE, as in a shell


def main(arguments=None) -> int:
    """Run the command line; return the exit status."""
    with dying_at_interrupt():
        from .checks.errors import OutputError, UncPhysicsError
        from .cli.parser import build_parser

        parser = build_parser()
        if "_ARGCOMPLETE" in os.environ:  # a shell requests completions
            import argcomplete

            argcomplete.autocomplete(parser)
        options = parser.parse_args(arguments)
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning
        try:
            try:
                status = options.run(options) or 0
                if sys.stdout is not None:  # None if it was closed before the start
                    sys.stdout.flush()
                return status
            except BrokenPipeError:  # the reader closed the pipe
                _drop_output()
                return PIPE_CLOSED
            except OSError as error:
                _drop_output()
                raise OutputError(
                    f"cannot be written: {error.strerror or error}", field=error.filename or "standard output"
                ) from error
        except UncPhysicsError as error:
            print(f"unc_physics: {error}", file=sys.stderr)
            return int(error.code)
        except KeyboardInterrupt:
            return INTERRUPTED


def _show_warning(message, category, filename, lineno, file=None, line=None):
    """Print a warning in one sentence, without its source location."""
    from .checks.shown import printable

    text = " ".join(str(message).split())
    print(f"unc_physics: warning: {printable(text)}", file=file or sys.stderr)


def _drop_output():
    """Discard remaining output, so that the interpreter does not retry it at exit."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (OSError, ValueError, AttributeError):  # not a real file, or None
        pass


if __name__ == "__main__":
    sys.exit(main())
