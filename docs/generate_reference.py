"""Generate the reference pages, as a Sphinx extension, in ``docs/reference/generated/``.

Each page is made from the code that defines its facts: schemas, argument parsers, docstrings, interface
files, parameter descriptors, rules of the status and sphere packings. ``python docs/generate_reference.py``
writes the pages without building the site. Pages of the Python interface hold directives for Sphinx. The
others are plain Markdown, and part of the repository.
"""

from __future__ import annotations

import argparse
import importlib.util
import inspect
import json
import re
import textwrap
from collections.abc import Iterable, Iterator
from dataclasses import MISSING, fields
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OUTPUT = ROOT / "docs" / "reference" / "generated"
#: Packages of ROS that the node and its client import; the site is built without ROS, too.
ROS_MODULES = sorted(
    {
        name
        for path in (ROOT / "unc_physics" / "ros").rglob("*.py")
        for name in re.findall(
            r"^(?:from|import) (rclpy|\w+_msgs|\w+_interfaces)\b", path.read_text(), re.MULTILINE
        )
    }
)
SCHEMAS = {
    "scene": ("Scene files", "The keys of a scene file, which `load_scene` and the commands read."),
    "prediction": ("JSON output", "The keys of the object that `predict --json` prints."),
}
TOPICS = {
    "scene": (
        "Python: scenes",
        "Bodies, their surroundings and the physics between them.",
        """Scene RigidBody Element PosePath Wrench load_scene LoadedScene
        load_world WorldDescription PRESETS physics_of auto_stiffness""",
    ),
    "beliefs": (
        "Python: beliefs",
        "Means and covariances of the bodies' states at time 0.",
        "Belief BodyBelief start_belief",
    ),
    "prediction": (
        "Python: predictions",
        "The call that predicts, its answer, and the status of the answer.",
        """predict Prediction PredictedBody Trajectory Snapshot Mode assess assess_all
        BodyStatus Status assess_stability Stability
        rollouts RolloutStates predict_many Request RequestAnswer""",
    ),
    "events": (
        "Python: events and probabilities",
        "Events whose probability a prediction estimates.",
        "Touches InRegion AtRest Upright FellOff Event encounters BoxRegion Probability ContactTime",
    ),
    "propagators": (
        "Python: propagators",
        "Methods, their options and their base class.",
        "PROPAGATORS make_propagator Propagator",
    ),
    "ranking": (
        "Python: ranking of actions",
        "Actions ordered by their probability of success.",
        "rank Ranking RankedAction",
    ),
    "tracking": (
        "Python: tracking",
        "Beliefs that are kept while measurements arrive.",
        """Tracker AxialSymmetry ContactNoise PoseMeasurement PositionMeasurement RelativePoseMeasurement
        Correction TrackStatus""",
    ),
    "geometry": (
        "Python: geometry",
        "Meshes, sphere packings and links of robots.",
        """SpherePacking SolidMesh load_model list_models load_packing save_packing load_solid pack_solid
        primitive_model rounded_box signed_distance SignedDistance from_urdf link_motions
        load_robot_motion""",
    ),
    "calibration": (
        "Python: calibration",
        "Parameters fitted to recorded motions.",
        "calibrate Calibration Fitted calibrate_contact_noise NoiseCalibration Motion read_motions",
    ),
    "errors": (
        "Python: errors",
        "The exception of all bad input, and its codes.",
        "UncPhysicsError ErrorCode",
    ),
    "ros_client": (
        "Python: ROS client",
        "Messages from names and numbers, and calls of the node that return messages.",
        """ros.Client ros.object_state ros.environment ros.prediction_request ros.make_message ros.poses_of
        ros.request_of_planning_scene""",
    ),
}
PHYSICS_KEYS = ("integrator", "dt", "gravity", "damping", "friction", "restitution", "gyroscopic")
VALUES = {  # what the small definitions of the schemas accept
    "positive": "number > 0",
    "non_negative": "number ≥ 0",
    "share": "number from 0 to 1",
    "flag": "true or false",
    "vector": "3 numbers",
    "positives": "3 numbers > 0",
    "quaternion": "4 numbers",
    "roll_pitch_yaw": "3 numbers, or `{degrees: 3 numbers}`",
    "std": "1 or 3 numbers ≥ 0",
}
WITHOUT_DOCSTRING = {  # values, which have no docstring of their own
    "PRESETS": "Arguments of `Scene` for each preset of the physics, ``paper`` and ``everyday``.",
    "PROPAGATORS": "Propagator classes by name, including those of other packages.",
}


