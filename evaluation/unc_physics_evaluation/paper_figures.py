"""Pictures of the paper's kind: its Figs. 2 to 8, and errors over the constants that it leaves open."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from unc_physics import Belief, RigidBody, Scene, SpherePacking, make_propagator, predict
from unc_physics.physics.paper.rollout import simulate
from unc_physics.plots.palette import body_color
from unc_physics.plots.scene_picture import SIDE, draw_body, draw_environment, ellipse
from unc_physics.spatial.layout import ERR_POSITION, POSITION, QUATERNION
from unc_physics.spatial.rotation import rotation_matrix

from .comparison import CPU_TIME, ERRORS
from .methods import FULL_POINTS, MONTE_CARLO, color, label, look, method_of
from .paper_claims import Measured, geometric_mean
from .plots import log_axis, new_figure, save
from .scenarios import (
    DAMPING,
    DT,
    GAP,
    LARGE,
    MASS,
    OFFSET,
    SPEED,
    STIFFNESS,
    collision,
    collision_free,
    has_packing,
    resting,
    salt_box_into_bin,
    spread,
    unit_model,
)

TRUTH, OTHER, OURS = ("black", "#C1272D"), "#C1272D", ("#2A9D8F", "#E9A23B")
#: Fig. 2: models and their numbers of spheres.
PACKINGS = (("pin", 100), ("bunny", 1000), ("armadillo", LARGE))
#: Fig. 5: model, spheres, method; sigma is 0.05 m.
COMPARED = (
    ("bunny", 1000, "local_sampling"),
    ("bunny", 1000, FULL_POINTS),
    ("pin", 100, "linearization"),
    ("armadillo", 10_000, "surrogate"),
)
_FREE = (("linear_velocity", 0.1), ("angular_velocity", 1.0))
_RADIUS, _WIDE = 0.3, 3.0  # of Fig. 3: radius of the balls [m], and the larger k_sigma
_ABOVE = np.eye(3)
_PIXEL = 0.0025  # m


def predictions_to_draw(monte_carlo: Callable) -> dict[str, np.ndarray]:
    """Return the states (N, B, 13) for Figs. 3, 4, 5 and 8; ``monte_carlo`` returns samples of a scene."""
    found = {}

    def keep(name, case, method):
        scene, belief, horizon = case
        found[f"{name} truth"] = monte_carlo(scene, belief, horizon).states
        predicted = predict(scene, belief, method_of(method), horizon).belief
        found[f"{name} mean"] = predicted.mean
        found[f"{name} drawn"] = predicted.sample(len(found[f"{name} truth"]), np.random.default_rng(2))
        found[f"{name} covariance"] = predicted.blocks

    keep("3", _two_balls(), "surrogate")
    keep("3 wide", _two_balls(), f"surrogate k_sigma={_WIDE}")
    for uncertain, deviation in _FREE:
        keep(f"4 {uncertain}", collision_free(uncertain, "pin", 1000, deviation), "linearization")
    for model, spheres, method in COMPARED:
        keep(f"5 {model} {method}", collision(model, spheres, 0.05), method)
    scene, belief, horizon = salt_box_into_bin()
    found["8 truth"] = monte_carlo(scene, belief, horizon).states
    found["8 mean"] = belief.mean
    return found


def _two_balls(sigma=0.05):
    """Return the paper's collision with one sphere for each body."""
    r = _RADIUS
    solid = {"inertia": 0.4 * r**2 * np.eye(3), "volume": 4.0 / 3.0 * np.pi * r**3, "bounding_radius": r}
    ball = SpherePacking("ball", np.zeros((1, 3)), np.array([r]), origin=np.zeros(3), **solid)
    bodies = tuple(RigidBody(name, ball, MASS) for name in ("left", "right"))
    scene = Scene(bodies, dt=DT, stiffness=STIFFNESS, damping=DAMPING)
    mean = resting([[-GAP / 2, OFFSET / 2, 0.0], [GAP / 2, -OFFSET / 2, 0.0]])
    mean[:, 3] = SPEED, -SPEED
    return scene, Belief(mean, spread(2, position=sigma)), 2.0


