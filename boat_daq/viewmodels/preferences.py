"""What the window remembers between starts: a small JSON file; a broken one is set aside, never fatal."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

NAME = "window.json"


class Preferences:
    """Remembered values.

    Parameters
    ----------
    folder : where the file lies; made when first saved.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / NAME
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
            values = json.loads(self.path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return {}
        return values if isinstance(values, dict) else {}

    def _save(self) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        beside = self.path.with_suffix(".new")
        beside.write_text(json.dumps(self._values, indent=1), encoding="utf-8")
        beside.replace(self.path)
