"""Figures: the same colour for the same method everywhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from scipy.spatial.transform import Rotation

from unc_physics.cli.scene_picture import outline
from unc_physics.geometry.packing_file import SpherePacking
from unc_physics.geometry.picture import box_corners, shaded_balls, view_axes
from unc_physics.physics.layout import POSITION, QUATERNION
from unc_physics.propagators.registry import PROPAGATORS
from unc_physics.scene.environment import Element

from .comparison import CPU_TIME, POSITION_ERROR, ROTATION_ERROR
from .methods import FLOOR, GAUSSIAN, LOOKS, MONTE_CARLO, color, label
from .pareto import Choice, front
from .results import Rows

DPI = 130


def draw_over_sigma(path: Path, lines: Sequence[tuple[str, str, Rows]], title: str) -> None:
    """Errors or times over sigma, a column for each number of spheres.

    Parameters
    ----------
    lines : sequence of (str, str, Rows)
        For each line of panels the quantity, what it is called, and the rows.
    """
    spheres = sorted({count for *_, rows in lines for count in rows.unique("spheres")})
    figure = new_figure(2.7 * len(spheres) + 1.6, 2.7 * len(lines) + 0.6)
    axes = figure.subplots(len(lines), len(spheres), squeeze=False, sharey="row", sharex=True)
    for i, (quantity, name, rows) in enumerate(lines):
        scale = 1e3 if quantity == CPU_TIME else 1.0
        for j, count in enumerate(spheres):
            ax = axes[i, j]
            found = rows.where(quantity=quantity, spheres=count)
            for method, samples in _curves(found):
                _over_sigma(ax, found.where(method=method, samples=samples), method, samples, scale)
            _log_axis(ax, "y")
            ax.tick_params(axis="x", labelsize=8)
            if i == 0:
                ax.set_title(f"{count:,} spheres".replace(",", "\u202f"), fontsize=10)
            if i == len(lines) - 1:
                ax.set_xlabel("sigma of initial positions [m]", fontsize=8)
        axes[i, 0].set_ylabel(name, fontsize=9)
    _legend(
        figure,
        {text: line for ax in axes.flat for line, text in zip(*ax.get_legend_handles_labels(), strict=True)},
    )
    figure.suptitle(title, fontsize=12)
    save(figure, path)


def draw_floors(path: Path, rows: Rows) -> None:
    """Both floors over the number of samples, a column for each model."""
    models, sigmas = rows.unique("model"), rows.unique("sigma")
    figure = new_figure(3.3 * len(models) + 1.6, 6.6)
    axes = figure.subplots(2, len(models), squeeze=False, sharex=True, sharey="row")
    shades = np.linspace(0.35, 1.0, len(sigmas))
    handles = {}
    for i, (quantity, title) in enumerate(
        ((POSITION_ERROR, "W1 of positions [m]"), (ROTATION_ERROR, "W1 of rotations [deg]"))
    ):
        for j, model in enumerate(models):
            for sigma, shade in zip(sigmas, shades, strict=True):
                for method, marker in ((GAUSSIAN, "s"), (FLOOR, "o")):
                    found = rows.where(quantity=quantity, model=model, sigma=sigma, method=method)
                    sizes = sorted(found.unique("samples"))
                    (line,) = axes[i, j].plot(
                        sizes,
                        [found.where(samples=n).mean() for n in sizes],
                        LOOKS[method].line,
                        marker=marker,
                        markersize=4,
                        color=color(method),
                        alpha=shade,
                    )
                    handles[f"{label(method)}, sigma {sigma} m"] = line
            _log_axis(axes[i, j], "x")
            _log_axis(axes[i, j], "y")
            if i == 0:
                axes[i, j].set_title(model, fontsize=10)
            else:
                axes[i, j].set_xlabel("samples of the truth and of the other", fontsize=8)
        axes[i, 0].set_ylabel(title, fontsize=9)
    _legend(figure, dict(sorted(handles.items())))
    save(figure, path)


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
            growing = [c for c in found if c.method in PROPAGATORS and PROPAGATORS[c.method].grows]
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
            _log_axis(ax, "x", decades_only=True)
            _log_axis(ax, "y")
            if i == 0:
                ax.set_title(model, fontsize=10)
            else:
                ax.set_xlabel(f"{time} [ms]", fontsize=8)
        axes[i, 0].set_ylabel(title, fontsize=9)
    _legend(figure, handles)
    save(figure, path)


def draw_storage(path: Path, rows: Rows) -> None:
    """Scalars over the number of bodies."""
    figure = new_figure(7.6, 4.2)
    ax = figure.subplots()
    for k, (method, samples) in enumerate(rows.curves()):
        found = rows.where(method=method, samples=samples)
        ax.plot(
            [row["bodies"] for row in found],
            found.values(),
            ":" if samples else "-",
            marker=LOOKS[method].marker,
            markersize=max(9 - k, 4),  # what lies below others shows beside them
            linewidth=max(5 - 0.6 * k, 1.5),
            color=color(method, samples),
            label=label(method, samples),
        )
    ax.set_xscale("log", base=2)
    _log_axis(ax, "y", decades_only=True)
    bodies = rows.unique("bodies")
    ax.set_xticks(bodies, labels=[str(b) for b in bodies], fontsize=8)
    ax.set(xlabel="bodies", ylabel="scalars that stand for the distribution")
    _legend(figure, {text: line for line, text in zip(*ax.get_legend_handles_labels(), strict=True)})
    save(figure, path)


def draw_packings(path: Path, packings: Sequence[SpherePacking]) -> None:
    """Shaded balls of several packings side by side."""
    figure = new_figure(3.8 * len(packings), 4.2)
    for ax, packing in zip(np.atleast_1d(figure.subplots(1, len(packings))), packings, strict=True):
        view = view_axes("z" if packing.name == "pin" else "y")  # the scans stand along y
        box = box_corners(packing) @ view.T
        middle = 0.5 * (box.min(axis=0) + box.max(axis=0))
        half = 0.53 * float(np.ptp(box[:, :2], axis=0).max())
        sizes = np.log(packing.radii)
        image = shaded_balls(
            packing.centers @ view.T - middle, packing.radii, half, (sizes.min(), sizes.max())
        )
        ax.imshow(image, extent=[-half, half, -half, half], origin="lower", interpolation="bilinear")
        count = f"{len(packing):,}".replace(",", "\u202f")
        ax.set_title(f"{packing.name}, {count} spheres", fontsize=10)
        ax.set_xlabel("m", fontsize=8)
        ax.tick_params(labelsize=7)
    save(figure, path)


def draw_samples(
    path: Path, arrays: Mapping[str, np.ndarray], packing: SpherePacking, method: str, title: str
) -> None:
    """Bodies of some samples, and the positions of all, before and after; the truth beside the prediction.

    Parameters
    ----------
    arrays : mapping of str to (N, B, 13) array
        ``before``, ``truth`` and ``prediction``.
    packing : SpherePacking
        Its largest spheres stand for a body.
    """
    panels = (
        ("before", "before", "0.35"),
        ("after: truth", "truth", "0.1"),
        (f"after: {label(method)}", "prediction", color(method)),
    )
    everything = np.concatenate([arrays["before"], arrays["truth"]])[:, :, POSITION].reshape(-1, 3)
    middle, reach = (
        np.median(everything, axis=0),
        np.percentile(np.abs(everything - np.median(everything, axis=0)), 99.5, axis=0),
    )
    radius = float(np.max(np.linalg.norm(packing.centers, axis=1)))
    limits = np.stack([middle - reach - radius, middle + reach + radius])
    width, height = limits[1, 0] - limits[0, 0], limits[1, 1] - limits[0, 1]
    figure = new_figure(4.2 * len(panels) + 0.4, 4.2 * height / width + 1.2)
    axes = figure.subplots(1, len(panels), sharex=True, sharey=True)
    for ax, (name, key, shade) in zip(axes, panels, strict=True):
        states = arrays[key]
        for body in range(states.shape[1]):
            tint = shade if body == 0 or key == "prediction" else "#B2182B"
            _draw_bodies(ax, states[:40, body], packing, tint)
            ax.plot(
                *states[:, body, :2].T,
                ".",
                markersize=2.0,
                color=tint,
                alpha=0.6,
                zorder=3,
                markeredgewidth=0,
            )
        ax.set(xlim=limits[:, 0], ylim=limits[:, 1], aspect="equal")
        plane = states[:, :, :2]
        beyond = np.mean(np.any((plane < limits[0, :2]) | (plane > limits[1, :2]), axis=-1))
        ax.set_title(name if beyond < 0.01 else f"{name} ({beyond:.0%} beyond the frame)", fontsize=10)
        ax.set_xlabel("x [m]", fontsize=8)
        ax.grid(True, color="0.93", linewidth=0.6)
        ax.set_axisbelow(True)
    axes[0].set_ylabel("y [m]", fontsize=8)
    figure.suptitle(
        f"{title}; dots: centres of {len(arrays['truth'])} samples, bodies: 40 of them", fontsize=10
    )
    save(figure, path)


def draw_final_positions(
    path: Path, ends: Mapping[str, np.ndarray], elements: Sequence[Element], title: str
) -> None:
    """Where a body's centre ends up, in each engine: from above and from the side.

    Parameters
    ----------
    ends : mapping of str to (N, 13) array
        By engine.
    elements : sequence of Element
        Of the environment; those that are finite are drawn.
    title : str
    """
    everything = np.concatenate([states[:, POSITION] for states in ends.values()])
    low, high = np.percentile(everything, 0.5, axis=0), np.percentile(everything, 99.5, axis=0)
    margin = 0.12 * float(np.max(high - low))
    low, high = low - margin, high + margin
    ranges = high - low
    width = 3.6
    heights = width * ranges[1:] / ranges[0]
    figure = new_figure(width * len(ends) + 1.0, float(heights.sum()) + 1.3)
    axes = figure.subplots(2, len(ends), squeeze=False, sharex=True, sharey="row", height_ratios=heights)
    for j, (name, states) in enumerate(ends.items()):
        for i, other in enumerate((1, 2)):
            ax = axes[i, j]
            view = np.eye(3)[[0, other, 3 - other]]
            for element in elements:
                if element.finite:
                    corners = outline(element, view)
                    ax.add_patch(Polygon(corners, facecolor="#F4EDE0", edgecolor="0.6", linewidth=0.6))
            shade = color(name)
            ax.plot(
                states[:, 0], states[:, other], ".", markersize=4, alpha=0.5, color=shade, markeredgewidth=0
            )
            ax.set(xlim=(low[0], high[0]), ylim=(low[other], high[other]), aspect="equal")
            ax.grid(True, color="0.93", linewidth=0.6)
            ax.set_axisbelow(True)
            ax.tick_params(labelsize=8)
        axes[0, j].set_title(label(name), fontsize=10)
        axes[1, j].set_xlabel("x [m]", fontsize=8)
    axes[0, 0].set_ylabel("from above: y [m]", fontsize=8)
    axes[1, 0].set_ylabel("from the side: z [m]", fontsize=8)
    count = len(next(iter(ends.values())))
    figure.suptitle(f"{title}: where the body's centre ends up, {count} samples", fontsize=10)
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
            _log_axis(ax, "x")
            _log_axis(ax, "y", decades_only=i == 0)
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


def _draw_bodies(ax, states, packing, tint, spheres=60):
    """Translucent discs of each body's largest spheres, seen along z."""
    for state in states:
        centers = (
            Rotation.from_quat(state[QUATERNION]).apply(packing.centers[:spheres].copy()) + state[POSITION]
        )
        diameters = 2.0 * packing.radii[:spheres]
        ax.add_collection(
            EllipseCollection(
                diameters,
                diameters,
                np.zeros(len(diameters)),
                units="xy",
                offsets=centers[:, :2],
                offset_transform=ax.transData,
                facecolors=tint,
                alpha=0.015,
                edgecolors="none",
                rasterized=True,
            )
        )


