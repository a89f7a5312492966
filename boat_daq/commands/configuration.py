"""`boat-daq config` and `unit`: the stored settings and the units, by key, from the descriptions of their fields."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from boat_daq.commands.console import JsonOption, notify, present, writing
from boat_daq.commands.options import values_of

if TYPE_CHECKING:
    from boat_daq.engine.described import StoredChange
    from boat_daq.engine.settings import Settings, Unit, UnitLibrary

config = typer.Typer(no_args_is_help=True, help="Show and change the stored settings.")
unit = typer.Typer(no_args_is_help=True, help="Show and change the stored units: limits, wiring, calibrations.")

NameArgument = Annotated[str, typer.Argument(metavar="NAME", help="Name of the unit.")]
ValuesArgument = Annotated[list[str], typer.Argument(metavar="KEY=VALUE...", help="Values by key.")]
KeysArgument = Annotated[list[str] | None, typer.Argument(metavar="[KEY]...", help="Only these; default all.")]
FileArgument = Annotated[Path, typer.Argument(metavar="FILE.toml")]


@config.command("get")
def config_get(keys: KeysArgument = None, as_json: JsonOption = False) -> None:
    """Show the settings: value, range, default, meaning, and when a new value takes effect.

    Example: boat-daq config get rate_hz
    """
    from boat_daq.engine.settings import load_settings

    _show_settings(load_settings(), keys, as_json=as_json)


@config.command("set")
def config_set(values: ValuesArgument, as_json: JsonOption = False) -> None:
    """Change settings.

    Example: boat-daq config set rate_hz=1000 operator="Ada Lovelace"
    """
    from boat_daq.engine.described import with_typed
    from boat_daq.engine.settings import load_settings, save_settings

    settings = with_typed(load_settings(), values_of(values), "settings")
    save_settings(settings)
    _show_settings(settings, list(values_of(values)), as_json=as_json)


@config.command("reset")
def config_reset(keys: KeysArgument = None, as_json: JsonOption = False) -> None:
    """Set settings to their defaults; without a key all, and a file that is refused is kept as settings.toml.refused.

    Example: boat-daq config reset baud
    """
    from boat_daq.engine.described import with_defaults
    from boat_daq.engine.settings import Settings, load_settings, save_settings

    settings = with_defaults(load_settings(), keys, "settings") if keys else Settings()
    save_settings(settings)
    _show_settings(settings, keys, as_json=as_json)


@config.command("undo")
def config_undo(as_json: JsonOption = False) -> None:
    """Take the newest change back; a second call makes it again.

    Example: boat-daq config undo
    """
    from boat_daq.engine.described import with_undone
    from boat_daq.engine.settings import save_settings, stored_settings

    settings, changes = stored_settings()
    settings = with_undone(settings, changes, "settings")
    save_settings(settings)
    _show_settings(settings, None, as_json=as_json)


@config.command("changes")
def config_changes(as_json: JsonOption = False) -> None:
    """Show what changed when, newest first.

    Example: boat-daq config changes
    """
    from boat_daq.engine.settings import stored_settings

    _show_changes(stored_settings()[1], as_json=as_json)


@config.command("export")
def config_export(file: FileArgument, as_json: JsonOption = False) -> None:
    """Write the settings to a file that `config import` reads.

    Example: boat-daq config export rig.toml
    """
    from boat_daq.engine.settings import load_settings, settings_text
    from protocol.base.whole_file import write_whole

    with writing(file):
        write_whole(file, settings_text(load_settings()))
    present({"path": str(file)}, f"wrote {file}", as_json=as_json)


@config.command("import")
def config_import(file: FileArgument, as_json: JsonOption = False) -> None:
    """Take all settings from a file.

    Example: boat-daq config import rig.toml
    """
    from boat_daq.engine.settings import read_settings, save_settings
    from boat_daq.engine.toml_values import read_text

    settings = read_settings(read_text(file), str(file))[0]
    save_settings(settings)
    _show_settings(settings, None, as_json=as_json)


@unit.command("list")
def unit_list(as_json: JsonOption = False) -> None:
    """List the stored units: limits, and the calibration in force.

    Example: boat-daq unit list
    """
    from boat_daq.engine.settings import UnitLibrary
    from protocol.base.errors import RequestError

    library = UnitLibrary()
    rows = []
    for name in library.names():
        try:
            rows.append(_summary(library.load(name)))
        except RequestError as error:
            notify(f"unit {name} cannot be used: {error.cause}")
    if not rows:
        notify("no unit is stored; to add one: boat-daq unit new NAME")
    lines = [
        f"{row['name']:<12} {row['min_kpa']:g} to {row['max_kpa']:g} kPa, "
        f"calibrated {row['calibrated_utc'] or 'never'}  {row['note']}".rstrip()
        for row in rows
    ]
    present({"units": rows}, *lines, as_json=as_json)


@unit.command("show")
def unit_show(name: NameArgument, as_json: JsonOption = False) -> None:
    """Show a unit: values with range, default and meaning, calibrations, metadata, type B contributions, changes.

    Example: boat-daq unit show SA1
    """
    from boat_daq.engine.settings import UnitLibrary

    _show_unit(UnitLibrary(), name, as_json=as_json)


@unit.command("new")
def unit_new(
    name: NameArgument,
    values: Annotated[list[str] | None, typer.Argument(metavar="[KEY=VALUE]...", help="Values by key.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Add a unit.

    Example: boat-daq unit new SA7 min_kpa=-25 max_kpa=40 note="thin wall"
    """
    from boat_daq.engine.described import with_typed
    from boat_daq.engine.settings import Unit, UnitLibrary
    from protocol.base.errors import RequestError

    library = UnitLibrary()
    if name in library.names():
        raise RequestError(f"there is a unit {name} already", "Choose another name.", command="boat-daq unit set")
    library.save(with_typed(Unit(name), values_of(values), f"unit {name}"))
    _show_unit(library, name, as_json=as_json)


