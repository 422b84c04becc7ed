"""The pictures of the docs: how each is made, and from what.

``python docs/pictures.py`` (``make pictures``) makes those anew whose sources changed, which takes hours
where experiments of the evaluation are among them; ``--check`` says which these are, and NAMEs choose some.
``--results EXPERIMENT DIR`` publishes the tables and figures of a finished run.
"""

from __future__ import annotations

import argparse
import functools
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import yaml

ROOT = Path(__file__).resolve().parents[1]
IMAGES, RESULTS = ROOT / "docs" / "images", ROOT / "docs" / "results"
STAMPS = IMAGES / "made_from.json"
EVALUATION = "evaluation/unc_physics_evaluation"
#: Figures of the paper's kind.
PAPER = (*(f"figure_{n}" for n in (2, 3, 4, 5, 6, 8)), "figure_7_position", "figure_7_rotation", "k_sigma")
SAMPLED = ("--propagator", "monte_carlo", "--samples", "200")


class Picture(NamedTuple):
    """How a picture is made.

    Attributes
    ----------
    command : tuple of str
        Arguments of ``python -m``, in which OUT stands for the file; of an experiment, which has its figures
        in a folder, for that.
    sources : tuple of str
        Files that it is made from; what they import is left out, but for what draws.
    figure : str
        Of an experiment: the figure's name.
    """

    command: tuple[str, ...]
    sources: tuple[str, ...]
    figure: str = ""


def scene(name: str, *options: str) -> Picture:
    """A scene before and after."""
    file = f"examples/scenes/{name}.yaml"
    bodies = yaml.safe_load((ROOT / file).read_text())["bodies"]
    models = sorted({f"models/{body['model']}.npz" for body in bodies})
    command = ("unc_physics", "predict", file, *options, "--picture", "OUT")
    return Picture(command, (file, *models, "unc_physics/plots/scene_picture.py"))


def animation(name: str, *options: str) -> Picture:
    """A scene that moves."""
    still = scene(name, *options)
    return still._replace(sources=(*still.sources, "unc_physics/plots/scene_animation.py"))


#: Sources of pictures of models.
DRAWING = "unc_physics/plots/model_picture.py", "unc_physics/shapes/piece_mesh.py"


def model(name: str, up: str = "z") -> Picture:
    """A packing at several levels, with one of its axes up."""
    sources = f"models/{name}.npz", *DRAWING
    return Picture(("unc_physics", "show", name, "--up", up, "-o", "OUT"), sources)


def experiment(name: str, figure: str, plots: str = "plots") -> Picture:
    """A figure of the evaluation."""
    sources = f"{EVALUATION}/experiments/{name}.py", f"{EVALUATION}/{plots}.py"
    return Picture(("unc_physics", "evaluate", name, "-o", "OUT"), sources, figure)


def results(name: str) -> Picture:
    """A figure of the results page that is drawn from its table."""
    sources = f"docs/results/{name}.csv", "docs/plot_results.py"
    return Picture(("docs.plot_results", name, "OUT"), sources)


@functools.cache
def pictures() -> dict[str, Picture]:
    """All pictures, by their files' names in ``docs/images``."""
    return {
        "scenes/two_bunnies.png": scene("two_bunnies", "--period", "0.05"),
        "scenes/salt_box_on_table.png": scene("salt_box_on_table", "--period", "0.05"),
        "scenes/can_off_shelf.png": scene("can_off_shelf", "--period", "0.05"),
        "scenes/drop_into_bin.png": scene("drop_into_bin", "--period", "0.05", *SAMPLED),
        "scenes/push_box.png": scene("push_box", "--period", "0.25"),
        "scenes/close_fingers.png": scene("close_fingers", "--period", "0.25"),
        "scenes/release_over_bin.png": scene("release_over_bin", "--period", "0.05", *SAMPLED),
        "scenes/put_bottle_down.png": scene("put_bottle_down", "--period", "0.1"),
        "scenes/belt_against_fence.png": scene("belt_against_fence", "--period", "0.25"),
        "table.gif": animation("table", "--period", "0.05", "--probabilities", *SAMPLED),
        "models_bunny.png": model("bunny", "y"),
        "models_mug.png": model("mug"),
        "shapes.png": Picture(
            ("docs.plot_shapes", "OUT"),
            ("docs/plot_shapes.py", "models/bottle.npz", "models/mug.npz", *DRAWING),
        ),
        "demo.png": Picture(
            ("unc_physics.ros.demo", "--output", "OUT"),
            (
                "models/can.npz",
                "models/salt_box.npz",
                "unc_physics/ros/demo.py",
                "unc_physics/ros/demo_scene.py",
            ),
        ),
        "tracking.png": Picture(
            ("docs.plot_tracking", "OUT"), ("docs/plot_tracking.py", f"{EVALUATION}/tracked_tosses.py")
        ),
        "results/reality_coverage.png": results("reality_coverage"),
        **{f"paper/{figure}.png": experiment("paper", figure, "paper_figures") for figure in PAPER},
        "calibration.png": experiment("calibration", "calibration"),
        "head_to_head.png": experiment("head_to_head", "head_to_head"),
        "evaluation/orders.png": experiment("orders", "orders", "order_plots"),
    }


