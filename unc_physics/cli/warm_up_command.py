"""The command ``warm-up``: compile kernels in advance, for example during installation or launch."""

from __future__ import annotations

import time


def add_warm_up_command(commands) -> None:
    """Add the parser of ``warm-up`` to the command line's subparsers."""
    parser = commands.add_parser(
        "warm-up",
        help="compile kernels ahead",
        description="Compile what predictions by these propagators need, or load it where it is compiled, so"
        " that no first prediction waits for it.",
    )
    parser.add_argument(
        "propagators", nargs="*", metavar="PROPAGATOR", help="names of propagators (default: all)"
    )
    parser.add_argument(
        "--physics",
        choices=("everyday", "paper"),
        default="everyday",
        help="for scenes of this physics; propagators that do not run on it are made ready for the paper's"
        " (default: everyday)",
    )
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Compile and print the duration."""
    from ..prediction.warm_up import warm_up
    from ..propagators.registry import PROPAGATORS
    from ..scene.presets import PRESETS

    for name in arguments.propagators or PROPAGATORS:
        wall, spent = time.perf_counter(), time.process_time()
        warm_up((name,), PRESETS[arguments.physics])
        wall, spent = time.perf_counter() - wall, time.process_time() - spent
        print(f"{name}: ready after {wall:.1f} s ({spent:.1f} s of CPU)", flush=True)
    return 0
