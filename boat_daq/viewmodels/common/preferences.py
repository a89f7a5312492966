"""Values kept between starts in a small JSON file, which is ignored if broken; one of them is the precision.

Several windows share the file: each writes only the values that it has set, and reads the file at its start only. A
file that cannot be written is reported once.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from analysis.fidelity import LEVELS, Fidelity, Level, fidelity
from boat_daq.engine.toml_values import read_json
from protocol.base.errors import RequestError
from protocol.base.units import CHOICES, STORED_UNITS, ShownUnits
from protocol.base.whole_file import write_whole

LENGTHS_MM = (1.0, 10_000.0)  # of an actuator at rest
_NAME = "window.json"
_DEFAULT: Level = "normal"


class Preferences:
    def __init__(self, folder: Path, report: Callable[[str, str], object] = lambda cause, remedy: None) -> None:
        self.path = folder / _NAME
        self._report: Callable[[str, str], object] | None = report
        self._values: dict[str, Any] = self._load()
        self._unsaved: set[str] = set()

    def get(self, key: str, default: Any = None) -> Any:
        """Return the value of `key`; `default` if it is missing or of another type."""
        value = self._values.get(key, default)
        return value if default is None or isinstance(value, type(default)) else default

    def set(self, key: str, value: Any) -> None:
        if self._unsaved or self._values.get(key) != value:
            self._values[key] = value
            self._unsaved.add(key)
            self._save()

    def change(self, key: str, change: Callable[[Any], Any]) -> None:
        """Store what `change` makes of the value in the file, which another window may have written."""
        self.set(key, change(self._load().get(key, self._values.get(key))))

    def set_later(self, key: str, value: Any) -> None:
        """Store a JSON value that changes with every movement of the mouse: the next `set` writes it to the disk."""
        self._values[key] = value
        self._unsaved.add(key)

    def _load(self) -> dict[str, Any]:
        try:
            values = read_json(self.path)
        except RequestError:
            return {}
        return values if isinstance(values, dict) else {}

    def _save(self) -> None:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            kept = {**self._values, **self._load()} | {key: self._values[key] for key in self._unsaved}
            write_whole(self.path, json.dumps(kept, indent=1))
            self._unsaved.clear()
        except OSError as error:
            if self._report is not None:
                report, self._report = self._report, None
                cause = f"window settings cannot be saved in {self.path.parent}: {error.strerror}"
                report(cause, "This session is not affected. Check the folder and the disk before the next start.")


class UnitChoice:
    KEY = "units"

    def __init__(self, preferences: Preferences, apply: Callable[[ShownUnits], None]) -> None:
        self._preferences, self._apply = preferences, apply
        apply(self.units)

    @property
    def units(self) -> ShownUnits:
        """Return the units in use; what is stored and is none is left out."""
        kept = self._preferences.get(self.KEY, {})
        chosen = {name: kept[name] for name, units in CHOICES.items() if kept.get(name) in units}
        length = kept.get("rest_length_mm", STORED_UNITS.rest_length_mm)
        known = isinstance(length, int | float) and LENGTHS_MM[0] <= length <= LENGTHS_MM[1]
        return replace(STORED_UNITS, rest_length_mm=length if known else STORED_UNITS.rest_length_mm, **chosen)

    def choose(self, units: ShownUnits) -> None:
        self._preferences.set(self.KEY, asdict(units))
        self._apply(units)

    def set_length(self, text: str) -> None:
        """Set the length of the actuator at rest, of which an elongation in % is a part."""
        try:
            length_mm = float(text.replace(",", "."))
        except ValueError:
            length_mm = math.nan
        low, high = LENGTHS_MM
        if not low <= length_mm <= high:
            raise RequestError(f"{text!r} is not a length at rest", f"enter {low:g} to {high:g} mm")
        self.choose(replace(self.units, rest_length_mm=length_mm))


class Precision:
    def __init__(self, preferences: Preferences, apply: Callable[[Fidelity], None]) -> None:
        self._preferences, self._apply = preferences, apply
        apply(fidelity(self.level))

    @property
    def level(self) -> Level:
        kept = self._preferences.get("fidelity", _DEFAULT)
        return next((level for level in LEVELS if level == kept), _DEFAULT)

    def choose(self, level: Level) -> None:
        """Compute at `level` from now on; results shown stay until they are computed again."""
        self._preferences.set("fidelity", level)
        self._apply(fidelity(level))
