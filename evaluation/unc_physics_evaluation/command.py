"""The command ``evaluate``: speed and error of every method, as rows, figures and a report."""

from __future__ import annotations

import argparse
import sys
from importlib.util import find_spec
from pathlib import Path

NEEDS = {"ot": "pot", "scipy": "scipy", "matplotlib": "matplotlib"}


def add_evaluate_command(commands) -> None:
    """Add the parser of ``evaluate`` to the command line's subparsers."""
    from .experiments import BY_NAME, DEFAULT

    parser = commands.add_parser(
        "evaluate",
        help="measure speed and error of all propagators",
        description=(
            "Measure speed and error of all propagators beside Monte Carlo, and write rows (CSV), figures and"
            " a report (report.md). An interrupted run goes on where it stopped; finished work is never done"
            " again."
        ),
        epilog=f"Only where named, as they take long or need more than this package: {', '.join(BY_NAME)}.",
    )
    parser.add_argument(
        "experiments", nargs="*", metavar="EXPERIMENT", help=f"which to run (default: {', '.join(DEFAULT)})"
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help="a look in ten minutes, once the kernels are compiled, in place of results in hours",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        help="folder for the results (default: evaluation_results, or evaluation_quick)",
    )
    parser.add_argument(
        "--executor",
        metavar="KIND",
        help="who computes: processes:N, or dask://HOST:PORT for a scheduler (default: a process for each"
        " processor)",
    )
    parser.add_argument(
        "--seed", type=int, default=0, metavar="S", help="another one gives an independent sweep (default 0)"
    )
    parser.add_argument(
        "--meshes",
        metavar="DIR",
        help="folder of the meshes that packing needs: bunny00.off and armadillo.off",
    )
    parser.add_argument(
        "--data",
        metavar="DIR",
        help="folder of recorded motions that reality predicts, in place of those of this package",
    )
    parser.add_argument(
        "--method",
        action="append",
        default=[],
        metavar="NAME",
        help="registered propagator, as 'NAME KEY=VALUE ...' with options, in the tables and figures of the"
        " experiment paper; may be repeated",
    )
    parser.add_argument(
        "--report", action="store_true", help="run nothing, write the report from the rows that are there"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the jobs that are missing, and write the report."""
    from unc_physics.checks.errors import ErrorCode, InvalidOptionError, NotSupportedError

    from .experiments import DEFAULT, NAMES, experiment
    from .jobs import Settings
    from .methods import method_of, text_of
    from .provenance import threads
    from .report import verdicts, write_report
    from .results import Results
    from .runner import run_jobs

    if arguments.seed < 0:
        raise InvalidOptionError("must not be negative", field="--seed", value=arguments.seed)
    lacks = [package for module, package in NEEDS.items() if find_spec(module) is None]
    if lacks:
        raise NotSupportedError(f"evaluate needs {' and '.join(lacks)}: pip install {' '.join(lacks)}")
    chosen = [experiment(name) for name in dict.fromkeys(arguments.experiments or DEFAULT)]
    meshes = arguments.meshes and str(Path(arguments.meshes).resolve())
    data = arguments.data and str(Path(arguments.data).resolve())
    if arguments.method and "paper" not in (arguments.experiments or DEFAULT):
        raise InvalidOptionError("goes with the experiment paper only", field="--method")
    added = tuple(text_of(method_of(text)) for text in arguments.method)
    settings = Settings(arguments.quick, arguments.seed, meshes, data, added)
    jobs = [job for module in chosen for job in module.jobs(settings)]
    gaps = [gap for module in chosen if hasattr(module, "missing") for gap in module.missing(settings)]
    gaps = list(dict.fromkeys(gaps))
    folder = Path(arguments.output or ("evaluation_quick" if settings.quick else "evaluation_results"))
    if arguments.report and not any((folder / f"{name}.csv").is_file() for name in NAMES):
        raise InvalidOptionError(
            "has no rows to report on; run the same command without --report first",
            field="--output",
            value=str(folder),
        )
    results = Results(folder)
    failures = {}
    with results.locked():
        if not arguments.report:
            try:
                failures = run_jobs(jobs, results, arguments.executor or f"processes:{threads()}")
            except KeyboardInterrupt:
                print(
                    f"interrupted: what is finished is kept in {results.folder}; the same command goes on"
                    " there",
                    file=sys.stderr,
                )
                raise
        path = write_report(results, NAMES, gaps, failures)
    for gap in gaps:
        print(f"left out: {gap}")
    for job, why in failures.items():
        print(f"failed: {job}: {why}")
    for name, sentence in verdicts(results, chosen):
        print(f"{name}: {sentence}")
    print(f"wrote {path}")
    return int(ErrorCode.INTERNAL) if failures else 0
