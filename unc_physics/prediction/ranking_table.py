"""Rankings as plain values and as text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from ..checks.shown import printable
from .events import Event

if TYPE_CHECKING:
    from .rank import Ranking


def ranking_as_dict(ranking: Ranking, also: Sequence[Event] = ()) -> dict[str, Any]:
    """Return a ranking as plain Python values, which JSON can hold.

    The probabilities of further events, ``also``, are added to each action.
    """
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


def ranking_as_table(ranking: Ranking, also: Sequence[Event] = (), most: int | None = None) -> str:
    """Return a table of the actions, the best one first, of at most ``most`` lines.

    Each of the further events, ``also``, is a column.
    """
    width = max(6, *(len(printable(action.name)) for action in ranking))
    order = "lowest first" if ranking.smallest_first else "highest first"
    what = f"{printable(str(ranking.score))}; {order}; {ranking.rollouts} rollouts, seed {ranking.seed}"
    lines = [
        f"probability of: {what}",
        f"{'action':<{width}}  {'probability':>11}  {'interval':^14}  {'difference':>16}  {'margin':>6}"
        + "  rollouts"
        + "".join(f"  {f'[{k}]':>5}" for k in range(1, len(also) + 1)),
    ]
    for action in ranking:
        p, low, high = action.score.estimate, action.score.low, action.score.high
        difference = f"{action.difference.value:+.3f} +- {action.difference.std:.3f}"
        row = f"{printable(action.name):<{width}}  {p:11.3f}  {low:.3f} to {high:.3f}  "
        margin = "" if action.margin is None else f"{action.margin:.2f}"
        row += f"{'' if action is ranking.best else difference:>16}  {margin:>6}  {action.rollouts:8d}"
        row += "".join(f"  {action.prediction.probability(event).estimate:.3f}" for event in also)
        row += "  tied" if action.tied else "  clearly worse" if action.clearly_worse else ""
        lines.append(row)
    notes = [f"[{k}] {printable(str(event))}" for k, event in enumerate(also, 1)]
    tied = sum(action.tied for action in ranking)
    if tied:
        said = f"{tied} actions are tied: within a standard error of the best score."
        if all(action.margin is None for action in ranking if action.tied):
            said += " Contacts have no margin, so they are in the order in which they were given."
        else:
            said += " They are in order of margin, the distance from failure in standard deviations."
        notes.append(said)
    if most is not None and len(lines) + len(notes) > most:
        kept = max(3, most - len(notes) - 1)
        lines = [*lines[:kept], f"... {len(lines) - kept} more actions"]
    return "\n".join(lines + notes)
