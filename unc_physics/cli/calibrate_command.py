"""The command ``calibrate``: fit physics to recorded motions and a scene file."""

from __future__ import annotations

import argparse

from .arguments import add_options, check_picture


def add_calibrate_command(commands) -> None:
    """Add the parser of ``calibrate`` to the command line's subparsers."""
    parser = commands.add_parser(
        "calibrate",
        help="fit friction, restitution, inertia and errors of the model to recorded motions",
        description=(
            "Fit uncertain values of a scene to recorded motions of its only body. Each motion is predicted"
            " from its first poses, before contact. Proper scores compare it with the later poses."
            " Prints the fitted values with their uncertainty, and lines to paste into the scene file."
        ),
        epilog=(
            "A CSV file has columns time [s], x, y, z [m], qx, qy, qz, qw and, for several motions, motion."
            " Velocities are not read: they come from a fit of free flight. Needs scipy: pip install"
            " 'unc_physics[calibration]'."
        ),
    )
    parser.add_argument(
        "motions",
        metavar="DATA",
        help=(
            ".csv or .npz file (states, offsets, dt), a folder of them, or a rosbag where rosbag2_py can be"
            " imported"
        ),
    )
    parser.add_argument(
        "scene",
        metavar="SCENE.yaml",
        help="scene file with one body; its state and standard deviations are ignored",
    )
    parser.add_argument(
        "--fit",
        nargs="+",
        metavar="NAME",
        help=(
            "values to fit, of: friction, restitution, impact_friction_speed, inertia, height,"
            " impact_direction_std, impact_point_std, impact_friction_std, friction_std, restitution_std,"
            " surface_tilt_std, position_noise, rotation_noise (default: all but laws of"
            " impacts that the scene lacks)"
        ),
    )
    parser.add_argument(
        "--times",
        type=float,
        nargs="+",
        metavar="T",
        help="times after the start at which predictions are scored, in addition to the end [s]"
        " (default 0.1 0.2 0.4)",
    )
    parser.add_argument(
        "--samples",
        type=int,
        metavar="N",
        help="samples of each prediction (default: 16 for 30 motions, more for fewer)",
    )
    parser.add_argument(
        "--evaluations",
        type=int,
        metavar="N",
        help="parameter sets that the search tries (default 80); half as many for contact noise",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the draws (default 0)")
    parser.add_argument("--topic", metavar="NAME", help="topic of the poses, if a rosbag has several")
    parser.add_argument(
        "--model-origin",
        action="store_true",
        help="positions are those of the model's own origin, as in ROS, not of the centre of mass",
    )
    parser.add_argument(
        "--picture", metavar="OUT.png", help="also draw the coverage of regions before and after"
    )
    parser.add_argument(
        "--contact-noise",
        type=float,
        nargs=2,
        metavar=("M", "RAD"),
        help="also fit the contact noise of a tracker, for poses with these standard deviations",
    )
    add_options(parser, "--executor", "--models")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Calibrate and print the result."""
    from tqdm import tqdm

    from ..calibration.calibrate import EVALUATIONS, calibrate
    from ..calibration.flight import moving_body
    from ..calibration.motions import read_motions
    from ..calibration.objective import TIMES
    from ..calibration.snippet import as_scene_file, as_table
    from ..scene.scene_file import load_scene

    if arguments.picture is not None:
        check_picture(arguments.picture)
    scene = load_scene(arguments.scene, arguments.models).scene
    origin = moving_body(scene).model.origin if arguments.model_origin else None
    motions = read_motions(arguments.motions, origin=origin, topic=arguments.topic)
    evaluations = EVALUATIONS if arguments.evaluations is None else arguments.evaluations
    with tqdm(total=evaluations, unit="model", desc="calibrate", disable=None, leave=False) as bar:

        def progress(done, total, best):
            bar.total = total
            bar.set_postfix_str(f"best score {best:.4f}", refresh=False)
            bar.update(done - bar.n)

        found = calibrate(
            motions,
            scene,
            arguments.fit,
            times=arguments.times or TIMES,
            samples=arguments.samples,
            evaluations=evaluations,
            seed=arguments.seed,
            executor=arguments.executor,
            progress=progress,
        )
    left_out = len(motions) - len(found.recorded)
    if left_out:
        print(
            f"{left_out} of {len(motions)} motions touch something within their first three poses: left out"
        )
    print(as_table(found))
    print(f"\n{as_scene_file(found.scene)}", end="")
    if arguments.contact_noise is not None:
        position, rotation = arguments.contact_noise
        std = [position] * 3 + [rotation] * 3
        options = {"seed": arguments.seed, "executor": arguments.executor}
        print(f"\n{_fit_contact_noise(motions, found.scene, std, evaluations // 2, options)}")
    if arguments.picture is not None:
        from ..calibration.picture import draw_calibration

        draw_calibration(arguments.picture, found)
        print(f"wrote {arguments.picture}")
    return 0


def _fit_contact_noise(motions, scene, std, evaluations, options):
    """The contact noise that fits motions, as Python text, and what it gains."""
    from tqdm import tqdm

    from ..calibration.contact_noise import FITTED, LEAST_EVALUATIONS, calibrate_contact_noise

    with tqdm(unit="set", desc="contact noise", disable=None, leave=False) as bar:

        def progress(done, total, best):
            bar.total = total
            bar.update(done - bar.n)

        evaluations = max(evaluations, LEAST_EVALUATIONS)
        found = calibrate_contact_noise(
            motions, scene, std, evaluations=evaluations, progress=progress, **options
        )
    fields = ", ".join(f"{name}={getattr(found.noise, name):.3g}" for name in FITTED)
    before, after = found.scores
    return (
        f"Tracker(..., noise=ContactNoise({fields}))\n"
        f"log score of poses {before:.2f} before, {after:.2f} after, of {found.motions} motions"
    )
