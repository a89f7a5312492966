"""Files made from recordings: samples, calibrations, reports; and recordings made from tables and captured text."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from analysis.fidelity import Level
from analysis.progress import Progress, part_of
from boat_daq.workflows.calibration_in_force import chosen_curve, exported_elongation, stated_contributions
from boat_daq.workflows.run_analysis import analysed_run
from protocol.base.errors import FileError
from protocol.base.regular_file import read_regular
from protocol.base.units import STORED_UNITS, ShownUnits

if TYPE_CHECKING:
    import numpy as np

    from analysis.data.recording import Recording
    from protocol.text.profile import TextProfile

WRITING = 2  # duration of setting a report, in analyses of a run
CAPTURE_MAX_BYTES = 1 << 30
_MONITOR_STAMP = re.compile(rb"^\[?\d{1,2}:\d{2}:\d{2}[.:]\d{3}\]?\s*(?:->|>|:)?\s+", re.MULTILINE)


def export_run(path: Path, target: Path, *, progress: Progress | None = None) -> str:
    """Write the samples in the form of the suffix of `target`; return why it has no elongation, else empty."""
    from analysis.data.export import SUFFIXES, export, require_library
    from analysis.data.load import load_recording
    from analysis.figures.sensor_analysis import Options
    from analysis.tracking.run import with_camera_placed

    format = SUFFIXES.get(target.suffix, "csv")
    require_library(format)
    recording = load_recording(path)
    options = Options(chosen_curve(recording), mcmc=False, type_b=stated_contributions(recording))
    converted, void = exported_elongation(recording, options)
    export(with_camera_placed(recording), target, format, converted=converted, progress=progress)
    return void


def export_calibration(path: Path, target: Path, *, curve: str = "", progress: Progress | None = None) -> str:
    """Write a recording's calibration as .json, .h, .m or .csv; return what its user must know, empty for nothing."""
    from analysis.calibration_export.calibration_file import CalibrationFile
    from analysis.calibration_export.forms import FORMS, write_calibration

    found = CalibrationFile.of_run(analysed_run(path, curve=curve, progress=progress))
    form = next(form for form, suffix in FORMS.items() if suffix == target.suffix)
    write_calibration(found, target, form)
    return ". ".join(found.remarks)


def preview_table(path: Path, separator: str | None) -> dict[str, Any]:
    """Return what the importer finds in a CSV file, and the units of measurement that each quantity may have."""
    from analysis.data.column_names import units_of
    from analysis.data.csv_import import preview

    roles = ("time_s", "pressure_kpa", "target_kpa", "elongation_mm", *(f"s{n}_mv" for n in range(1, 9)))
    units = {role: tuple(unit.lower() for unit in units_of(role)) for role in roles}
    return preview(path, separator=separator) | {"units": units}


def import_files(
    paths: Sequence[Path],
    target: Path,
    columns: Mapping[str, str],
    stated: Mapping[str, str],
    *,
    text_profile: Path | None = None,
    **options: Any,
) -> Recording:
    """Write one or two files as a recording and return it; `options` are those of `import_csv`."""
    from analysis.data.boat_writer import write_boat_file
    from analysis.data.csv_import import import_csv, import_two

    if text_profile is not None:
        recording = import_capture(paths[0], text_profile)
    elif len(paths) == 1:
        recording = import_csv(paths[0], columns=columns, **options)
    else:
        from analysis.tracking.clock import place_second

        recording = import_two(paths[0], paths[1], columns=columns, place=place_second)
    recording = replace(recording, meta={**recording.meta, **stated})
    write_boat_file(target, recording, original=paths[0], second=paths[1] if len(paths) > 1 else None)
    return recording


def add_marker(path: Path, time_s: float, text: str) -> None:
    """Add a marker with a note to a closed recording, at a time from its first sample."""
    import numpy as np

    from analysis.data.boat_file import read_boat_file
    from boat_daq.engine.recording.rename import add_mark
    from protocol.base.errors import RequestError

    recording = read_boat_file(path)
    if not text.strip():
        raise RequestError("the marker has no text", "Give its text.")
    if not 0.0 <= time_s <= recording.duration_s:
        cause = f"{time_s:g} s is outside the recording of {recording.duration_s:.2f} s"
        raise RequestError(cause, "Give the time from its first sample, s.")
    row = max(0, int(np.searchsorted(recording.time_s, time_s, side="right")) - 1)
    segment = int(recording.segment[row])
    first = int(np.argmax(recording.segment == segment))
    add_mark(path, segment, time_s - float(recording.time_s[first]), text.strip())


