"""Report of a sweep: Markdown with figures, from the available rows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType

from .experiments import experiment
from .results import Results


def write_report(
    results: Results, names: Sequence[str], gaps: Sequence[str], failures: Mapping[str, str]
) -> Path:
    """Write ``report.md`` on the named experiments that have rows.

    Parameters
    ----------
    results : Results
    names : sequence of str
        Experiments, in the order of the report.
    gaps : sequence of str
        What was omitted, and why.
    failures : mapping of str to str
        Jobs that failed, and why.
    """
    parts, made = ["# Evaluation\n"], {}
    for name in names:
        rows = results.rows(name)
        if not rows:
            continue
        for row in rows:
            made[row["versions"], row["machine"]] = made.get((row["versions"], row["machine"]), 0) + 1
        parts += [
            f"## {experiment(name).TITLE}\n",
            f"`python -m unc_physics evaluate {name}`, rows in {name}.csv\n",
            *(f"**{sentence}**\n" for _, sentence in verdicts(results, [experiment(name)])),
            experiment(name).report(results),
        ]
    if gaps or failures:
        parts.append("## Left out\n")
        parts += [f"* {gap}" for gap in gaps]
        parts += [f"* {job}: {why}" for job, why in failures.items()]
        parts.append("")
    parts.append("## Made by\n")
    parts += [f"* {count} rows: {versions}; {machine}" for (versions, machine), count in made.items()]
    path = results.folder / "report.md"
    path.write_text("\n".join(parts) + "\n")
    return path


def verdicts(results: Results, experiments: Iterable[ModuleType]) -> Iterator[tuple[str, str]]:
    """Return the names and verdicts of experiments that have both rows and a verdict."""
    for module in experiments:
        name = module.__name__.rpartition(".")[2]
        if hasattr(module, "verdict") and results.rows(name):
            yield name, module.verdict(results)
