"""What the window remembers between starts: a small JSON file; a broken one is set aside, never fatal.

Where it cannot be stored, that is told once, and the values last as long as the window.
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
    """Remembered values.

    Parameters
    ----------
    folder : where the file lies; made when first saved.
    tell : is called with cause and remedy the first time that it cannot be saved.
    """

    def __init__(self, folder: Path, tell: Callable[[str, str], object] = lambda cause, remedy: None) -> None:
        self.path = folder / NAME
        self._tell: Callable[[str, str], object] | None = tell
        self._values: dict[str, Any] = self._load()

    def get(self, key: str, default: Any = None) -> Any:
        """Return what is remembered under `key`; `default` where nothing is, or another kind of value."""
        value = self._values.get(key, default)
        return value if default is None or isinstance(value, type(default)) else default

    def set(self, key: str, value: Any) -> None:
        """Remember a JSON value."""
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
            if self._tell is not None:
                tell, self._tell = self._tell, None
                cause = f"what the window remembers cannot be stored in {self.path.parent}: {error.strerror}"
                tell(cause, "The session goes on; check the folder and the disk before the next start.")
