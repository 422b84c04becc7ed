"""The commands ``pack``, ``models`` and ``show``."""

from __future__ import annotations

import argparse
import re
import time
from pathlib import Path

from ..checks.shown import counted, plain_digits, printable
from ..programs import dying_at_interrupt
from .arguments import add_options
from .output import PROGRESS_AFTER, check_output, note, writing

_OPTIONS = {"most": "--pieces", "tolerance": "--tolerance"}  # of arguments of `mesh_pieces`
_LARGE, _SMALL = 1e4, 1.0  # size range of a body [mm]; outside it, the mesh may have another unit


def add_pack_command(commands) -> None:
    """Add the parser of ``pack`` to the command line's subparsers."""
    parser = commands.add_parser(
        "pack",
        help="pack a mesh with spheres",
        description=(
            "Make a model file of a closed mesh: convex pieces that are its shape, and disjoint spheres that"
            " fill it. Boxes, their unions, cylinders, spheres, capsules and surfaces of revolution are"
            " recognised; a mesh that fills 97 % of its convex hull is its hull; coacd cuts others into"
            " hulls. The first spheres give the body its extent, flat faces and rims; the others follow by"
            " size. Mass properties are those of the mesh, at uniform density."
        ),
        epilog=(
            "All formats that trimesh reads are accepted. Cavities and several components are allowed. A link"
            " of a robot or world, robot.urdf#LINK, has its own scale, mass and inertia."
        ),
    )
    parser.add_argument(
        "mesh",
        metavar="MESH",
        help="mesh file, in metres unless --scale says otherwise; or FILE.urdf#LINK, .sdf#MODEL, .xml#BODY",
    )
    parser.add_argument(
        "-n",
        "--spheres",
        type=int,
        default=1000,
        metavar="N",
        help="number of spheres, which pictures and physics: paper use (default 1000)",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="OUT.npz",
        help="model file to write (default: NAME.npz in the user's own models, where it is found by name)",
    )
    parser.add_argument(
        "--pieces",
        type=int,
        metavar="P",
        help="number of convex pieces, at most (default: 32, or with --tolerance as many as it takes)",
    )
    parser.add_argument(
        "--tolerance",
        type=float,
        metavar="M",
        help=(
            "largest distance between the pieces and the mesh [m]: they are made finer until they are within"
            " it (default: 10 %% of its longest side, for which nothing is made finer)"
        ),
    )
    parser.add_argument("--name", help="name of the model (default: the name of OUT.npz, or else of MESH)")
    parser.add_argument(
        "--scale",
        type=float,
        default=1.0,
        metavar="S",
        help="length of the mesh's unit in metres, 0.001 for millimetres (default 1)",
    )
    parser.add_argument("--mass", type=float, metavar="KG", help="mass to note in the file [kg]")
    parser.add_argument("--source", help="where the mesh comes from, to note in the file")
    parser.add_argument("--licence", help="licence of the mesh, to note in the file")
    parser.add_argument(
        "--repair",
        action="store_true",
        help=(
            "try trimesh's repairs on a mesh that is open or has inverted faces, unite parts that overlap,"
            " and report what changed"
        ),
    )
    parser.add_argument(
        "--uniform",
        action="store_true",
        help="of a link: compute centre of mass and inertia from its shape, in place of the file's",
    )
    parser.add_argument(
        "--largest-first",
        action="store_true",
        help="order all spheres by size: the first ones fill the body best, but leave out edges and rims",
    )
    _add_threads(parser)
    parser.set_defaults(run=run_pack)


def add_models_command(commands) -> None:
    """Add the parser of ``models`` to the command line's subparsers."""
    parser = commands.add_parser(
        "models",
        help="list the models, or make them",
        description=("List the models of the library. With --make, pack the models of this package again."),
    )
    add_options(parser, "--models")
    parser.add_argument("--make", nargs="*", metavar="NAME", help="pack these models again (default: all)")
    parser.add_argument(
        "-n",
        "--spheres",
        type=int,
        metavar="N",
        help="number of spheres, in place of each model's own; the model is then called NAME_N",
    )
    parser.add_argument(
        "--meshes",
        metavar="DIR",
        help="folder with the mesh files of bunny and armadillo (bunny00.off, armadillo.off)",
    )
    parser.add_argument(
        "-o", "--output", metavar="DIR", help="folder to write to (default: the user's own models)"
    )
    _add_threads(parser)
    parser.set_defaults(run=run_models)


