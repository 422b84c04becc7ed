"""What the measures of the code count, in a small package whose calls, constants and tests are known."""

import re

from unc_physics_evaluation import mutation
from unc_physics_evaluation.call_walk import Package, Place, passed
from unc_physics_evaluation.code_metrics import ENTRY, PROPAGATOR, ROOT, tuned_constants

SOURCES = {
    "__init__.py": "",
    "node.py": """
        from . import methods
        from .job import Job
        from .messages.read import read

        class Server:
            job: Job

            def __init__(self):
                self.log = Log()

            def answer(self, request):
                for part in read(request):
                    part.check(part.looked_at)
                self.log.add(self.job.run().size)
                return submit(self._later, methods.BY_NAME["fast"])

            def _later(self):
                raise Unknown(self.unknown())

            def not_called(self):
                never()

        class Log:
            def add(self, text): ...

        def submit(function, method): ...
        def never(): ...
        """,
    "job.py": """
        from dataclasses import dataclass
        from .methods import Method
        from .physics.step import kernel, step

        class Job:
            def run(self) -> "Result | None":
                raise NotImplementedError

        @dataclass
        class Real(Job):
            method: Method

            def run(self) -> Result:
                step()
                with self.method.limited() as limit:
                    return Result(limit.passed)

        class Result:
            def __init__(self, value): ...

            @property
            def size(self): ...
        """,
    "methods.py": """
        TABLE = {}

        def enter(function):
            TABLE[function.__name__] = function
            return function

        def slow(): ...
        def fast(): ...

        BY_NAME = {"slow": slow, "fast": fast}

        @enter
        def entered(): ...

        class Limit:
            @property
            def passed(self): return TABLE["entered"]()

        class Method:
            def limited(self) -> Limit: return super().other()
        """,
    "messages/__init__.py": "from .read import read",
    "messages/read.py": """
        from ..parts import Part

        def read(request) -> list[Part]:
            return [Part(text) for text in request]
        """,
    "parts.py": """
        class Base:
            def __post_init__(self): ...
            def check(self, look): self.looked_at()
            def looked_at(self): ...

        class Part(Base):
            def looked_at(self): super().looked_at()
        """,
    "physics/step.py": """
        from ..parts import unrelated

        @kernel
        def step(): inner_step()

        def inner_step(): ...
        """,
}


def write(folder, sources):
    for name, text in sources.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        lines = text.splitlines()
        margin = min((len(line) - len(line.lstrip()) for line in lines if line.strip()), default=0)
        path.write_text("\n".join(line[margin:] for line in lines) + "\n")


def test_the_walk_passes_what_can_be_called(tmp_path):
    write(tmp_path / "small", SOURCES)
    entry, real = Place("small.node", "Server.answer"), Place("small.job", "Real")
    found = {
        ".".join(place).removeprefix("small.") for place in passed(Package(tmp_path / "small"), entry, real)
    }
    assert found == {
        *("node.Server.answer", "node.Server._later", "node.Log.add", "node.submit"),
        *("messages.read.read", "parts.Base.__post_init__", "parts.Base.check", "parts.Base.looked_at"),
        *("parts.Part.looked_at", "job.Real.run", "job.Result.__init__", "job.Result.size"),
        *(
            "methods.Method.limited",
            "methods.Limit.passed",
            "methods.slow",
            "methods.fast",
            "methods.entered",
        ),
        "physics.step.step",  # compiled: the walk ends there
    }


def test_a_request_passes_the_files_that_contributing_lists():
    listed = re.findall(r"^\| `([\w/]+\.py)` \|", (ROOT / "CONTRIBUTING.md").read_text(), re.MULTILINE)
    package = Package(ROOT / "unc_physics")
    functions = passed(package, ENTRY, PROPAGATOR)
    files = {str(package.files[place.module].relative_to(ROOT / "unc_physics")) for place in functions}
    assert len(listed) > 10
    assert set(listed) - files == {"ros/services.py"}, "which calls the function where the walk starts"


def test_constants_that_somebody_chose(tmp_path):
    path = tmp_path / "solver.py"
    path.write_text(
        "SWEEPS, COLUMN, GUARD = 200, 7, 1e-12\n"
        "SAME = 1.0 - 1e-9\n"
        "SHARE = -0.3\n"
        "LEVELS = 0.97, 1.05\n"
        "TWICE = 2.0 * SHARE\n"
        "lower = 0.1\n"
        "def solve(x):\n"
        "    for k in range(min(SWEEPS, 5)):\n"
        "        x[COLUMN] += 0.75 * x[0] / 24.0 + 0.05\n"
        "    return x[COLUMN] > 0.0\n"
    )
    found = [(constant.name, constant.value) for constant in tuned_constants([path])]
    assert found == [("SWEEPS", 200), ("SHARE", -0.3), ("LEVELS", 0.97), ("LEVELS", 1.05), ("", 0.05)]


def test_each_mutant_has_one_change():
    source = (
        "import math\n"
        "LIMIT = 2.0\n"
        "@kernel\n"
        "def compiled(x): return x + 1\n"
        "def rule(x, y):\n"
        '    """Text."""\n'
        "    if x < y and not y:\n"
        "        raise\n"
        "    x += 1\n"
        "    return max(x, key=y) if y else -x\n"
    )
    changes = [str(mutant) for mutant in mutation.mutants("a.py", source)]
    assert [change.removeprefix("a.py:") for change in changes] == [
        "2: 2.0 -> 3.0",
        "7: if x < y and (not y): raise -> if not (x < y and (not y)): raise",
        "7: x < y and (not y) -> x < y or not y",
        "7: x < y -> x <= y",
        "7: not y -> y",
        "8: raise -> pass",
        "9: x += 1 -> pass",
        "9: 1 -> 2",
        "10: return max(x, key=y) if y else -x -> return",
        "10: max(x, key=y) if y else -x -> -x if y else max(x, key=y)",
        "10: max(x, key=y) -> max(x)",
        "10: max -> min",
        "10: -x -> x",
    ]
    for mutant in mutation.mutants("a.py", source):
        compile(mutant.source, "a.py", "exec")
