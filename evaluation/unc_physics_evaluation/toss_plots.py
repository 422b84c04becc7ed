"""Reliability diagrams of tosses: how often what was said to come with a probability came."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .experiments import tosses as x
from .methods import OURS, color
from .plots import new_figure, save
from .recorded_tosses import FACES
from .results import Rows

_BINS = np.array([0.0, 0.02, 0.1, 0.25, 0.5, 0.75, 0.9, 0.98, 1.0001])
_DASHES = {x.AS_GIVEN: ":", x.NO_ERRORS: "--", x.ERRORS: "-"}


def draw_reliability(path: Path, rows: Rows, lines: Sequence) -> None:
    """Faces, and regions of positions and rotations, at each time."""
    from .toss_report import values

    figure = new_figure(13.0, 6.4)
    axes = figure.subplots(2, 5)
    for line in lines:
        look = {
            "color": color(line.method, line.samples) if line.engine == OURS else color(line.engine),
            "linestyle": _DASHES[line.given],
            "label": line.title,
            "linewidth": 1.3,
        }
        said, came = _faces(rows, line, values)
        axes[0, 0].plot(said, came, marker=".", **look)
        for row, quantity in enumerate((x.POSITION_RANK, x.ROTATION_RANK)):
            for k, when in enumerate(x.LABELS):
                ranks = np.sort(list(values(rows, line, f"{quantity} {when}").values()))
                share = (1.0 + np.arange(len(ranks))) / len(ranks)
                axes[row, k + 1].plot(ranks, share, **look)
    for ax in (axes[0, 0], *axes[:, 1:].flat):
        ax.plot([0, 1], [0, 1], color="#CCCCCC", linewidth=0.8, zorder=0)
        ax.set_xlim(0, 1)
        ax.set_ylim(0, 1)
        ax.tick_params(labelsize=7)
    axes[0, 0].set_title("faces", fontsize=9)
    axes[0, 0].set_xlabel("probability", fontsize=8)
    axes[0, 0].set_ylabel("how often it came", fontsize=8)
    for k, when in enumerate(x.LABELS):
        axes[0, k + 1].set_title(f"position, {when}", fontsize=9)
        axes[1, k + 1].set_title(f"rotation, {when}", fontsize=9)
        axes[1, k + 1].set_xlabel("region of", fontsize=8)
        axes[0, k + 1].set_ylabel("holds", fontsize=8)
    handles = axes[0, 0].get_legend_handles_labels()
    axes[1, 0].axis("off")
    axes[1, 0].legend(*handles, fontsize=7, loc="center", frameon=False)
    save(figure, path)


def _faces(rows, line, values):
    """Mean probability and frequency of faces, in bins of probability."""
    observed = values(rows, line, x.FACE)
    shares, came = [], []
    for face in range(FACES):
        for k, share in values(rows, line, f"{x.SHARE} {face}").items():
            shares.append(share)
            came.append(observed[k] == face)
    shares, came = np.array(shares), np.array(came)
    which = np.digitize(shares, _BINS) - 1
    some = [which == b for b in range(len(_BINS) - 1) if np.any(which == b)]
    return [shares[own].mean() for own in some], [came[own].mean() for own in some]
