"""The camera's tab: opened and closed, its picture, value and reason, in a real window."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial

import numpy as np
import pytest

from boat_daq.engine.camera.source import CameraFrame
from boat_daq.engine.simulator.picture import FAULTLESS, CameraScene, Disturbance, Renderer
from boat_daq.gui.live.readings_panel import BY_CAMERA
from boat_daq.workflows import camera_tracking as choice
from protocol.base.errors import DeviceError, RequestError
from protocol.base.units import ShownUnits
from tests.boat_daq.gui.recorded_session import connected

SCENE = CameraScene(width=160, height=120, px_per_mm=5.0)


class Pictures:
    """A camera that gives rendered pictures, each when it is asked for."""

    name, live, frame_count = "7", True, 0

    def __init__(self, wrong: Disturbance = FAULTLESS, error: DeviceError | None = None) -> None:
        self.renderer, self.wrong, self.error, self.closed = Renderer(SCENE), wrong, error, False

    def frames(self) -> Iterator[CameraFrame]:
        for n in range(10_000):
            if self.closed:
                return
            time.sleep(0.004)
            wrong = self.wrong if n > 20 else FAULTLESS
            yield CameraFrame(n / 30, partial(self.renderer.frame, n, np.zeros(1), 0.0, wrong))

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def panel(live, monkeypatch):
    """Return the panel of a window on a board, its tab in front, and a function that opens a camera."""
    panel = live.live.camera
    live.model.session.live.add_sink = lambda sink: lambda: None
    live.model.session.resumed_after = lambda: 0
    live.live.pane.setCurrentWidget(live.live.readings)
    live.live.readings.choose(BY_CAMERA)

    def opened(source: Pictures) -> None:
        monkeypatch.setattr(choice, "open_source", lambda name, allow_remote: source)
        panel.source.setText("7")
        panel.mark.setText("8")
        panel.button.click()

    yield panel, opened
    panel.model.close()


def test_camera_shows_marks_and_elongation(panel, qtbot):
    """With its uncertainty; closed again, the picture goes."""
    shown, opened = panel
    opened(Pictures())
    assert shown.button.text() == "Close"
    qtbot.waitUntil(lambda: shown.model.view().u != "", timeout=20_000)
    shown.draw()
    assert shown.value.text() in {"0.000 mm", *(f"{sign}0.00{n} mm" for sign in "+\u2212" for n in range(8))}
    shown.model.units = ShownUnits.of("in")
    shown.refresh(connected())
    assert (shown.value.text()[-3:], shown.u.text()[-3:]) == (" in", " in")
    assert len(shown.picture._outlines) == 2
    assert shown.source.isReadOnly()
    shown.grab()  # paints
    shown.button.click()
    assert shown.button.text() == "Open"
    assert not shown.picture.isVisible()


def test_a_covered_mark_is_named(panel, qtbot):
    """Cause and remedy in place of the value."""
    shown, opened = panel
    opened(Pictures(Disturbance(gain=1.7)))
    qtbot.waitUntil(lambda: "saturated" in shown.model.view().warning, timeout=20_000)
    shown.draw()
    assert shown.value.text() == "\u2013"
    assert "reduce light or exposure" in shown.warning.text()


def test_refusals_are_shown_and_change_nothing(live, panel):
    """No length; no such camera."""
    shown, _ = panel
    for source, mark, cause in (("0", "x", "'x' is not a length"), ("99", "8", "there is no camera 99")):
        shown.source.setText(source)
        shown.mark.setText(mark)
        shown.button.click()
        assert cause.casefold() in live.model.notices.current().text.casefold()
        assert shown.model.channel is None
        live.model.notices.dismiss(live.model.notices.current())


def test_a_camera_that_fails_is_closed_with_its_cause(live, panel, qtbot):
    """An unplugged cable ends the camera, not the window."""
    shown, opened = panel
    source = Pictures(error=DeviceError("the camera gives no more pictures", "check its cable"))
    source.frames = lambda: (_ for _ in ()).throw(source.error)
    opened(source)

    def failed() -> bool:
        live.model.tick()
        return shown.model.channel is None

    qtbot.waitUntil(failed, timeout=20_000)
    assert "gives no more pictures" in live.model.notices.current().text


@pytest.mark.nightly
def test_marks_are_saved_to_print(panel, tmp_path):
    """Of the size that is typed."""
    shown, _ = panel
    shown.model.save_marks(tmp_path / "marks.pdf", "8")
    assert (tmp_path / "marks.pdf").read_bytes().startswith(b"%PDF")
    with pytest.raises(RequestError, match="'x' is not a length"):
        shown.model.save_marks(tmp_path / "marks.pdf", "x")


def test_virtual_camera_is_chosen_in_the_window(panel, monkeypatch):
    """There was no way to practise it; it is offered with a virtual board alone, and keeps the camera used last."""
    shown, _ = panel
    model, seen = shown.model, []
    shown.refresh(None)
    assert not shown.virtual.isVisible()
    model.virtual = lambda: "http://127.0.0.1:8090/"
    shown.refresh(None)
    assert shown.virtual.isVisible()
    monkeypatch.setattr(choice, "open_source", lambda name, allow_remote: seen.append(name) or Pictures())
    before = model.source
    shown.virtual.click()
    assert (seen, model.source) == (["http://127.0.0.1:8090/"], before)
    assert (shown.virtual.isVisible(), shown.button.text()) == (False, "Close")
