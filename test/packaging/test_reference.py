"""The generated pages of the reference: each public name, key, option and parameter has its place."""

import json
import re
import sys
from dataclasses import fields

import pytest
from building import ROOT

from unc_physics import PRESETS, PROPAGATORS, ErrorCode, Status
from unc_physics.cli.parser import build_parser
from unc_physics.prediction.diagnostics import RULES

sys.path.append(str(ROOT / "docs"))

import generate_reference

STATED_OTHERWISE = "dt", "rolling_friction"  # 1/240, and without the preset


def test_each_public_name_has_a_topic():
    assert not generate_reference.undocumented_names()


def test_the_repositorys_pages_are_current():
    """`python docs/generate_reference.py` writes them."""
    pytest.importorskip("rclpy")
    stored = {path.stem: path.read_text() for path in generate_reference.OUTPUT.glob("*.md")}
    made = dict(generate_reference.pages())
    assert {name for name in made if stored.get(name, "") != made[name] and "python_" not in name} == set()
    assert stored.keys() <= made.keys()


def test_scene_keys_state_the_values_of_everyday_physics():
    schema = json.loads((ROOT / "unc_physics" / "schemas" / "scene.schema.json").read_text())
    values = {
        k: v for k, v in PRESETS["everyday"].items() if isinstance(v, float) and k not in STATED_OTHERWISE
    }
    assert len(values) == 8
    for key, value in values.items():
        assert f"with everyday {value:g}" in schema["properties"][key]["description"], key


@pytest.mark.parametrize("name", generate_reference.SCHEMAS)
def test_a_schemas_keys_are_on_its_page(name):
    page = generate_reference.schema_page(name, "", "")
    schema = json.loads((ROOT / "unc_physics" / "schemas" / f"{name}.schema.json").read_text())
    tables = [schema, *(part for part in schema["$defs"].values() if "properties" in part)]
    assert all(f"`{key}`" in page for table in tables for key in table["properties"])


def test_the_presets_are_on_the_page_of_scene_files():
    page = generate_reference.schema_page("scene", "", "")
    (row,) = re.findall(r"^\| `friction` \| (\S+) \| (\S+) \|$", page, re.MULTILINE)
    assert row == ("none", str(PRESETS["everyday"]["friction"]))


def test_each_option_of_a_command_is_on_the_page():
    page = generate_reference.command_line_page()
    (commands,) = (action for action in build_parser()._actions if action.choices and action.dest != "help")
    found = {command: set(parser._option_string_actions) for command, parser in commands.choices.items()}
    sections = dict(re.findall(r"^## (\w+[\w-]*)\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL))
    for command in ("predict", "rank", "pack", "warm-up"):
        assert all(f"`{option}" in sections[command] for option in found[command] - {"-h", "--help"})


def test_options_of_propagators_are_on_their_page():
    page = generate_reference.python_page("propagators", "", "", ["PROPAGATORS"])
    for name, cls in PROPAGATORS.items():
        for option in fields(cls):
            assert f"| `{name}` | `{option.name}` |" in page


def test_fields_of_interfaces_have_the_comments_above_them():
    page = generate_reference.interface_page("", "msg")
    assert "| `error_code` | `uint16` | One of the constants. |" in page
    assert "| `NO_OBJECTS=11` | `uint16` | No objects were given. |" in page


def test_measures_and_codes_are_on_the_page_of_the_status():
    page = generate_reference.status_page()
    sections = dict(re.findall(r"^## (\w+)\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL))
    assert all(f"| `{name}` |" in sections[Status(rule.flag).name] for name, rule in RULES.items())
    assert all(f"| {int(code)} | `{code.name}` |" in page for code in ErrorCode)


def test_each_model_is_on_its_page():
    page = generate_reference.models_page()
    for path in (ROOT / "models").glob("*.npz"):
        # in the table of models, and in that of their first spheres
        assert len(re.findall(rf"^\| {path.stem} \|", page, re.MULTILINE)) == 2
