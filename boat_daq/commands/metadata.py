"""`boat-daq metadata`: what is stated about a recording: customer, item, ambient conditions, fields of one's own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify, show
from boat_daq.commands.options import RecordingArgument, SetOption, TemplateOption, values_of

if TYPE_CHECKING:
    from protocol.recording import Metadata


def metadata(
    run: RecordingArgument,
    values: SetOption = None,
    template: TemplateOption = "",
    save_template: Annotated[
        str, typer.Option("--save-template", metavar="NAME", help="Store the metadata as a template.")
    ] = "",
    marker: Annotated[
        tuple[float, str] | None,
        typer.Option("--add-marker", metavar="SECONDS TEXT", help="Add a marker at a time from the first sample."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Show the metadata and markers of a recording, or change them; the unit's next recording inherits them.

    Keys: operator, customer, item, serial_number, note, ambient_temperature_c, ambient_humidity_percent; any other key
    names a field of your own. What was stated before stays in the file. While a recording is in progress, only the
    program that records it can state them.

    Example: boat-daq metadata SA1.boat --set customer="Soft Robotics Lab" --set serial_number=0042
    """
    from boat_daq.engine.recording.metadata_entry import read_metadata, remember, state_metadata
    from boat_daq.engine.recording.metadata_entry import save_template as store
    from boat_daq.engine.recording.summary import summarise
    from boat_daq.engine.settings import UnitLibrary
    from boat_daq.workflows.run_files import add_marker, markers_of

    stated = read_metadata(run)
    if values or template:
        stated = with_stated(stated, values, template)
        state_metadata(run, stated)
        summary = summarise(run)
        remember(UnitLibrary(simulated=summary.simulated), summary.unit or "", stated)
    if save_template:
        notify(f"wrote {store(save_template, stated)}")
    if marker is not None:
        add_marker(run, *marker)
    marks = markers_of(run)
    if as_json:
        emit_json({**stated.as_json(), "markers": [{"time_s": time_s, "text": text} for time_s, text in marks]})
        return
    for label, text in stated.lines() or (("metadata", "none stated"),):
        show(f"{label.lower():<20} " + "".join(c if c.isprintable() else " " for c in text))
    for time_s, text in marks:
        show(f"marker at {time_s:>8.2f} s " + "".join(c if c.isprintable() else " " for c in text))


def with_stated(stated: Metadata, values: list[str] | None, template: str) -> Metadata:
    """Return metadata with the values of `--set`, and what is then not stated from a template.

    Parameters
    ----------
    template : name or file; empty for none.
    """
    from boat_daq.engine.recording.metadata_entry import load_template

    changed = stated.changed(values_of(values))
    return changed.filled_from(load_template(template)) if template else changed