def pages() -> Iterator[tuple[str, str]]:
    """Yield the name and the Markdown text of each generated page."""
    for name, (title, summary) in SCHEMAS.items():
        yield f"{name}_keys", schema_page(name, title, summary)
    yield "command_line", command_line_page()
    for name, (title, summary, members) in TOPICS.items():
        yield f"python_{name}", python_page(name, title, summary, _names(name, members))
    yield "messages", interface_page("Messages", "msg")
    yield "services", interface_page("Services and the action", "srv", "action")
    yield "parameters", parameters_page()
    yield "status", status_page()
    yield "models", models_page()


# -- schemas -----------------------------------------------------------------------------------------


def schema_page(name: str, title: str, summary: str) -> str:
    """Return the keys of a JSON schema, one table for each kind of object."""
    from unc_physics.cli.schema_command import schema_text

    schema = json.loads(schema_text(name))
    definitions = {key: each for key, each in schema.get("$defs", {}).items() if key not in SCHEMAS}
    lines = [f"# {title}", "", summary, "", schema["description"], ""]
    lines += [
        f"`python -m unc_physics schema {name}` prints the JSON schema, which editors use to complete keys.",
        "",
    ]
    lines += _keys("Top level", schema)
    if name == "scene":
        lines += _presets()
    for key, definition in definitions.items():
        if "properties" in definition:
            lines += _keys(key.replace("_", " ").capitalize(), definition)
    return "\n".join(lines)


def _presets():
    """Return the values that each preset of the physics stands for."""
    from unc_physics import PRESETS, Scene

    defaults = {field.name: field.default for field in fields(Scene) if field.default is not MISSING}
    rows = [
        (f"`{key}`", *(_value({**defaults, **preset}[key]) for preset in PRESETS.values()))
        for key in PHYSICS_KEYS
    ]
    lines = ["## Presets of the physics", ""]
    lines += ["The key `physics` selects the values of all keys that the file does not contain.", ""]
    lines += [
        "| key | " + " | ".join(f"`{name}`" for name in PRESETS) + " |",
        "|---" * (1 + len(PRESETS)) + "|",
    ]
    return [*lines, *map(_row, rows), ""]


def _value(value):
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _keys(heading, schema):
    lines = [f"## {heading}", ""]
    if heading != "Top level" and "description" in schema:
        lines += [f"{_sentence(schema['description'])}", ""]
    rows = list(_rows(schema, ""))
    return [*lines, "| key | value | meaning |", "|---|---|---|", *(_row(row) for row in rows), ""]


def _rows(schema, prefix):
    required = schema.get("required", [])
    for key, value in schema["properties"].items():
        kind = _kind(value) + (" (required)" if key in required else "")
        yield f"`{prefix}{key}`", kind, value.get("description", "")
        for inner, suffix in ((value, ""), (value.get("items", {}), "[]")):
            if isinstance(inner, dict) and "properties" in inner:
                yield from _rows(inner, f"{prefix}{key}{suffix}.")


def _kind(value):
    """Return what a key takes, in words."""
    if "$ref" in value:
        name = value["$ref"].rpartition("/")[2].removesuffix(".schema.json")
        return VALUES.get(name, name.replace("_", " "))
    if "enum" in value:
        return " or ".join("null" if each is None else f"`{each}`" for each in value["enum"])
    if "const" in value:
        return f"`{value['const']}`"
    for several in ("anyOf", "oneOf"):
        if several in value:
            return " or ".join(dict.fromkeys(_kind(each) for each in value[several]))
    if value.get("type") == "array" and isinstance(value.get("items"), dict):
        return f"list of {_kind(value['items'])}" if value["items"] else "list"
    if isinstance(value.get("type"), list):
        return " or ".join(value["type"])
    return value.get("type", "any")


