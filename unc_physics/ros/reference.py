"""Prints what `docs/ros.md` and `config/unc_physics.yaml` say about parameters: ``python -m
unc_physics.ros.reference``.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import fields

import yaml

from .parameters import Settings


def parameter_table() -> str:
    """All parameters as a Markdown table."""
    lines = ["| parameter | default | range | what it is |", "|---|---|---|---|"]
    for spec in fields(Settings):
        meta = spec.metadata
        if meta["choices"]:
            allowed = ", ".join(meta["choices"])
        else:
            allowed = "" if meta["low"] is None else f"{meta['low']:g} to {meta['high']:g}"
        name = f"`{spec.name}`" + (" (read-only)" if meta["read_only"] else "")
        lines.append(f"| {name} | `{_default(spec)}` | {allowed} | {meta['description']} |")
    return "\n".join(lines)


def parameter_file() -> str:
    """All parameters with their defaults as a parameter file."""
    lines = [
        "# All parameters of the node with their defaults; docs/ros.md tells their ranges.",
        "# Made by: python -m unc_physics.ros.reference --yaml > config/unc_physics.yaml",
        "/**:",
        "  ros__parameters:",
    ]
    for spec in fields(Settings):
        lines += [f"    # {spec.metadata['description']}", f"    {spec.name}: {_default(spec)}"]
    return "\n".join(lines)


def _default(spec):
    """The default in YAML that ROS reads as the same type."""
    value = list(spec.default) if isinstance(spec.default, tuple) else spec.default
    text = yaml.safe_dump(value, default_flow_style=True, width=1000).removesuffix("...\n").strip()
    return '""' if value == "" else text


def main(arguments=None) -> int:
    """Print the table or the file."""
    parser = argparse.ArgumentParser(prog="unc_physics.ros.reference", description=__doc__)
    parser.add_argument("--yaml", action="store_true", help="print the parameter file in place of the table")
    print(parameter_file() if parser.parse_args(arguments).yaml else parameter_table())
    return 0


if __name__ == "__main__":
    sys.exit(main())
