"""Draw figures of the results page from its tables: ``python -m docs.plot_results NAME OUT.png``."""

from __future__ import annotations

import argparse
import csv
import re
import sys
from pathlib import Path

import numpy as np

from unc_physics_evaluation.methods import LOOKS, OURS

RESULTS = Path(__file__).parent / "results"
COVERAGE = "reality_coverage"
SETS = "cube tosses, 60", "household cube, 11"
TIMES = "0.1 s", "0.2 s", "0.4 s", "rest"
PREDICTIONS = {  # method and style of the line
    "unc_physics, default": (OURS, "--"),
    "unc_physics, calibrated": (OURS, "-"),
    "MuJoCo, calibrated": ("mujoco", "-"),
    "PyBullet, calibrated": ("pybullet", "-"),
}


def read(name: str) -> list[dict[str, str]]:
    """Rows of a table."""
    with open(RESULTS / f"{name}.csv", encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def draw_coverage(path: Path) -> None:
    """Draw the coverage of 90 % regions at each time: one set a column, positions above rotations."""
    from matplotlib.figure import Figure

    rows = {(row["motions"], row["prediction"]): row for row in read(COVERAGE)}
    figure = Figure(figsize=(9.0, 5.6), layout="constrained")
    panels = figure.subplots(2, len(SETS), sharex=True, sharey=True)
    for line, quantity in zip(panels, ("position", "rotation"), strict=True):
        line[0].set_ylabel(f"{quantity}: observed coverage [%]")
        for panel, motions in zip(line, SETS, strict=True):
            panel.axhline(90.0, color="#AAAAAA", linewidth=1.0)
            for k, (prediction, (method, style)) in enumerate(PREDICTIONS.items()):
                cells = [rows[motions, prediction][f"{quantity} in 90 %, {time}"] for time in TIMES]
                share, low, high = np.array([re.findall(r"\d+", cell) for cell in cells], float).T
                panel.errorbar(
                    np.arange(len(TIMES)) + 0.06 * (k - 1.5),
                    share,
                    [share - low, high - share],
                    color=LOOKS[method].color,
                    marker=LOOKS[method].marker,
                    linestyle=style,
                    elinewidth=0.8,
                    capsize=2,
                    label=prediction,
                )
            panel.grid(alpha=0.3)
    for panel, motions in zip(panels[0], SETS, strict=True):
        panel.set_title(f"{motions} motions")
    panels[0, 0].set_ylim(0.0, 103.0)
    panels[0, 0].set_xticks(range(len(TIMES)), TIMES)
    figure.suptitle("Regions with a nominal coverage of 90 %, with 95 % intervals", fontsize=11)
    figure.legend(
        *panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=len(PREDICTIONS)
    )
    figure.savefig(path, dpi=120, metadata={"Software": None})


def main(arguments=None) -> int:
    """Draw the figure that the arguments name."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name", choices=(COVERAGE,))
    parser.add_argument("path", type=Path, metavar="OUT.png")
    options = parser.parse_args(arguments)
    draw_coverage(options.path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
