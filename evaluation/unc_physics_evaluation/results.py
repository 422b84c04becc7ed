"""A folder of results: rows in a CSV file for each experiment, and arrays for pictures."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from unc_physics.checks.errors import OutputError

from .jobs import Job, Outcome, Row
from .tables import table

ORIGIN = ("versions", "machine", "job", "part")
_NUMBERS = (int, float)


class Rows(list):
    """Rows as dicts, with selection."""

    def where(self, **wanted) -> Rows:
        """Return the rows with these values."""
        return Rows(row for row in self if all(row.get(name) == value for name, value in wanted.items()))

    def unique(self, column: str) -> list:
        """Return the distinct values of a column, in order of appearance."""
        return list(dict.fromkeys(row[column] for row in self if row.get(column) is not None))

    def curves(self) -> list[tuple[str, int | None]]:
        """Return (method, samples) of all rows: methods in order of appearance, samples ascending."""
        return [
            (method, samples)
            for method in self.unique("method")
            for samples in sorted(self.where(method=method).unique("samples")) or [None]
        ]

    def values(self) -> np.ndarray:
        """Return the values of all rows."""
        return np.array([row["value"] for row in self], float)

    def mean(self) -> float:
        """Return the mean of the values; NaN without rows."""
        return float(np.mean(self.values())) if self else float("nan")

    def median(self) -> float:
        """Return the median of the values; NaN without rows."""
        return float(np.median(self.values())) if self else float("nan")


class Results:
    """A folder that fills up with finished jobs.

    Parameters
    ----------
    folder : path-like
        Created if it does not exist.

    Raises
    ------
    OutputError
        If it cannot be written to.
    """

    def __init__(self, folder):
        self.folder = Path(folder)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(
                f"cannot be made: {error.strerror}", field="--output", value=str(folder)
            ) from None
        if not os.access(self.folder, os.W_OK):
            raise OutputError("cannot be written to", field="--output", value=str(folder))

    @contextmanager
    def locked(self):
        """Keep other evaluations out of the folder."""
        import fcntl

        with open(self.folder / ".lock", "w") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise OutputError(
                    "is in use by another evaluation", field="--output", value=str(self.folder)
                ) from None
            yield

    def rows(self, experiment: str) -> Rows:
        """Return all rows of finished jobs, ordered by their parameters."""
        lines, whole = self._read(experiment)
        rows = [
            {name: _parsed(text) for name, text in line.items()} for line in lines if line["job"] in whole
        ]
        return Rows(sorted(rows, key=_parameters))

    def missing(self, jobs: Sequence[Job]) -> list[Job]:
        """Return the unfinished jobs, and remove partly written results of an interruption.

        Raises
        ------
        OutputError
            If the folder holds results with other columns.
        """
        first = {job.experiment: job for job in reversed(jobs)}
        finished = {
            experiment: self._finished(experiment, _columns(job)) for experiment, job in first.items()
        }
        return [job for job in jobs if job.key not in finished[job.experiment]]

    def _finished(self, experiment, columns):
        """Return the keys of the finished jobs, after removing other rows from the file."""
        lines, whole = self._read(experiment)
        path, kept = self._csv(experiment), [line for line in lines if line["job"] in whole]
        if kept and list(kept[0]) != columns:
            raise OutputError(
                "was written by another version of unc_physics; choose another folder with --output",
                field=str(path),
            )
        if not kept:
            path.unlink(missing_ok=True)
        elif len(kept) < len(lines) or not path.read_text().endswith("\n"):
            fresh = path.with_suffix(".tmp")
            fresh.write_text(_csv_text(columns, kept, header=True))
            fresh.replace(path)
        return whole

    def add(self, job: Job, outcome: Outcome, origin: dict) -> None:
        """Add a finished job; ``origin`` holds the versions and the machine that made it."""
        if outcome.arrays:
            path = self._npz(job.experiment, job.key)
            path.parent.mkdir(exist_ok=True)
            with open(path.with_suffix(".tmp"), "wb") as file:
                np.savez_compressed(file, **outcome.arrays)
            path.with_suffix(".tmp").replace(path)
        rows = [
            {
                **job.parameters,
                **row._asdict(),
                **origin,
                "job": job.key,
                "part": f"{k + 1}/{len(outcome.rows)}",
            }
            for k, row in enumerate(outcome.rows)
        ]
        path = self._csv(job.experiment)
        header = not path.is_file()
        with open(path, "a", newline="") as file:
            file.write(_csv_text(_columns(job), rows, header))

    def arrays(self, experiment: str, key: str) -> dict[str, np.ndarray]:
        """Return the arrays of a finished job, by its key in the column ``job``; empty if it has none."""
        path = self._npz(experiment, key)
        if not path.is_file():
            return {}
        with np.load(path) as file:
            return dict(file)

    def figure(self, name: str) -> Path:
        """Return the path of a figure."""
        folder = self.folder / "figures"
        folder.mkdir(exist_ok=True)
        return folder / f"{name}.png"

    def table(self, name: str, head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
        """Write a table to ``tables/NAME.csv``, which the docs show, and return it in Markdown."""
        folder = self.folder / "tables"
        folder.mkdir(exist_ok=True)
        with open(folder / f"{name}.csv", "w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([head, *lines])
        return table(head, lines)

    def _read(self, experiment):
        """Return complete lines as dicts of texts, and the keys of jobs with all their lines."""
        path = self._csv(experiment)
        text = path.read_text() if path.is_file() else ""
        lines = list(csv.DictReader(io.StringIO(text[: text.rfind("\n") + 1])))
        return lines, _whole_jobs(lines)

    def _csv(self, experiment):
        return self.folder / f"{experiment}.csv"

    def _npz(self, experiment, key):
        return self.folder / "samples" / f"{experiment} {key}.npz".replace(" ", "_")


def _columns(job):
    return [*job.parameters, *Row._fields, *ORIGIN]


def _parameters(row):
    """Return a sort key of a job's parameters; texts and numbers cannot be compared."""
    names = list(row)
    return [(isinstance(row[name], str), row[name]) for name in names[: names.index(Row._fields[0])]]


def _csv_text(columns, rows: Iterable[dict], header):
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    if header:
        writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _whole_jobs(lines):
    counts, wanted = {}, {}
    for line in lines:
        counts[line["job"]] = counts.get(line["job"], 0) + 1
        wanted[line["job"]] = line["part"].partition("/")[2]
    return {key for key, count in counts.items() if wanted[key] == str(count)}


def _parsed(text):
    if not text:
        return None
    for kind in _NUMBERS:
        try:
            return kind(text)
        except ValueError:
            continue
    return text