def draw_predictions(path_of: Callable[[str], Path], arrays: Mapping[str, np.ndarray]) -> list[Path]:
    """Draw Figs. 2, 3, 4, 5 and 8, and return their files; ``path_of`` takes a figure's name."""
    drawn = []
    for name, draw in (
        ("2", _figure_2),
        ("3", _figure_3),
        ("4", _figure_4),
        ("5", _figure_5),
        ("8", _figure_8),
    ):
        drawn.append(path_of(f"figure_{name}"))
        save(draw(arrays), drawn[-1])
    return drawn


def _figure_2(arrays):
    figure = new_figure(9.6, 3.6)
    for ax, (model, spheres) in zip(figure.subplots(1, 3), PACKINGS, strict=True):
        packing = unit_model(model, spheres if has_packing(model, spheres) else 10_000)
        state = resting([[0.0, 0.0, 0.0]])[0]
        view = SIDE if model == "pin" else _ABOVE
        draw_body(ax, packing, state, view, np.array(body_color(0)), 0.0015, 1.0, len(packing))
        ax.set_title(_sized(model, len(packing)), fontsize=10)
        ax.set_axis_off()
    return figure


def _figure_3(arrays):
    figure = new_figure(9.6, 4.6)
    outcomes, schematic = figure.subplots(1, 2)
    truth, mean = arrays["3 truth"], arrays["3 mean"]
    from matplotlib.patches import Circle

    for body in (0, 1):
        shade = body_color(body)
        for place in truth[:40, body, POSITION]:
            outcomes.add_patch(Circle(place[:2], _RADIUS, fill=False, color=shade, alpha=0.25, linewidth=0.7))
        outcomes.plot(*truth[:, body, :2].T, ".", color=shade, markersize=2, alpha=0.5)
        for name, line in (("3", "-"), ("3 wide", "--")):
            P = arrays[f"{name} covariance"][body][ERR_POSITION, ERR_POSITION][:2, :2]
            outcomes.add_patch(ellipse(mean[body, :2], P, edgecolor="black", linewidth=1.6, linestyle=line))
        outcomes.plot([], [], ".", color=shade, label=f"samples, body {body + 1}")
    for k, line in ((make_propagator("surrogate").k_sigma, "-"), (_WIDE, "--")):
        outcomes.plot([], [], line, color="black", label=f"surrogate (2 std), $k_\\sigma$ = {k:g}")
    outcomes.legend(fontsize=8, loc="upper right")
    outcomes.set_title("After the collision: samples, and the surrogate's ellipses", fontsize=9)
    scene, belief, _ = _two_balls()
    state = belief.mean[None].copy()
    while np.linalg.norm(state[0, 1, POSITION] - state[0, 0, POSITION]) >= 2.0 * _RADIUS:
        simulate(state, scene.world, 1)
    i, j = state[0, :, POSITION][:, :2]
    d, sigma = np.linalg.norm(j - i), np.sqrt(2.0 * belief.blocks[0, 0, 0])
    n = (j - i) / d
    across = np.array([-n[1], n[0]])
    for center, body in ((i, 0), (j, 1)):
        schematic.add_patch(Circle(center, _RADIUS, color=body_color(body), alpha=0.25))
    rng = np.random.default_rng(3)
    for error in sigma * rng.standard_normal((60, 2)):
        ray = (j + error - i) / np.linalg.norm(j + error - i)
        schematic.plot(*np.array([i, i + 1.5 * d * ray]).T, color="0.6", linewidth=0.5, zorder=1)
    default = make_propagator("surrogate").k_sigma
    for k, line in ((default, "-"), (_WIDE, "--")):
        for side in (-1.0, 1.0):
            ray = d * n + side * k * sigma * across
            ray *= 1.5 * d / np.linalg.norm(ray)
            (drawn,) = schematic.plot(*np.array([i, i + ray]).T, line, color="#C1272D", linewidth=1.6)
        angle = np.degrees(np.arctan(k * sigma / d))
        drawn.set_label(f"cone of Eq. 20, $k_\\sigma$ = {k:g}: {angle:.0f}°")
    schematic.annotate("", i + 1.5 * d * n, i, arrowprops={"arrowstyle": "->"})
    schematic.plot(*np.array([i, j]).T, "o", color="black", markersize=3)
    schematic.plot([], [], color="0.6", linewidth=0.5, label="normals of samples")
    schematic.legend(fontsize=8, loc="upper left")
    schematic.set_title("At the first contact: the normal and the surrogate's cone", fontsize=9)
    for ax in (outcomes, schematic):
        ax.autoscale_view()
        _metres(ax)
    return figure


