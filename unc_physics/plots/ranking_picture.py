"""Picture of a ranking of actions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ..checks.shown import printable

_KEPT, _WORSE = "#0072B2", "#999999"
_OTHERS = ("#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9")


class DrawnAction(NamedTuple):
    """Action in a picture: its score with the interval, and the probabilities of other events."""

    name: str
    score: float
    low: float
    high: float
    clearly_worse: bool
    rollouts: int
    others: Sequence[float]


def draw_ranking(
    path: str, actions: Sequence[DrawnAction], score: str, others: Sequence[str] = (), title: str = ""
) -> None:
    """Draw each action's score with its interval into a PNG file, and probabilities of other events.

    ``score`` and ``others`` are the texts of the events.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.2, 1.3 + 0.36 * len(actions)), layout="constrained")
    ax = figure.subplots()
    for row, action in enumerate(actions):
        p, low, high = action.score, action.low, action.high
        color = _WORSE if action.clearly_worse else _KEPT
        ax.errorbar(p, row, xerr=[[p - low], [high - p]], fmt="o", color=color, capsize=3, zorder=3)
        for estimate, tint in zip(action.others, _OTHERS, strict=False):
            ax.plot(estimate, row, "|", color=tint, markersize=11, markeredgewidth=2)
        ax.annotate(
            f"{action.rollouts} rollouts",
            (1.02, row),
            xycoords=("axes fraction", "data"),
            fontsize=8,
            va="center",
        )
    ax.plot([], [], "o-", color=_KEPT, label=printable(score))
    if any(action.clearly_worse for action in actions):
        ax.plot([], [], "o-", color=_WORSE, label="the same, where clearly worse")
    for event, tint in zip(others, _OTHERS, strict=False):
        ax.plot([], [], "|", color=tint, markeredgewidth=2, label=printable(event))
    ax.set_yticks(range(len(actions)), [printable(action.name) for action in actions])
    ax.invert_yaxis()
    ax.set_xlim(-0.02, 1.02)
    ax.set_xlabel("probability, with its 99.9 % confidence interval", fontsize=9)
    ax.grid(axis="x", color="#E5E5E5")
    figure.legend(loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    ax.set_title(title, fontsize=11)
    figure.savefig(path, dpi=130)
