"""Browser page with a time line, display options, propagator choice, and uncertainty sliders."""

from __future__ import annotations

import contextlib
import html
import io
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..checks.errors import UncPhysicsError
from .adjusting import LABELS
from .drawing import Drawing
from .session import Session

_FASTEST = 0.03  # s, least interval of frames
_STEPS = 100  # steps of a slider
_LAST_PREDICTION = 5.0  # s, longest wait for the last prediction on closing


class Page:
    """Page that shows a session until it is closed; any client that reaches ``host`` can view and adjust.

    Mesh files are as in `Drawing`.
    """

    def __init__(
        self, session: Session, host="127.0.0.1", port=8080, title="", meshes: Mapping[str, str] | None = None
    ):
        self._session = session
        frames = session.predict()
        self.server = _server(host, port, title)
        self._drawing = Drawing(self.server, session.scene, frames, meshes)
        self._wanted, self._closed = threading.Event(), threading.Event()
        self._add_time_line(frames)
        self._add_choices()
        self._add_sliders()
        self._summary = self.server.gui.add_markdown(session.summary())
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._play, self._predict)]
        for thread in self._threads:
            thread.start()

    @property
    def drawn(self) -> Drawing:
        """The current drawing."""
        return self._drawing

    @property
    def port(self) -> int:
        """The port on which it listens."""
        return self.server.get_port()

    def _add_time_line(self, frames):
        gui = self.server.gui
        last = float(frames.times[-1])
        self._line = gui.add_slider("time [s]", 0.0, last, _shown(last / (len(frames.times) - 1), last), 0.0)
        self._playing = gui.add_checkbox("play", True)
        self._speed = gui.add_dropdown("speed", ("1", "1/2", "1/4", "1/10"), initial_value="1")

        @self._line.on_update
        def _(_event):
            self._drawing.show(self._frame())

    def _frame(self):
        """Return the index of the frame at the time line's position."""
        return int(np.abs(self._drawing.frames.times - self._line.value).argmin())

    def _add_choices(self):
        gui, session = self.server.gui, self._session
        ghosts, ellipsoids = gui.add_checkbox("samples", True), gui.add_checkbox("ellipsoids, 2 std", True)
        ghosts.on_update(lambda _: self._drawing.show_ghosts(ghosts.value))
        ellipsoids.on_update(lambda _: self._drawing.show_ellipsoids(ellipsoids.value))
        names = tuple(session.propagators)
        chosen = gui.add_dropdown("propagator", names, initial_value=session.propagator.name)

        @chosen.on_update
        def _(_event):
            session.choose(chosen.value)
            self._wanted.set()

    def _add_sliders(self):
        sliders: dict[str, Any] = {}
        with self.server.gui.add_folder("uncertainty at the start"):
            for key, value, most, unit in self._session.quantities:
                label = LABELS[key] + (f" [{unit}]" if unit else "")
                step = most / _STEPS
                slider = self.server.gui.add_slider(label, 0.0, most, step, _shown(value, most))
                slider.on_update(lambda _, key=key, slider=slider: self._adjust(key, slider.value))
                sliders[key] = slider
            back = self.server.gui.add_button("reset")

        @back.on_click
        def _(_event):
            for key, value, most, _ in self._session.quantities:
                sliders[key].value = _shown(value, most)
            self._session.reset()
            self._wanted.set()

    def _adjust(self, key, value):
        self._session.adjust(key, value)
        self._wanted.set()

    def _predict(self):
        """Predict after each change; of several pending changes only the last is predicted."""
        while not self._closed.is_set():
            if not self._wanted.wait(0.2):
                continue
            self._wanted.clear()
            try:
                frames = self._session.predict()
                if self._closed.is_set():
                    return
                self._drawing.replace(frames)
                self._summary.content = self._session.summary()
            except UncPhysicsError as error:
                self._summary.content = f"**not predicted**: {error}"

    def _play(self):
        """Advance the time line in real time while a client is connected."""
        while not self._closed.wait(self._pause()):
            if self._playing.value and self.server.get_clients():
                times = self._drawing.frames.times
                frame = (self._frame() + 1) % len(times)
                self._line.value = float(times[frame])
                self._drawing.show(frame)

    def _pause(self):
        times = self._drawing.frames.times
        slower = float(self._speed.value.removeprefix("1/"))
        last = self._frame() == len(times) - 1
        return max(slower * float(times[-1]) / max(len(times) - 1, 1), _FASTEST) + (0.7 if last else 0.0)

    def close(self) -> None:
        """Stop the page."""
        self._closed.set()
        for thread in self._threads:  # a thread that still sends would cause warnings
            thread.join(_LAST_PREDICTION)
        _stop(self.server)

    def wait(self) -> None:
        """Wait until the page is closed or interrupted."""
        while not self._closed.wait(3600.0):
            pass


def _shown(value, most):
    """Round a slider value to three digits."""
    return float(f"{min(value, most):.3g}")


def _server(host, port, title=""):
    """Return a viser server that prints nothing."""
    import viser

    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=host, port=port, label=title or None, verbose=False)
    server.gui.configure_theme(control_width="small", show_share_button=False)
    server.gui.main_panel.dock_right()  # beside the scene, not above it
    return server


def _stop(server):
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def record(session: Session, path: Path, meshes: Mapping[str, str] | None = None) -> None:
    """Write a standalone page that repeats the prediction, without controls."""
    frames = session.predict()
    server = _server("127.0.0.1", 0)
    try:
        drawing = Drawing(server, session.scene, frames, meshes)
        writer = server.get_scene_serializer()
        for k, moment in enumerate(frames.times):
            drawing.show(k)
            after = frames.times[k + 1] - moment if k + 1 < len(frames.times) else 1.0
            writer.insert_sleep(float(after))
        title = f"<title>{html.escape(path.stem)}: unc_physics</title>"
        path.write_text(writer.as_html().replace("<title>Viser</title>", title, 1), encoding="utf-8")
    finally:
        _stop(server)
