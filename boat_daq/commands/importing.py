"""`boat-daq import`: a CSV as it is found into a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from boat_daq.commands.console import JsonOption, emit_json, out, say


def import_csv(
    file: Annotated[Path, typer.Argument(metavar="FILE.csv", help="The file to import.")],
    to: Annotated[Path | None, typer.Option("--out", metavar="FILE.boat", help="The recording to write.")] = None,
    mapping: Annotated[
        list[str] | None,
        typer.Option(
            "--map", metavar="NAME=COLUMN[:UNIT]", help="time_s, pressure_kpa, target_kpa, s1_mv, s1_lit, ..."
        ),
    ] = None,
    profile: Annotated[Path | None, typer.Option(help="A map saved before.")] = None,
    save_profile: Annotated[Path | None, typer.Option(help="Keep the map in this file.")] = None,
    rate: Annotated[float | None, typer.Option(min=0.001, metavar="HZ", help="Where the file has no time.")] = None,
    preview: Annotated[bool, typer.Option("--preview", help="Show what would be imported; write nothing.")] = False,
    json: JsonOption = False,
) -> None:
    """A CSV as it is found into a recording.

    Separator, decimal sign, encoding, header and units are told from the file. Columns that are not recognised are
    mapped by hand, by name or by number from 1. Example:

        boat-daq import lab.csv --out lab.boat --map pressure_kpa=3:bar --map s1_mv="Sensor A:V"
    """
    from analysis.data import csv_columns
    from analysis.data import csv_import as importer

    columns = csv_columns.load_profile(profile) if profile else {}
    columns |= column_map(mapping)
    if save_profile is not None:
        from analysis.data.csv_table import read_table

        table = read_table(file)
        csv_columns.save_profile(save_profile, csv_columns.map_columns(table, columns), table)
        say(f"kept the map in {save_profile}")
    if preview:
        _show(importer.preview(file, columns), json)
        return
    if to is None:
        raise typer.BadParameter("give --out FILE.boat, or --preview")
    recording = importer.import_csv(file, columns=columns, rate_hz=rate)
    from analysis.data.boat_writer import write_boat_file

    write_boat_file(to, recording, original=file)
    notes = [*recording.meta.get("import_notes", ()), *recording.meta.get("import_issues", ())]
    for note in notes:
        say(note)
    if json:
        emit_json({"file": to, "samples": recording.n, "map": recording.meta["import_map"], "notes": notes,
                   "masked": dict(recording.masked), "gaps": len(recording.gaps)})  # fmt: skip
    else:
        say(f"wrote {to}: {recording.n} samples, {recording.n_sensors} sensors, {recording.duration_s:.1f} s")


def column_map(mapping: list[str] | None) -> dict[str, str]:
    """Return what `--map NAME=COLUMN[:UNIT]` says, NAME -> COLUMN[:UNIT]."""
    return dict(_pair(text) for text in mapping or ())


def _pair(text: str) -> tuple[str, str]:
    name, equals, column = text.partition("=")
    if not equals or not name or not column:
        raise typer.BadParameter(f"{text!r} is not NAME=COLUMN[:UNIT]", param_hint="--map")
    return name, column


def _show(content: dict[str, Any], json: bool) -> None:
    if json:
        emit_json(content)
        return
    from rich.table import Table

    out.print(
        f"{content['rows']} rows from line {content['first_data_line']}, {content['encoding']}, separated by "
        f"{content['separator']!r}, decimal {content['decimal']!r}",
        highlight=False, markup=False,
    )  # fmt: skip
    table = Table("no.", "column", "unit", "taken as", "first values", box=None, pad_edge=False)
    for column in content["columns"]:
        taken = f"{column['taken_as']} {column['taken_unit']}".strip()
        first = "  ".join(str(value) for value in column["first"])
        table.add_row(str(column["number"]), column["name"], column["unit"], taken, first)
    out.print(table)
    for said in [*content["notes"], *content["issues"]]:
        say(said)
    if content["missing"]:
        say(f"not recognised: {', '.join(content['missing'])}; map it with --map NAME=COLUMN[:UNIT]")