def add_show_command(commands) -> None:
    """Add the parser of ``show`` to the command line's subparsers."""
    parser = commands.add_parser(
        "show",
        help="draw a model",
        description="Draw the pieces of a model, and its first 10, 100 ... spheres, into a PNG.",
    )
    parser.add_argument("model", metavar="MODEL", help="a model's name, or the path of its file")
    parser.add_argument("-o", "--output", metavar="OUT.png", help="picture to write (default: MODEL.png)")
    parser.add_argument(
        "--up", choices="xyz", default="z", help="axis that points up in the picture (default z)"
    )
    add_options(parser, "--models")
    parser.set_defaults(run=run_show)


def _add_threads(parser):
    parser.add_argument(
        "--threads",
        type=int,
        metavar="T",
        help="threads to use (default: one per processor); the result is the same for any number",
    )


def run_pack(arguments: argparse.Namespace) -> int:
    """Pack a mesh file."""
    _require("trimesh", "scipy", *(["manifold3d", "networkx"] if arguments.repair else []))
    from dataclasses import replace

    from ..checks.errors import InvalidMeshError, InvalidOptionError
    from ..descriptions.reading import is_description
    from ..shapes.solid_mesh import load_solid, mesh_notes

    _check_positive("-n", arguments.spheres)
    if arguments.pieces is not None:
        _check_positive("--pieces", arguments.pieces)
    for option, meaning in (
        ("scale", "number of metres, 0.001 for a mesh in millimetres"),
        ("mass", "number of kilograms"),
        ("tolerance", "number of metres"),
    ):
        value = getattr(arguments, option)
        if value is not None and not 0.0 < value < float("inf"):
            raise InvalidOptionError(f"must be a positive {meaning}", field=f"--{option}", value=value)
    file, _, link = arguments.mesh.partition("#")
    own = link or arguments.mesh
    name = arguments.name or Path(arguments.output or own.replace("::", "_")).stem
    if Path(name).name != name:
        raise InvalidOptionError("must be a plain file name", field="--name", value=name)
    output = _model_output(arguments.output, name)
    about = {key: getattr(arguments, key) for key in ("mass", "source", "licence")}
    if is_description(file):
        solid, about = _link_solid(file, link, arguments, about)
    elif arguments.uniform:
        raise InvalidOptionError("is for links of a URDF, SDF or MJCF", field="--uniform", value=True)
    else:
        try:
            solid, repairs = load_solid(arguments.mesh, repair=arguments.repair)
        except InvalidMeshError as error:
            problem = error.problem.replace(" (a repair ", " (--repair ")
            raise InvalidMeshError(problem, field=error.field, value=error.value) from None
        for repair in repairs:
            print(f"repair: {printable(repair)}")
        for line in mesh_notes(Path(arguments.mesh)):
            note(line)
        solid = solid.scaled(arguments.scale)
    solid = replace(solid, name=arguments.mesh)
    about |= {"largest_first": arguments.largest_first}
    if not about.get("pieces"):
        about |= _pieces(solid, arguments.pieces, arguments.tolerance, arguments.threads)
    _pack(solid, name, arguments.spheres, arguments.threads, output, **about)
    _note_units(solid, arguments.scale)
    return 0


def _link_solid(file, link, arguments, about):
    """Return a link's solid, and its properties unless the arguments set them."""
    from ..descriptions.link_solid import find_link, link_solid
    from ..descriptions.reading import read_description

    description = read_description(file)
    found = find_link(description, link or None)
    own = link_solid(description.path, found, uniform=arguments.uniform, repair=arguments.repair)
    for line in (*description.notes, *own.notes):
        note(line)
    own = own.scaled(arguments.scale)
    source = f"link {found.name} of {description.path.name}"
    given = {key: value for key, value in about.items() if value is not None}
    return own.solid, {"mass": own.mass, "source": source, "pieces": own.pieces} | given


