"""Closing the window: during a run, without one, by a signal."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from boat_daq.engine.snapshot import SessionState
from boat_daq.gui import main_window
from boat_daq.workflows.jobs import Job


def test_first_close_does_not_end_a_run(live, monkeypatch, qtbot):
    """Ctrl+Q beside Ctrl+1 stopped a run without a prompt; pressed again at once, it quits."""
    monkeypatch.setattr(main_window, "_LEAVE_S", 0.2)
    live.model.session.change(state=SessionState.RUNNING)
    live.refresh()
    live.leave()
    assert live.isVisible()
    assert live.model.notices.current().cause == "a run is in progress"
    qtbot.waitUntil(lambda: live.model.notices.current() is None)  # it stayed until it was dismissed
    live.leave()
    live.vent()
    assert live.model.notices.current() is None  # the strip still asked beside "Stopped early, vented"
    live.leave()
    assert not live.isVisible()


def test_first_close_does_not_lose_a_file_that_is_written(live, tmp_path):
    """A window closed while a report was made left neither the file nor a message."""
    job = live.model.jobs.start("report", Job("Making the report", time.sleep, 60), lambda job: None)
    job.target = tmp_path / "r.pdf"
    live.leave()
    assert live.isVisible()
    assert live.model.notices.current().cause == "Making the report: no file is written yet"
    live.leave()
    assert not live.isVisible()


def test_without_a_run_the_window_closes_at_once(live):
    """No prompt where nothing is lost."""
    live.leave()
    assert not live.isVisible()


@pytest.mark.nightly
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_sigterm_closes_the_window(tmp_path, number):
    """SIGTERM raised KeyboardInterrupt inside a slot, where Qt lost it: the window went on."""
    home = {"HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path), "QT_QPA_PLATFORM": "offscreen"}
    command = [sys.executable, "-m", "boat_daq", "gui", "--board"]
    window = subprocess.Popen(command, cwd=tmp_path, env={**os.environ, **home})
    time.sleep(12)
    window.send_signal(number)
    assert window.wait(60) == 130