# -- command line ------------------------------------------------------------------------------------


def command_line_page() -> str:
    """Return the commands with their arguments, from the argument parsers."""
    from unc_physics.cli.parser import build_parser

    parser = build_parser()
    (commands,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    plugins = _plugin_commands()
    lines = [
        "# Command line",
        "",
        f"`python -m unc_physics COMMAND`. {parser.description} {parser.epilog}",
        "",
    ]
    for name, command in commands.choices.items():
        if name not in plugins:
            lines += _command(name, command)
    return "\n".join(lines)


def _plugin_commands():
    """Return the commands of other packages, and `evaluate`, which depend on what is installed."""
    from importlib.metadata import entry_points

    from unc_physics.cli.parser import GROUP

    return {point.name for point in entry_points(group=GROUP)} | {"evaluate"}


def _command(name, parser):
    usage = " ".join(parser.format_usage().removeprefix("usage: ").split())
    lines = [f"## {name}", "", parser.description or "", "", f"```text\n{_wrapped(usage)}\n```", ""]
    rows = []
    for action in parser._actions:
        if action.help is argparse.SUPPRESS or isinstance(action, argparse._HelpAction):
            continue
        formatter = parser._get_formatter()
        if not action.option_strings:
            words = [formatter._format_args(action, action.dest)]
        elif action.nargs == 0:
            words = action.option_strings
        else:
            value = formatter._format_args(action, action.dest.upper())
            words = [f"{option} {value}" for option in action.option_strings]
        meaning = formatter._expand_help(action) if action.help else ""
        rows.append((", ".join(f"`{word}`" for word in words), meaning))
    if rows:
        lines += ["| argument | meaning |", "|---|---|", *(_row(row) for row in rows), ""]
    return [*lines, parser.epilog or "", ""]


def _wrapped(usage):
    return textwrap.fill(usage, 100, subsequent_indent="    ", break_on_hyphens=False)


# -- Python ------------------------------------------------------------------------------------------


def python_page(topic: str, title: str, summary: str, members: Iterable[str]) -> str:
    """Return a page of autodoc directives for the public names of one topic."""
    import unc_physics

    lines = [f"# {title}", "", summary, ""]
    if topic == "propagators":
        lines += _propagator_table()
    lines += ["```{eval-rst}"]
    for member in members:
        name = f"unc_physics.{member}"
        if member in WITHOUT_DOCSTRING:
            lines += [f".. py:data:: {name}", "", f"   {WITHOUT_DOCSTRING[member]}", ""]
        elif member.startswith("ros."):
            kind = "class" if member[4].isupper() else "function"
            lines += [f".. auto{kind}:: {name}", *(["   :members:"] if kind == "class" else []), ""]
        elif inspect.isclass(getattr(unc_physics, member)):
            lines += [f".. autoclass:: {name}", "   :members:", *_inherited(getattr(unc_physics, member)), ""]
        elif callable(getattr(unc_physics, member)):
            lines += [f".. autofunction:: {name}", ""]
        else:
            lines += [f".. autodata:: {name}", ""]
    return "\n".join([*lines, "```", ""])


def _where(integrators):
    """Return the integrator of a support that is for one integrator only, in parentheses."""
    return f" ({integrators[0]})" if len(integrators) == 1 else ""


def _inherited(cls):
    """Return the option that lists members of the data class that a class extends."""
    return ["   :inherited-members: object"] if cls.__name__ == "Prediction" else []


def _propagator_table():
    """Return what each propagator is, supports and takes as options."""
    from unc_physics import PROPAGATORS

    rows = []
    for name, cls in PROPAGATORS.items():
        made = cls()
        supports = (
            (f"uncertain parameters{_where(made.supports.parameters_on)}", made.supports.parameters),
            ("errors of impacts", made.supports.impact_errors),
            (f"actions{_where(made.supports.actions)}", made.supports.actions),
            ("`overlap: reject`", made.supports.overlap_rejection),
        )
        rows.append(
            (
                f"`{name}`",
                cls.description(),
                made.traits.mean_update,
                "yes" if made.traits.cross_body else "no",
                ", ".join(word for word, holds in supports if holds) or "none of these",
            )
        )
    lines = ["| name | method | mean | correlations between bodies | supports |", "|---|---|---|---|---|"]
    lines += [_row(row) for row in rows]
    lines += [
        "",
        "Errors of impacts: the keys `impact_direction_std`, `impact_point_std` and `impact_friction_std`.",
        "",
    ]
    lines += ["| propagator | option | meaning |", "|---|---|---|"]
    lines += [
        _row((f"`{name}`", f"`{option.name}`", option.as_text()))
        for name, cls in PROPAGATORS.items()
        for option in cls.described_options()
    ]
    return [*lines, ""]


def undocumented_names() -> set[str]:
    """Return the public names that no topic lists."""
    import unc_physics

    listed = (_names(topic, members) for topic, (_, _, members) in TOPICS.items())
    return set(unc_physics.__all__).difference(*listed)


def _names(topic, members):
    """Return the public names of a topic; that of scenes has the shapes of the environment, too."""
    from unc_physics.scene.environment import ELEMENTS

    shapes = [kind.__name__ for kind in ELEMENTS.values()] if topic == "scene" else []
    return members.split() + shapes


# -- ROS ---------------------------------------------------------------------------------------------


def interface_page(title: str, *folders: str) -> str:
    """Return the fields of the interfaces of some folders of ``unc_physics_msgs``, with their comments."""
    lines = [
        f"# {title}",
        "",
        "`ros2 interface show --all-comments unc_physics_msgs/KIND/NAME` prints the same.",
        "",
    ]
    for folder in folders:
        for path in sorted((ROOT / "unc_physics_msgs" / folder).iterdir()):
            lines += _interface(path)
    return "\n".join(lines)


def _interface(path):
    parts = {"msg": [""], "srv": ["Request", "Response"], "action": ["Goal", "Result", "Feedback"]}[
        path.parent.name
    ]
    lines = [f"## {path.stem}", ""]
    for part, text in zip(parts, re.split(r"^---$", path.read_text(), flags=re.MULTILINE), strict=True):
        summary, rows = _fields(text)
        lines += [f"**{part}.** {summary}" if part else summary, ""]
        if rows:
            lines += ["| field | type | meaning |", "|---|---|---|", *(_row(row) for row in rows), ""]
    return lines


def _fields(text):
    """Return the leading comment of an interface, and rows of name, type and comment of its fields."""
    summary, comment, rows = "", [], []
    for line in text.splitlines():
        stripped = line.strip()
        if stripped.startswith("#"):
            comment.append(stripped.lstrip("# "))
        elif stripped:
            kind, _, rest = stripped.partition(" ")
            name, _, inline = rest.partition("#")
            constant = name.replace(" ", "") if "=" in name else name.strip()
            meaning = " ".join([*comment, inline.strip()]).strip()
            rows.append((f"`{constant}`", f"`{kind}`", meaning or ("as above" if rows else "")))
            comment = []
        elif comment:
            summary, comment = " ".join([summary, *comment]).strip(), []
    return " ".join([summary, *comment]).strip(), rows


def parameters_page() -> str:
    """Return the node's parameters, from their descriptors."""
    if importlib.util.find_spec("rclpy"):
        from unc_physics.ros.parameters import parameter_table
    else:
        from sphinx.ext.autodoc.mock import mock

        with mock(ROS_MODULES):
            from unc_physics.ros.parameters import parameter_table
    lines = [
        "# Parameters of the node",
        "",
        "`config/unc_physics.yaml` holds all parameters with their defaults.",
        "Parameters that are not read-only may change at run time. The next request or scene uses them.",
        "",
        parameter_table(),
        "",
    ]
    return "\n".join(lines)


# -- status, errors, models --------------------------------------------------------------------------


def status_page() -> str:
    """Return the rules of the status flags and the error codes."""
    from unc_physics import ErrorCode, Status
    from unc_physics.checks.errors import UncPhysicsError, error_of
    from unc_physics.prediction.diagnostics import RULES

    lines = [
        "# Flags and error codes",
        "",
        "How to act on a flag: [](../../explanation/what_to_believe.md).",
        "",
    ]
    for flag in Status:
        lines += [f"## {flag.name}", "", f"Value {flag.value}.", ""]
        rows = []
        for name, rule in RULES.items():
            if rule.flag == flag:
                limit = "none" if rule.limit == float("inf") else f"{rule.limit:.3g}"
                meaning = " ".join(inspect.getdoc(rule.compute).split())
                advice = re.sub(r"\{\w+[^}]*\}", "…", rule.words)
                rows.append((f"`{name}`", limit, meaning, _sentence(advice)))
        lines += ["| measure | flagged above | what it measures | message |", "|---|--:|---|---|"]
        lines += [*(_row(row) for row in rows), ""]
    lines += ["## Error codes", ""]
    lines += [
        "The code of an exception, the `error_code` of an answer over ROS, and the exit status of a command.",
        "",
    ]
    lines += ["| code | name | meaning |", "|--:|---|---|"]
    for code in ErrorCode:
        kind = type(error_of(code, ""))
        meaning = (
            "No error." if code == ErrorCode.NONE else inspect.getdoc(kind) or inspect.getdoc(UncPhysicsError)
        )
        lines.append(_row((str(int(code)), f"`{code.name}`", " ".join(str(meaning).split()))))
    return "\n".join([*lines, ""])


_PREFIXES = 100, 300, 1000, 3000


def models_page() -> str:
    """Return the models that ship, measured from their packings, with sources and licences."""
    from unc_physics import load_packing

    text = (ROOT / "models" / "README.md").read_text(encoding="utf-8")
    about = dict(re.findall(r"^\| (\w+) \|.*\| ([^|]+) \|$", text, re.MULTILINE))
    head = "model", "size [mm]", "mass [kg]", "spheres", "fill [%]", "largest surface gap [mm]"
    lines = [_row((*head, "what it is")), "|---|---|--:|--:|--:|--:|---|"]
    quality = [
        "Loss of extent [mm], for the first spheres of each model:",
        "",
        "| model | " + " | ".join(map(str, _PREFIXES)) + " | all |",
        "|---|" + "--:|" * (len(_PREFIXES) + 1),
    ]
    for path in sorted((ROOT / "models").glob("*.npz")):
        packing = load_packing(path)
        size = " x ".join(f"{1e3 * side:.4g}" for side in packing.bounds[1] - packing.bounds[0])
        numbers = (
            f"{packing.mass:.3g}",
            str(len(packing)),
            f"{100 * packing.fill:.1f}",
            f"{1e3 * packing.surface_gap:.2f}",
        )
        lines.append(_row((path.stem, size, *numbers, about[path.stem])))
        parts = [packing.prefix(count) for count in _PREFIXES] + [packing]
        measures = (f"{1e3 * part.extent_loss:.2f}" for part in parts)
        quality.append(_row((path.stem, *measures)))
    tables = "\n".join([*lines, "", *quality]) + "\n"
    return re.sub(r"^\|.*\n(?:\|.*\n)+", tables, text, count=1, flags=re.MULTILINE)


# -- output ------------------------------------------------------------------------------------------


def _row(cells):
    return "| " + " | ".join(" ".join(str(cell).split()).replace("|", r"\|") for cell in cells) + " |"


def _sentence(text):
    return text[:1].upper() + text[1:].rstrip(".") + "."


def write(folder: Path = OUTPUT) -> None:
    """Write all pages into a folder; a page whose text is the same keeps its time stamp."""
    if missing := undocumented_names():
        raise RuntimeError(f"docs/generate_reference.py: no topic lists {', '.join(sorted(missing))}")
    folder.mkdir(parents=True, exist_ok=True)
    made = {f"{name}.md": text for name, text in pages()}
    for path in folder.glob("*.md"):
        if path.name not in made:
            path.unlink()
    for name, text in made.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def setup(app):
    """Write the pages when Sphinx starts, before it looks for documents."""
    app.connect("builder-inited", lambda _: write())
    return {"parallel_read_safe": True}


if __name__ == "__main__":
    write()
