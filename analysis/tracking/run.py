"""A camera's record laid over its run: its delay removed, elongations counted from rest.

Rest is the second before the first pressure; without a frame there, elongations count from where the tracker began, and
a warning says so. A tracker that began anew, as after a break of the run, has its own rest, before the next pressure;
without one its frames give no elongation. What the run's figures take from the record is in `analysis.figures.camera`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.data.camera_record import CameraRecord
from analysis.data.recording import Recording
from analysis.tracking.clock import Delay, find_delay, find_place
from analysis.tracking.lens import Picture
from analysis.tracking.marks import PictureFault
from analysis.tracking.tracker import MarkTracker
from analysis.warning import Warning, WarningCode
from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError

_REST_S = 1.5
DRIVEN_KPA = 1.0
LONGEST_DELAY_S = 3.0
LARGEST_U_S = 0.05  # of a delay that is used
UNSTEADY_U_S = 0.012  # a third of a frame; more where a busy computer stamps frames late
_LEAST_R2 = 0.8  # of elongation over pressure: hysteresis and creep leave more
NO_REST = "no_rest"  # fault of a frame whose tracker did not see the unit at rest
INDEPENDENT_MM = 0.0005  # least standard uncertainty of a frame's own


@dataclass(frozen=True, slots=True)
class Filmed:
    """A recording with its camera's record on its clock."""

    recording: Recording  # whose `camera` is placed; elongations from rest
    delay: Delay | None  # None where no ramp showed it: then the frames' own times are used
    rest_mm: float  # elongation that was subtracted; NaN where rest was not seen
    u_scale: float  # relative standard uncertainty of the scale
    warnings: tuple[Warning, ...]  # what a reader must know

    @property
    def record(self) -> CameraRecord:
        assert self.recording.camera is not None
        return self.recording.camera


def track(pictures: Iterable[tuple[Picture, float]], tracker: MarkTracker) -> CameraRecord:
    """Return the elongation in pictures with their times, in order."""
    seen = [tracker.read_checked(picture, time_s) for picture, time_s in pictures]
    columns = np.array([(t.time_s, t.elongation_mm, t.u_mm) for t in seen], float).reshape(-1, 3)
    faults = np.array([t.fault or "" for t in seen], np.str_)
    intervals = np.diff(columns[:, 0])
    typical = float(np.median(intervals)) if intervals.size else 1.0
    missing = np.maximum(np.rint(intervals / typical) - 1, 0)[intervals > 1.6 * typical] if typical > 0 else np.zeros(0)
    return CameraRecord(columns[:, 0], columns[:, 1], columns[:, 2], faults, int(missing.sum()))


def with_video(recording: Recording, record: CameraRecord, about: Mapping[str, Any]) -> Recording:
    """Return the recording with the record of a video taken elsewhere, whose beginning is not known."""
    usable = recording.pressure_usable
    begin_s = find_place(record.time_s, record.elongation_mm, recording.time_s[usable], recording.pressure_kpa[usable])
    placed = replace(record, time_s=record.time_s + begin_s)
    return replace(recording, camera=placed, meta={**recording.meta, "camera": dict(about)})


def filmed(recording: Recording) -> Filmed:
    """Return a recording with its camera's record placed."""
    record = recording.camera
    assert record is not None
    warnings = []
    delay = _delay(recording, record)
    if delay is not None and delay.u_s > LARGEST_U_S:
        delay = None
    if delay is None:
        text = "no ramp shows the delay of the camera: its frames are used at the times of their arrival"
        warnings.append(Warning(WarningCode.CAMERA_DELAY, "", text))
    else:
        if delay.u_s > UNSTEADY_U_S:
            text = (
                f"the camera's delay is uncertain by {1e3 * delay.u_s:.0f} ms: holds are read, ramps are not reliable"
            )
            warnings.append(Warning(WarningCode.CAMERA_DELAY, "", text))
        record = record.shifted(delay.delay_s, delay.certain_drift, delay.about_s)
    if not _follows_pressure(recording, record):
        text = (
            "the elongation of the camera does not follow the pressure: it may be of another run, or of another thing"
        )
        warnings.append(Warning(WarningCode.CAMERA_CONTRADICTS, "", text))
    record, rest_mm, unknown = _from_rest(recording, record)
    warnings += [Warning(WarningCode.CAMERA_REST, "", text) for text in unknown]
    if faults := record.faults:
        without = sum(faults.values())
        listed = ", ".join(f"{code.replace('_', ' ')} {n}" for code, n in faults.items())
        text = f"{without} of {record.time_s.size} frames of the camera give no elongation: {listed}"
        warnings.append(Warning(WarningCode.CAMERA_NO_VALUE, "", text))
    u_scale = float(recording.meta.get("camera", {}).get("u_scale") or 0.0)
    return Filmed(replace(recording, camera=record), delay, rest_mm, u_scale, tuple(warnings))


def with_camera_placed(recording: Recording) -> Recording:
    """Return a recording whose camera, if it has one, is on its clock and counts from rest."""
    return filmed(recording).recording if recording.camera is not None else recording


