"""Results of other methods and other programs, kept as tables with their provenance.

Each file names its method and date; the scripts `make_*.py` beside the tests make them again, and a nightly test
compares.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any


@cache
def load(name: str) -> dict[str, Any]:
    """Return a table by its name, without the suffix."""
    content: dict[str, Any] = json.loads((Path(__file__).parent / f"{name}.json").read_text(encoding="utf-8"))
    return content
