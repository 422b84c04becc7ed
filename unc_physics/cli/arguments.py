"""Options that several commands have: their descriptions, and their checks."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from .output import check_output


def key_and_value(text: str) -> tuple[str, str]:
    """Return key and value of an argument ``KEY=VALUE``."""
    key, separator, value = text.partition("=")
    if not separator or not key:
        raise argparse.ArgumentTypeError(f"'{text}' is not of the form KEY=VALUE")
    return key, value


_PAIRS: dict[str, Any] = {"action": "append", "default": [], "type": key_and_value}
_OPTIONS: dict[str, dict[str, Any]] = {
    "--executor": {
        "metavar": "KIND",
        "help": "who computes: processes:N, or dask://HOST:PORT for a scheduler (default: this process)",
    },
    "--horizon": {"metavar": "T", "help": "time to predict for [s], instead of the file's"},
    "--json": {"action": "store_true", "help": "print one JSON object instead of a table"},
    "--models": {"metavar": "DIR", "help": "folder of the models, instead of the model library"},
    "--option": {
        **_PAIRS,
        "metavar": "KEY=VALUE",
        "help": "option of the propagator; the command 'propagators' lists them; may be repeated",
    },
    "--mesh": {
        **_PAIRS,
        "metavar": "BODY=FILE",
        "help": "draw a body as the mesh that its model was packed from; may be repeated",
    },
    "--time-limit": {
        "metavar": "T",
        "help": "give up after computing for T seconds; compiling does not count",
    },
}


def add_options(parser: argparse.ArgumentParser, *names: str) -> None:
    """Add common options by their names."""
    for name in names:
        parser.add_argument(name, **_OPTIONS[name])


def horizon_of(arguments, horizon: float | None) -> float | None:
    """Return the horizon of the arguments [s], or else the file's; the prediction checks it."""
    from ..checks.errors import InvalidHorizonError
    from ..checks.validation import number_from_text

    if arguments.horizon is None:
        return horizon
    return number_from_text(arguments.horizon, "horizon", InvalidHorizonError)


def propagator_options(arguments) -> dict[str, str]:
    """Return the options of the propagator by key.

    Raises
    ------
    InvalidOptionError
        If a key is given twice.
    """
    from ..checks.errors import InvalidOptionError

    options: dict[str, str] = {}
    for key, value in arguments.option:
        if key in options:
            raise InvalidOptionError("is given twice", field="--option", value=key)
        options[key] = value
    return options


@contextlib.contextmanager
def time_limit(arguments) -> Iterator[float | None]:
    """Yield the checked time limit [s]; an error of the ``with`` block about it names the option."""
    from ..checks.errors import PredictionTimeoutError
    from ..checks.validation import number_from_text, positive

    limit = None
    if arguments.time_limit is not None:
        limit = positive(number_from_text(arguments.time_limit, "--time-limit"), "--time-limit")
    try:
        yield limit
    except PredictionTimeoutError as error:
        raise error.at("--time-limit") from None


def check_picture(path) -> None:
    """Raise an error if a picture cannot be drawn or written, before the work."""
    from ..checks.errors import NotSupportedError

    missing = [name for name in ("matplotlib", "scipy") if find_spec(name) is None]
    if missing:
        raise NotSupportedError(f"--picture needs {' and '.join(missing)}: pip install {' '.join(missing)}")
    check_output(path, ".gif" if Path(path).suffix == ".gif" else ".png", "--picture")
