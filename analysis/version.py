"""The version of the installed program, which results and files name."""

from __future__ import annotations

from importlib import metadata


def program_version() -> str:
    """Return the version of the installed program."""
    try:
        return metadata.version("boat-daq")
    except metadata.PackageNotFoundError:
        return "uninstalled"
