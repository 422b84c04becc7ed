"""The command ``view``."""

from __future__ import annotations

from pathlib import Path

from ..propagators.names import ANYTIME, entries
from .arguments import add_options, propagator_options
from .output import check_output, writing

_HORIZON = 1.0  # s, if neither file nor command sets it


def add_view_command(commands) -> None:
    """Add the parser of ``view`` to the command line's subparsers."""
    parser = commands.add_parser(
        "view",
        help="look at a prediction in the browser",
        description=(
            "Show the prediction of a scene in the browser, with samples, ellipsoids and probabilities. The"
            " page predicts again when its propagator or an uncertainty is changed. Ctrl-C ends it."
        ),
    )
    parser.add_argument("scene", metavar="SCENE.yaml", help="scene file")
    parser.add_argument(
        "--propagator",
        default=ANYTIME,
        metavar="NAME",
        help=f"propagator of the first prediction (default {ANYTIME}): one of {', '.join(entries())}",
    )
    add_options(parser, "--option", "--horizon", "--mesh", "--models")
    parser.add_argument(
        "--frames", type=int, default=60, metavar="N", help="number of times that are shown (default 60)"
    )
    parser.add_argument(
        "--ghosts", type=int, default=30, metavar="N", help="number of samples that are drawn (default 30)"
    )
    parser.add_argument("--record", metavar="FILE.html", help="write a self-contained page, and exit")
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        help="address to listen on (default 127.0.0.1: this machine only); whoever reaches it can use it",
    )
    parser.add_argument("--port", type=int, default=8080, help="port to listen on (default 8080)")
    parser.add_argument("--no-open", action="store_true", help="only print the page's address")
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Show the page until interrupted, or write it to a file."""
    session = session_of(arguments)
    meshes = dict(arguments.mesh)
    if arguments.record is not None:
        from ..view.page import record

        output = check_output(arguments.record, ".html", "--record")
        with writing(output, "--record"):
            record(session, output, meshes)
        print(f"wrote {output}")
        return 0
    import webbrowser

    from ..view.page import Page

    page = Page(session, arguments.host, arguments.port, Path(arguments.scene).stem, meshes)
    address = f"http://{arguments.host}:{page.port}"
    print(f"{address} shows the prediction; Ctrl-C ends it", flush=True)
    if not arguments.no_open:
        webbrowser.open(address)
    try:
        page.wait()
    finally:
        page.close()
    return 0


def session_of(arguments):
    """Return a session for the arguments, after checks."""
    from ..checks.errors import InvalidRequestError
    from ..checks.names import hint
    from ..checks.validation import integer, number_from_text, positive
    from ..propagators.registry import propagator_from_texts
    from ..scene.scene_file import load_scene
    from ..view.session import Session, check_installed

    check_installed("view")
    frames = integer(arguments.frames, "--frames", low=2)
    ghosts = integer(arguments.ghosts, "--ghosts", low=0)
    integer(arguments.port, "--port", low=0)
    propagator = propagator_from_texts(arguments.propagator, propagator_options(arguments), None, None)
    scene, belief, horizon = load_scene(arguments.scene, arguments.models)
    if arguments.horizon is not None:
        horizon = positive(number_from_text(arguments.horizon, "--horizon"), "--horizon")
    names = [body.name for body in scene.bodies]
    for name, _ in arguments.mesh:
        if name not in names:
            said = f"is no body of the scene{hint(name, names)}"
            raise InvalidRequestError(said, field="--mesh", value=name)
    return Session(scene, belief, horizon or _HORIZON, propagator, frames, ghosts)