def _note_units(solid, scale):
    """Print a note if a body's size suggests another unit."""
    size = 1e3 * float((solid.bounds[1] - solid.bounds[0]).max())
    if size > _LARGE:
        meant = size * 1e-3
        note(
            f"the body is {plain_digits(size)} mm long: is the mesh in millimetres, and not in metres?"
            f" --scale {plain_digits(1e-3 * scale)} makes it {plain_digits(meant)} mm"
        )
    elif size < _SMALL:
        note(
            f"the body is {size:.3g} mm long: is the mesh in metres already?"
            f" --scale {plain_digits(1e3 * scale)} makes it {plain_digits(1e3 * size)} mm"
        )


def run_models(arguments: argparse.Namespace) -> int:
    """List the models, or pack them."""
    if arguments.make is not None:
        return _make(arguments)
    from ..checks.errors import InvalidOptionError
    from ..shapes.library import list_models, models_dirs
    from ..shapes.packing_file import load_packing

    for option in ("spheres", "meshes", "output", "threads"):
        if getattr(arguments, option) is not None:
            raise InvalidOptionError(
                "goes with --make only", field=f"--{option}", value=getattr(arguments, option)
            )
    models = list_models(arguments.models)
    if not models:
        print(f"no models in {', '.join(map(str, models_dirs(arguments.models))) or 'any folder'}")
    else:
        print(table([load_packing(path) for path in models.values()], list(models)))
        for folder in dict.fromkeys(path.parent for path in models.values()):
            print(f"from {folder}")
    return 0


def table(packings, names) -> str:
    """Return a table of size, mass, pieces, spheres, fill and surface gap of models."""
    rows = [("model", "size [mm]", "mass [kg]", "pieces", "spheres", "fill [%]", "gap [mm]")]
    for packing, name in zip(packings, names, strict=True):
        size = gap = mass = "-"
        if packing.bounds is not None:
            size = " x ".join(plain_digits(1e3 * side) for side in packing.bounds[1] - packing.bounds[0])
        if packing.surface_gap is not None:
            gap = f"{1e3 * packing.surface_gap:.2f}"
        if packing.mass is not None:
            mass = plain_digits(packing.mass, 3)
        pieces = "-" if packing.has_only_spheres else str(len(packing.pieces))
        count, fill = str(len(packing)), f"{100.0 * packing.fill:.1f}"
        rows.append((printable(name), size, mass, pieces, count, fill, gap))
    return _aligned(rows)


def quality_table(parts) -> str:
    """Loss of extent for parts of one packing."""
    rows = [("spheres", "loss of extent [mm]")]
    for part in parts:
        rows.append((str(len(part)), "-" if part.extent_loss is None else f"{1e3 * part.extent_loss:.2f}"))
    return _aligned(rows)


def _aligned(rows):
    """Lines of a table, the first two columns to the left."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return "\n".join(
        "  ".join(
            f"{cell:<{w}}" if k < 2 else f"{cell:>{w}}"
            for k, (cell, w) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    )


def run_show(arguments: argparse.Namespace) -> int:
    """Draw a model."""
    _require("matplotlib")
    from ..plots.model_picture import draw_levels
    from ..shapes.library import load_model

    packing = load_model(arguments.model, arguments.models)
    parts = [packing.prefix(k) for k in (10, 100, 1000, 10_000) if k < len(packing)] + [packing]
    output = check_output(arguments.output or f"{Path(arguments.model).stem}.png", ".png", "--output")
    with writing(output, "--output"):
        draw_levels(output, parts, up=arguments.up)
    print(quality_table(parts))
    if not packing.has_only_spheres:
        print(f"{counted(len(packing.pieces), 'piece')}: {packing.pieces_kind or 'of unknown origin'}")
        if packing.pieces_error is not None:
            print(error_text(packing.pieces_error))
    else:
        note("the model has no pieces, only spheres: a small body can pass between them")
    print(f"wrote {printable(str(output))}")
    return 0


def _make(arguments):
    from ..checks.errors import UnknownModelError
    from ..shapes.recipes import RECIPES, recipe_solid

    names = arguments.make or list(RECIPES)
    _require("trimesh", "scipy", *(["manifold3d"] if "mug" in names else []))

    if arguments.spheres is not None:
        _check_positive("-n", arguments.spheres)
    for name in names:
        if name not in RECIPES:
            raise UnknownModelError(
                f"has no recipe; there are: {', '.join(RECIPES)}", field="--make", value=name
            )
    for name in names:
        stem = name if arguments.spheres is None else f"{name}_{arguments.spheres}"
        output = _model_output(arguments.output and Path(arguments.output) / f"{stem}.npz", stem)
        solid, about = recipe_solid(name, arguments.meshes)
        about |= {"largest_first": RECIPES[name].largest_first}
        if "pieces" not in about:
            about |= _pieces(solid, None, None, arguments.threads)
        _pack(solid, name, arguments.spheres or RECIPES[name].spheres, arguments.threads, output, **about)
    return 0


def _pieces(solid, most, tolerance, threads):
    """Return the fields of a mesh's pieces, and print what they are; none where coacd is missing."""
    from ..checks.errors import InvalidMeshError, NotSupportedError
    from ..shapes.mesh_pieces import mesh_pieces

    start = time.perf_counter()
    try:
        found = mesh_pieces(solid, most, tolerance, threads=threads)
    except NotSupportedError as error:
        note(f"{error}; without pieces, a small body can pass between spheres")
        return {"pieces": ()}
    except InvalidMeshError as error:
        raise InvalidMeshError(as_options(error.problem), field=error.field, value=error.value) from None
    pieces = counted(len(found.pieces), "piece")
    print(f"{pieces}: {found.kind} ({time.perf_counter() - start:.1f} s)\n{error_text(found.error)}")
    if found.note:
        note(as_options(found.note))
    return found.entries


