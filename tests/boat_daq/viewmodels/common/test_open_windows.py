"""This window among others: VENT ALL vents this session at once, and what the others answered is reported."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from boat_daq.engine.session.shared_vent import SharedVent, VentAnswer
from boat_daq.viewmodels.common import open_windows
from boat_daq.viewmodels.common.notices import Notices, Severity
from boat_daq.viewmodels.common.open_windows import OpenWindows
from boat_daq.viewmodels.common.preferences import Preferences
from tests.boat_daq.viewmodels.helpers import until


@pytest.fixture
def windows(tmp_path, monkeypatch):
    """One window that has joined; the session's vents are in `vented`."""
    monkeypatch.setattr(open_windows, "LOOK_S", 0.0)
    vented = []
    made = OpenWindows(SimpleNamespace(vent=lambda: vented.append("SA1")), lambda: "SA1", Notices(), tmp_path)
    made.vented = vented
    made.join()
    yield made
    made.close()


def test_other_windows_are_seen_and_vented(windows, tmp_path):
    """Another one is named once it has joined; the key vents both."""
    other = SharedVent(lambda: windows.vented.append("SA2"), lambda: "SA2", tmp_path)
    until(lambda: windows.follow() or windows.others == ["SA2"])
    windows.vent_all()
    assert windows.vented[0] == "SA1"  # at once, before any answer
    until(lambda: windows.follow() or windows._notices.history)
    assert "SA2" in windows._notices.history[-1].sentences
    assert sorted(windows.vented) == ["SA1", "SA2"]
    other.close()
    until(lambda: windows.follow() or windows.others == [])


def test_a_vent_that_is_not_confirmed_is_a_fault(windows):
    """The operator is told which session, and what to do."""
    windows._report([VentAnswer("SA2", vented=False)])
    notice = windows._notices.history[-1]
    assert notice.severity is Severity.FAULT
    assert "SA2 did not confirm the vent" in notice.sentences


def test_windows_keep_each_others_preferences(tmp_path):
    """Two windows share the file: neither removes what the other has set, and neither takes its values over."""
    one, two = Preferences(tmp_path), Preferences(tmp_path)
    one.set("unit", "SA1")
    two.set("port", "/dev/ttyACM1")
    two.set("unit", "SA2")
    one.set("page", "Runs")
    assert one.get("unit") == "SA1"
    again = Preferences(tmp_path)
    assert [again.get(key) for key in ("unit", "port", "page")] == ["SA2", "/dev/ttyACM1", "Runs"]
    one.change("layouts", lambda kept: {**(kept or {}), "SA1": 1})
    two.change("layouts", lambda kept: {**(kept or {}), "SA2": 2})
    assert Preferences(tmp_path).get("layouts") == {"SA1": 1, "SA2": 2}
