"""A staircase of known loop: y = 1650 + 6 p -+ 6 (1 - z^2), z = -1..1 over 0..50 kPa.

Full-scale output 300 mV, loop 4.00 % of it (3.84 % between levels of 10 kPa), noise 0.3 mV and 0.02 kPa rms.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis import analyse
from analysis.data.csv_import import import_csv
from analysis.data.recording import Recording
from protocol.base.arrays import FloatArray

FSO_MV, HYSTERESIS, NOISE_MV = 300.0, 3.84, 0.30
HEAD = "time_s,pressure_kpa,s1_mv"


@dataclass(frozen=True)
class Run:
    """Times, pressures and signals of a run [n]."""

    time_s: FloatArray
    pressure_kpa: FloatArray
    signal_mv: FloatArray

    def lines(self, form: str = "{:.3f},{:.4f},{:.4f}", head: str = HEAD, step: int = 1) -> list[str]:
        """Return a table of every `step`th sample."""
        rows = zip(self.time_s[::step], self.pressure_kpa[::step], self.signal_mv[::step], strict=True)
        return [*([head] if head else []), *(form.format(*row) for row in rows)]


def signal(pressure_kpa: FloatArray, way: FloatArray) -> FloatArray:
    """Return the signal without noise; `way` is 1 up and -1 down."""
    z = 2 * pressure_kpa / 50 - 1
    return 1650 + 6 * pressure_kpa - 6 * way * (1 - z * z)


def staircase(rate_hz: float = 50.0, hold_s: float = 2.0, ramp_kpa_s: float = 20.0, cycles: int = 4) -> Run:
    """Return cycles over 0, 10 .. 50 kPa and back."""
    rng = np.random.default_rng(3)
    levels = [(0.0, 1.0)]
    for _ in range(cycles):
        levels += [(p, 1.0) for p in (10, 20, 30, 40, 50)] + [(p, -1.0) for p in (40, 30, 20, 10, 0)]
    pressure: list[float] = []
    way: list[float] = []
    at = 0.0
    for level, sign in levels:
        ramp = np.linspace(at, level, max(1, int(abs(level - at) / ramp_kpa_s * rate_hz)), endpoint=False)
        part = [*ramp[: None if level != at else 0], *[level] * int(hold_s * rate_hz)]
        pressure += part
        way += [sign] * len(part)
        at = level
    p = np.array(pressure)
    y = signal(p, np.array(way))
    time_s = np.arange(p.size) / rate_hz
    return Run(time_s, p + rng.normal(0, 0.02, p.size), y + rng.normal(0, 0.3, p.size))


def put(folder: Path, lines: list[str], name: str = "case.csv") -> Path:
    """Write lines into a file."""
    path = folder / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def figures(recording: Recording) -> tuple[dict[str, float], list[str]]:
    """Return the figures of the first sensor, and all that was said; equal arrays are analysed once."""
    arrays = (recording.time_s - recording.time_s[0], recording.pressure_kpa, recording.signal_mv)
    key = tuple(np.round(array, 6).tobytes() for array in arrays)
    if key not in _KNOWN:
        found = analyse(recording, mcmc=False)
        values = {name: figure.value for name, figure in found.sensors[0].figures.items()}
        _KNOWN[key] = values, [warning.sentence for warning in found.warnings]
    values, warnings = _KNOWN[key]
    meta = recording.meta
    return values, [*meta.get("import_notes", ()), *meta.get("import_issues", ()), *warnings]


_KNOWN: dict[tuple[bytes, ...], tuple[dict[str, float], list[str]]] = {}


def holds(recording: Recording, run: Run, said: str = "") -> None:
    """Check that a recording has the samples of a run, and that something is said of it."""
    n = recording.n
    assert abs(n - run.time_s.size) <= 1
    np.testing.assert_allclose(recording.time_s, run.time_s[:n] - run.time_s[0], atol=2e-3)
    np.testing.assert_allclose(recording.pressure_kpa, run.pressure_kpa[:n], atol=2e-3)
    known = np.isfinite(recording.signal_mv[:, 0])
    assert known.sum() >= n - 1
    np.testing.assert_allclose(recording.signal_mv[known, 0], run.signal_mv[:n][known], atol=6e-3)
    texts = [*recording.meta.get("import_notes", ()), *recording.meta.get("import_issues", ())]
    assert not said or any(said in text for text in texts), texts


def is_the_truth(path: Path, said: str = "", **options: Any) -> None:
    """Check that a file gives the known figures, and that something is said of it."""
    are_the_truth(import_csv(path, **options), said)


def are_the_truth(recording: Recording, said: str = "") -> None:
    """Check that a recording has the known figures, and that something is said of it."""
    values, texts = figures(recording)
    assert abs(values["fso_mv"] - FSO_MV) < 0.5
    assert abs(values["system_hysteresis_percent_fso"] - HYSTERESIS) < 0.03
    assert abs(values["noise_mv"] - NOISE_MV) < 0.02
    assert not said or any(said in text for text in texts), texts


Lines = Callable[[Run], list[str]]