def _figure_4(arrays):
    figure = new_figure(9.6, 4.8)
    packing = unit_model("pin", 1000)
    tip = packing.centers[np.argmax(np.linalg.norm(packing.centers, axis=1))]
    for ax, (uncertain, deviation) in zip(figure.subplots(1, 2), _FREE, strict=True):
        name = f"4 {uncertain}"
        for states, shade, text in (
            (arrays[f"{name} truth"], OTHER, "Monte Carlo"),
            (arrays[f"{name} drawn"], OURS[0], "linearization"),
        ):
            points = states[:, 0, POSITION]
            if uncertain == "angular_velocity":
                points = points + np.array([rotation_matrix(q) @ tip for q in states[:, 0, QUATERNION]])
            ax.plot(*points[:, :2].T, ".", color=shade, markersize=3, alpha=0.6, label=text)
        mean = arrays[f"{name} mean"][0]
        draw_body(ax, packing, mean, _ABOVE, np.array(body_color(0)), _PIXEL, 0.35, 300)
        unit, of = ("m/s", "centre") if uncertain == "linear_velocity" else ("rad/s", "tip")
        ax.set_title(f"{of} of the pin, {uncertain.replace('_', ' ')} ±{deviation:g} {unit}", fontsize=10)
        ax.legend(fontsize=8)
        ax.autoscale()
        _metres(ax)
    return figure


def _figure_5(arrays):
    figure = new_figure(10.4, 8.4)
    for ax, (model, spheres, method) in zip(figure.subplots(2, 2).flat, COMPARED, strict=True):
        name = f"5 {model} {method}"
        truth, drawn, mean = (arrays[f"{name} {part}"] for part in ("truth", "drawn", "mean"))
        packing = unit_model(model, min(spheres, 1000))
        for body in (0, 1):
            draw_body(ax, packing, mean[body], _ABOVE, np.array(body_color(body)), _PIXEL, 0.35, 1000)
            place = {"markersize": 2.5, "alpha": 0.6, "zorder": 4}
            ax.plot(*truth[:, body, :2].T, ".", color=TRUTH[body], label=f"truth, body {body + 1}", **place)
            ax.plot(*drawn[:, body, :2].T, ".", color=OURS[body], label=f"method, body {body + 1}", **place)
        ax.autoscale()
        ax.set_title(f"{_sized(model, spheres)}: {label(method)}", fontsize=10)
        _metres(ax)
    ax.figure.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=4, markerscale=4)
    return figure


def _figure_8(arrays):
    scene, _, _ = salt_box_into_bin()
    model, states, start = scene.bodies[0].model, arrays["8 truth"][:30, 0], arrays["8 mean"][0]
    figure = new_figure(9.6, 4.6)
    for ax, view, window in zip(
        figure.subplots(1, 2),
        (SIDE, _ABOVE),
        ((-0.3, 0.3, -0.03, 0.45), (-0.3, 0.3, -0.25, 0.25)),
        strict=True,
    ):
        draw_environment(ax, scene.environment, view, window)
        for state in states:
            draw_body(ax, model, state, view, np.array(body_color(1)), 0.0015, 0.25, 300)
        draw_body(ax, model, start, view, np.array(body_color(0)), 0.0015, 0.9, 2000)
        ax.set_xlim(*window[:2])
        ax.set_ylim(*window[2:])
        _metres(ax, "xz" if view is SIDE else "xy")
    figure.suptitle("A salt box is dropped into a bin: the mean now (blue), and 30 outcomes", fontsize=10)
    return figure


def _sized(model, spheres):
    """Return a model with its number of spheres, in groups of three digits."""
    return f"{model}, {spheres:,}".replace(",", "\u202f").replace("\u202f ", ", ") + " spheres"


def _metres(ax, axes="xy"):
    ax.set_aspect("equal")
    ax.set_xlabel(f"{axes[0]} [m]", fontsize=8)
    ax.set_ylabel(f"{axes[1]} [m]", fontsize=8)
    ax.tick_params(labelsize=8)


