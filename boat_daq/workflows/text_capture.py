"""Captured text of a serial monitor into a `Recording`, by the text profile that a live port is read with."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from analysis.data.recording import Recording
from protocol.base.errors import FileError
from protocol.base.regular_file import read_regular
from protocol.link.events import Samples
from protocol.text.connection import TextConnection
from protocol.text.profile import TextProfile, load_profile

CAPTURE_MAX_BYTES = 1 << 30
_MONITOR_STAMP = re.compile(rb"^\[?\d{1,2}:\d{2}:\d{2}[.:]\d{3}\]?\s*(?:->|>|:)?\s+", re.MULTILINE)


def import_capture(path: Path, profile: str | Path) -> Recording:
    """Import captured text by a text profile: a file, or its TOML. FileError: no line is as the profile says.

    A last line without an end, and lines that are not as the profile says, are left out and named; the stamps of a
    serial monitor before the lines are ignored.
    """
    described = load_profile(profile)
    try:
        text = _MONITOR_STAMP.sub(b"", read_regular(path, CAPTURE_MAX_BYTES))
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror or error}", "Check name and permissions.") from error
    link = TextConnection(described)
    events = link.receive(b"\n" + text, 0)  # nothing is torn before the first line
    blocks = [event.array for event in events if isinstance(event, Samples)]
    if not blocks:
        raise FileError(f"no line of {path.name} is as the text profile says", "Propose the profile of this file.")
    samples = np.concatenate(blocks)
    notes = []
    if link.statistics.malformed:
        notes.append(f"{link.statistics.malformed} lines are not as the text profile says: left out")
    if not text.endswith((b"\n", b"\r")):
        notes.append("the last line has no end: left out")
    return _recording(path, described, samples, notes)


def _recording(path: Path, profile: TextProfile, samples: np.ndarray, notes: list[str]) -> Recording:
    meta = {
        "imported_from": path.name, "import_map": {}, "import_text_profile": profile.toml, "import_notes": notes,
        "simulated": profile.simulated, "polarity": profile.polarity,
        **({"channels": [list(channel) for channel in profile.channels]} if profile.channels else {}),
    }  # fmt: skip
    counts = "lit" in (samples.dtype.names or ())
    parts = {}
    if counts:
        meta |= {"vref_mv": profile.vref_mv, "adc_bits": profile.adc_bits}
        parts = {"lit": samples["lit"], "dark": samples["dark"]}
        signal = (samples["lit"].astype(float) - samples["dark"]) * profile.vref_mv / 2.0**profile.adc_bits
    else:
        signal = samples["signal_mv"]
    return Recording.from_arrays(
        (samples["time_us"] - samples["time_us"][0]) / 1e6, samples["pressure_pa"] / 1000.0, signal, **parts,
        flags=samples["flags"], channel=samples["channel"] if profile.channels else None, meta=meta, source=str(path),
    )  # fmt: skip