def markers_of(path: Path) -> list[tuple[float, str]]:
    """Return the markers of a recording: time from its first sample, s, and note."""
    from boat_daq.engine.recording.rename import has_marks

    if not has_marks(path):  # few have one: the samples, which give its time, are not read in vain
        return []
    from analysis.data.boat_file import read_boat_file

    return list(read_boat_file(path).meta["markers"])


def import_tables(paths: Sequence[Path], target: Path, columns: Mapping[str, str], **options: Any) -> list[str]:
    """Write one or two files as a recording, as `import_files`; return the notes of the importer."""
    recording = import_files(paths, target, columns, {}, **options)
    return [*recording.meta.get("import_notes", ()), *recording.meta.get("import_issues", ())]


def report_runs(
    paths: list[Path],
    target: Path,
    *,
    curve: str = "",
    level: Level = "normal",
    units: ShownUnits = STORED_UNITS,
    progress: Progress | None = None,
) -> str:
    from analysis import write_report
    from analysis.figures.against_shadow import against_shadow

    parts = len(paths) + WRITING
    analyses = [
        analysed_run(path, curve=curve, level=level, mcmc=True, progress=part_of(progress, i, 1, parts))
        for i, path in enumerate(paths)
    ]
    setting = part_of(progress, len(paths), WRITING, parts)
    compared = len(analyses) == 1 and analyses[0].kind == "calibration"
    shadow = against_shadow(analyses[0]) if compared else None
    return write_report(analyses, target, shadow=shadow, units=units, progress=setting).verdict


def import_capture(path: Path, profile: str | Path) -> Recording:
    """Import captured text by a text profile: a file, or its TOML. FileError: no line is as the profile says.

    A last line without an end, and lines that are not as the profile says, are left out and named; the stamps of a
    serial monitor before the lines are ignored.
    """
    import numpy as np

    from protocol.link.events import Samples
    from protocol.text.connection import TextConnection
    from protocol.text.profile import load_profile

    described = load_profile(profile)
    try:
        content = read_regular(path, CAPTURE_MAX_BYTES)
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror or error}", "Check name and permissions.") from error
    link = TextConnection(described)
    events = link.receive(b"\n" + _MONITOR_STAMP.sub(b"", content), 0)  # nothing is torn before the first line
    blocks = [event.array for event in events if isinstance(event, Samples)]
    if not blocks:
        raise FileError(f"no line of {path.name} matches the text profile", "Propose the profile of this file.")
    samples = np.concatenate(blocks)
    notes = []
    if link.statistics.malformed:
        notes.append(f"{link.statistics.malformed} lines do not match the text profile: left out")
    if not content.endswith((b"\n", b"\r")):
        last = len(content.splitlines())
        notes.append(f"line {last}, the last one, has no line end: left out as incomplete")
    return _recording(path, described, samples, notes)


def _recording(path: Path, profile: TextProfile, samples: np.ndarray, notes: list[str]) -> Recording:
    from analysis.data.recording import Recording

    meta = {
        "imported_from": path.name, "import_map": {}, "import_text_profile": profile.toml, "import_notes": notes,
        "simulated": profile.simulated, "polarity": profile.polarity,
        **({"channels": [list(channel) for channel in profile.channels]} if profile.channels else {}),
    }  # fmt: skip
    counts = "lit" in (samples.dtype.names or ())
    parts = {}
    if counts:
        meta |= {"vref_mv": profile.vref_mv, "adc_bits": profile.adc_bits}
        parts = {"lit": samples["lit"], "dark": samples["dark"]}
        signal = (samples["lit"].astype(float) - samples["dark"]) * profile.vref_mv / 2.0**profile.adc_bits
    else:
        signal = samples["signal_mv"]
    return Recording.from_arrays(
        (samples["time_us"] - samples["time_us"][0]) / 1e6, samples["pressure_pa"] / 1000.0, signal, **parts,
        flags=samples["flags"], channel=samples["channel"] if profile.channels else None, meta=meta, source=str(path),
    )  # fmt: skip
