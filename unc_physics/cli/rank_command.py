"""The command ``rank``: a file of actions in, the actions by their probability of success out."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path

from ..checks.shown import printable
from .output import writing
from .predict_command import check_picture
from .progress import told_progress


def add_rank_command(commands) -> None:
    """Add the parser of ``rank`` to the command line's subparsers."""
    parser = commands.add_parser(
        "rank",
        help="rank what a robot may do by its probability of success",
        description=(
            "Simulate a scene after each of several actions, all with the same random draws, and rank the"
            " actions by how probable it is that they succeed. Clear losers get few rollouts."
        ),
    )
    parser.add_argument(
        "actions", metavar="ACTIONS.yaml", help="file that names a scene, actions, and what counts as success"
    )
    parser.add_argument("--horizon", metavar="T", help="time to predict for [s], instead of the file's")
    parser.add_argument(
        "--rollouts", type=int, default=1000, metavar="N", help="most rollouts of one action (default 1000)"
    )
    parser.add_argument(
        "--budget",
        type=int,
        metavar="N",
        help=(
            "most rollouts of all actions together; by default a fifth of N for each, but as many as two may"
            " take"
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
    """Rank, and print the result."""
    from ..checks.validation import positive
    from ..prediction.actions_file import load_actions
    from ..prediction.rank import rank

    if arguments.picture is not None:
        check_picture(arguments.picture)
    limit = None if arguments.time_limit is None else positive(arguments.time_limit, "--time-limit")
    loaded = load_actions(arguments.actions, arguments.models)
    for k, event in enumerate(loaded.also):
        event.check(loaded.scene, f"also[{k}]")
    horizon = loaded.horizon if arguments.horizon is None else arguments.horizon
    with told_progress("rank", "rollout", f"{len(loaded.actions)} actions") as show:
        ranking = rank(
            loaded.scene,
            loaded.belief,
            loaded.actions,
            loaded.score,
            horizon,
            smallest_first=loaded.smallest_first,
            rollouts=arguments.rollouts,
            budget=arguments.budget,
            seed=arguments.seed,
            max_computation_time=limit,
            progress=show,
        )
    if arguments.json:
        print(json.dumps(as_dict(ranking, loaded.also), allow_nan=False))
    else:
        print(as_table(ranking, loaded.also))
    if arguments.picture is not None:
        from .rank_picture import draw_ranking

        with writing(Path(arguments.picture), "--picture"):
            draw_ranking(
                arguments.picture, ranking, loaded.also, Path(arguments.actions).stem.replace("_", " ")
            )
    return 0


def as_dict(ranking, also=()) -> dict:
    """The ranking as plain Python values; ``also`` are further events to tell of each action."""
    return {
        "score": str(ranking.score),
        "smallest_first": ranking.smallest_first,
        "seed": ranking.seed,
        "rollouts": ranking.rollouts,
        "wall_time": max(action.prediction.wall_time for action in ranking),
        "actions": [
            {
                "name": action.name,
                "score": asdict(action.score),
                "difference": action.difference.value,
                "difference_std": action.difference.std,
                "margin": _finite(action.margin),
                "tied": action.tied,
                "clearly_worse": action.clearly_worse,
                "rollouts": action.rollouts,
                "also": {str(event): asdict(action.prediction.probability(event)) for event in also},
            }
            for action in ranking
        ],
    }


def _finite(value):
    """Return a number as JSON can hold it: None where it has no bounds."""
    return value if value is not None and math.isfinite(value) else None


def as_table(ranking, also=()) -> str:
    """The ranking as text, the best action first."""
    width = max(6, *(len(printable(action.name)) for action in ranking))
    order = "lowest first" if ranking.smallest_first else "highest first"
    what = f"{printable(str(ranking.score))}; {order}; {ranking.rollouts} rollouts, seed {ranking.seed}"
    lines = [
        f"probability of: {what}",
        f"{'action':<{width}}  {'probability':>11}  {'interval':^15}  {'difference':>17}  {'margin':>6}"
        + "  rollouts"
        + "".join(f"  [{k}]  " for k in range(1, len(also) + 1)),
    ]
    for action in ranking:
        p, low, high = action.score.estimate, action.score.low, action.score.high
        difference = f"{action.difference.value:+.3f} +- {action.difference.std:.3f}"
        row = f"{printable(action.name):<{width}}  {p:11.3f}  {low:.3f} to {high:.3f}  "
        margin = "" if action.margin is None else f"{action.margin:.2f}"
        row += f"{'' if action is ranking.best else difference:>17}  {margin:>6}  {action.rollouts:8d}"
        row += "".join(f"  {action.prediction.probability(event).estimate:.3f}" for event in also)
        row += "  tied" if action.tied else "  clearly worse" if action.clearly_worse else ""
        lines.append(row)
    lines += [f"[{k}] {printable(str(event))}" for k, event in enumerate(also, 1)]
    tied = sum(action.tied for action in ranking)
    if tied:
        lines.append(
            f"{tied} actions are tied: within a standard error of the best score. They are in order of"
            " margin, the distance from failure in standard deviations."
        )
    return "\n".join(lines)
