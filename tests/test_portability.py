"""What breaks on Windows, or under another locale, stays out of the product, except where it is guarded."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from boat_daq.commands.record import dated_name
from boat_daq.engine.file_names import check_file_name

ROOT = Path(__file__).resolve().parents[1]
POSIX_MODULES = {"fcntl", "grp", "pty", "pwd", "resource", "syslog", "termios", "tty"}
POSIX_NAMES = {  # attributes of os, signal, socket and select that Windows lacks
    "AF_UNIX", "O_NOCTTY", "O_NONBLOCK", "SIGALRM", "SIGCONT", "SIGHUP", "SIGKILL", "SIGSTOP", "SIGUSR1", "chown",
    "fork", "geteuid", "getgid", "getloadavg", "getpgid", "getpriority", "getuid", "kill", "killpg", "mkfifo", "nice",
    "openpty", "poll", "sched_getaffinity", "sched_setaffinity", "setpriority", "setsid", "statvfs", "sysconf",
    "ttyname", "uname",
}  # fmt: skip
POSIX_PATHS = ("/dev/", "/proc/", "/tmp", "/etc/", "/usr/", "/var/")
GUARDED = {  # each module that uses one, and what it does on Windows
    "analysis/studies/harness.py": "states nothing of the processor's load and its cores as Python counts them",
    "boat_daq/cli.py": "keeps its output",
    "boat_daq/commands/usage.py": "names that mean `-`; no file has them there",
    "boat_daq/engine/bug_report.py": "a pattern of ports that hold no name",
    "boat_daq/engine/camera/source.py": "asks the camera itself",
    "boat_daq/engine/link/ports.py": "takes the ports that the system lists",
    "boat_daq/engine/link/reader.py": "keeps the priority",
    "boat_daq/engine/log.py": "states no memory",
    "boat_daq/engine/outlets/lsl.py": "joins on every network",
    "boat_daq/engine/qualification/drills.py": "leaves the drill out",
    "boat_daq/engine/qualification/result.py": "asks Python for processor and disk",
    "protocol/recording/writer_lock.py": "locks by msvcrt",
    "boat_daq/engine/screen.py": "needs no display server",
    "boat_daq/engine/simulator/server.py": "refuses a pseudo-terminal, and serves TCP",
    "boat_daq/workflows/jobs.py": "sets the priority class",
}
TEXT_CALLS = {"open": 1, "read_text": 0, "write_text": 1}  # with the place of `mode` or `encoding`


def modules(pattern: str) -> Iterator[tuple[str, ast.Module]]:
    """Yield the modules that hold the pattern; to parse all of them takes seconds."""
    held = re.compile(pattern)
    for package in ("analysis", "boat_daq", "protocol"):
        for path in sorted((ROOT / package).rglob("*.py")):
            if held.search(text := path.read_text(encoding="utf-8")):
                yield path.relative_to(ROOT).as_posix(), ast.parse(text)


def posix_only(tree: ast.Module) -> set[str]:
    """Return what a module uses that Windows lacks; its docstrings are no use."""
    found = set()
    texts = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else [alias.name for alias in node.names]
            found |= POSIX_MODULES.intersection(names)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.value.id in ("os", "select", "signal", "socket") and node.attr in POSIX_NAMES:
                found.add(f"{node.value.id}.{node.attr}")
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in texts:
            found |= {node.value} if node.value.startswith(POSIX_PATHS) else set()
    return found


def without_encoding(tree: ast.Module) -> list[int]:
    """Return the lines that open text in the encoding of the locale."""
    found = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        given = {keyword.arg for keyword in node.keywords}
        if isinstance(node.func, ast.Attribute) and getattr(node.func.value, "id", "") in ("os", "webbrowser"):
            continue
        if name in ("read_text", "write_text"):
            bare = "encoding" not in given and len(node.args) <= TEXT_CALLS[name]
        elif name in ("run", "Popen", "check_output"):
            bare = any(k.arg in ("text", "universal_newlines") for k in node.keywords) and "encoding" not in given
        elif name == "open" and isinstance(node.func, ast.Attribute):  # of a path: its mode is the first
            mode = str(getattr(node.args[0], "value", "b")) if node.args else "b"
            bare = "encoding" not in given and bool(re.fullmatch(r"[rwax]\+?t?", mode))
        else:
            bare = name == "open" and isinstance(node.func, ast.Name) and "encoding" not in given and len(node.args) < 3
            bare = bare and not any("b" in str(getattr(a, "value", "")) for a in node.args[1:2])
        if bare:
            found.append(node.lineno)
    return found


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("import os\nos.getuid()", {"os.getuid"}),
        ("def f():\n    import fcntl", {"fcntl"}),
        ("port = '/dev/ttyACM0'", {"/dev/ttyACM0"}),
        ("'''Open /dev/ttyACM0.'''\nimport os\nos.getpid()", set()),
    ],
)
def test_what_windows_lacks_is_found(source: str, found: set[str]) -> None:
    assert posix_only(ast.parse(source)) == found


def test_what_windows_lacks_is_used_only_where_it_is_guarded() -> None:
    """Each module of the table still uses something, and no other does."""
    names = "|".join(POSIX_MODULES | POSIX_NAMES)
    pattern = rf"(import|from|os\.|select\.|signal\.|socket\.) ?({names})\b|{'|'.join(POSIX_PATHS)}"
    used = {name: found for name, tree in modules(pattern) if (found := posix_only(tree))}
    assert {name: found for name, found in used.items() if name not in GUARDED} == {}
    assert set(GUARDED) - set(used) == set()


def test_text_is_never_read_or_written_in_the_encoding_of_the_locale() -> None:
    assert without_encoding(
        ast.parse("open('a')\nopen('a', 'rb')\np.read_text()\np.write_text('x', 'utf-8')\np.open('w')")
    ) == [
        1,
        3,
        5,
    ]
    pattern = r"\bopen\(|read_text|write_text|subprocess"
    assert {name: lines for name, tree in modules(pattern) if (lines := without_encoding(tree))} == {}


def test_names_of_recordings_hold_on_every_system() -> None:
    name = dated_name("SA1").name
    check_file_name(name)
    assert ":" not in name
