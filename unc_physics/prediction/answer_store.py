"""A folder of answers in Parquet files, to which an interrupted run returns."""

from __future__ import annotations

import fcntl
import hashlib
import os
import pickle
import time
from dataclasses import asdict, fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..checks.errors import InvalidRequestError, NotSupportedError, OutputError
from ..scene.scene import Scene
from ..shapes.primitive_models import PrimitiveModel
from ..spatial.layout import ANGULAR_VELOCITY, ERROR, POSITION, QUATERNION, VELOCITY

_SHARD_TIME = 10.0  # s, of answers in a file, at most: so many are lost when the process is killed
_SHARD_ROWS = 50_000  # of a file, at most: 70 MB
_STATE = {
    "position": POSITION,
    "orientation": QUATERNION,
    "linear_velocity": VELOCITY,
    "angular_velocity": ANGULAR_VELOCITY,
}


class AnswerStore:
    """Folder to which answers are added, in files that are there as a whole or not at all.

    A file has a row for each body and time, with columns ``number``, ``request`` (its fingerprint),
    ``seed``, ``time`` [s], ``body``, ``position``, ``orientation``, ``linear_velocity``,
    ``angular_velocity``, ``covariance`` (144, row by row), ``flags`` and ``reasons`` of the status, and
    ``events``, a list of their probabilities.

    Parameters
    ----------
    folder : path-like
        Created if it does not exist.

    Raises
    ------
    NotSupportedError
        Without pyarrow.
    OutputError
        If the folder cannot be written, another run uses it, or it holds something else.
    """

    def __init__(self, folder: Any):
        try:
            import pyarrow  # pyright: ignore[reportMissingImports]  # optional, as below
            from pyarrow import parquet  # pyright: ignore[reportMissingImports]
        except ImportError:
            raise NotSupportedError("needs pyarrow: pip install 'unc_physics[many]'", field="store") from None
        self._arrow, self._parquet, self._folder = pyarrow, parquet, Path(folder)
        self._waiting: list[tuple[Any, str]] = []
        self._rows, self._since = 0, time.monotonic()
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._lock = os.open(self._folder / ".lock", os.O_WRONLY | os.O_CREAT)
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutputError("is in use by another run", field="store", value=str(folder)) from None
        except OSError as error:
            raise OutputError(
                f"cannot be written: {error.strerror}", field="store", value=str(folder)
            ) from None
        self._known = dict(self._read())

    def close(self) -> None:
        """Write what waits, and let others use the folder."""
        try:
            self._write()
        finally:
            os.close(self._lock)

    def has(self, number: int, request: Any) -> bool:
        """Return whether the answer to a request is there.

        Raises `InvalidRequestError` if it is the answer to another request of that number.
        """
        if number not in self._known:
            return False
        if self._known[number] != fingerprint(request):
            raise InvalidRequestError(
                f"holds the answer to another request of number {number}, or that of another version; take"
                " another folder",
                field="store",
                value=str(self._folder),
            )
        return True

    def add(self, answer: Any, request: Any) -> None:
        """Add the answer to a request."""
        self._waiting.append((answer, fingerprint(request)))
        self._rows += answer.means.shape[0] * answer.means.shape[1]
        if self._rows >= _SHARD_ROWS or time.monotonic() - self._since >= _SHARD_TIME:
            self._write()

    def _read(self):
        """Yield numbers and fingerprints of the answers that are there."""
        for path in self._folder.glob("*.parquet"):
            try:
                found = self._parquet.read_table(path, columns=["number", "request"])
                yield from zip(*(column.to_pylist() for column in found.columns), strict=True)
            except (OSError, ValueError, KeyError) as error:
                raise OutputError(
                    f"holds a file that is none of its own, {path.name}: {error}",
                    field="store",
                    value=str(self._folder),
                ) from None

    def _write(self):
        """Write the answers that wait, by a name that becomes visible when the file is whole."""
        self._since = time.monotonic()
        if not self._waiting:
            return
        first = self._waiting[0][0].number
        path, fresh = self._folder / f"from-{first:09d}.parquet", self._folder / "part.tmp"
        try:
            self._parquet.write_table(self._table(), fresh, compression="zstd")
            os.replace(fresh, path)
        except OSError as error:
            raise OutputError(
                f"cannot be written: {error.strerror or error}", field="store", value=str(path)
            ) from None
        self._waiting, self._rows = [], 0

    def _table(self):
        number, text, list_, arrow = (
            self._arrow.float64(),
            self._arrow.string(),
            self._arrow.list_,
            self._arrow,
        )
        of_event = [("event", text), *((key, number) for key in ("estimate", "low", "high"))]
        columns = {
            "number": arrow.int64(),
            "request": text,
            "seed": arrow.int64(),
            "time": number,
            "body": text,
        }
        columns |= {name: list_(number, part.stop - part.start) for name, part in _STATE.items()}
        columns |= {"covariance": list_(number, ERROR * ERROR), "flags": list_(text), "reasons": list_(text)}
        columns["events"] = list_(arrow.struct(of_event))
        rows = [row for answer, digest in self._waiting for row in _rows(answer, digest)]
        return arrow.Table.from_pylist(rows, arrow.schema(columns.items()))


def _rows(answer, digest):
    """Yield the rows of an answer."""
    for k, time_of_row in enumerate(answer.times.tolist()):
        events = [{"event": event, **asdict(p)} for event, p in answer.probabilities[k].items()]
        for b, body in enumerate(answer.bodies):
            yield {
                "number": answer.number,
                "request": digest,
                "seed": answer.seed,
                "time": time_of_row,
                "body": body,
                **{name: answer.means[k, b, part].tolist() for name, part in _STATE.items()},
                "covariance": answer.covariances[k, b].ravel().tolist(),
                "flags": [flag.name for flag in answer.statuses[k][b].flags],
                "reasons": answer.statuses[k][b].reasons,
                "events": events,
            }


def fingerprint(request: Any) -> str:
    """Return a text that differs between requests, and between versions of this package."""
    found = hashlib.sha256(__version__.encode())
    _add(request, found)
    return found.hexdigest()[:32]


def _add(value, digest):
    """Add a value to a digest: of data classes the fields, which are there without what was computed."""
    if isinstance(value, np.ndarray):
        digest.update(f"{value.shape}{value.dtype}".encode() + value.tobytes())
    elif isinstance(value, Scene):
        digest.update(_of_scene(value))
    elif is_dataclass(value) and not isinstance(value, PrimitiveModel):  # whose fields would be packed
        digest.update(type(value).__name__.encode())
        for field in fields(value):
            _add(getattr(value, field.name), digest)
    elif isinstance(value, (tuple, list)):
        digest.update(f"{type(value).__name__}{len(value)}".encode())
        for part in value:
            _add(part, digest)
    else:
        digest.update(pickle.dumps(value, protocol=4))


@lru_cache(maxsize=64)
def _of_scene(scene):
    """Return the digest of a scene, which many requests have in common."""
    digest = hashlib.sha256()
    for field in fields(scene):
        _add(getattr(scene, field.name), digest)
    return digest.digest()
