"""The result of a qualification as one JSON object.

Identity of this installation: program, computer and disk, for the qualification report.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
from collections.abc import Sequence
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any

from boat_daq import __version__
from boat_daq.engine.installation import library_versions, shortcomings
from boat_daq.engine.qualification.drill_rig import DrillResult

_ROOT = Path(__file__).resolve().parents[3]
_PACKAGES = ("boat_daq", "protocol", "analysis")
_CODE = (".py", ".toml", ".j2")
_LIBRARIES = ("numpy", "pyserial", "cobs", "scipy", "pandas", "PySide6-Essentials", "pyqtgraph")


def program() -> dict[str, str | int]:
    """Return version, folder, and one SHA-256 over all files of the program."""
    found = [path for package in _PACKAGES for path in (_ROOT / package).rglob("*") if path.suffix in _CODE]
    digest = hashlib.sha256()
    for path in sorted(found):
        digest.update(path.relative_to(_ROOT).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return {"version": __version__, "sha256": digest.hexdigest(), "files": len(found), "folder": str(_ROOT)}


def machine() -> dict[str, str]:
    """Return name, operating system, processor and memory of this computer."""
    processor = _value(Path("/proc/cpuinfo"), "model name") or platform.processor() or platform.machine()
    memory = _value(Path("/proc/meminfo"), "MemTotal").partition(" ")[0]
    return {
        "name": platform.node(),
        "system": f"{_system_name()}, {platform.system()} {platform.release()}",
        "processor": f"{processor}, {os.cpu_count()} cores",
        "memory": f"{int(memory) * 1024 / 1e9:.1f} GB" if memory else "not known",
    }


def disk(folder: Path) -> dict[str, str | float]:
    """Return file system, device, size and free space of the disk of a folder, GB."""
    path = folder.resolve()
    device, kind = _mount(path)
    usage = shutil.disk_usage(path)
    sizes = {"size_gb": round(usage.total / 1e9, 1), "free_gb": round(usage.free / 1e9, 1)}
    return {"folder": str(path), "file_system": kind, "device": device, **sizes}


def _system_name() -> str:
    try:
        return platform.freedesktop_os_release().get("PRETTY_NAME", platform.platform())
    except OSError:  # not Linux
        return platform.platform()


def _mount(path: Path) -> tuple[str, str]:
    """Return (device, type) of the file system a path is on. The mount point nearest to it."""
    best, found = 0, ("not known", "not known")
    for line in _lines(Path("/proc/self/mounts")):
        device, point, kind = line.split()[:3]
        point = point.replace("\\040", " ")
        inside = path == Path(point) or Path(point) in path.parents
        if inside and len(point) >= best:
            best, found = len(point), (device, kind)
    return found


def _value(path: Path, name: str) -> str:
    """Return what is behind the name in a file of the system's; empty where it has no such line."""
    return next((line.partition(":")[2].strip() for line in _lines(path) if line.startswith(name)), "")


def _lines(path: Path) -> list[str]:
    """Return the lines of a file of the system's; none where it has no such file."""
    return path.read_text(encoding="utf-8", errors="replace").splitlines() if path.exists() else []


def qualification(results: Sequence[DrillResult], begun: datetime, *, whole: bool, folder: Path) -> dict[str, Any]:
    """Return the object of `qualify --json`, without its files."""
    failed = [result.name for result in results if not result.passed]
    if failed:
        verdict = f"FAILED: {', '.join(failed)}. Do not use this installation until the cause is found."
    elif whole:
        verdict = f"PASSED: all {len(results)} drills."
    else:
        names = ", ".join(result.name for result in results)
        verdict = f"Passed the selected drills ({names or 'none'}): this is not a full qualification."
    return {
        "simulated": True,
        "passed": not failed and bool(results),
        "whole": whole,
        "verdict": verdict,
        "begun": begun.isoformat(timespec="seconds"),
        "seconds": sum(result.seconds for result in results),
        "program": program(),
        "machine": machine(),
        "disk": disk(folder),
        "versions": {"boat-daq": __version__, "Python": platform.python_version(), **library_versions(_LIBRARIES)},
        "shortcomings": [asdict(found) for found in shortcomings()],
        "drills": [_drill(result) for result in results],
    }


def _drill(result: DrillResult) -> dict[str, Any]:
    boards = [
        {
            "port": "pseudo-terminal" if b.port == "pty" else f"TCP on {b.port.partition(':')[0]}",
            "speed": b.speed,
            "unit": b.unit,
            "seed": b.seed,
            "faults": list(b.faults),
        }
        for b in result.boards
    ]
    return {**asdict(result), "passed": result.passed, "boards": boards}