def stamp(picture: Picture) -> str:
    """Text that changes with what a picture is made from."""
    digest = hashlib.sha256(" ".join((*picture.command, picture.figure)).encode())
    for source in picture.sources:
        digest.update(b"\0" + (ROOT / source).read_bytes())
    return digest.hexdigest()[:16]


def stamps() -> dict[str, str]:
    """The stamps that the pictures at hand were made with."""
    return json.loads(STAMPS.read_text()) if STAMPS.exists() else {}


def old(names: list[str]) -> list[str]:
    """Those of some pictures that are missing, or whose sources have changed."""
    known, all_pictures = stamps(), pictures()
    return [
        name for name in names if not (IMAGES / name).exists() or known.get(name) != stamp(all_pictures[name])
    ]


def make(name: str, folders: dict[tuple[str, ...], Path]) -> None:
    """Make one picture and note its stamp; ``folders`` keeps those of experiments that have run."""
    picture = pictures()[name]
    environment = os.environ | {"UNC_PHYSICS_MODELS": str(ROOT / "models")}

    def run(out):
        arguments = [str(out) if part == "OUT" else part for part in picture.command]
        subprocess.run(
            [sys.executable, "-m", *arguments],
            cwd=ROOT,
            env=environment,
            check=True,
            stdout=subprocess.DEVNULL,
        )

    if picture.figure:
        if picture.command not in folders:
            folders[picture.command] = Path(tempfile.mkdtemp(prefix="unc_physics_pictures_"))
            run(folders[picture.command])
        shutil.copy(next(folders[picture.command].rglob(f"{picture.figure}.png")), IMAGES / name)
    else:
        run(IMAGES / name)
    STAMPS.write_text(json.dumps(dict(sorted((stamps() | {name: stamp(picture)}).items())), indent=1) + "\n")


def copy_tables(name: str, folder: Path) -> None:
    """Copy the tables of an experiment that the results show."""
    for path in (*folder.glob("*.csv"), *folder.glob("tables/*.csv")):
        rows = path == folder / f"{name}.csv"
        if not rows and (RESULTS / path.name).exists():
            shutil.copy(path, RESULTS / path.name)


def main(arguments=None) -> int:
    """Make pictures, or say which are old; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="pictures, as scenes/two_bunnies.png")
    parser.add_argument(
        "--results",
        nargs=2,
        action="append",
        default=[],
        metavar=("EXPERIMENT", "DIR"),
        help="take the tables and figures of an experiment from its finished results",
    )
    parser.add_argument("--check", action="store_true", help="say which are old, and make none")
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.names if name not in pictures()]:
        parser.error(f"no picture of the docs: {', '.join(unknown)}; there are {', '.join(pictures())}")
    found = old(options.names or list(pictures()))
    if options.check:
        print("\n".join(found) or "All pictures are as their sources.")
        return bool(found)
    folders = {("unc_physics", "evaluate", name, "-o", "OUT"): Path(path) for name, path in options.results}
    for (*_, experiment_name, _, _), folder in folders.items():
        copy_tables(experiment_name, folder)
    if folders:
        found = [name for name, picture in pictures().items() if picture.command in folders]
    for name in options.names or found:
        print(name, flush=True)
        make(name, folders)
    return 0


if __name__ == "__main__":
    sys.exit(main())
