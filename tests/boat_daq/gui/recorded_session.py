"""A session for display only: one recorded snapshot and a filled ring, to look at a page without a board."""

from __future__ import annotations

import copy
import dataclasses
import functools
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from boat_daq.engine.display.ring_buffer import RingBuffer
from boat_daq.engine.plan import StepMark
from boat_daq.engine.settings import Settings
from boat_daq.engine.snapshot import LastSample, Limits, LinkState, Reading, SessionSnapshot, SessionState
from boat_daq.viewmodels.common.notices import Notices
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.common.services import Services, UndoHistory
from protocol.recording import BoardState, ExtraChannel, SampleFlag, sample_dtype

if TYPE_CHECKING:
    from boat_daq.gui.main_window import MainWindow

RATE_HZ = 100


def filled_ring(
    seconds: float,
    *,
    seed: int = 1,
    sensors: int = 2,
    channels: tuple[ExtraChannel, ...] = (),
) -> RingBuffer:
    """A ring with a triangle of pressure and signals that follow it, with noise; sensors 3 and 4 as 1 and 2.

    The first of `channels` rises from 20 by 3 in the time, others have no value.
    """
    return copy.deepcopy(_ring(seconds, seed, sensors, channels))


@functools.cache
def _ring(seconds: float, seed: int, sensors: int, channels: tuple[ExtraChannel, ...]) -> RingBuffer:
    ring = RingBuffer(sensors, mv_per_count=1.0, others=channels)
    ring.target_kpa = 30.0
    samples = _samples(seconds, seed, sensors)
    if channels:
        wider = np.zeros(len(samples), sample_dtype(sensors, "signal", len(channels)))
        for name in samples.dtype.names or ():
            wider[name] = samples[name]
        wider["channel"] = np.nan
        wider["channel"][:, 0] = np.linspace(20.0, 23.0, len(samples))
        samples = wider
    ring.append(samples)
    return ring


@functools.cache
def _samples(seconds: float, seed: int, sensors: int) -> NDArray[np.void]:
    n = round(seconds * RATE_HZ)
    generator = np.random.default_rng(seed)
    time_s = np.arange(n) / RATE_HZ
    samples = np.zeros(n, sample_dtype(sensors, "signal"))
    pressure = 50 - 90 * np.abs((time_s / 18) % 2 - 1)
    x = pressure * 0.072
    samples["time_us"] = np.round(time_s * 1e6)
    samples["host_ns"] = np.round(time_s * 1e9)
    samples["index"] = np.arange(n)
    samples["pressure_pa"] = 1000 * pressure
    first = 1652 + 46.4 * x - 2.7 * x**2 + generator.normal(0, 1.5, n)
    second = 1624 + 33.4 * x - 2.3 * x**2 + generator.normal(0, 1.0, n)
    samples["signal_mv"] = np.column_stack([(first, second)[i % 2] for i in range(sensors)])
    return samples


class RecordedSession:
    """Shows `shown` and `ring`; records the commands it receives."""

    def __init__(self, shown: SessionSnapshot, ring: RingBuffer | None = None) -> None:
        self.calls: list[str] = []
        self.shown, self.live = shown, SimpleNamespace(ring=ring)
        self.settings = Settings()
        self.kept: list[Reading] = []
        self.marks: tuple[StepMark, ...] = ()

    def snapshot(self) -> SessionSnapshot:
        return self.shown

    def steps(self) -> tuple[StepMark, ...]:
        return self.marks

    steps_on_screen = steps

    def readings(self) -> tuple[Reading, ...]:
        return tuple(self.kept)

    def add_reading(self, step_id: int, elongation_mm: float | None, source: str, **extra: Any) -> Reading:
        reading = Reading(step_id, elongation_mm, extra.get("resolution_mm", 0.5), source, "2026-01-01T00:00:00+00:00")
        self.kept.append(reading)
        return reading

    def change(self, **fields: Any) -> None:
        """Show another snapshot from now on."""
        self.shown = dataclasses.replace(self.shown, **fields)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return lambda *args, **kwargs: self.calls.append(name)


def window_on(session: RecordedSession, folder: Path) -> MainWindow:
    """A window on `session`; what it keeps lies in `folder`."""
    from boat_daq.engine.settings import UnitLibrary
    from boat_daq.gui import app
    from boat_daq.viewmodels.app_model import AppModel

    model = AppModel(session, folder / "config", folder / "recordings", UnitLibrary(folder / "units"))
    model.shadow.prepare = lambda: None  # a helper process has no place in these tests
    return app.window_on(model)


def services_in(folder: Path) -> Services:
    """The services of a window that keeps its things in `folder`."""
    return Services(Notices(), Preferences(folder / "config"), UndoHistory(), folder / "recordings")


def idle() -> SessionSnapshot:
    """Nothing connected."""
    return SessionSnapshot(SessionState.IDLE, LinkState.CLOSED)


def connected() -> SessionSnapshot:
    """A simulated board that streams."""
    last = LastSample(120.0, 30.0, 30.0, (1702.4, 1660.1), BoardState.HOLDING, SampleFlag(0))
    limits = Limits(-40.0, 50.0, "plan", "plan")
    return SessionSnapshot(
        SessionState.IDLE,
        LinkState.UP,
        port="/dev/pts/7",
        simulated=True,
        can_command=True,
        last=last,
        limits=limits,
        unit="SA1",
    )