def as_options(text):
    """Return a text about pieces with the options of ``pack`` in place of arguments."""
    return re.sub(r"\b(most|tolerance)=", lambda found: f"{_OPTIONS[found[1]]} ", text)


def error_text(error) -> str:
    """Return a line about a surface error."""
    mean, high, outside, inside = (f"{1e3 * x:.2f} mm" for x in error)
    return (
        f"surface error: mean {mean}, 99 % {high}; largest: the mesh {outside} outside the pieces,"
        f" the pieces {inside} outside the mesh"
    )


def _pack(solid, name, count, threads, output, **about):
    """Pack with a progress bar, write the file, and print a summary."""
    from tqdm import tqdm

    from ..shapes.packing import pack_solid
    from ..shapes.packing_file import save_packing

    with tqdm(total=count, unit="sphere", desc=name, delay=PROGRESS_AFTER, disable=None, leave=False) as bar:

        def progress(placed, fill):
            bar.set_postfix_str(f"fill {100.0 * fill:.1f} %", refresh=False)
            bar.update(placed - bar.n)

        packing = pack_solid(
            solid, count, threads=threads, progress=None if bar.disable else progress, **about
        ).named(name)
    with writing(output, "--output"):
        save_packing(output, packing)
    print(table([packing], [name]))
    if len(packing) < count:
        print(
            f"stopped at {len(packing)} of {count} spheres and a fill of {100.0 * packing.fill:.1f} %: no gap"
            " was left for a ball of 1e-7 of the body's size"
        )
    print(f"wrote {printable(str(output))}")


def _require(*modules):
    """Raise `NotSupportedError` if an optional dependency is missing."""
    from importlib import import_module
    from importlib.util import find_spec

    from ..checks.errors import NotSupportedError

    missing = [module for module in modules if find_spec(module) is None]
    if missing:
        raise NotSupportedError(
            f"this command needs {' and '.join(missing)}: pip install {' '.join(missing)}"
        )
    with dying_at_interrupt():
        for module in modules:
            import_module(module)


def _check_positive(option, value):
    from ..checks.errors import InvalidOptionError

    if value < 1:
        raise InvalidOptionError("must be at least 1", field=option, value=value)


def _model_output(path, name):
    """Return the path of a model file to write; the default is in the user's folder of models."""
    from ..checks.errors import InvalidOptionError, OutputError
    from ..shapes.library import cache_dir, list_models, models_dirs

    if path is not None:
        return check_output(path, ".npz", "--output")
    output = cache_dir() / f"{name}.npz"
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"cannot be made: {error.strerror}; name a file with -o", field="folder", value=str(output.parent)
        ) from error
    output = check_output(output, ".npz", "--output")
    found = list_models().get(name, output)
    if output.parent in models_dirs() and found.resolve() != output.resolve():
        raise InvalidOptionError(
            f"is the name of {found}, which would be found in place of the new one; choose another name, or a"
            " file with -o",
            field="the model's name",
            value=name,
        )
    if output.parent not in models_dirs():
        note(f"models are looked for in {models_dirs()[0]} alone, so this one is found by its path only")
    return output
