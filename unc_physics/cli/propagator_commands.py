"""The commands about propagators: ``propagators`` lists them, ``warm-up`` compiles their kernels."""

from __future__ import annotations

import time

#: The columns of the paper's Table 1, in the order of `base.Traits`.
_TABLE_1 = (
    "propagator",
    "mean update",
    "uncertainty",
    "cross-body corr.",
    "sep. int./coll.",
    "collision treatment",
)


def add_propagators_command(commands) -> None:
    """Add the parser of ``propagators`` to the command line's subparsers."""
    parser = commands.add_parser(
        "propagators",
        help="list the propagators and their options",
        description="Compare all propagators, including those of other packages, as the paper's Table 1 does,"
        " and list their options.",
    )
    parser.set_defaults(run=run_propagators)


def run_propagators(arguments) -> int:
    """Print the paper's Table 1 of all propagators, and their options."""
    from ..propagators.registry import PROPAGATORS

    lines: list[tuple[str, ...]] = [_TABLE_1]
    for name, cls in PROPAGATORS.items():
        values = vars(cls.traits).values()
        lines.append(
            (name, *(("no", "yes")[value] if isinstance(value, bool) else value for value in values))
        )
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        print("  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip())
    print()
    for name, cls in PROPAGATORS.items():
        print(f"{name}: {cls.description()}")
        for option in cls.described_options():
            print(f"    {option.name}: {option.as_text()}")
    return 0


def add_warm_up_command(commands) -> None:
    """Add the parser of ``warm-up`` to the command line's subparsers."""
    parser = commands.add_parser(
        "warm-up",
        help="compile kernels ahead",
        description="Compile the kernels of these propagators, so that first predictions start at once. Each"
        " processor core compiles for another propagator.",
    )
    parser.add_argument(
        "propagators", nargs="*", metavar="PROPAGATOR", help="names of propagators (default: all)"
    )
    parser.add_argument(
        "--physics",
        choices=("everyday", "paper"),
        default="everyday",
        help="physics of the scenes (default: everyday); propagators that do not support it are compiled for"
        " the paper's",
    )
    parser.set_defaults(run=run_warm_up)


def run_warm_up(arguments) -> int:
    """Compile with a progress bar, and print the duration for each propagator."""
    from tqdm import tqdm

    from ..prediction.warm_up import TYPICAL_KERNELS, warm_up_in_processes
    from ..propagators.registry import PROPAGATORS
    from ..scene.presets import PRESETS

    total = None if arguments.propagators else TYPICAL_KERNELS[arguments.physics]
    names = arguments.propagators or PROPAGATORS
    started = time.perf_counter()
    with tqdm(total=total, unit=" kernels", desc="compiling", disable=None, leave=False) as bar:
        for name, compiled in warm_up_in_processes(names, PRESETS[arguments.physics]):
            bar.update(compiled - bar.n)
            if name is not None:
                bar.write(f"{name}: ready after {time.perf_counter() - started:.1f} s")
    return 0
