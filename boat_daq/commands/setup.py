"""`boat-daq setup`: what is compiled at its first use, compiled now."""

from __future__ import annotations

import time

from boat_daq.commands.console import JsonOption, notify, present

_TEXTS = {"calibration": "the inverse of calibrations", "rays": "the ray tracer", "shadow": "the finite elements"}


def setup(as_json: JsonOption = False) -> None:
    """Compile the parts that are compiled at their first use, so that no first call waits: once for each version.

    Example: boat-daq setup
    """
    from analysis.compile_all import compile_all
    from analysis.compiled import CACHE_FOLDER

    before = time.process_time()
    compiled = compile_all(notify=lambda step: notify(f"compiling {_TEXTS[step]}"))
    cpu_s, folder = time.process_time() - before, str(CACHE_FOLDER or "")
    text = f"compiled in {cpu_s:.0f} s of CPU time, kept in {folder}" if compiled else f"all is compiled, in {folder}"
    present({"compiled": compiled, "cpu_s": cpu_s, "folder": folder}, text, as_json=as_json)
