"""The command ``rank``: rank actions of a file by their probability of success."""

from __future__ import annotations

import json
from pathlib import Path

from .output import progress_display, writing
from .predict_command import check_picture


def add_rank_command(commands) -> None:
    """Add the parser of ``rank`` to the command line's subparsers."""
    parser = commands.add_parser(
        "rank",
        help="rank actions by their probability of success",
        description=(
            "Simulate a scene after each of several actions, all with the same random draws, and rank the"
            " actions by their probability of success. Clear losers get few rollouts."
        ),
    )
    parser.add_argument("actions", metavar="ACTIONS.yaml", help="file with a scene, actions and a score")
    parser.add_argument("--horizon", metavar="T", help="time to predict for [s], instead of the file's")
    parser.add_argument(
        "--rollouts",
        type=int,
        default=1000,
        metavar="N",
        help="maximum number of rollouts of one action (default 1000)",
    )
    parser.add_argument(
        "--budget",
        type=int,
        metavar="N",
        help=(
            "maximum number of rollouts of all actions together (default: a fifth of --rollouts for each"
            " action, at least twice --rollouts)"
        ),
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the draws (default 0)")
    parser.add_argument(
        "--time-limit", metavar="T", help="give up after computing for T seconds; compiling does not count"
    )
    parser.add_argument(
        "--picture", metavar="OUT.png", help="also draw the actions' probabilities with their intervals"
    )
    parser.add_argument("--models", metavar="DIR", help="folder of the models, instead of the model library")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Rank and print the result."""
    from ..checks.errors import InvalidHorizonError
    from ..checks.validation import number_from_text, positive
    from ..prediction.actions_file import load_actions
    from ..prediction.rank import rank

    if arguments.picture is not None:
        check_picture(arguments.picture)
    limit = None
    if arguments.time_limit is not None:
        limit = positive(number_from_text(arguments.time_limit, "--time-limit"), "--time-limit")
    scene, belief, horizon, actions, score, also = load_actions(arguments.actions, arguments.models)
    for k, event in enumerate(also):
        event.check(scene, f"also[{k}]")
    if arguments.horizon is not None:
        horizon = number_from_text(arguments.horizon, "horizon", InvalidHorizonError)
    with progress_display("rank", "rollout", f"{len(actions)} actions") as show:
        ranking = rank(
            scene,
            belief,
            actions,
            score,
            horizon,
            rollouts=arguments.rollouts,
            budget=arguments.budget,
            seed=arguments.seed,
            max_computation_time=limit,
            progress=show,
        )
    print(json.dumps(ranking.to_dict(also), allow_nan=False) if arguments.json else ranking.table(also))
    if arguments.picture is not None:
        from ..plots.ranking_picture import draw_ranking

        with writing(Path(arguments.picture), "--picture"):
            draw_ranking(arguments.picture, ranking, also, Path(arguments.actions).stem.replace("_", " "))
    return 0
