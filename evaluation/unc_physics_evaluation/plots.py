"""Figures: the same colour for the same method everywhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from .results import Rows

DPI = 130


def log_axis(ax, which):
    """Give an axis a logarithmic scale with plain numbers at 1, 2 and 5."""
    ax.set(**{f"{which}scale": "log"})
    axis = ax.xaxis if which == "x" else ax.yaxis
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.15g}".replace(",", "\u202f")))
    axis.set_minor_locator(NullLocator())
    axis.set_tick_params(labelsize=8)
    ax.grid(True, which="major", color="0.9", linewidth=0.6)


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of so many inches."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write a figure."""
    figure.savefig(path, dpi=DPI)


def draw_calibration(path: Path, groups: Mapping[str, Rows], kinds: Sequence[str], tolerance: float) -> None:
    """Answered probabilities against the truth: a line of panels for each group, one for each kind.

    Parameters
    ----------
    groups : mapping of str to Rows
        Of answers, each with what is ``expected`` beside its value.
    kinds : sequence of str
        First words of the rows' quantities.
    tolerance : float
        Is shaded.
    """
    figure = new_figure(11.0, 3.8 * len(groups))
    axes = figure.subplots(len(groups), len(kinds), squeeze=False, sharex=True, sharey=True)
    ends = np.array([0.0, 1.0])
    for line, (title, rows) in zip(axes, groups.items(), strict=True):
        for ax, kind in zip(line, kinds, strict=True):
            asked = [row for row in rows if row["quantity"].startswith(kind)]
            shown = [(row["expected"], row["value"]) for row in asked if np.isfinite(row["value"])]
            ax.fill_between(ends, ends - tolerance, ends + tolerance, color="0.9", linewidth=0)
            ax.plot(ends, ends, color="0.6", linewidth=1.0)
            ax.plot(*np.array(shown).reshape(-1, 2).T, "o", markersize=4, alpha=0.6, markeredgewidth=0)
            limits = (-0.03, 1.03)
            ax.set(aspect="equal", xlim=limits, ylim=limits)
            ax.set_title(f"{kind}: {len(shown)} of {len(asked)} answered", fontsize=10)
        line[0].set_ylabel(f"{title}\nprobability answered", fontsize=9)
    for ax in axes[-1]:
        ax.set_xlabel("truth", fontsize=9)
    figure.suptitle(f"Answered probabilities against the truth; shaded: within {tolerance}", fontsize=12)
    save(figure, path)
