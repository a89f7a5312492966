"""OpenCV, which only a camera needs: the extra `camera` brings it."""

from __future__ import annotations

import importlib
from typing import Any

from boat_daq.errors import OperatorError


def opencv() -> Any:
    """Return OpenCV.

    Raises
    ------
    OperatorError : it is not installed.
    """
    try:
        return importlib.import_module("cv2")
    except ModuleNotFoundError as error:
        raise OperatorError("OpenCV is not installed", 'Install it with: pip install "boat-daq[camera]"') from error
