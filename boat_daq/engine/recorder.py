"""The recorder: a sink that keeps everything, on its own thread, and loses nothing it has acknowledged."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from boat_daq.engine.blocks import Block
from boat_daq.errors import StorageError


@dataclass(frozen=True, slots=True)
class Acknowledged:
    """What is safely in the file: survives a kill of this process at any later instant."""

    chunks: int = 0
    bytes: int = 0
    samples: int = 0


class Recorder:
    """Writes one recording; is itself the sink (`acquisition.add_sink(recorder)`).

    Parameters
    ----------
    path : file to create; its name ends in .boat. An existing file is refused.
    meta : values for `session` (keys of `protocol.recording.SESSION_KEYS`; uuid, status, times, version and the
        sample type are filled in here). `n_sensors` and `sample_kind` must be there.
    health : called once a second on the writer's thread for a row of `health` (see `link_health.LinkHealth.snapshot`).
    on_error : called once, on the writer's thread, when the disk fails; the recorder goes on trying.

    Raises
    ------
    StorageError : the file exists, or its folder cannot be written.
    """

    def __init__(
        self,
        path: Path,
        meta: Mapping[str, Any],
        *,
        health: Callable[[], Any] | None = None,
        on_error: Callable[[StorageError], None] | None = None,
    ) -> None:
        raise NotImplementedError

    def __call__(self, block: Block) -> None:
        """Take a block; returns at once."""

    @property
    def acknowledged(self) -> Acknowledged:
        """Counters of what is committed."""
        raise NotImplementedError

    @property
    def lag_ms(self) -> float:
        """Age of the oldest thing not yet committed."""
        raise NotImplementedError

    @property
    def segment(self) -> int:
        """Number of the current segment, 0 before the first."""
        raise NotImplementedError

    def new_segment(self, reason: str, *, paused: bool = False) -> int:
        """Begin a segment by hand ("paused", "resumed", "reconnected") and return its number.

        START and a restarted board begin one by themselves.
        """
        raise NotImplementedError

    def event(self, source: str, kind: str, *, value: float | None = None, text: str = "", time_us: int | None = None) -> None:
        """Keep an event; source is board, host, user or sequencer."""

    def step_started(
        self, number: int, cycle: int, branch: str, *, target_kpa: float, ramp_kpa_per_s: float, started_us: int
    ) -> int:
        """Keep the start of a sequencer's step and return its id."""
        raise NotImplementedError

    def step_updated(
        self,
        step_id: int,
        *,
        arrived_us: int | None = None,
        settled_us: int | None = None,
        ended_us: int | None = None,
        status: str | None = None,
        detail: Mapping[str, Any] | None = None,
    ) -> None:
        """Fill in what has become known of a step; what is None stays as it is."""

    def reading(
        self, step_id: int, elongation_mm: float | None, *, resolution_mm: float | None = None, source: str, reader: str = "", note: str = ""
    ) -> None:
        """Keep a reading of elongation; a later one for the same step corrects it and both stay."""

    def result(self, kind: str, *, parameters: Mapping[str, Any], content: Mapping[str, Any], seed: int | None = None) -> None:
        """Keep the result of an analysis."""

    def update_meta(self, **values: Any) -> None:
        """Set keys of `session`."""

    def flush(self, timeout_s: float = 5.0) -> bool:
        """Wait until all that was handed over so far is committed; False when it is not in time."""
        raise NotImplementedError

    def close(self, reason: str) -> Path:
        """Commit the rest, close into one file, check it, and return its path. May be called twice.

        Raises
        ------
        StorageError : the disk does not take the rest; what is written stays and `recover` closes it later.
        """
        raise NotImplementedError


def append_reading(path: Path, step_id: int, elongation_mm: float | None, **fields: Any) -> None:
    """Add a reading to a closed recording (fields as `Recorder.reading`)."""


def append_result(path: Path, kind: str, **fields: Any) -> None:
    """Add a result to a closed recording (fields as `Recorder.result`)."""


def check_space(path: Path, *, rate_hz: float, duration_s: float, n_sensors: int) -> float:
    """Return how many times over the plan's recording fits on the disk of `path`.

    Raises
    ------
    StorageError : it does not fit, or the folder cannot be written.
    """
    raise NotImplementedError
