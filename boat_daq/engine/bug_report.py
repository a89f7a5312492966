"""A bug report: log, settings, versions and the last recording's summary, in one ZIP without personal data.

Rules: no sample and no byte of a board goes in. What is personal is taken out of every text before it is packed: names
of operators, notes, the names of computers and of this one's user, and every path but a file's ending. What is left out
is replaced by a placeholder in brackets.
"""

from __future__ import annotations

import contextlib
import getpass
import json
import platform
import re
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from boat_daq import __version__
from boat_daq.engine.installation import library_versions, shortcomings
from boat_daq.engine.log import RECORDING, log_folder, without_password
from boat_daq.engine.recording.file import now_utc
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.settings import home
from boat_daq.engine.snapshot import MessageKind
from protocol.base.errors import BoatDaqError, RequestError, writing
from protocol.base.whole_file import written_whole
from protocol.recording import Metadata

LOGS = 5
LOG_BYTES = 2_000_000  # of each, the newest end
_PACKAGES = (
    "numpy",
    "scipy",
    "pandas",
    "pyserial",
    "cobs",
    "PySide6-Essentials",
    "pyqtgraph",
    "numba",
    "typer",
    "matplotlib",
)
_PERSONAL_KEYS = ("operator", "note", "recordings", "profile", "reader")
_OPERATOR, _NOTE = "[operator]", "[note]"
_PATH = re.compile(r"(?:\b[A-Za-z]:)?(?:[\\/]{1,2}[^\\/\s'\"`,;:()<>|]+)+")
_ENDINGS = "boat|csv|tsv|txt|toml|json|xlsx|parquet|pdf|html|zip|png|jpe?g|tiff?|bmp|svg"
_FILE = re.compile(rf"(?:\b[A-Za-z]:)?[\\/][^\n'\"]*?\.({_ENDINGS})\b", re.IGNORECASE)
# a message that begins with a file's name
_NAMED = re.compile(rf"(?<=\] )[^\n\[\]'\"]*?\.({_ENDINGS})\b", re.IGNORECASE)
# of TOML or JSON, and not an empty one
_STRING = r'''("""(?s:.*?)"""|"(?:[^"\\\n]|\\.)+"|\'\'\'(?s:.*?)\'\'\'|'[^'\n]+')'''
_CHANGED = re.compile(rf"\b(before|after)(\s*=\s*){_STRING}")  # values in the list of what changed when
_HERE = ("127.0.0.1", "localhost", "[::1]")
_HOST = re.compile(r"socket://(\[[^\]\s]+\]|[^\s:/]+)")
_KEPT = re.compile(r"/dev/(tty|pts|cu)|//(127\.0\.0\.1|localhost|\[)")
_BEGUN = re.compile(rf"{RECORDING}(.+\.boat)\s*$", re.MULTILINE)
_MARKED = re.compile(rf"({MessageKind.MARK}): .*")


def write_bug_report(out: Path) -> Path:
    """Pack a report, with the summary of the last recording in the log."""
    if out.exists():
        raise RequestError(f"{out} exists already", "choose another name")
    texts = {name: without_password(text) for name, text in collect().items()}
    hide = Redaction(texts)
    with writing(out), written_whole(out) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in texts.items():
            archive.writestr(name, hide(text))
    return out


def contents(out: Path) -> tuple[str, ...]:
    """Return the names inside a report."""
    with zipfile.ZipFile(out) as archive:
        return tuple(archive.namelist())


def collect() -> dict[str, str]:
    """Return the texts of a report by their names, as they are."""
    logs = _logs()
    found = _last_recording(logs)
    versions = {
        "boat_daq": __version__,
        "made_utc": now_utc(),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "packages": library_versions(_PACKAGES),
        "shortcomings": [found.text for found in shortcomings()],
    }
    texts = {"versions.json": _json(versions), "settings.toml": _tail(home() / "settings.toml")}
    if found is not None:
        texts["recording.json"] = _json(_summary(found))
    return {**texts, **{f"log/{path.name}": text for path, text in logs.items()}}