@unit.command("set")
def unit_set(name: NameArgument, values: ValuesArgument, as_json: JsonOption = False) -> None:
    """Change values of a unit. A plan outside its limits is refused before anything moves.

    Example: boat-daq unit set SA1 min_kpa=-25
    """
    from boat_daq.engine.described import with_typed
    from boat_daq.engine.settings import UnitLibrary

    library = UnitLibrary()
    library.save(with_typed(library.stored(name), values_of(values), f"unit {name}"))
    _show_unit(library, name, as_json=as_json)


@unit.command("reset")
def unit_reset(name: NameArgument, keys: KeysArgument = None, as_json: JsonOption = False) -> None:
    """Set values of a unit to their defaults; without a key all. Calibrations stay.

    Example: boat-daq unit reset SA1 polarity
    """
    from boat_daq.engine.described import with_defaults
    from boat_daq.engine.settings import UnitLibrary

    library = UnitLibrary()
    library.save(with_defaults(library.stored(name), keys or (), f"unit {name}"))
    _show_unit(library, name, as_json=as_json)


@unit.command("undo")
def unit_undo(name: NameArgument, as_json: JsonOption = False) -> None:
    """Take the newest change of a unit's values back; a second call makes it again. Calibrations stay.

    Example: boat-daq unit undo SA1
    """
    from boat_daq.engine.described import with_undone
    from boat_daq.engine.settings import UnitLibrary

    library = UnitLibrary()
    stored = library.stored(name)
    library.save(with_undone(stored, stored.changes, f"unit {name}"))
    _show_unit(library, name, as_json=as_json)


@unit.command("export")
def unit_export(name: NameArgument, file: FileArgument, as_json: JsonOption = False) -> None:
    """Write a unit with its calibrations and changes to a file that `unit import` reads.

    Example: boat-daq unit export SA1 SA1.toml
    """
    from boat_daq.engine.settings import UnitLibrary
    from protocol.base.whole_file import write_whole

    text = UnitLibrary().text(name)
    with writing(file):
        write_whole(file, text)
    present({"path": str(file)}, f"wrote {file}", as_json=as_json)


