"""Draw a recorded toss that is tracked through its bounces: ``python -m docs.plot_tracking OUT.png``."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

TOSS, RATE, SEED = 40, 30.0, 0
AHEAD_FROM = 3, 5, 8  # frames
BLUE, ORANGE, GREEN, GREY = "#0072b2", "#d55e00", "#009e73", "#888888"


def draw(path: Path) -> None:
    """Draw the path with its predictions, and velocities beside those of a filter with constant velocity."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Ellipse

    from unc_physics import PoseMeasurement
    from unc_physics_evaluation.recorded_tosses import recorded_tosses
    from unc_physics_evaluation.tracked_tosses import (
        AHEAD,
        NOISE,
        FilterFollower,
        TrackerFollower,
        frames_of,
        tracked_scene,
    )

    tosses = recorded_tosses()
    scene = tracked_scene(tosses)
    every, frames = (frames_of(tosses, TOSS, rate, "plain", SEED) for rate in (1.0 / tosses.dt, RATE))
    tracker, other = TrackerFollower(scene, frames, SEED), FilterFollower(scene, frames, SEED)
    found: dict[str, list] = {"tracker": [], "filter": []}
    ahead = []
    for n, (time, pose) in enumerate(zip(frames.times.tolist(), frames.measured, strict=True)):
        for name, follower in (("tracker", tracker), ("filter", other)):
            follower.correct(time, PoseMeasurement(pose, NOISE))
            belief = follower.belief(time)
            found[name].append(
                (*belief.mean[0, [0, 2, 3, 5]], *np.sqrt(belief.marginal(0).diagonal()[[3, 5]]))
            )
        if n in AHEAD_FROM:
            ahead.append((n, tracker.ahead(AHEAD)))
    x, z = every.truth[:, 0], every.truth[:, 2]
    figure = Figure(figsize=(8.0, 6.4), layout="constrained")
    side, across, up = figure.subplots(3, 1, height_ratios=(1.4, 1.0, 1.0))
    side.plot(x, z, color=GREY, label="recorded")
    side.plot(*frames.measured[:, [0, 2]].T, ".", color="black", markersize=4, label="measured, 30 Hz")
    rows = np.array(found["tracker"])
    side.plot(rows[:, 0], rows[:, 1], "-", color=BLUE, linewidth=1.0, label="Tracker")
    for k, (n, belief) in enumerate(ahead):
        values, vectors = np.linalg.eigh(belief.marginal(0)[np.ix_([0, 2], [0, 2])])
        width, height = 2.0 * np.sqrt(4.605 * values)  # 90 % of a normal distribution in the plane
        angle = float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0])))
        middle = belief.mean[0, [0, 2]]
        words = "0.2 s ahead, 90 %" if k == 0 else None
        side.add_patch(
            Ellipse(middle.tolist(), width, height, angle=angle, fill=False, edgecolor=GREEN, label=words)
        )
        side.plot([rows[n, 0], middle[0]], [rows[n, 1], middle[1]], ":", color=GREEN, linewidth=1.0)
        later = int(np.abs(every.times - frames.times[n] - AHEAD).argmin())
        side.plot(x[later], z[later], "x", color=GREEN, label="recorded then" if k == 0 else None)
    side.set_xlabel("x [m]")
    side.set_ylabel("height [m]")
    side.legend(loc="upper right", fontsize=8)
    for panel, column, words in ((across, 2, "x velocity [m/s]"), (up, 3, "vertical velocity [m/s]")):
        panel.plot(every.times, every.truth[:, 3 if column == 2 else 5], color=GREY, linewidth=1.0)
        for name, color, label in (("filter", ORANGE, "constant velocity"), ("tracker", BLUE, "Tracker")):
            rows = np.array(found[name])[2:]
            mean, std = rows[:, column], rows[:, column + 2]
            panel.errorbar(
                frames.times[2:],
                mean,
                1.645 * std,
                fmt=".",
                color=color,
                elinewidth=1.0,
                capsize=2,
                label=label,
            )
        panel.set_ylabel(words)
        panel.grid(alpha=0.3)
    across.legend(loc="lower left", fontsize=8)
    up.set_xlabel("time [s]")
    figure.savefig(path, dpi=120, metadata={"Software": None})


def main(arguments=None) -> int:
    """Draw the picture into the file that the arguments name."""
    (path,) = sys.argv[1:] if arguments is None else arguments
    draw(Path(path))
    return 0


if __name__ == "__main__":
    sys.exit(main())
