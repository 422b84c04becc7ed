"""The code of docs/extending.md, as files."""

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "extending.md"


def code(language="python"):
    """The page's blocks in a language, each under the file's name in its first line."""
    blocks = re.findall(rf"^```{language}\n# (\S+)\n(.*?)^```$", PAGE.read_text(), re.DOTALL | re.MULTILINE)
    return dict(blocks)


def install(folder, module, name):
    """Put a module of the page into a folder as an installed package whose entry point is a propagator of
    that name.
    """
    (folder / f"{module}.py").write_text(code()[f"{module}.py"])
    toml = re.search(rf'^{name} = "(\w+:\w+)"$', PAGE.read_text(), re.MULTILINE)
    package = folder / f"{module}-1.0.dist-info"
    package.mkdir()
    (package / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
    (package / "entry_points.txt").write_text(f"[unc_physics.propagators]\n{name} = {toml[1]}\n")


def environment(*folders):
    """Environment variables of a process that finds the packages, and first those in some folders."""
    places = [*map(str, folders), str(ROOT), os.environ.get("PYTHONPATH", "")]
    return os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, places))}


def run(*command, folders=(), cwd=ROOT):
    """Exit status, output and errors of a process of Python in such an environment."""
    command, env = [sys.executable, *command], environment(*folders)
    done = subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


def edited(text, difference):
    """A file's text after the lines of a difference: those with ``-`` are found, those with ``+`` take their
    place.
    """
    for old, new in re.findall(r"^-(.*)\n((?:\+.*\n)+)", difference, re.MULTILINE):
        assert text.count(f"{old}\n") == 1, old
        text = text.replace(f"{old}\n", re.sub(r"^\+", "", new, flags=re.MULTILINE))
    return text
