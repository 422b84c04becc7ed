"""The command ``rank``: rank scene files by the probability of an event."""

from __future__ import annotations

import functools
import json
import operator

from .arguments import add_options, horizon_of, time_limit
from .output import progress_display


def add_rank_command(commands) -> None:
    """Add the parser of ``rank`` to the command line's subparsers."""
    parser = commands.add_parser(
        "rank",
        help="rank scene files by the probability of an event",
        description=(
            "Predict several scene files, all with the same random draws, and rank them by the probability of"
            " an event. Clear losers get few rollouts."
        ),
    )
    parser.add_argument("scenes", nargs="+", metavar="SCENE.yaml", help="scene file of one action")
    parser.add_argument(
        "--event",
        action="append",
        required=True,
        metavar="EVENT",
        help=(
            "what counts as success, such as 'upright: cup' or 'fell_off: {object: cup}'; if"
            " repeated, all events together"
        ),
    )
    add_options(parser, "--horizon", "--executor", "--time-limit", "--models", "--json")
    parser.add_argument(
        "--rollouts",
        type=int,
        default=1000,
        metavar="N",
        help="maximum number of rollouts of one scene (default 1000)",
    )
    parser.add_argument(
        "--budget",
        type=int,
        metavar="N",
        help=(
            "maximum number of rollouts of all scenes together (default: a fifth of --rollouts for each"
            " scene, at least twice --rollouts)"
        ),
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the draws (default 0)")
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Rank and print the result."""
    from ..checks.errors import InvalidHorizonError
    from ..prediction.event_entries import event_from_text
    from ..prediction.rank import rank
    from ..scene.scene_file import load_scene

    score = functools.reduce(operator.and_, (event_from_text(text, "--event") for text in arguments.event))
    loaded = {path: load_scene(path, arguments.models) for path in arguments.scenes}
    first = loaded[arguments.scenes[0]]
    horizon = horizon_of(arguments, first.horizon)
    others = [one.horizon for one in loaded.values() if one.horizon != first.horizon]
    if others and arguments.horizon is None:
        raise InvalidHorizonError(
            f"must be the same in all files, {first.horizon} s as in the first one, or be given by --horizon",
            field="horizon",
            value=others[0],
        )
    waiting = progress_display("rank", "rollout", f"{len(loaded)} scenes")
    with time_limit(arguments) as limit, waiting as show:
        ranking = rank(
            first.scene,
            first.belief,
            {path: one[:2] for path, one in loaded.items()},
            score,
            horizon,
            rollouts=arguments.rollouts,
            budget=arguments.budget,
            seed=arguments.seed,
            executor=arguments.executor,
            max_computation_time=limit,
            progress=show,
        )
    print(json.dumps(ranking.to_dict(), allow_nan=False) if arguments.json else ranking.table())
    return 0