def _curves(rows):
    """(method, samples) of the curves in a panel, limits last."""
    return sorted(rows.curves(), key=lambda curve: (curve[0] in (GAUSSIAN, FLOOR), curve[0] != MONTE_CARLO))


def _over_sigma(ax, rows, method, samples, scale):
    sigmas = sorted(rows.unique("sigma"))
    cells = [rows.where(sigma=sigma) for sigma in sigmas]
    middle = scale * np.array([cell.mean() if scale == 1.0 else cell.median() for cell in cells])
    shade = color(method, samples)
    ax.plot(
        sigmas,
        middle,
        LOOKS[method].line,
        color=shade,
        label=label(method, samples),
        linewidth=1.3,
        marker=LOOKS[method].marker,
        markersize=3.5,
    )
    if method == MONTE_CARLO and scale == 1.0 and samples in (10, 100):  # the paper shades these two
        spread = np.array([cell.std() for cell in cells])
        ax.fill_between(
            sigmas,
            np.maximum(middle - spread, 0.3 * middle),
            middle + spread,
            color=shade,
            alpha=0.2,
            linewidth=0,
        )


def _log_axis(ax, which, decades_only=False):
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
            ax.set_title(f"{kind}: {len(shown)} of {len(asked)} available", fontsize=10)
        line[0].set_ylabel(f"{title}\nprobability answered", fontsize=9)
    for ax in axes[-1]:
        ax.set_xlabel("truth", fontsize=9)
    figure.suptitle(f"Answered probabilities against the truth; shaded: within {tolerance}", fontsize=12)
    save(figure, path)
