"""The command ``import``."""

from __future__ import annotations

from pathlib import Path

from ..checks.shown import counted, printable
from .output import check_output, note, progress_display, writing

_HEAD = """\
# {what}, from {source}.
# Predict with
#   python -m unc_physics predict {name}
"""


def add_import_command(commands) -> None:
    """Add the parser of ``import`` to the command line's subparsers."""
    parser = commands.add_parser(
        "import",
        help="make a scene file of a URDF, SDF or MJCF world",
        description=(
            "Convert a URDF, SDF or MJCF file to a scene file. Static planes, boxes, spheres, cylinders and"
            " capsules become the environment, and so do meshes of boxes. Other static meshes become fixed"
            " bodies, packed with spheres beside the scene file. Models that can move become bodies. The"
            " command names what it leaves out, and what is missing or unusual."
        ),
    )
    parser.add_argument("world", metavar="WORLD", help="file that ends in .urdf, .sdf, .world, .mjcf or .xml")
    parser.add_argument("-o", "--output", required=True, metavar="SCENE.yaml", help="scene file to write")
    parser.add_argument(
        "-n", "--spheres", type=int, default=1000, metavar="N", help="spheres of each packing (default 1000)"
    )
    parser.add_argument(
        "--joint",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="position of a joint [rad or m]; in a URDF it fixes all links; may be repeated",
    )
    parser.add_argument(
        "--uniform",
        action="store_true",
        help="compute centres of mass and inertia from the shapes, in place of the file's",
    )
    parser.add_argument(
        "--repair", action="store_true", help="try trimesh's repairs on meshes that are not closed"
    )
    parser.set_defaults(run=run_import)


def run_import(arguments) -> int:
    """Write the scene file and print a summary."""
    import yaml

    from ..descriptions.world import load_world
    from ..shapes.packing_file import save_packing

    output = check_output(arguments.output, ".yaml", "--output")
    source = printable(Path(arguments.world).name)
    remedy = "Ctrl-C ends it, fewer spheres (-n) take less time"
    with progress_display("import", "part", source, remedy) as progress:
        world = load_world(
            arguments.world,
            spheres=arguments.spheres,
            configuration=dict(map(_joint, arguments.joint)) or None,
            uniform=arguments.uniform,
            repair=arguments.repair,
            progress=progress,
        )
    folder = output.parent / f"{output.stem}_models"
    content = {
        "physics": "everyday",
        "horizon": 1.0,
        "bodies": [],
        "environment": [_element(element) for element in world.environment],
    }
    with writing(output, "--output"):
        stems: set[str] = set()
        for body in world.bodies:
            folder.mkdir(exist_ok=True)
            file = save_packing(folder / f"{_stem(body.name, stems)}.npz", body.model)
            content["bodies"].append(_body(body, world.beliefs[body.name], file.relative_to(output.parent)))
        content = {key: value for key, value in content.items() if value != []}
        moving = sum(not body.fixed for body in world.bodies)
        elements, bodies = len(world.environment), len(world.bodies)
        what = (
            f"{counted(elements, 'element')} of the environment and"
            f" {bodies} bod{'y' if bodies == 1 else 'ies'}"
        )
        head = _HEAD.format(what=what, source=source, name=printable(output.name))
        output.write_text(head + yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=110))
    print(f"{what}, {moving} of which move")
    for line in world.left_out:
        print(f"left out: {printable(line)}")
    for line in world.notes:
        print(f"note: {printable(line)}")
    print(f"wrote {printable(str(output))}")
    if not moving:
        note("nothing in it moves: add bodies with their model, pose and standard deviations")
    return 0


def _joint(text):
    from ..checks.errors import InvalidOptionError
    from ..checks.validation import number_from_text

    name, separator, value = text.partition("=")
    if not separator:
        raise InvalidOptionError("must be of the form NAME=VALUE", field="--joint", value=text)
    return name, number_from_text(value, f"--joint {name}")


def _stem(name, taken):
    """Return the name of a body's model file, which no other body has; ``taken`` gets it."""
    stem = name.replace("::", "_").replace("/", "_")
    while stem.lower() in taken:
        stem += "_"
    taken.add(stem.lower())
    return stem


def _element(element):
    """Return an element as an entry of a scene file."""
    from ..scene.environment import quantities

    keys = quantities(type(element))
    entry = {"name": element.name, element.shape: {key: _plain(getattr(element, key)) for key in keys}}
    return entry | _surface(element)


def _body(body, belief, file):
    entry = {"name": body.name, "model": file.as_posix(), "mass": float(body.mass)}
    entry |= {"position": _plain(belief.position), "orientation": _plain(belief.orientation)}
    if body.fixed:
        del entry["mass"]
        entry["fixed"] = True
    return entry | _surface(body)


def _surface(thing):
    found = {key: getattr(thing, key) for key in ("friction", "restitution")}
    return {key: value for key, value in found.items() if value is not None}


def _plain(value):
    """Return a number or an array as plain values without round-off."""
    import numpy as np

    return (np.round(np.asarray(value, float), 9) + 0.0).tolist()