@unit.command("import")
def unit_import(file: FileArgument, as_json: JsonOption = False) -> None:
    """Take a unit from a file; one that is stored keeps its calibrations, which the file must begin with.

    Example: boat-daq unit import SA1.toml
    """
    from boat_daq.engine.settings import UnitLibrary, read_unit

    library, found = UnitLibrary(), read_unit(file)
    library.save(found)
    _show_unit(library, found.name, as_json=as_json)


def _show_settings(settings: Settings, keys: list[str] | None, *, as_json: bool) -> None:
    from boat_daq.engine.settings import settings_path

    found = _values(settings, keys)
    present({"settings": found, "path": str(settings_path())}, *_lines(found), as_json=as_json)


def _show_unit(library: UnitLibrary, name: str, *, as_json: bool) -> None:
    shown = library.stored(name)
    found = _values(shown, None)
    entries = [{k: v for k, v in dataclasses.asdict(entry).items() if k != "content"} for entry in shown.history]
    content = {
        **_summary(shown),
        "settings": found,
        "metadata": dict(shown.metadata),
        "type_b": dict(shown.type_b),
        "history": entries,
        "changes": [dataclasses.asdict(change) for change in shown.changes],
    }
    tables = (("metadata", shown.metadata), ("type B", shown.type_b))
    more = [f"{label}: {', '.join(table)}" for label, table in tables if table]
    dates = [f"{entry.utc} {'accepted' if entry.accepted else 'withdrawn'} {entry.note}" for entry in shown.history]
    present(content, *_lines(found), *(f"calibration: {text.rstrip()}" for text in dates), *more, as_json=as_json)


def _summary(shown: Unit) -> dict[str, Any]:
    """Return what a list shows of a unit."""
    values = {key: getattr(shown, key) for key in ("name", "min_kpa", "max_kpa", "polarity", "note", "usb_serial")}
    in_force = shown.calibration
    return {**values, "calibrations": len(shown.history), "calibrated_utc": in_force.utc if in_force else None}


def _values(values: Settings | Unit, keys: list[str] | None) -> dict[str, dict[str, Any]]:
    """Return value and description by key.

    Raises
    ------
    RequestError : an unknown key.
    """
    from boat_daq.engine.described import described
    from boat_daq.engine.toml_values import BadValue

    known = described(values)
    for key in keys or ():
        if key not in known:
            raise BadValue("settings", key, "is not a known key", f"Known: {', '.join(known)}.")
    return {
        key: {
            "value": getattr(values, key),
            "default": about.default,
            "unit": about.unit,
            "range": about.range_text,
            "meaning": about.meaning,
            "applies": str(about.applies),
        }
        for key, about in known.items()
        if not keys or key in keys
    }


def _lines(found: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return a line of text for each value, and its description below it."""
    from boat_daq.engine.described import text_of

    lines = []
    for key, about in found.items():
        value, default = text_of(about["value"]), text_of(about["default"])
        parts = (about["range"], f"default {default}" if default else "", f"applies {about['applies']}")
        lines += [
            f"{key} = {value} {about['unit']}".rstrip(),
            f"    {about['meaning']} ({'; '.join(filter(None, parts))})",
        ]
    return lines


def _show_changes(changes: tuple[StoredChange, ...], *, as_json: bool) -> None:
    rows = [dataclasses.asdict(change) for change in reversed(changes)]
    lines = [f"{c.utc}  {c.key}: {c.before or '-'} -> {c.after or '-'}" for c in reversed(changes)]
    present({"changes": rows}, *lines, as_json=as_json)


@unit.command("changes")
def unit_changes(name: NameArgument, as_json: JsonOption = False) -> None:
    """Show what changed when, newest first; calibrations have dates of their own.

    Example: boat-daq unit changes SA1
    """
    from boat_daq.engine.settings import UnitLibrary

    _show_changes(UnitLibrary().stored(name).changes, as_json=as_json)
