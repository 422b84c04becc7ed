"""Reliability before and after a calibration, as a picture."""

from __future__ import annotations

import numpy as np

from .calibrate import Calibration

_TITLES = {"position_rank": "positions", "rotation_rank": "rotations"}


def draw_calibration(path, found: Calibration) -> None:
    """Draw which share of motions the regions of each level hold, at each time, before and after."""
    from matplotlib.figure import Figure

    times = max((one.times for one in found.recorded), key=len)
    figure = Figure(figsize=(2.6 * len(times) + 0.4, 5.4), layout="constrained")
    axes = figure.subplots(2, len(times), squeeze=False, sharex=True, sharey=True)
    kinds = (("before", found.scores_before, "#999999"), ("after", found.scores_after, "#0072B2"))
    for row, (quantity, title) in enumerate(_TITLES.items()):
        for k in range(len(times)):
            ax = axes[row, k]
            ax.plot([0, 1], [0, 1], color="#CCCCCC", linewidth=0.8)
            for name, scores, color in kinds:
                ranks = np.sort(
                    [
                        ranks[-1] if k == len(times) - 1 else ranks[k]
                        for one in scores
                        if len(ranks := getattr(one, quantity)) == len(times) or k == len(times) - 1
                    ]
                )
                share = (1.0 + np.arange(len(ranks))) / len(ranks)
                ax.plot(ranks, share, color=color, label=name, drawstyle="steps-post")
            when = "at the end" if k == len(times) - 1 else f"{times[k]:.3g} s"
            ax.set_title(f"{title}, {when}", fontsize=9)
            ax.set_xlim(0, 1)
            ax.set_ylim(0, 1)
            if row:
                ax.set_xlabel("nominal coverage", fontsize=8)
        axes[row, 0].set_ylabel("observed coverage", fontsize=8)
    axes[0, 0].legend(fontsize=8, frameon=False)
    figure.savefig(path, dpi=130)
