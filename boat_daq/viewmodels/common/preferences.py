"""Values kept between starts in a small JSON file; a broken file is ignored.

If it cannot be written, that is reported once, and the values last as long as the window.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from boat_daq.engine.toml_values import read_json
from boat_daq.errors import OperatorError

NAME = "window.json"


class Preferences:
    """Values by key.

    Parameters
    ----------
    folder : of the file; made when first saved.
    report : is called with cause and remedy the first time that it cannot be saved.
    """

    def __init__(self, folder: Path, report: Callable[[str, str], object] = lambda cause, remedy: None) -> None:
        self.path = folder / NAME
        self._report: Callable[[str, str], object] | None = report
        self._values: dict[str, Any] = self._load()

    def get(self, key: str, default: Any = None) -> Any:
        """Return the value of `key`; `default` if it is missing or of another type."""
        value = self._values.get(key, default)
        return value if default is None or isinstance(value, type(default)) else default

    def set(self, key: str, value: Any) -> None:
        """Store a JSON value."""
        if self._values.get(key) != value:
            self._values[key] = value
            self._save()

    def _load(self) -> dict[str, Any]:
        try:
            values = read_json(self.path)
        except OperatorError:
            return {}
        return values if isinstance(values, dict) else {}

    def _save(self) -> None:
        beside = self.path.with_suffix(".new")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            beside.write_text(json.dumps(self._values, indent=1), encoding="utf-8")
            beside.replace(self.path)
        except OSError as error:
            if self._report is not None:
                report, self._report = self._report, None
                cause = f"window settings cannot be saved in {self.path.parent}: {error.strerror}"
                report(cause, "This session is not affected. Check the folder and the disk before the next start.")
