"""Libraries that only some need: extras of the package, imported where they are used.

An absent one is reported with the command that installs it into the environment of this program.
"""

from __future__ import annotations

import importlib
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from protocol.base.errors import RequestError

EXTRAS = {  # module: name of the library, extra that brings it, what to install
    "cv2": ("OpenCV", "camera", ("opencv-python-headless>=4.10,<6",)),
    "distributed": ("Dask", "cluster", ("dask>=2024.8", "distributed>=2024.8")),
    "frappy": ("frappy", "secop", ("frappy-core>=0.20.9,<1",)),
    "h5py": ("h5py", "hdf5", ("h5py>=3.10,<4",)),
    "pyarrow": ("pyarrow", "parquet", ("pyarrow>=15",)),
    "pylsl": ("pylsl", "lsl", ("pylsl>=1.17,<2",)),
    "xarray": ("xarray", "xarray", ("xarray>=2024.1",)),
    "python_calamine": ("calamine, which reads Excel,", "excel", ("python-calamine>=0.3,<1",)),
    "rosbags": ("rosbags", "rosbag", ("rosbags>=0.10,<0.12",)),
}


def optional(module: str) -> Any:
    """Return an optional library or module. RequestError: it is not installed; its command installs it."""
    library, _, requirements = EXTRAS[module.partition(".")[0]]
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if getattr(sys, "frozen", False):  # a bundle has no pip
            remedy = "The standalone program cannot load it: install boat-daq with pipx."
            raise RequestError(f"{library} is not installed", remedy) from error
        command = install_command(*(f'"{requirement}"' for requirement in requirements))
        raise RequestError(f"{library} is not installed", "Install it", command=command) from error


def install_command(*arguments: str) -> str:
    """Return the command that installs quoted requirements into the environment of this program, whatever made it."""
    prefix, wanted = Path(sys.prefix), " ".join(arguments)
    if prefix.parent.name == "venvs" and (prefix / "pipx_metadata.json").is_file():
        options = any(argument.startswith("-") for argument in arguments)
        return f"pipx {'runpip' if options else 'inject'} {prefix.name}{' install' if options else ''} {wanted}"
    if find_spec("pip") is None:  # made by uv
        return f'uv pip install --python "{sys.executable}" {wanted}'
    return f'"{sys.executable}" -m pip install {wanted}'
