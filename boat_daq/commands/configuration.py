"""`boat-daq config` and `unit`: the stored settings and the units, by key, from the descriptions of their fields."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any

import typer

from boat_daq.commands.console import JsonOption, notify, present
from boat_daq.commands.options import values_of

if TYPE_CHECKING:
    from boat_daq.engine.settings import Settings, Unit, UnitLibrary

config = typer.Typer(no_args_is_help=True, help="Show and change the stored settings.")
unit = typer.Typer(no_args_is_help=True, help="Show and change the stored units: limits, wiring, calibrations.")

NameArgument = Annotated[str, typer.Argument(metavar="NAME", help="Name of the unit.")]
ValuesArgument = Annotated[list[str], typer.Argument(metavar="KEY=VALUE...", help="Values by key.")]
KeysArgument = Annotated[list[str] | None, typer.Argument(metavar="[KEY]...", help="Only these; default all.")]


@config.command("get")
def config_get(keys: KeysArgument = None, as_json: JsonOption = False) -> None:
    """Show the settings: value, range, default and meaning.

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

    stored = load_settings()
    with _typed_values():
        settings = with_typed(stored, values_of(values), "settings")
    save_settings(settings)
    _show_settings(settings, list(values_of(values)), as_json=as_json)


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
    """Show a unit: values, calibrations, metadata, changes.

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
    with _typed_values():
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
    stored = library.stored(name)
    with _typed_values():
        library.save(with_typed(stored, values_of(values), f"unit {name}"))
    _show_unit(library, name, as_json=as_json)


@contextmanager
def _typed_values() -> Iterator[None]:
    """Report a value that its key cannot have as a wrong call. ChoiceError: in place of a `BadValue`."""
    from boat_daq.engine.toml_values import BadValue
    from protocol.base.errors import ChoiceError

    try:
        yield
    except BadValue as error:
        raise ChoiceError(error.cause, error.remedy) from error


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
    """Return value and description by key. ChoiceError: an unknown key."""
    from boat_daq.engine.described import described
    from protocol.base.errors import ChoiceError, one_of

    known = described(values)
    for key in keys or ():
        if key not in known:
            raise ChoiceError(f"settings: '{key:.60}' is not a known key", one_of(key, known))
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
