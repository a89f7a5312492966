"""The window's thread is blocked for seconds: reader and writer continue."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from boat_daq.engine.recording.summary import summarise
from tests.faults.drill import drill, needs_pty

pytestmark = needs_pty


def compute(seconds: float) -> int:
    """Hold the interpreter for that time, as a page that draws too much does."""
    end, n = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        n += sum(range(1000))
    return n


@pytest.mark.parametrize(
    "seconds",
    [
        pytest.param(
            1.0,
            marks=pytest.mark.fault(27, how="the main thread computes for 1 s, on a board at 20x over a pty", times=1),
        ),
        pytest.param(
            10.0,
            marks=[
                pytest.mark.nightly,
                pytest.mark.fault(27, how="the main thread computes for 10 s, on a board at 20x over a pty", times=1),
            ],
        ),
    ],
)
def test_reader_and_writer_continue_while_interpreter_is_busy(tmp_path: Path, seconds: float) -> None:
    """No sample is lost, and those of the blocked time are in the file."""
    with drill(tmp_path, speed=20.0, own_process=True) as found:
        found.reached(lambda s: s.recorded_s > 2)
        before = found.session.snapshot().recorded_s
        assert compute(seconds) > 0
        gained = found.session.snapshot().recorded_s - before
        found.close()
    summary = summarise(found.path)
    assert gained > 5 * seconds
    assert (summary.gaps, summary.lost_samples, summary.crc_errors) == (0, 0, 0)


@pytest.mark.nightly
@pytest.mark.fault(27, how="the window's own thread blocked for 10 s, on a board at 20x over a pty", times=1)
def test_blocked_window_loses_no_sample(tmp_path: Path, qtbot: object) -> None:
    """Blocked for 10 s, the window draws again afterwards and no sample is lost."""
    from boat_daq.gui.app import make_application, window_on
    from boat_daq.viewmodels.app_model import AppModel

    make_application()
    with drill(tmp_path, speed=20.0, own_process=True) as found:
        model = AppModel(found.session, tmp_path / "config", tmp_path / "recordings", found.session.units)
        model.shadow.prepare = lambda: None  # type: ignore[method-assign]
        window = window_on(model)
        window.show()
        qtbot.wait(1000)  # type: ignore[attr-defined]
        before = found.session.snapshot().recorded_s
        compute(10.0)
        assert found.session.snapshot().recorded_s - before > 50.0
        qtbot.wait(1000)  # type: ignore[attr-defined]
        found.close()
        window.close()
        window.deleteLater()
    summary = summarise(found.path)
    assert (summary.gaps, summary.lost_samples, summary.crc_errors) == (0, 0, 0)