def draw_sweeps(path: Path, measured: Measured, section: str, quantity: str, title: str) -> None:
    """Draw a time or an error over sigma: models as rows, numbers of spheres as columns (Figs. 6 and 7)."""
    cases = measured.cases(section)
    models, sizes = (list(dict.fromkeys(case[k] for case in cases)) for k in (0, 1))
    sizes.sort()
    methods = sorted(measured.methods(section), key=lambda method: method[0] == MONTE_CARLO)  # samples last
    figure = new_figure(2.5 * len(sizes) + 2.2, 2.5 * len(models) + 0.5)
    axes = figure.subplots(len(models), len(sizes), squeeze=False, sharex=True, sharey="row")
    handles = {}
    for line, model in zip(axes, models, strict=True):
        for ax, spheres in zip(line, sizes, strict=True):
            own = [case for case in cases if case[:2] == (model, spheres)]
            sigmas = [case[2] for case in own]
            for method in methods:
                values = [measured.values(section, case, method, quantity) for case in own]
                if not all(map(len, values)):
                    continue
                scale = 1e3 if quantity == CPU_TIME else 1.0
                middle = scale * np.array([measured.value(section, case, method, quantity) for case in own])
                style = look(method[0])
                (handle,) = ax.plot(
                    sigmas,
                    middle,
                    style.line,
                    marker=style.marker,
                    markersize=3,
                    linewidth=1.0,
                    color=color(*method),
                )
                handles[label(*method)] = handle
                if method[0] == MONTE_CARLO and method[1] in (10, 100) and quantity != CPU_TIME:
                    std = np.array([found.std() for found in values])
                    ax.fill_between(
                        sigmas, middle - std, middle + std, color=color(*method), alpha=0.25, linewidth=0
                    )
            log_axis(ax, "y")
            ax.set_title(_sized(model, spheres), fontsize=9)
            ax.tick_params(labelsize=8)
    for ax in axes[-1]:
        ax.set_xlabel("sigma [m]", fontsize=8)
    figure.supylabel(title, fontsize=10)
    figure.legend(list(handles.values()), list(handles), loc="outside right upper", fontsize=9, frameon=False)
    save(figure, path)


def draw_constant(path: Path, measured: Measured, methods: Mapping[float, str]) -> None:
    """Draw errors over those of ten samples by the surrogate's ``k_sigma``, a column for each model.

    ``methods`` has the method with each value.
    """
    cases, values = measured.cases("variants"), list(methods)
    models = list(dict.fromkeys(case[0] for case in cases))
    figure = new_figure(3.2 * len(models) + 0.6, 5.4)
    axes = figure.subplots(2, len(models), squeeze=False, sharex=True, sharey="row")
    for line, quantity, name in zip(axes, ERRORS, ("position", "rotation"), strict=True):
        for ax, model in zip(line, models, strict=True):
            own = [case for case in cases if case[0] == model]
            curves = np.array(
                [
                    [
                        measured.ratio("variants", (method, None), (MONTE_CARLO, 10), quantity, [case])
                        for method in methods.values()
                    ]
                    for case in own
                ]
            )
            for curve, case in zip(curves, own, strict=True):
                shade = {0.01: "#56B4E9", 0.05: "#009E73", 0.1: "#CC79A7"}[case[2]]
                ax.plot(values, curve, color=shade, linewidth=0.7, alpha=0.7)
            ax.plot(values, [geometric_mean(column) for column in curves.T], "k-o", markersize=3)
            ax.axhline(1.0, color="0.6", linestyle=":")
            log_axis(ax, "x")
            log_axis(ax, "y")
            ax.set_title(f"{model}, {name}", fontsize=9)
        line[0].set_ylabel("W1 over that of 10 samples", fontsize=8)
    for ax in axes[-1]:
        ax.set_xlabel("$k_\\sigma$", fontsize=9)
    for sigma, shade in ((0.01, "#56B4E9"), (0.05, "#009E73"), (0.1, "#CC79A7")):
        axes[0, 0].plot([], [], color=shade, label=f"sigma {sigma} m")
    axes[0, 0].plot([], [], "k-o", markersize=3, label="geometric mean")
    axes[0, 0].legend(fontsize=7)
    figure.suptitle("A thin line for each number of spheres, sigma and encounter", fontsize=9)
    save(figure, path)
