"""`boat-daq metadata`: what is stated about a recording: customer, item, ambient conditions, fields of one's own."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, show
from boat_daq.commands.options import RecordingArgument, SetOption, values_of


def metadata(
    run: RecordingArgument,
    values: SetOption = None,
    marker: Annotated[
        tuple[float, str] | None,
        typer.Option("--add-marker", metavar="SECONDS TEXT", help="Add a marker at a time from the first sample."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Show the metadata and markers of a recording, or change them; the unit's next recording inherits them.

    Keys: operator, customer, item, serial_number, note, ambient_temperature_c, ambient_humidity_percent; any other key
    names a field of your own. Earlier values stay in the file. During a recording only the program that
    records can change them.

    Example: boat-daq metadata SA1.boat --set customer="Soft Robotics Lab" --set serial_number=0042
    """
    from boat_daq.engine.recording.metadata_entry import read_metadata, remember, state_metadata
    from boat_daq.engine.recording.summary import summarise
    from boat_daq.engine.settings import UnitLibrary
    from boat_daq.workflows.run_files import add_marker, markers_of

    stated = read_metadata(run)
    if values:
        stated = stated.changed(values_of(values))
        state_metadata(run, stated)
        summary = summarise(run)
        remember(UnitLibrary(simulated=summary.simulated), summary.unit or "", stated)
    if marker is not None:
        add_marker(run, *marker)
    marks = markers_of(run)
    if as_json:
        emit_json({**asdict(stated), "markers": [{"time_s": time_s, "text": text} for time_s, text in marks]})
        return
    for label, text in stated.lines() or (("metadata", "none stated"),):
        show(f"{label.lower():<20} " + "".join(c if c.isprintable() else " " for c in text))
    for time_s, text in marks:
        show(f"marker at {time_s:>8.2f} s " + "".join(c if c.isprintable() else " " for c in text))
