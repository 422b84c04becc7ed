"""Draw figures of the results page from its tables: ``python -m docs.plot_results NAME OUT.png``."""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path

RESULTS = Path(__file__).parent / "results"
LINES = {  # method: label, propagator whose colour and marker it has, style of the line
    "sigma points": ("sigma points", "sigma_points", "-"),
    "linearization": ("linearization", "linearization", "-"),
    "MC-10": ("10 Monte Carlo samples", "monte_carlo", "-"),
    "floor": ("floor", None, ":"),
}
FIGURES = {
    "collisions": (
        "sigma [m]",
        "uncertainty of initial positions [m]",
        ("W1 position [m]", "W1 rotation [deg]"),
    ),
    "collisions_time": ("spheres", "spheres of each body", ("CPU time [ms]",)),
}


def draw(name: str, path: Path) -> None:
    """Draw one quantity a row and one model a column, with at most four lines a panel."""
    from matplotlib.figure import Figure

    from unc_physics import PROPAGATORS

    abscissa, label, quantities = FIGURES[name]
    with open(RESULTS / f"{name}.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    models = list(dict.fromkeys(row["model"] for row in rows))
    methods = [method for method in LINES if any(row["method"] == method for row in rows)]
    figure = Figure(figsize=(9.0, 2.4 * len(quantities) + 0.8), layout="constrained")
    panels = figure.subplots(len(quantities), len(models), squeeze=False, sharex=True, sharey="row")
    for i, quantity in enumerate(quantities):
        panels[i, 0].set_ylabel(quantity)
        for panel, model in zip(panels[i], models, strict=True):
            for method in methods:
                chosen = [row for row in rows if row["method"] == method and row["model"] == model]
                words, propagator, style = LINES[method]
                look = PROPAGATORS.get(propagator)
                color, marker = (look.color, look.marker) if look else ("#888888", "")
                x, y = ([float(row[key]) for row in chosen] for key in (abscissa, quantity))
                panel.loglog(x, y, style, marker=marker, color=color, label=words)
            panel.grid(alpha=0.3)
    for panel, model in zip(panels[0], models, strict=True):
        panel.set_title(model)
    for panel in panels[-1]:
        panel.set_xlabel(label)
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=len(methods))
    figure.savefig(path, dpi=120, metadata={"Software": None})


def main(arguments=None) -> int:
    """Draw the figure that the arguments name."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name", choices=FIGURES)
    parser.add_argument("path", type=Path, metavar="OUT.png")
    options = parser.parse_args(arguments)
    draw(options.name, options.path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