class Redaction:
    """Removes personal data from texts."""

    def __init__(self, texts: Mapping[str, str]) -> None:
        placeholders = {_user(): "[user]", platform.node(): "[computer]", platform.node().split(".")[0]: "[computer]"}
        placeholders |= _places()
        placeholders |= dict.fromkeys(_values(texts.values(), "operator"), _OPERATOR)
        placeholders |= dict.fromkeys(_values(texts.values(), "reader"), _OPERATOR)
        placeholders |= dict.fromkeys(_values(texts.values(), "note"), _NOTE)
        begun = [name for text in texts.values() for name in _BEGUN.findall(text)]
        placeholders |= dict.fromkeys([*begun, *(Path(name).name for name in begun)], "[path].boat")
        hosts = {host for text in texts.values() for host in _HOST.findall(text)}
        placeholders |= dict.fromkeys(hosts.difference(_HERE), "[host]")
        # the longest first: a name within another must not leave a part of it
        self._placeholders = [(w, placeholders[w]) for w in sorted(placeholders, key=len, reverse=True) if len(w) > 1]

    def __call__(self, text: str) -> str:
        """Return the text without what is personal."""
        text = _CHANGED.sub(r'\1\2"[value]"', text)
        text = _MARKED.sub(rf"\1: {_NOTE}", text)
        for key in _PERSONAL_KEYS:
            text = re.sub(rf'^(\s*"?{key}"?\s*[=:]\s*){_STRING}', rf'\1"[{key}]"', text, flags=re.MULTILINE)
        for word, placeholder in self._placeholders:
            text = re.sub(rf"(?<!\w){re.escape(word)}(?!\w)", placeholder, text, flags=re.IGNORECASE)
        text = _NAMED.sub(r"[path].\1", _FILE.sub(r"[path].\1", text))
        return _PATH.sub(lambda found: found[0] if _KEPT.match(found[0]) else "[path]", text)


def _values(texts: Iterable[str], key: str) -> set[str]:
    found = set()
    for text in texts:
        for value in re.findall(rf'"?{key}"?\s*[=:]\s*{_STRING}', text):
            plain = value.strip(value[0])
            found.add(plain)
            with contextlib.suppress(ValueError):
                found.add(str(json.loads(f'"{plain}"')))
    return found


def _places() -> dict[str, str]:
    """Return this user's folders, plain and quoted, each with its placeholder.

    The patterns for paths end at a space, and names of people contain spaces.
    """
    home_folder = Path.home()
    found = {home_folder.name: "[user]"}
    for folder, placeholder in ((home_folder, "[home]"), (home(), "[path]"), (Path.cwd(), "[path]")):
        if len(folder.parts) > 1:
            found |= dict.fromkeys((str(folder), str(folder).replace("\\", "\\\\"), folder.as_posix()), placeholder)
    return found


def _user() -> str:
    with contextlib.suppress(OSError, KeyError, ImportError):  # no such user in the system's list
        return getpass.getuser()
    return Path.home().name


def _summary(path: Path) -> dict[str, Any]:
    try:
        return asdict(replace(summarise(path), metadata=Metadata()))  # for whom is nobody else's
    except (BoatDaqError, OSError) as error:
        return {"path": str(path), "unreadable": str(error)}


def _last_recording(logs: Mapping[Path, str]) -> Path | None:
    """Return the recording that the newest log names last, where it is still there."""
    for path in sorted(logs, key=lambda p: p.stat().st_mtime, reverse=True):
        named = _BEGUN.findall(logs[path])
        if named and Path(named[-1]).exists():
            return Path(named[-1])
    return None


def _logs() -> dict[Path, str]:
    paths = [path for path in log_folder().glob("*.log*") if path.is_file()]
    return {path: _tail(path) for path in sorted(paths, key=lambda p: p.stat().st_mtime)[-LOGS:]}


def _tail(path: Path) -> str:
    """Return the newest end of a text file; why not, where it cannot be read."""
    try:
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - LOG_BYTES))
            return file.read().decode("utf-8", errors="replace")
    except FileNotFoundError:
        return "(there is none)\n"
    except OSError as error:
        return f"(cannot be read: {error.strerror})\n"


def _json(value: object) -> str:
    return json.dumps(value, indent=1, ensure_ascii=False, default=str) + "\n"
