"""What the pages of the docs are checked by, and the notebooks made of the tutorials."""

import ast
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "docs"))

from blocks import blocks
from count_words import words
from notebooks import TUTORIALS, notebook, write_notebooks
from run_pages import agree, run_page

PAGE = """# Title

```yaml
# file: scene.yaml
horizon: 1
```

Text of five words, [here](https://link.not/counted).

```python
value = 2.0
```

```py
value = 3.0
```

```python
print("value", value)
```

```text
value 2.04
```

End.
"""


def test_blocks_are_files_and_what_runs_with_the_output_that_is_shown():
    file, first, second = blocks(PAGE)
    assert (file.kind, file.name, file.text) == ("file", "scene.yaml", "horizon: 1\n")
    assert (first.kind, first.output) == ("python", None)
    assert PAGE[slice(*second.output)] == "value 2.04\n"


@pytest.mark.parametrize(
    ("shown", "printed", "same"),
    [
        ("falls 0.51\n", "falls  0.53\n", True),
        ("falls 0.51\n", "falls 0.75\n", False),
        ("falls 0.51\n", "stays 0.51\n", False),
        ("moved 100 mm\n", "moved 120 mm\n", True),
        ("moved 100 mm\n", "moved 150 mm\n", False),
        ("t = 1 s  (auto, 6 s)\n", "t = 1 s  (auto, 0.31 s)\n", True),
        ("a 1\n", "a 1\nb 2\n", False),
    ],
)
def test_outputs_agree_but_for_round_off_and_durations(shown, printed, same):
    assert agree(shown, printed) == same


def test_a_page_runs_with_shared_names_and_shows_what_is_printed(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("run_pages.ROOT", tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.chdir(tmp_path)
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    assert run_page(page, update=False)
    assert (tmp_path / "scene.yaml").read_text() == "horizon: 1\n"
    page.write_text(PAGE.replace("value 2.04", "value 7"))
    assert not run_page(page, update=False)
    assert "shown:\nvalue 7\nprinted:\nvalue 2.0" in capsys.readouterr().out
    assert run_page(page, update=True)
    assert "```text\nvalue 2.0\n```" in page.read_text()


def test_words_are_those_of_the_text():
    assert words(PAGE) == 7
    assert words("```{glossary}\nterm\n```\n| a `cell` | two |\n") == 3


@pytest.mark.parametrize("page", sorted(TUTORIALS.glob("*.md")), ids=lambda page: page.stem)
def test_a_tutorial_is_a_notebook(page):
    text = page.read_text(encoding="utf-8")
    assert f"{{download}}`{page.stem}.ipynb <{page.stem}.ipynb>`" in text
    cells = notebook(text)["cells"]
    assert len({cell["id"] for cell in cells}) == len(cells)
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert len(code) == len(list(blocks(text)))
    for source in code:
        if not source.startswith("%%"):
            ast.parse(source)
    prose = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    assert not re.search(r"^```(?:python|bash|text)\n", prose, re.MULTILINE)
    assert "{download}" not in prose


def test_notebooks_are_written(tmp_path):
    assert [path.suffix for path in write_notebooks(tmp_path)] == [".ipynb"] * 4
