"""Libraries that only some need: extras of the package, imported where they are used."""

from __future__ import annotations

import importlib
import sys
from typing import Any

from protocol.base.errors import RequestError

EXTRAS = {  # module: name of the library, extra that brings it
    "cv2": ("OpenCV", "camera"),
    "distributed": ("Dask", "cluster"),
    "frappy": ("frappy", "secop"),
    "h5py": ("h5py", "hdf5"),
    "pyarrow": ("pyarrow", "parquet"),
    "pylsl": ("pylsl", "lsl"),
    "rosbags": ("rosbags", "rosbag"),
}


def optional(module: str) -> Any:
    """Return an optional library or module. RequestError: it is not installed; names the extra."""
    library, extra = EXTRAS[module.partition(".")[0]]
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        remedy = f'Install it with: pip install "boat-daq[{extra}]"'
        if getattr(sys, "frozen", False):  # a bundle has no pip
            remedy = f"The program without Python lacks it: install boat-daq[{extra}] with pip or uv instead."
        raise RequestError(f"{library} is not installed", remedy) from error
