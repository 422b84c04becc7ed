"""Errors over the time step: a panel for each case, a curve for each engine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.ticker import LogLocator, NullLocator

from .methods import LOOKS
from .plots import new_figure, save

_COLUMNS = 3
_BELOW_FLOOR = 30.0  # how far below the floor a panel may end; smaller errors are drawn at its edge
_SLOPES = {1: "--", 2: ":"}
_TICKS = (0.25, 1.0, 4.0, 16.0)  # ms


class Panel(NamedTuple):
    """One case of the figure.

    Attributes
    ----------
    title, unit : str
    floor : float
        Is shaded below.
    curves : mapping of str to (n, 2) array
        Time steps [s] and errors of each engine.
    """

    title: str
    unit: str
    floor: float
    curves: Mapping[str, np.ndarray]


def draw_orders(path: Path, panels: Sequence[Panel]) -> None:
    """Draw errors over time steps, with slopes 1 and 2 for comparison."""
    lines = -(-len(panels) // _COLUMNS)
    figure = new_figure(3.6 * _COLUMNS, 2.9 * lines + 0.6)
    axes = figure.subplots(lines, _COLUMNS, squeeze=False, sharex=True)
    handles = {}
    for ax, panel in zip(axes.flat, panels, strict=False):
        handles.update(_draw(ax, panel))
    for ax in axes.flat[len(panels) :]:
        ax.axis("off")
    for ax in axes.flat[max(0, len(panels) - _COLUMNS) : len(panels)]:
        ax.set_xlabel("time step [ms]", fontsize=9)
        ax.tick_params(axis="x", labelbottom=True)
    figure.legend(
        list(handles.values()),
        list(handles),
        loc="outside lower center",
        ncols=len(handles),
        fontsize=9,
        frameon=False,
    )
    save(figure, path)


def _draw(ax, panel):
    steps, errors = np.concatenate(list(panel.curves.values())).T
    bottom = max(0.3 * min(np.nanmin(errors), panel.floor), panel.floor / _BELOW_FLOOR)
    top = 3.0 * max(np.nanmax(errors), panel.floor)
    handles = {"floor": ax.axhspan(bottom, panel.floor, color="0.92", linewidth=0, zorder=0)}
    # through the most accurate curve that leaves the floor, at the longest step
    worst = [np.nanmax(curve[:, 1]) for curve in panel.curves.values()]
    begin = min((error for error in worst if error > panel.floor), default=panel.floor)
    across = np.array([steps.min(), steps.max()])
    for slope, style in _SLOPES.items():
        (handles[f"slope {slope}"],) = ax.plot(
            1e3 * across, begin * (across / across[1]) ** slope, style, color="0.55", linewidth=1.0, zorder=9
        )
    for k, (engine, curve) in enumerate(panel.curves.items()):
        look = LOOKS[engine]
        (handles[look.label],) = ax.plot(
            1e3 * curve[:, 0],
            np.maximum(curve[:, 1], 1.5 * bottom),
            marker=look.marker or "o",
            markersize=7.5 - 1.5 * k,  # curves that coincide show beside each other
            linewidth=2.0 - 0.4 * k,
            color=look.color,
            zorder=2 + k,
        )
    ax.set(xscale="log", yscale="log", ylim=(bottom, top))
    ax.set_title(panel.title, fontsize=10)
    ax.set_ylabel(f"error [{panel.unit}]", fontsize=8)
    ax.yaxis.set_major_locator(LogLocator(numticks=8))
    ax.set_xticks(_TICKS, labels=[f"{value:g}" for value in _TICKS])
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_minor_locator(NullLocator())
    ax.tick_params(labelsize=8)
    ax.grid(True, color="0.9", linewidth=0.6)
    ax.set_axisbelow(True)
    return handles
