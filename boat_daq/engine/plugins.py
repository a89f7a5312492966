"""Plugins of the lab: packages with entry points `boat_daq.hooks` and `boat_daq.figures`.

A plugin runs in a process of its own with a limit of time, so that one which raises, hangs, prints or crashes never
harms a run: it is named in a warning. Its process gets JSON and returns JSON. Which plugins there are is read from the
metadata of the installed packages; none is imported here.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from importlib.metadata import entry_points
from typing import Any

from boat_daq.engine.log import note
from boat_daq.own_packages import start_module

HOOKS, FIGURES = "boat_daq.hooks", "boat_daq.figures"
HOOK_S, FIGURE_S, CLOSING_S = 10.0, 30.0, 12.0
RESULT_MAX = 1_000_000
WAITING_MAX = 100
Warn = Callable[[str, str], None]  # takes cause and remedy


def installed(group: str) -> tuple[str, ...]:
    """Return the names of the plugins of a group; none in a bundle, which has no packages of the lab."""
    if getattr(sys, "frozen", False):
        return ()
    return tuple(sorted({found.name for found in entry_points(group=group)}))


def call(group: str, name: str, function: str, arguments: Mapping[str, Any], timeout_s: float) -> tuple[Any, str]:
    """Call a plugin and wait for it.

    Parameters
    ----------
    timeout_s : after which its process, and all that it started, is killed.

    Returns
    -------
    What it returned, and why it failed: "" where it did not.
    """
    pipe = subprocess.PIPE
    process = start_module(
        "boat_daq.plugin_process", group, name, stdin=pipe, stdout=pipe, stderr=pipe, start_new_session=True
    )
    text = json.dumps([function, dict(arguments)], default=str).encode()
    try:
        out, err = process.communicate(text, timeout_s)
    except subprocess.TimeoutExpired:
        with contextlib.suppress(OSError, AttributeError):
            os.killpg(process.pid, signal.SIGKILL)
        process.kill()
        process.communicate()
        return None, f"it did not end within {timeout_s:g} s"
    printed = err.decode("utf-8", "replace").strip()
    if printed:
        note("info", f"plugin {name} printed: {printed[-2000:]}")
    if process.returncode:
        return None, printed.splitlines()[-1][:200] if printed else f"its process ended with code {process.returncode}"
    if len(out) > RESULT_MAX:
        return None, f"its result has more than {RESULT_MAX} bytes"
    try:
        return json.loads(out), ""
    except ValueError:
        return None, "its result cannot be read"


def run_hooks(event: str, arguments: Mapping[str, Any], warn: Warn) -> None:
    """Call every hook with an event, one after the other; each that fails is named."""
    for name in installed(HOOKS):
        _, failure = call(HOOKS, name, event, arguments, HOOK_S)
        if failure:
            warn(f"the plugin {name} failed in {event}: {failure}", "correct it, or uninstall its package")


class Hooks:
    """Calls hooks from a thread of its own; without hooks there is no thread."""

    def __init__(self, warn: Warn) -> None:
        self._warn = warn
        self._waiting: queue.Queue[tuple[str, dict[str, Any]] | None] = queue.Queue(WAITING_MAX)
        self._thread: threading.Thread | None = None
        if installed(HOOKS):
            self._thread = threading.Thread(target=self._run, name="hooks", daemon=True)
            self._thread.start()

    def emit(self, event: str, **arguments: Any) -> None:
        """Have an event passed on; returns at once. Beyond `WAITING_MAX` that wait, it is left out and logged."""
        if self._thread is None:
            return
        try:
            self._waiting.put_nowait((event, arguments))
        except queue.Full:
            note("warning", f"the hooks are too slow: {event} is left out")

    def close(self) -> None:
        """Let the hooks end what waits, for a while."""
        if self._thread is not None:
            with contextlib.suppress(queue.Full):
                self._waiting.put_nowait(None)
            self._thread.join(CLOSING_S)

    def _run(self) -> None:
        while (taken := self._waiting.get()) is not None:
            run_hooks(*taken, self._warn)


def lab_figures(run: str, analysis: Mapping[str, Any], warn: Warn) -> list[dict[str, Any]]:
    """Return the figures of the lab's plugins: label, unit, a value for each sensor or one, and the plugin's name."""
    found = []
    for name in installed(FIGURES):
        returned, failure = call(FIGURES, name, "", {"run": run, "analysis": analysis}, FIGURE_S)
        try:
            found += [] if failure else [_figure(entry, name) for entry in returned]
        except (TypeError, ValueError, KeyError) as error:
            failure = f"a figure needs label, unit and values: {error!r}"
        if failure:
            warn(f"the figures of the plugin {name} failed: {failure}", "correct it, or uninstall its package")
    return found


def _figure(entry: Mapping[str, Any], plugin: str) -> dict[str, Any]:
    values = [float(value) if value is not None else float("nan") for value in entry["values"]]
    return {"label": str(entry["label"])[:60], "unit": str(entry["unit"])[:20], "values": values, "plugin": plugin}
