"""A camera's tracker with its source: for a session, or for a video file."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from boat_daq.engine.camera.capture import TrackedFrame
from boat_daq.engine.camera.source import Picture, open_source, open_video
from boat_daq.engine.session.camera_channel import FAULT_TEXTS, CameraChannel
from boat_daq.engine.settings import UnitLibrary, load_settings
from protocol.base.errors import ChoiceError, RequestError
from protocol.base.toml_file import read_values

if TYPE_CHECKING:
    from analysis.data.camera_record import CameraRecord
    from analysis.data.recording import Recording
    from analysis.progress import Progress
    from analysis.tracking.lens import Lens
    from analysis.tracking.tracker import MarkTracker
    from boat_daq.engine.session.session import Session


@dataclass(frozen=True, slots=True)
class CameraChoice:
    """A camera and its marks, as the operator states them."""

    source: str  # argument of `open_source`
    mark_mm: float = 10.0  # side of the marks' black square; 0 takes the millimetre grid in the picture
    u_mark_mm: float = 0.02
    lens: Path | None = None  # file of the calibrated lens; None takes the unit's
    unit: str = ""  # name of the unit, whose lens is taken; empty for none
    video: Path | None = None  # file for the pictures of a session; None stores none

    def tracker(self) -> MarkTracker:
        from analysis.tracking.lens import lens_of, read_lens
        from analysis.tracking.tracker import MarkTracker, Optics

        if not (0 <= self.mark_mm <= 500 and 0 <= self.u_mark_mm <= 10):
            raise ChoiceError(f"marks of {self.mark_mm:g} mm are not possible", "measure the black square of a mark")
        stored = UnitLibrary().load(self.unit).lens if self.unit and self.lens is None else {}
        lens = read_lens(self.lens) if self.lens is not None else None
        if stored:
            lens = lens_of(stored, f"the lens of unit {self.unit}")
        return MarkTracker(Optics(self.mark_mm, self.u_mark_mm, lens))

    def about(self, tracker: MarkTracker) -> dict[str, Any]:
        plane = tracker.plane
        return {
            "source": self.source,
            "mark_mm": tracker.side_mm,
            "u_mark_mm": self.u_mark_mm,
            "lens": tracker.lens.as_json() if tracker.lens is not None else None,
            "u_scale": plane.u_scale if plane is not None else None,
            "mm_per_px": plane.mm_per_px if plane is not None else None,
        }


_FILE_KEYS: dict[str, tuple[type, ...]] = {
    "source": (str, int),
    "mark_mm": (int, float),
    "u_mark_mm": (int, float),
    "lens": (str,),
    "video": (str,),
}


def camera_choice(text: str, unit: str = "", mark_mm: float | None = None) -> CameraChoice:
    """Return the camera that an option names: its source, or a TOML file with it, its marks, lens and video.

    Paths in the file are relative to it; `mark_mm` replaces its value.
    """
    marks: dict[str, Any] = {} if mark_mm is None else {"mark_mm": mark_mm}
    path = Path(text)
    if path.suffix.lower() != ".toml":
        return CameraChoice(text, unit=unit, **marks)
    values = read_values(path, _FILE_KEYS, of="the camera", example="mark_mm = 8")
    for key, value in values.items():
        if not isinstance(value, _FILE_KEYS[key]) or isinstance(value, bool):
            raise RequestError(f"{path.name}: {key} = {value!r:.60} is not possible", "write it as in the documents")
    if "source" not in values:
        raise RequestError(f"{path.name} names no source", "add a line such as source = 0")
    files: dict[str, Any] = {key: path.parent / values.pop(key) for key in ("lens", "video") if key in values}
    source = str(values.pop("source"))
    beside = path.parent / source
    return CameraChoice(str(beside) if beside.is_file() else source, unit=unit, **{**values, **files, **marks})


def keep_lens(unit: str, lens: Lens) -> None:
    library = UnitLibrary()
    library.save(replace(library.load(unit), lens=lens.as_json()))


def open_channel(session: Session, choice: CameraChoice) -> CameraChannel:
    """Open a camera beside a session."""
    tracker = choice.tracker()

    def tracked(picture: Picture, time_s: float) -> TrackedFrame:
        found = tracker.read_checked(picture, time_s)
        marks = tuple(corners for corners in (found.base_px, found.tip_px) if corners is not None)
        if found.fault is not None:
            return TrackedFrame(None, None, str(found.fault), marks)
        return TrackedFrame(float(found.elongation_mm), float(found.u_mm), marks_px=marks)

    source = open_source(choice.source, allow_remote=load_settings().allow_remote)
    return CameraChannel(session, source, tracked, lambda: choice.about(tracker), video=choice.video)


def track_video(choice: CameraChoice, progress: Progress | None = None) -> tuple[CameraRecord, dict[str, Any]]:
    """Return the elongation at every frame of a video file, and what a recording keeps of the camera."""
    from analysis.tracking.run import track
    from protocol.base.errors import DataError

    tracker = choice.tracker()
    source = open_video(Path(choice.source))

    def pictures() -> Iterator[tuple[Picture, float]]:
        for number, frame in enumerate(source.frames(), 1):
            if progress is not None and number % 30 == 0:
                progress(number, max(number, source.frame_count))
            yield frame.decode(), frame.time_s

    record = track(pictures(), tracker)
    if not record.valid.any():
        raise DataError(*_no_elongation(record))
    with Path(choice.source).open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return record, choice.about(tracker) | {"source": Path(choice.source).name, "sha256": digest}


def _no_elongation(record: CameraRecord) -> tuple[str, str]:
    """Return why a video shows no elongation, by its most frequent fault, and the remedy."""
    usual = "Film the marks of base and tip, sharp and whole, for at least a second."
    if not record.faults:
        return "the video has no frames that can be read", usual
    fault = max(record.faults, key=lambda code: record.faults[code])
    why, remedy = FAULT_TEXTS.get(fault, ("it shows the marks for less than half a second", usual))
    count = f"in {record.faults[fault]} of {record.time_s.size} frames"
    return f"the video shows no elongation: {why} {count}", f"{remedy[:1].upper()}{remedy[1:].rstrip('.')}."


def film(recording: Recording, choice: CameraChoice, progress: Progress | None = None) -> Recording:
    from analysis.tracking.run import with_video

    record, about = track_video(choice, progress)
    return with_video(recording, record, about)
