"""Boards whose clock wraps or that restart, the end of a recording of a stated duration, and torn last lines."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from analysis import load_recording
from analysis.data.csv_import import import_csv
from boat_daq.engine.snapshot import LinkState
from boat_daq.workflows import run_session
from protocol.link.events import BoardRestarted, Samples
from protocol.text.connection import TextConnection
from protocol.text.profile import load_profile
from protocol.text.proposal import propose
from tests.boat_daq.commands.calls import program
from tests.field.truth import Run

PROFILE = """
name = "board"
kind = "lines"
[device]
n_sensors = 1
rate_hz = 100
[lines]
fields = [
    {{ name = "time", unit = "{}" }}, {{ name = "pressure", unit = "kPa" }}, {{ name = "s1_signal", unit = "mV" }},
]
"""


def sent(unit: str, times: list[float]) -> tuple[list[float], bool]:
    """Return the times in which the lines of a board arrive, us, and whether it restarted; state is kept between."""
    profile = load_profile(PROFILE.format(unit))
    link, got, restarted = TextConnection(profile), [], False
    for at in [times[0], *times]:  # the first line may be torn
        state = link.decoder_state()
        link = TextConnection(profile, decoder_state=state)
        for event in link.receive(f"{at:.10g},1.5,1650.0\r\n".encode(), 0):
            got += event.array["time_us"].tolist() if isinstance(event, Samples) else []
            restarted |= isinstance(event, BoardRestarted)
    return got, restarted


@pytest.mark.parametrize(
    ("unit", "first", "wrap", "step"),
    [
        ("us", 2**32 - 50_000, 2**32, 10_000),
        ("ms", 2**16 - 50, 2**16, 10),
        ("ms", 2**32 // 1000 - 50, 4_294_967.296, 10),
        ("s", 59.9, 60.0, 0.01),
    ],
)
def test_a_clock_that_wraps_is_no_restart(unit: str, first: float, wrap: float, step: float) -> None:
    """A board's clock goes on over the usual wraps, though its profile does not state them."""
    times = [(first + k * step) % wrap for k in range(60)]
    got, restarted = sent(unit, times)
    factor = {"us": 1.0, "ms": 1e3, "s": 1e6}[unit]
    assert not restarted
    np.testing.assert_allclose(np.diff(got), step * factor, atol=1.01 * factor if unit == "ms" else 2)


def test_a_restart_is_one(tmp_path: Path) -> None:
    """A clock that falls from anywhere else restarts."""
    _, restarted = sent("us", [*range(6_000_000, 6_500_000, 10_000), *range(0, 500_000, 10_000)])
    assert restarted


@pytest.mark.parametrize(("unit", "wrap", "stated"), [("micros", 2**32, 2**32), ("millis", 2**16, 2**16)])
def test_the_profile_proposes_the_wrap(unit: str, wrap: int, stated: int) -> None:
    """Where the text shows a wrap, it is stated; a counter of 32 bits is, too."""
    step = 10_000 if unit == "micros" else 10
    rows = [f"{(wrap - 40 * step + k * step) % wrap},{k % 9}.5,{1600 + k}" for k in range(100)]
    fields = propose("\n".join([f"{unit},pressure,s1", *rows, ""]).encode()).fields
    assert fields[0].wraps_at == stated


class Board:
    """A session whose board reports these times, one each time it is asked, the first before it records."""

    def __init__(self, reported_s: list[float]) -> None:
        self.reported, self.now_s, self.asked = reported_s, 0.0, -1

    def snapshot(self) -> SimpleNamespace:
        """Return the next state."""
        self.asked += 1
        recorded = self.reported[min(self.asked, len(self.reported) - 1)]
        return SimpleNamespace(recorded_s=recorded, link=LinkState.UP, messages=())


@pytest.mark.parametrize(
    ("reported", "ends_s"),
    [
        ([float(k) for k in range(100)], 11),
        ([*(float(k) for k in range(7)), *(float(k) for k in range(100))], 12),
        ([0.0, 1.0, 2.0, 2.0], 14),
    ],
    ids=["steady", "restarted", "silent"],
)
def test_a_recording_ends_when_its_time_is_over(monkeypatch, reported: list[float], ends_s: float) -> None:
    """After a restart the board's time is too small for ever: then this computer's decides."""
    board = Board(reported)

    def wait(_: float) -> None:
        board.now_s += 1.0
        assert board.now_s < 60

    monkeypatch.setattr(run_session, "time", SimpleNamespace(monotonic=lambda: board.now_s, sleep=wait))
    monkeypatch.setattr(run_session, "MessagePrinter", lambda notify: lambda seen: None)
    run_session._listen(board, 12.0, print, lambda name: contextlib.nullcontext(lambda done, of: None))
    assert board.now_s == ends_s


@pytest.mark.nightly
@pytest.mark.parametrize(("mode", "lasts_s", "restarts"), [("wrap", 30, False), ("restart", 9, True)])
def test_the_boards_of_the_folder_are_recorded_for_the_stated_time(
    shared_data: Path, tmp_path: Path, mode: str, lasts_s: int, *, restarts: bool
) -> None:
    """A clock that wraps after 5 s, and a restart after 4.5 s: 7 s are recorded, and a wrap is no restart."""
    folder, port = shared_data / "field_cases", tmp_path / "port"
    if not folder.is_dir():
        pytest.skip("the folder of field cases is not beside this checkout")
    with subprocess.Popen([sys.executable, str(folder / "m14_emulator.py"), mode, str(port), str(lasts_s)]) as board:
        while not port.exists():
            time.sleep(0.02)
        begun, out = time.monotonic(), tmp_path / "a.boat"
        profile = folder / "m14_profile.toml"
        done = program("record", "--port", port, "--profile", profile, "--duration", 7, "--out", out)
        took_s = time.monotonic() - begun
        board.kill()
    assert 7.0 <= took_s < 11.0
    assert ("board restarted" in done.err) is restarts
    recording = load_recording(out)
    assert (np.diff(recording.time_s) > 0).all()
    assert (len(np.unique(recording.segment)) > 1) is restarts
    assert 5.0 < recording.n / 100 < 7.5


@pytest.mark.parametrize("form", ["{:.3f},{:.4f},{:.4f}", '{:.3f},{:.4f},"{:.4f}"', "{:.3f},{:.4f},{:.0f}"])
@pytest.mark.parametrize("ending", ["\n", "\r\n", "\n# end", "\n\0\0\0", "", "\0\0", "cut 1", "cut 12"])
def test_a_last_line_without_an_end_is_left_out(tmp_path: Path, run: Run, form: str, ending: str) -> None:
    """Its last number may be cut, 12.3 of 12.34: also where it looks whole; a line with an end is kept."""
    lines = run.lines(form)[:400]
    text = "\n".join(lines)
    cut = int(ending[4:]) if ending.startswith("cut") else 0
    path = tmp_path / "cut.csv"
    path.write_text(text[:-cut] if cut else text + ending, encoding="utf-8")
    recording, torn = import_csv(path), "\n" not in ending
    assert recording.n == len(lines) - 1 - torn
    said = recording.meta.get("import_issues", [])
    assert sum("line 400, the last one, has no line end" in text for text in said) == torn
    assert "broken_rows" not in recording.meta
