"""What is installed: the versions of libraries, and whether the compiled part is there that makes one of them fast.

The library cobs is compiled while it is installed; on a computer without a C compiler it is installed all the same, and
decodes frames in Python. That loses nothing at the rates of a board, and takes a share of a core that others may need.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from boat_daq.own_packages import ROOT
from protocol.base.errors import RequestError
from protocol.base.optional import install_command
from protocol.link.framing import is_compiled


@dataclass(frozen=True, slots=True)
class Shortcoming:
    """Something of this installation that is slower than it could be."""

    cause: str
    remedy: str
    command: str

    @property
    def text(self) -> str:
        """Return all of it in one line."""
        return f"{self.cause}. {self.remedy}: {self.command}"


SLOW_DECODER = Shortcoming(
    "frames of the board are decoded by Python, a tenth as fast: the compiled part of the library cobs is missing",
    "Install a C compiler and the headers of Python (on Debian gcc and python3-dev), then the library cobs again",
    command=install_command("--force-reinstall", "--no-cache-dir", "--no-binary", "cobs", "cobs"),
)


def shortcomings() -> tuple[Shortcoming, ...]:
    """Return what is slower than it could be; empty on a complete installation."""
    return () if is_compiled() else (SLOW_DECODER,)


def library_versions(names: Iterable[str]) -> dict[str, str]:
    """Return the versions of those libraries that are installed."""
    found: dict[str, str] = {}
    for name in names:
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found


def address_of(label: str) -> str:
    """Return an address of the project, by its label in `[project.urls]`; empty where none was published."""
    with contextlib.suppress(metadata.PackageNotFoundError):
        for line in metadata.metadata("boat-daq").get_all("Project-URL") or ():
            name, _, address = line.partition(", ")
            if name == label and "example.org" not in address:
                return str(address)
    return ""


_USES = {  # by distribution; what is not listed belongs to the commands
    "pyside6-essentials": "window", "shiboken6": "window", "pyqtgraph": "window",
    "numpy": "calibration", "scipy": "calibration", "pandas": "calibration", "emcee": "calibration",
    "python-dateutil": "calibration",
    "numba": "compiled parts", "llvmlite": "compiled parts",
    "matplotlib": "charts", "fonttools": "charts", "pillow": "charts", "kiwisolver": "charts", "contourpy": "charts",
    "typst": "PDF",
    "pyserial": "link", "cobs": "link",
}  # fmt: skip


def installed_sizes() -> list[tuple[str, str, int]]:
    """Return name, use and bytes on disk of this program and of each library that it requires, the largest first."""
    sizes: dict[str, int] = {}
    _add_sizes("boat-daq", sizes)
    return sorted(((name, _USES.get(name, "commands"), size) for name, size in sizes.items()), key=lambda row: -row[2])


def _add_sizes(name: str, sizes: dict[str, int]) -> None:
    """Add a distribution and what it requires; one that is not installed is left out."""
    key = re.sub(r"[-_.]+", "-", name).lower()
    if key in sizes:
        return
    try:
        found = metadata.distribution(name)
    except metadata.PackageNotFoundError:
        return
    files = (Path(str(file.locate())) for file in found.files or ())
    sizes[key] = sum(path.stat().st_size for path in files if path.is_file())
    for requirement in found.requires or ():
        if "extra ==" not in requirement:
            _add_sizes(re.split(r"[^\w.-]", requirement, maxsplit=1)[0], sizes)


def shipped(pattern: str, below: str) -> list[Path]:
    """Return files beside the sources, or in the environment's folder. RequestError: they are not installed."""
    if beside := sorted(ROOT.glob(pattern)):
        return beside
    listed = metadata.files("boat-daq") or []
    found = sorted(Path(str(file.locate())).resolve() for file in listed if file.match(f"{below}/{pattern}"))
    if not found:
        raise RequestError(f"{pattern} is not installed", "Install the program again.")
    return found
