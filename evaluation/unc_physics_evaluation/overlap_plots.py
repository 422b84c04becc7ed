"""Figures of beliefs that reach into things: how far they miss the goals, and one before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.patches import Rectangle
from scipy.ndimage import binary_closing, gaussian_filter

from unc_physics.geometry.library import load_model
from unc_physics.physics.layout import POSITION, QUATERNION
from unc_physics.physics.rotation import rotation_matrix

from .overlap_measures import OVERLAP
from .plots import new_figure, save
from .results import Rows

_TINTS = ("#D55E00", "#0072B2", "#009E73")  # of the starts
_OVERLAPPING, _APART = "#D55E00", "#0072B2"
_SHOWN = 14  # samples whose outlines are drawn
_PIXEL = 5e-4  # m
_GAPS = 7  # pixels, across gaps between spheres
_BINS = np.arange(-41.0, 42.0, 2.0) + 1.0 - 1e3 * OVERLAP  # mm: no bin on both sides of contact
_TITLES = {"rise": "rise [m]", "energy_gain": "energy gained [J]"}
_LEAST = {"rise": 1e-6, "energy_gain": 1e-6}


def draw_goals(
    path: Path,
    rows: Rows,
    groups: Sequence[str],
    starts: Mapping[str, str],
    quantities: Sequence[str],
    goals: Mapping[str, float],
) -> None:
    """The most of some quantities for each arrangement and uncertainty, by start, with their goals."""
    figure = new_figure(9.5, 2.6 * len(quantities) + 0.8)
    for ax, quantity in zip(
        np.atleast_1d(figure.subplots(len(quantities), 1, sharex=True)), quantities, strict=True
    ):
        for k, (start, title) in enumerate(starts.items()):
            found = rows.where(quantity=quantity, start=start)
            place = [
                next(g for g, group in enumerate(groups) if row["arrangement"].startswith(group))
                for row in found
            ]
            values = np.maximum(found.values(), _LEAST[quantity])
            ax.plot(
                np.array(place) + 0.22 * (k - 1),
                values,
                "o",
                color=_TINTS[k],
                markersize=4,
                alpha=0.5,
                markeredgewidth=0,
                label=title,
            )
        ax.axhline(goals[quantity], color="0.3", linestyle=":", linewidth=1.0)
        ax.set(yscale="log", ylabel=_TITLES[quantity])
        ax.grid(True, axis="y", color="0.92", linewidth=0.6)
        ax.tick_params(labelsize=8)
    ax.set_xticks(range(len(groups)), [group.replace(", ", ",\n") for group in groups], fontsize=7.5)
    figure.legend(
        *ax.get_legend_handles_labels(),
        loc="outside upper left",
        ncols=len(starts),
        fontsize=9,
        frameon=False,
    )
    save(figure, path)


def draw_starts(path: Path, model: str, states: Mapping[str, np.ndarray]) -> None:
    """Outlines of a body's samples on a table seen from the side, and how high their lowest points are.

    Parameters
    ----------
    model : str
    states : mapping of str to (N, 1, 13) array
        At time 0, by title.
    """
    packing = load_model(model)
    figure = new_figure(10.0, 4.7)
    axes = figure.subplots(2, len(states), sharex="row", height_ratios=(3.2, 1.0))
    half, top, bottom = 1.4 * packing.bounding_radius, 2.0 * packing.bounding_radius, 0.04
    for (above, below), (title, samples) in zip(axes.T, states.items(), strict=True):
        low = np.array([_lowest(packing, state[0]) for state in samples])
        above.add_patch(
            Rectangle((-half, -bottom), 2.0 * half, bottom, facecolor="0.9", edgecolor="0.55", linewidth=0.8)
        )
        for state, height in zip(samples[:_SHOWN, 0], low, strict=False):
            _draw_outline(
                above, packing, state, half, (-bottom, top), _OVERLAPPING if height < -OVERLAP else _APART
            )
        above.set(xlim=(-half, half), ylim=(-bottom, top), aspect="equal", title=title)
        above.set_xticks(np.arange(-0.05, 0.06, 0.05))
        for some, tint in ((low < -OVERLAP, _OVERLAPPING), (low >= -OVERLAP, _APART)):
            share = np.full(some.sum(), 100.0 / len(low))
            below.hist(1e3 * low[some], _BINS, weights=share, color=tint, alpha=0.8)
        overlap = f"{100.0 * np.mean(low < -OVERLAP):.0f} % overlap"
        below.text(0.02, 0.95, overlap, transform=below.transAxes, va="top", fontsize=9)
        below.set_xlabel("lowest point above the table [mm]", fontsize=9)
        for ax in (above, below):
            ax.tick_params(labelsize=8)
            ax.spines[["top", "right"]].set_visible(False)
    axes[0, 0].set_ylabel("z [m]", fontsize=9)
    axes[1, 0].set_ylabel("% of samples", fontsize=9)
    save(figure, path)


def _placed(packing, state):
    """Centres of a body's spheres, world frame [m]."""
    return packing.centers @ rotation_matrix(state[QUATERNION]).T + state[POSITION]


def _lowest(packing, state):
    return (_placed(packing, state)[:, 2] - packing.radii).min()


def _draw_outline(ax, packing, state, half, heights, tint):
    """The line around all of a body's spheres, seen along y."""
    x, z = np.arange(-half, half, _PIXEL), np.arange(*heights, _PIXEL)
    covered = np.zeros((len(z), len(x)), bool)
    for (cx, _, cz), r in zip(_placed(packing, state), packing.radii, strict=True):
        i, j = slice(*np.searchsorted(z, [cz - r, cz + r])), slice(*np.searchsorted(x, [cx - r, cx + r]))
        covered[i, j] |= (z[i] - cz)[:, None] ** 2 + (x[j] - cx)[None, :] ** 2 < r**2
    solid = gaussian_filter(binary_closing(covered, np.ones((_GAPS, _GAPS))).astype(float), 1.0)
    ax.contour(x, z, solid, levels=[0.5], colors=[tint], linewidths=0.8, alpha=0.8)