def plateau_means(record: CameraRecord, windows_s: FloatArray, u_scale: float) -> tuple[FloatArray, FloatArray]:
    """Return mean elongation and its standard uncertainty without that of the scale, mm, in windows of time.

    `windows_s`: [plateaus, 2] begin and end; NaN and u of NaN where fewer than three frames give a value.
    """
    t, x = record.time_s[record.valid], record.elongation_mm[record.valid]
    own = np.sqrt(np.maximum(record.u_mm[record.valid] ** 2 - (u_scale * x) ** 2, INDEPENDENT_MM**2))
    mean, u = np.full(len(windows_s), np.nan), np.full(len(windows_s), np.nan)
    for i, (first, last) in enumerate(np.searchsorted(t, windows_s)):
        if last - first >= 3:
            mean[i] = x[first:last].mean()
            u[i] = math.hypot(x[first:last].std(ddof=1) / math.sqrt(last - first), np.median(own[first:last]))
    return mean, u


def _delay(recording: Recording, record: CameraRecord) -> Delay | None:
    """Return the delay against the sensors' signals, else against the pressure."""
    signals = np.where(recording.usable, recording.signal_mv, np.nan)
    alive = np.isfinite(signals).mean(axis=0) > 0.5
    pressure = np.where(recording.pressure_usable, recording.pressure_kpa, np.nan)[:, None]
    expected_s = _coarse_delay(recording, record)
    for columns in (signals[:, alive], pressure):
        if columns.shape[1]:
            delay = find_delay(record.time_s, record.elongation_mm, recording.time_s, columns, expected_s)
            if delay is not None:
                return delay
    return None


def _coarse_delay(recording: Recording, record: CameraRecord) -> float:
    """Return the delay to about 0.1 s by the cross-correlation with the pressure; 0 where it shows none."""
    usable = recording.pressure_usable
    if usable.sum() < 2 or record.valid.sum() < 2:
        return 0.0
    pressure = recording.time_s[usable], recording.pressure_kpa[usable]
    try:
        delay_s = -find_place(record.time_s, record.elongation_mm, *pressure)
    except DataError:
        return 0.0
    return delay_s if abs(delay_s) <= LONGEST_DELAY_S else 0.0


def _follows_pressure(recording: Recording, record: CameraRecord) -> bool:
    """Return whether the elongation is that of an actuator at this pressure; True where neither changes."""
    usable = recording.pressure_usable
    valid = record.valid & (record.time_s >= recording.time_s[0]) & (record.time_s <= recording.time_s[-1])
    if valid.sum() < 30 or usable.sum() < 30:
        return True
    x = record.elongation_mm[valid]
    p = np.interp(record.time_s[valid], recording.time_s[usable], recording.pressure_kpa[usable])
    if np.ptp(p) < 10.0 * DRIVEN_KPA:
        return True
    slope = np.polynomial.Polynomial.fit(p, x, 3)
    left = x - slope(p)
    rises = float(slope(p.max()) - slope(p.min())) > 0
    return rises and float(left.var()) <= (1.0 - _LEAST_R2) * float(x.var())


def _from_rest(recording: Recording, record: CameraRecord) -> tuple[CameraRecord, float, list[str]]:
    """Return the record with elongations from rest, the first rest, and what is not known of the rests."""
    edges = [0]
    for at in np.flatnonzero(record.fault == PictureFault.LEARNING).tolist():
        if record.valid[edges[-1] : at].any():  # a tracker learns before its first value only
            edges.append(at)
    edges.append(record.time_s.size)
    rest_mm = _rest(recording, record, 0.0)
    warnings = []
    if not math.isfinite(rest_mm):
        warnings.append(
            "the camera did not see the unit at rest before the run: elongations count from its first frames"
        )
    x, fault = record.elongation_mm - (rest_mm if math.isfinite(rest_mm) else 0.0), record.fault.astype(object)
    for first, last in itertools.pairwise(edges[1:]):
        rows, at_s = slice(first, last), float(record.time_s[first])
        again_mm = _rest(recording, record, at_s)
        if math.isfinite(again_mm):
            x[rows] = record.elongation_mm[rows] - again_mm
            text = f"the camera began anew at {at_s:.0f} s: elongations after it count from the rest position then"
        else:
            fault[rows] = np.where(np.isfinite(x[rows]), NO_REST, fault[rows])
            x[rows] = np.nan
            text = f"the camera began anew at {at_s:.0f} s and did not see the unit at rest: its later frames are void"
        warnings.append(text)
    return replace(record, elongation_mm=x, fault=fault.astype(np.str_)), rest_mm, warnings


def _rest(recording: Recording, record: CameraRecord, since_s: float) -> float:
    """Return the mean elongation before the first pressure from a time on, mm; NaN where no frame shows it."""
    started = recording.steps["started_s"].to_numpy(dtype=float)
    pressure = np.abs(np.where(recording.pressure_usable, recording.pressure_kpa, 0.0))
    driven = np.flatnonzero((pressure > DRIVEN_KPA) & (recording.time_s >= since_s))
    if not since_s and started.size and np.isfinite(started[0]):
        end_s = float(started[0])
    elif driven.size:
        end_s = float(recording.time_s[driven[0]]) - 0.2
    else:
        return math.nan
    begin_s = max(end_s - _REST_S, since_s or -math.inf)
    inside = record.valid & (record.time_s > begin_s) & (record.time_s < end_s)
    return float(record.elongation_mm[inside].mean()) if inside.sum() >= 3 else math.nan
