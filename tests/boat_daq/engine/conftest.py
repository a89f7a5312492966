"""What the recorder's tests share: a board, a path, a recording begun."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from boat_daq.engine.recording.recorder import Recorder
from protocol.recording import RunEnd
from tests.boat_daq.engine.recording_source import Source, begin


@pytest.fixture
def source() -> Source:
    return Source()


@pytest.fixture
def path(tmp_path) -> Path:
    return tmp_path / "run.boat"


@pytest.fixture
def recorder(path, source) -> Iterator[Recorder]:
    recorder = begin(path, source)
    yield recorder
    recorder.close(RunEnd.STOPPED)
