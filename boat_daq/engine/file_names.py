"""File names that every system of a lab can hold, and paths that stay in their folder.

A function that takes a path writes there; one that takes a folder and a name writes in that folder or not at all.
"""

from __future__ import annotations

import itertools
import os
import re
from datetime import datetime
from pathlib import Path

from protocol.base.errors import RequestError

NAME_BYTES_MAX = 240  # file systems take 255, and -journal, -wal and -lock must fit behind
_DEVICES = {"CON", "PRN", "AUX", "NUL", *(f"{port}{n}" for port in ("COM", "LPT") for n in range(1, 10))}


def is_device_name(name: str) -> bool:
    """Return whether Windows takes a file of this name for a device."""
    return name.split(".")[0].rstrip().upper() in _DEVICES


def check_file_name(name: str) -> None:
    """Refuse a file name that some system of the lab cannot hold, or that is a path."""
    if name.strip(" .") == "":
        raise RequestError(f"{name!r} is not the name of a file", "Choose another name.")
    if is_device_name(name):
        raise RequestError(f"{name!r} is a name that Windows keeps for a device", "Choose another name.")
    if bad := sorted(set(name) & set('<>:"/\\|?*')) + [c for c in name if ord(c) < 32]:
        raise RequestError(f"{name!r} has {bad[0]!r} in it, which not every system can hold", "Choose another name.")
    if len(os.fsencode(name)) > NAME_BYTES_MAX:
        raise RequestError(f"the name {name[:40]!r}... is longer than {NAME_BYTES_MAX} bytes", "Choose a shorter one.")


def path_in(folder: Path, name: str) -> Path:
    """Return the path of a file in `folder`. See `check_file_name` for the names that are refused."""
    check_file_name(name)
    return folder / name


_FIELDS = ("unit", "operator", "plan", "date", "time", "number")


def named(template: str, folder: Path, now: datetime, **values: str) -> Path:
    """Return the path that a template gives, such as ``{unit}_{plan}_{number}``.

    `{number}` counts from 1 to the first name that is free; a template without it has one at its end where the name
    is taken. What a value has that no name can hold becomes a hyphen.
    """
    given = {"date": f"{now:%Y-%m-%d}", "time": f"{now:%H%M%S}"} | values
    unknown = sorted(set(re.findall(r"\{([^{}]*)\}", template)) - set(_FIELDS))
    if unknown or template.count("{") != template.count("}"):
        named_fields = ", ".join(f"{{{field}}}" for field in _FIELDS)
        raise RequestError(f"the template {template!r:.60} has another field", f"use {named_fields}")

    def name_of(number: int) -> str:
        plain = {key: re.sub(r'[<>:"/\\|?*\x00-\x1f]', "-", value) for key, value in given.items()}
        fields = dict.fromkeys(_FIELDS, "") | plain | {"number": f"{number:03}"}
        name = re.sub(r"\{(\w+)\}", lambda found: fields[found[1]], template)
        stem = name.strip(" _-").removesuffix(".boat")
        if not stem:
            raise RequestError(f"the template {template!r:.60} gives no name here", "add {date}_{time} to it")
        taken = number > 1 and "{number}" not in template
        return f"{stem}_{fields['number']}.boat" if taken else f"{stem}.boat"

    path = path_in(folder, name_of(1))
    numbers = itertools.count(2)
    while path.exists():
        path = path_in(folder, name_of(next(numbers)))
    return path
