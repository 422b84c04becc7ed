"""Figures: the same colour for the same method everywhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from unc_physics.propagators.base import Anytime
from unc_physics.propagators.registry import PROPAGATORS

from .comparison import POSITION_ERROR, ROTATION_ERROR
from .methods import FLOOR, GAUSSIAN, LOOKS, MONTE_CARLO, color, label
from .pareto import Choice, front
from .results import Rows

DPI = 130


def draw_speed_against_error(
    path: Path,
    choices: Mapping[tuple[str, str], Sequence[Choice]],
    limits: Mapping[tuple[str, str], float],
    time: str,
    engines: Mapping[tuple[str, str], Mapping[str, Sequence[Choice]]],
) -> None:
    """Error over the floor against time, a column for each model, with the Pareto front.

    Parameters
    ----------
    choices : mapping of (model, quantity) to sequence of Choice
    limits : mapping of (model, quantity) to float
        The best Gaussian's error over the floor.
    time : str
        Which time it is.
    engines : mapping of (model, quantity) to (mapping of str to sequence of Choice)
        Monte Carlo in other engines, by their names.
    """
    models = list(dict.fromkeys(model for model, _ in choices))
    titles = {POSITION_ERROR: "positions: W1 / floor", ROTATION_ERROR: "rotations: W1 / floor"}
    figure = new_figure(3.9 * len(models) + 1.6, 7.6)
    axes = figure.subplots(2, len(models), squeeze=False, sharex=True, sharey="row")
    handles = {}
    for i, (quantity, title) in enumerate(titles.items()):
        for j, model in enumerate(models):
            ax, found = axes[i, j], choices[model, quantity]
            best = front(found)
            (handles["Pareto front"],) = ax.plot(
                [1e3 * c.time for c in best],
                [c.error for c in best],
                color="#F0E442",
                linewidth=6,
                alpha=0.8,
                zorder=1,
                drawstyle="steps-post",
            )
            samples = [c for c in found if c.method == MONTE_CARLO]
            handles["Monte Carlo, N samples"] = _series(ax, samples, MONTE_CARLO)
            growing = [
                c for c in found if c.method in PROPAGATORS and issubclass(PROPAGATORS[c.method], Anytime)
            ]
            if growing:
                _series(ax, growing, growing[0].method)
            for series, offset, side in ((samples, (4, 4), "left"), (growing, (-5, -10), "right")):
                for c in series:
                    ax.annotate(
                        str(c.samples),
                        (1e3 * c.time, c.error),
                        xytext=offset,
                        textcoords="offset points",
                        ha=side,
                        fontsize=7,
                    )
            for c in found:
                if c.method != MONTE_CARLO:
                    ax.plot(
                        [1e3 * c.time] * 2,
                        c.scatter,
                        color=color(c.method),
                        linewidth=1.2,
                        alpha=0.7,
                        zorder=3,
                    )
                    (handles[label(c.method)],) = ax.plot(
                        1e3 * c.time,
                        c.error,
                        LOOKS[c.method].marker,
                        color=color(c.method),
                        markersize=9,
                        markeredgecolor="white",
                        linestyle="none",
                        zorder=4,
                    )
            for name, series in engines.get((model, quantity), {}).items():
                handles[f"Monte Carlo in {name}"] = _series(ax, series, name.partition(",")[0].lower())
            handles["limit of any single Gaussian"] = ax.axhline(
                limits[model, quantity], linestyle="--", color=color(GAUSSIAN)
            )
            handles["floor: two truths"] = ax.axhline(1.0, linestyle=":", color=color(FLOOR))
            log_axis(ax, "x", decades_only=True)
            log_axis(ax, "y")
            if i == 0:
                ax.set_title(model, fontsize=10)
            else:
                ax.set_xlabel(f"{time} [ms]", fontsize=8)
        axes[i, 0].set_ylabel(title, fontsize=9)
    _legend(figure, handles)
    save(figure, path)


def draw_work_precision(path: Path, panels: Mapping[str, Mapping[str, tuple[np.ndarray, float]]]) -> None:
    """Errors over CPU time, a column for each scene: of single samples, and of their distribution.

    Parameters
    ----------
    panels : mapping of str to (mapping of str to ((n, 3) array, float))
        For each scene and engine CPU time [s], error of a sample [m] and W1 [m] at each step, and W1's floor
        [m].
    """
    figure = new_figure(3.3 * len(panels) + 1.6, 6.6)
    axes = figure.subplots(2, len(panels), squeeze=False, sharex="col")
    handles = {}
    for j, (scene, curves) in enumerate(panels.items()):
        for i in range(2):
            ax = axes[i, j]
            for engine, (points, floor) in curves.items():
                look = LOOKS[engine]
                (line,) = ax.plot(
                    1e3 * points[:, 0],
                    1e3 * points[:, 1 + i],
                    marker=look.marker,
                    markersize=5,
                    color=look.color,
                )
                handles[look.label] = line
                if i == 1:
                    limit = ax.axhline(1e3 * floor, color=look.color, linestyle=":", linewidth=1.0)
                    handles[f"floor of {look.label}"] = limit
            log_axis(ax, "x")
            log_axis(ax, "y", decades_only=i == 0)
        axes[0, j].set_title(scene.replace("_", " "), fontsize=10)
        axes[1, j].set_xlabel("CPU time of a rollout [ms]", fontsize=8)
    axes[0, 0].set_ylabel("error of a sample's position, median [mm]", fontsize=9)
    axes[1, 0].set_ylabel("W1 of positions [mm]", fontsize=9)
    _legend(figure, dict(sorted(handles.items(), key=lambda entry: entry[0].startswith("floor"))))
    figure.suptitle(
        "Each engine against itself at the smallest steps; from left to right 60 to 2000 steps in a second",
        fontsize=10,
    )
    save(figure, path)


def log_axis(ax, which, decades_only=False):
    """A logarithmic axis with plain numbers at 1, 2 and 5, or at powers of ten only."""
    ax.set(**{f"{which}scale": "log"})
    axis = ax.xaxis if which == "x" else ax.yaxis
    axis.set_major_locator(LogLocator(subs=(1.0,) if decades_only else (1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.15g}".replace(",", "\u202f")))
    axis.set_minor_locator(NullLocator())
    axis.set_tick_params(labelsize=8)
    ax.grid(True, which="major", color="0.9", linewidth=0.6)


def _series(ax, choices, name):
    (line,) = ax.plot(
        [1e3 * c.time for c in choices],
        [c.error for c in choices],
        marker=LOOKS[name].marker,
        markersize=4,
        color=color(name),
        linewidth=1.0,
        zorder=2,
    )
    return line


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of so many inches."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _legend(figure, handles):
    figure.legend(list(handles.values()), list(handles), loc="outside right upper", fontsize=8, frameon=False)


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
