"""`boat-daq import` and `export`: a CSV file as a recording, and the samples of a recording as a file."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify, progress_bar, show, show_table
from boat_daq.commands.options import (
    MapOption,
    RateOption,
    ReadingsOption,
    RunArgument,
    one_of,
)
from boat_daq.commands.usage import STANDARD_OUTPUT

if TYPE_CHECKING:
    from analysis.data.export import ConvertedElongation, Format

_TIMES = [f"%Y-%m-%d{time}{zone}" for time in ("", "T%H:%M", "T%H:%M:%S", " %H:%M", " %H:%M:%S") for zone in ("", "%z")]
_FORMATS: tuple[Format, ...] = ("csv", "parquet", "hdf5", "mat", "rosbag", "rosbag-sqlite3")


def importing(
    files: Annotated[list[Path], typer.Argument(metavar="FILE [FILE]", help="File to import, or two of one run.")],
    to: Annotated[Path | None, typer.Option("--out", metavar="FILE.boat", help="Recording to write.")] = None,
    mapping: MapOption = None,
    skip: Annotated[int | None, typer.Option(min=0, metavar="N", help="Lines above the table to skip.")] = None,
    text_profile: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="Text profile of a captured serial text.")
    ] = None,
    rate: RateOption = None,
    unit: Annotated[str | None, typer.Option(metavar="NAME", help="Unit that was measured.")] = None,
    started: Annotated[
        datetime | None,
        typer.Option(metavar="TIME", formats=_TIMES, help="When the run began, such as 2026-01-31T14:05."),
    ] = None,
    preview: Annotated[
        bool, typer.Option("--preview", help="Show the columns that were found; write nothing.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Import a table into a recording: CSV, Excel, MATLAB, HDF5, Parquet, LabVIEW text, captured serial text.

    Separator, decimal sign, encoding, header and units are detected. Columns that are not recognised are mapped by name
    or by number from 1; cell * SCALE + OFFSET is the value in UNIT. `--preview --json` prints a map that `--map FILE`
    uses again. Unit and start of the run come from the file, --unit or --started. A last line without its
    end is left out: 12.3 may be the beginning of 12.34.

    Two files are joined by their dates, else by cross-correlation; the offset is printed.

    Example: boat-daq import lab.csv --out lab.boat --map pressure_kpa=3*25-12.5:kPa --map s1_mv="Sensor A:V"
    """
    if len(files) > 2:
        raise typer.BadParameter("give one file, or two of one run", param_hint="FILE")
    columns = column_map(mapping)
    if preview:
        _preview(files, columns, skip or 0, as_json=as_json)
        return
    if to is None:
        raise typer.BadParameter("give --out FILE.boat, or --preview")
    if len(files) > 1 and not (skip is None and text_profile is None and rate is None):
        raise typer.BadParameter("two files are joined by their own times: omit --skip, --text-profile and --rate")
    from boat_daq.workflows.run_files import import_files

    stated = {"unit": unit, "started_utc": started.astimezone(UTC).isoformat() if started is not None else None}
    known = {key: value for key, value in stated.items() if value}
    recording = import_files(files, to, columns, known, text_profile=text_profile, rate_hz=rate, skip=skip)
    notes = [*recording.meta.get("import_notes", ()), *recording.meta.get("import_issues", ())]
    for note in notes:
        notify(note)
    if as_json:
        offset = {key: recording.meta[f"import_{key}"] for key in ("offset_s", "offset_u_s") if len(files) > 1}
        emit_json({"file": to, "samples": recording.n, "map": recording.meta["import_map"], "notes": notes,
                   "masked": dict(recording.masked), "gaps": len(recording.gaps), **offset})  # fmt: skip
    else:
        sensors = f"{recording.n_sensors} sensor{'s' * (recording.n_sensors > 1)}"
        notify(f"wrote {to}: {recording.n} samples, {sensors}, {recording.duration_s:.1f} s")


