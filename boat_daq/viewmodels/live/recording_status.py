"""The recording in progress as text: time, size and free disk space, read from the file once a second."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import monotonic

from boat_daq.engine.snapshot import LinkState, SessionSnapshot
from boat_daq.formatting import duration, size_text
from boat_daq.viewmodels.common.notices import NOT_SAVING, sentence
from boat_daq.viewmodels.live.run_model import RunModel
from protocol.base.errors import BoatDaqError

_LOOK_S = 1.0
LITTLE_SPACE = 1e9  # bytes
RECORD, STOP = "Record", "Stop"


@dataclass(frozen=True, slots=True)
class RecordingText:
    """The badge: three texts, tooltip and state; `button` records or stops, empty where neither is possible."""

    text: str = ""
    short: str = ""
    least: str = ""
    tip: str = ""
    state: str = ""
    button: str = ""


class RecordingStatus:
    def __init__(self, run: RunModel, clock: Callable[[], float] = monotonic) -> None:
        self._run, self._clock = run, clock
        self._looked: tuple[Path, float] = (Path(), float("-inf"))
        self._named = ("", float("-inf"))
        self._size = self._left = 0

    @property
    def folder(self) -> Path:
        """Return the folder of the recording in progress, else that of the next one."""
        recording = self._run.snapshot.recording
        return recording.parent if recording is not None else self._run.services.recordings

    def toggle(self) -> None:
        self._run.toggle_recording()

    def text(self, snapshot: SessionSnapshot) -> RecordingText:
        path = snapshot.recording
        if path is None:
            can = snapshot.link is LinkState.UP
            tip = f"Record without a plan, into {self.folder}\n{self._preview()}"
            return RecordingText(tip=tip.rstrip(), button=RECORD if can else "")
        self._look(path)
        no_data = snapshot.link is not LinkState.UP
        sign = "\u25b2" if no_data else "\u25cf"
        least = f"{sign} REC {duration(snapshot.recorded_s)}"
        short = f"{least}  no data" if no_data else least
        left = f"{size_text(self._left)} free"
        little = self._left < LITTLE_SPACE
        health = snapshot.health
        cost = f"\na crash now would lose at most {health.at_risk_ms / 1e3:.2f} s" if health is not None else ""
        pace = self._size / snapshot.recorded_s if snapshot.recorded_s > 0 else 0.0
        lasts = f", enough for {duration(self._left / pace)} at this rate" if pace else ""
        tip = f"{path.name}\nin {path.parent} (click to open it)\n{size_text(self._size)}, {left}{lasts}{cost}"
        button = "" if snapshot.under_way else STOP
        text = "   ".join((short, size_text(self._size), left))
        lag_ms = health.lag_ms if health is not None else 0.0
        if snapshot.saves_nothing:
            waits = f" {duration(lag_ms / 1e3)}" if lag_ms > _LOOK_S * 1e3 else ""
            text = NOT_SAVING + waits
            tip = f"{sentence(snapshot.not_saving or 'the disk takes no data; they wait in memory')}\n{tip}"
            return RecordingText(text, text, NOT_SAVING, tip, "fault", button)
        wrong = little or no_data or (health is not None and health.late)
        state = "warning" if wrong else ""
        return RecordingText(text, f"{short}   {left}" if little else short, least, tip, state, button)

    def _preview(self) -> str:
        """Return the name that a recording begun now would have, where the settings have a template of it."""
        if not self._run.session.settings.file_name:
            return ""
        if self._clock() - self._named[1] >= _LOOK_S:
            try:
                name = self._run.next_recording().name
            except BoatDaqError as error:
                name = error.cause
            self._named = (name, self._clock())
        return self._named[0]

    def _look(self, path: Path) -> None:
        before, at_s = self._looked
        if path == before and self._clock() - at_s < _LOOK_S:
            return
        self._looked = (path, self._clock())
        files = (path, path.with_name(f"{path.name}-wal"))
        try:
            self._size = sum(file.stat().st_size for file in files if file.exists())
            self._left = shutil.disk_usage(path.parent).free
        except OSError:  # the recorder reports a disk that fails
            self._size = self._left = 0
