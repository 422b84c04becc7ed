"""The command ``rank``: rank actions of a file by their probability of success."""

from __future__ import annotations

import json
from pathlib import Path

from .arguments import add_options, check_picture, horizon_of, time_limit
from .output import progress_display, writing


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
    add_options(parser, "--horizon", "--time-limit", "--models", "--json")
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
        "--picture", metavar="OUT.png", help="also draw the actions' probabilities with their intervals"
    )
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Rank and print the result."""
    from ..prediction.actions_file import load_actions
    from ..prediction.rank import rank

    if arguments.picture is not None:
        check_picture(arguments.picture)
    scene, belief, horizon, actions, score, also = load_actions(arguments.actions, arguments.models)
    for k, event in enumerate(also):
        event.check(scene, f"also[{k}]")
    waiting = progress_display("rank", "rollout", f"{len(actions)} actions")
    with time_limit(arguments) as limit, waiting as show:
        ranking = rank(
            scene,
            belief,
            actions,
            score,
            horizon_of(arguments, horizon),
            rollouts=arguments.rollouts,
            budget=arguments.budget,
            seed=arguments.seed,
            max_computation_time=limit,
            progress=show,
        )
    print(json.dumps(ranking.to_dict(also), allow_nan=False) if arguments.json else ranking.table(also))
    if arguments.picture is not None:
        _draw(arguments, ranking, also)
    return 0


def _draw(arguments, ranking, also):
    """Draw the actions with their scores, and the probabilities of the events `also`."""
    from ..plots.ranking_picture import DrawnAction, draw_ranking

    actions = [
        DrawnAction(
            action.name,
            action.score.estimate,
            action.score.low,
            action.score.high,
            action.clearly_worse,
            action.rollouts,
            [action.prediction.probability(event).estimate for event in also],
        )
        for action in ranking
    ]
    title = Path(arguments.actions).stem.replace("_", " ")
    with writing(Path(arguments.picture), "--picture"):
        draw_ranking(arguments.picture, actions, str(ranking.score), [str(event) for event in also], title)
