"""The command ``predict-many``: predict all lines of a file, on any executor."""

from __future__ import annotations

from pathlib import Path

from ..checks.shown import counted
from .arguments import add_options
from .output import note, progress_display


def add_predict_many_command(commands) -> None:
    """Add the parser of ``predict-many`` to the command line's subparsers."""
    parser = commands.add_parser(
        "predict-many",
        help="predict all lines of a file, on many machines if need be",
        description=(
            "Predict each line of a file, and write Parquet files with a row for each body and time. The same"
            " command goes on after an interruption, and computes lines that were corrected."
        ),
        epilog=(
            "A line is a JSON object with the keys scene (the content of a scene file), propagator, options,"
            " times [s] (default: the scene's horizon), events and seed (default: the number of the line)."
        ),
    )
    parser.add_argument("requests", metavar="REQUESTS.jsonl", help="file with a request in each line")
    parser.add_argument("-o", "--output", required=True, metavar="FOLDER", help="folder of the answers")
    add_options(parser, "--executor", "--models")
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Predict all lines, and report the first one that cannot be predicted."""
    from ..checks.errors import InvalidRequestError
    from ..prediction.many import RequestLine, predict_many

    path = Path(arguments.requests)
    try:
        with open(path, encoding="utf-8") as file:
            total = sum(not line.isspace() for line in file)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise InvalidRequestError(f"cannot be read: {why}", field="REQUESTS", value=str(path)) from None
    models = arguments.models and str(Path(arguments.models).resolve())
    remedy = "Ctrl-C ends it, and the same command goes on"
    done, failed = 0, []
    with (
        open(path, encoding="utf-8") as file,
        progress_display("predict-many", "request", f"{total} requests", remedy) as show,
    ):
        lines = (
            RequestLine(number, line, models, str(path.parent.resolve()))
            for number, line in enumerate(file, 1)
            if not line.isspace()
        )
        progress = None if show is None else lambda done: show(done, total)
        for answer in predict_many(lines, arguments.executor, store=arguments.output, progress=progress):
            done += 1
            if answer.error is not None:
                failed.append(answer)
    there = total - done
    print(
        f"{arguments.output}: {counted(total - len(failed), 'answer')}"
        + f", {there} of them earlier" * (there > 0)
    )
    if failed:
        if len(failed) > 1:
            note(
                f"{len(failed)} lines have no answer: {', '.join(str(one.number) for one in failed[:20])} ..."
            )
        error, where = failed[0].error, f"{path.name}, line {failed[0].number}"
        raise error.at(where if error.field is None else f"{where}: {error.field}")
    return 0
