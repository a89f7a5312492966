"""The badge of the recording: what it shows of file, disk and run."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from boat_daq.engine.settings import Settings
from boat_daq.engine.snapshot import HealthSnapshot, LinkState, SessionState
from boat_daq.viewmodels.live import recording_status
from boat_daq.viewmodels.live.recording_status import RECORD, STOP, RecordingStatus
from protocol.link.events import LinkStatistics
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, services_in


def status_of(tmp_path, now=lambda: 0.0, **changes):
    """A status of a session that shows these changes."""
    session = RecordedSession(connected())
    session.change(**changes)
    run = SimpleNamespace(
        services=services_in(tmp_path), snapshot=session.shown, session=SimpleNamespace(settings=Settings())
    )
    return RecordingStatus(run, now), session.shown


def test_size_is_that_of_the_file_and_its_log(tmp_path, monkeypatch):
    """Looked at once a second, not for every frame."""
    monkeypatch.setattr(recording_status.shutil, "disk_usage", lambda _: SimpleNamespace(free=41.6e9))
    path, clock = tmp_path / "a.boat", [0.0]
    path.write_bytes(bytes(1_500_000))
    path.with_name("a.boat-wal").write_bytes(bytes(2_000_000))
    status, shown = status_of(tmp_path, lambda: clock[0], recording=path, recorded_s=754.0)
    text = status.text(shown)
    assert (text.text, text.short, text.state) == ("● REC 12:34   3.5 MB   41.6 GB free", "● REC 12:34", "")
    lost = status.text(replace(shown, link=LinkState.LOST))  # it stood still, as if it went on
    assert (lost.short, lost.least, lost.state) == ("▲ REC 12:34  no data", "▲ REC 12:34", "warning")
    assert text.tip.startswith(f"a.boat\nin {tmp_path} (click to open it)\n3.5 MB, 41.6 GB free, enough for 2489")
    path.write_bytes(bytes(3_500_000))
    assert "3.5 MB" in status.text(shown).text
    clock[0] = 1.0
    assert "5.5 MB" in status.text(shown).text
    path.unlink()
    path.with_name("a.boat-wal").unlink()
    clock[0] = 2.0
    assert "0.0 MB" in status.text(shown).text


def test_little_space_is_marked_even_when_short(tmp_path, monkeypatch):
    """Less than a gigabyte is a warning, and is not left out in a narrow window."""
    monkeypatch.setattr(recording_status.shutil, "disk_usage", lambda _: SimpleNamespace(free=0.3e9))
    status, shown = status_of(tmp_path, recording=tmp_path / "a.boat", recorded_s=1.0)
    assert (status.text(shown).state, status.text(shown).short) == ("warning", "● REC 0:01   300 MB free")


def test_cost_of_a_crash_is_shown_and_late_samples_are_a_warning(tmp_path, monkeypatch):
    """The tooltip has the cost; samples that wait for more than 0.5 s are a warning, whose delay the header shows."""
    monkeypatch.setattr(recording_status.shutil, "disk_usage", lambda _: SimpleNamespace(free=41.6e9))
    for lag_ms, at_risk_ms, state in ((40.0, 131.0, ""), (2700.0, 2700.0, "warning")):
        health = HealthSnapshot(LinkStatistics(), 100.0, 100.0, 0.0, lag_ms, None, None, None, (), at_risk_ms)
        status, shown = status_of(tmp_path, recording=tmp_path / "a.boat", recorded_s=1.0, health=health)
        text = status.text(shown)
        assert text.state == state
        assert text.tip.endswith(f"a crash now would lose at most {at_risk_ms / 1e3:.2f} s")


def test_a_disk_that_takes_nothing_is_not_shown_as_recording(tmp_path, monkeypatch):
    """On a full disk the badge counted on, amber: REC 0:43, with a delay of 23 s beside it."""
    monkeypatch.setattr(recording_status.shutil, "disk_usage", lambda _: SimpleNamespace(free=0.0))
    health = HealthSnapshot(LinkStatistics(), 100.0, 100.0, 0.0, 23_495.0, None, None, None, (), 23_495.0)
    status, shown = status_of(tmp_path, recording=tmp_path / "a.boat", recorded_s=43.0, health=health)
    text = status.text(shown)
    assert (text.text, text.short, text.state) == ("\u25a0 NOT SAVING 0:23", "\u25a0 NOT SAVING 0:23", "fault")
    assert "REC" not in text.text


@pytest.mark.parametrize(
    ("changes", "button"),
    [({}, RECORD), ({"link": LinkState.CLOSED}, ""), ({"recording": True}, STOP),
     ({"recording": True, "state": SessionState.RUNNING}, "")],
)  # fmt: skip
def test_button_is_offered_where_it_acts(tmp_path, changes, button):
    """A board can be recorded without a plan; the recording of a run ends with the run."""
    changes = changes | ({"recording": tmp_path / "sub" / "a.boat"} if "recording" in changes else {})
    status, shown = status_of(tmp_path, **changes)
    assert status.text(shown).button == button
    assert status.folder == (tmp_path / "sub" if "recording" in changes else tmp_path / "recordings")
