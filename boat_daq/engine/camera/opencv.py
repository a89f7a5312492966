"""OpenCV, which only a camera needs: the extra `camera` brings it."""

from __future__ import annotations

import importlib
from typing import Any

from protocol.base.errors import RequestError


def opencv() -> Any:
    """Return OpenCV. RequestError: it is not installed."""
    try:
        return importlib.import_module("cv2")
    except ModuleNotFoundError as error:
        raise RequestError("OpenCV is not installed", 'Install it with: pip install "boat-daq[camera]"') from error
