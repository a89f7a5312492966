"""The common part of all studies: chosen by name, run one after the other, written as JSON and pictures.

The studies are time against error (`tradeoff`), where a method fails (`failure_maps`) and the numbers of the paper
(`paper`). A figure is drawn when its files are written, within the style of all figures.
"""

from __future__ import annotations

import datetime
import json
import os
import platform
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from analysis import figure_style as style
from analysis.progress import Progress, part_of
from protocol.base.errors import ChoiceError, one_of
from protocol.base.whole_file import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def machine() -> dict[str, Any]:
    return {
        "system": platform.system(),
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "python": platform.python_version(),
        "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        "date_utc": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


Study = TypeVar("Study")
Result = TypeVar("Result")
Suffix = Literal["png", "svg"]
_DPI = 110


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure to be drawn into a file of this name, without suffix."""

    name: str
    draw: Callable[[], Figure]
    dpi: int = _DPI


def chosen(studies: Sequence[Study], names: Iterable[str], names_of: Callable[[Study], Collection[str]]) -> list[Study]:
    """Return the studies that have one of the names, each once and in their order; all for no names.

    Raises RequestError: no study has such a name.
    """
    wanted = set(names)
    known = list(dict.fromkeys(name for study in studies for name in names_of(study)))
    unknown = sorted(wanted.difference(known))
    if unknown:
        raise ChoiceError(f"there is no method '{unknown[0]}'", one_of(unknown[0], known))
    return [study for study in studies if not wanted or wanted.intersection(names_of(study))]


def run_all(
    studies: Sequence[Study],
    run: Callable[[Study, Progress], Result],
    progress: Progress | None = None,
    work: Callable[[Study], float] = lambda _: 1.0,
) -> list[Result]:
    """Run the studies one after the other; `progress` is called with the work done and that of all studies."""
    sizes = [work(study) for study in studies]
    return [run(study, part_of(progress, sum(sizes[:i]), sizes[i], sum(sizes))) for i, study in enumerate(studies)]


def write_json(content: Mapping[str, Any], path: Path) -> None:
    """Write a result of a study."""
    write_whole(path, json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def write_pictures(
    pictures: Iterable[Picture], folder: Path, suffixes: Sequence[Suffix] = ("png", "svg"), **look: Any
) -> list[Path]:
    """Draw pictures and write each in every format; return the files.

    `look`: parameters of matplotlib beside those of the style, with `_` for `.`.
    """
    import matplotlib as mpl  # half a second that only who draws spends

    files = []
    with mpl.rc_context(style.RC | {name.replace("_", "."): value for name, value in look.items()}):
        for picture in pictures:
            figure = picture.draw()
            for suffix in suffixes:
                files.append(folder / f"{picture.name}.{suffix}")
                options: dict[str, Any] = {"metadata": {"Date": None}} if suffix == "svg" else {}
                style.save_picture(figure, files[-1], dpi=picture.dpi, **options)
                figure.set_layout_engine("none")  # laid out once for all formats
    return files