def _preview(files: list[Path], columns: dict[str, str], skip: int, *, as_json: bool) -> None:
    from analysis.data.csv_import import preview

    seen = [preview(file, columns, skip=skip) for file in files]
    if as_json:
        emit_json(seen[0] if len(seen) == 1 else {"files": seen})
        return
    for content in seen:
        _show(content)


def column_map(mapping: list[str] | None) -> dict[str, str]:
    """Return the options `--map` as NAME -> COLUMN[*SCALE][+OFFSET][:UNIT]; one may be a file with a kept map."""
    columns: dict[str, str] = {}
    for text in mapping or ():
        name, sign, column = text.partition("=")
        if not sign and text.endswith(".json"):
            from analysis.data.csv_import import load_profile

            columns |= load_profile(text)
            continue
        if not name or not column:
            raise typer.BadParameter(f"{text!r} is not NAME=COLUMN[:UNIT]", param_hint="--map")
        columns[name] = column
    return columns


def _show(content: dict[str, Any]) -> None:
    written = f", separated by {content['separator']!r}, decimal {content['decimal']!r}" if content["separator"] else ""
    show(f"{content['rows']} rows from line {content['first_data_line']}, {content['encoding']}{written}")
    rows = []
    for column in content["columns"]:
        imported, first = f"{column['taken_as']} {column['taken_unit']}".strip(), "  ".join(map(str, column["first"]))
        rows.append((str(column["number"]), column["name"], column["unit"], imported, first))
    show_table(("no.", "column", "unit", "imported as", "first values"), rows, left=5)
    for note in [*content["notes"], *content["issues"]]:
        notify(note)
    if content["missing"]:
        notify(f"not recognised: {', '.join(content['missing'])}; map it with --map NAME=COLUMN[:UNIT]")


def export(
    run: RunArgument,
    format: Annotated[
        str, typer.Option(callback=one_of(*_FORMATS), help="csv, parquet, hdf5, mat, rosbag or rosbag-sqlite3.")
    ],
    to: Annotated[Path, typer.Option("--out", metavar="PATH", help="File to write.")],
    calibration: Annotated[
        Path | None,
        typer.Option(metavar="FILE.json", help="Calibration for the elongation; default the run's own readings."),
    ] = None,
    elongation: ReadingsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write the samples of a run with their elongation: CSV with a JSON file of metadata, Parquet, HDF5, MAT, ROS 2.

    Elongation and expanded uncertainty (u_mm, k = 2) come from --calibration, else from the run's readings, else from
    the accepted calibration of its unit; without one the columns are left out.

    Example: boat-daq export run.boat --format csv --out run.csv
    """
    from analysis.calibration_export.calibration_file import read_calibration
    from analysis.calibration_export.conversion import convert_recording, other_unit
    from analysis.data.export import export as write
    from analysis.data.export import require_library
    from analysis.data.load import load_recording
    from analysis.tracking.run import with_camera_placed
    from boat_daq.workflows.calibration_in_force import exported_elongation, stated_contributions
    from protocol.recording.missing import missing_of

    require_library(format)
    recording, void = load_recording(run), ""
    for line in missing_of(recording.meta).lines():
        notify(line)
    if calibration is not None:
        found = read_calibration(calibration)
        for remark in other_unit(found, recording.unit):
            notify(remark)
        converted: ConvertedElongation | None = convert_recording(recording, found)
    else:
        from analysis import Options

        options = Options(mcmc=False, type_b=stated_contributions(recording))
        converted, void = exported_elongation(recording, options, elongation)
        if void:
            notify(f"without elongation: {void}; --calibration FILE.json gives one")
    with progress_bar("Exporting") as advance:
        kind = next(known for known in _FORMATS if known == format)
        files = write(with_camera_placed(recording), to, kind, converted=converted, progress=advance)
    if as_json:
        source = None if converted is None else converted.calibration
        head = {"files": files, "samples": recording.n, "simulated": recording.simulated}
        emit_json(head | {"calibration": source, "elongation_void": void})
    else:
        for file in files:
            if not file.name.startswith(STANDARD_OUTPUT):
                notify(f"wrote {file}")
