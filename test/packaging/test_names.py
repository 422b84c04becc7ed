"""Nothing outside the propagators' folder names one but the default one, and class names are unique."""

import io
import re
import tokenize
from collections import Counter

from building import ROOT

from unc_physics.propagators.names import ANYTIME, BUILT_IN

PACKAGE = ROOT / "unc_physics"
PLACES = [place.partition(":") for place in BUILT_IN.values()]
#: Of modules, of classes, of their carries, and as users write them.
NAMES = {
    *BUILT_IN,
    *(module for module, _, _ in PLACES),
    *(cls for _, _, cls in PLACES),
    *(f"{cls.removesuffix('s')}Carry" for _, _, cls in PLACES),
    *(name.replace("_", " ") for name in BUILT_IN),
} - {ANYTIME}  # which is also what stiffness and overlap may be
#: Tokens with words; Python 3.12 splits formatted texts.
WORDS = (tokenize.NAME, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", tokenize.STRING))
NAMED = re.compile(r"(?<![\w])(" + "|".join(sorted(NAMES)) + r")(?!\w)")


def named(source):
    """The propagators that a module names in code and texts, with lines; docstrings do not count."""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        text = token.string
        docstring = text.lstrip("rf").startswith('"""')
        if token.type in WORDS and not docstring and text.strip("\"'") != ANYTIME:
            yield from (f"line {token.start[0]}: {name}" for name in NAMED.findall(text))


def test_no_propagator_is_named():
    source = (
        f'"""Of MonteCarlo."""\nfrom ..surrogate import SurrogateCarry\nx = "by cloud alone", "{ANYTIME}"'
    )
    found = ["line 2: surrogate", "line 2: SurrogateCarry", "line 3: cloud"]
    assert list(named(source)) == found
    for folder in ("scene", "physics", "prediction", "cli", "ros"):
        for path in sorted((PACKAGE / folder).rglob("*.py")):
            assert not list(named(path.read_text())), path


def test_class_names_are_unique():
    texts = [path.read_text() for path in PACKAGE.rglob("*.py")]
    classes = [name for text in texts for name in re.findall(r"^ *class (\w+)", text, re.MULTILINE)]
    assert "RigidBody" in classes
    assert [name for name, count in Counter(classes).items() if count > 1] == []
