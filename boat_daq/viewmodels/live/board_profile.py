"""A profile for a board with another firmware: its output, the proposed profile, the preview, the commands.

Rules: nothing is sent to the port. The preview comes from the program's own decoder. Limits and commands are entered by
the operator, never proposed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from boat_daq.engine.link.opening import PortListener
from boat_daq.engine.settings import Settings
from boat_daq.formatting import number, plain_number
from protocol.base.errors import ProfileError, RequestError
from protocol.base.whole_file import write_whole
from protocol.link.events import Samples
from protocol.text.connection import TextConnection
from protocol.text.packets import parse_format
from protocol.text.profile import COMMANDS, TextProfile, load_profile
from protocol.text.proposal import ENOUGH, Proposal, ProposedField, propose_any

RAW_LINES, RAW_BYTES, RAW_MAX = 10, 16, 200  # lines shown; bytes and characters of one
PREVIEW_BYTES = 60_000  # the newest, that the preview decodes
PREVIEW_ROWS = 4
_SETTLED_S = 4.0  # of listening, after which the proposal stays: the operator reads it
AGAIN_BYTES = 300  # more than before, for another proposal of a board that has only begun to print
MEANINGS = ("time", "index", "pressure")
_PARTS = {"signal": "Sensor {n}", "lit": "Sensor {n}, lit", "dark": "Sensor {n}, dark"}
LEFT_OUT = "_"
COMMAND_LABELS = {
    "set_pressure": "Set the pressure", "vent": "Vent", "start": "Start sampling", "stop": "Stop sampling",
    "heartbeat": "Heartbeat", "identify": "Identify", "clear_fault": "Clear a fault", "set_limits": "Set the limits",
}  # fmt: skip
DEVICE = {  # key -> label, unit
    "rate_hz": ("Rate", "Hz"), "vref_mv": ("Reference of the ADC", "mV"), "adc_bits": ("Bits of the ADC", ""),
    "low_kpa": ("Lowest pressure", "kPa"), "high_kpa": ("Highest pressure", "kPa"),
}  # fmt: skip


def meaning_choices() -> list[tuple[str, str]]:
    """Return the meanings of a field as (text, name in the profile); any other text names an extra channel."""
    sensors = [(text.format(n=n), f"s{n}_{part}") for n in range(1, 5) for part, text in _PARTS.items()]
    return [*((name.capitalize(), name) for name in MEANINGS), *sensors, ("left out", LEFT_OUT)]


@dataclass(frozen=True, slots=True)
class Preview:
    """The newest samples as decoded; `remark` counts the good lines, or gives the reason without a profile."""

    headings: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    remark: str = ""
    good: bool = False


class BoardProfile:
    """A profile in the making."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._listener: PortListener | None = None
        self._data, self._seconds = b"", 0.0
        self._proposed_from = 0  # bytes
        self._edited = False
        self.proposal: Proposal | None = None
        self.problem = ""
        self.name = "Own board"

    @property
    def listening(self) -> bool:
        """Return whether a port is open."""
        return self._listener is not None

    def listen(self, port: str) -> None:
        """Collect what a device sends."""
        if not port.strip():
            raise RequestError("no port is selected", "Select the port of the board.")
        self.stop()
        self._begin()
        self._listener = PortListener(port.strip(), self._settings)

    def open(self, path: Path) -> None:
        """Read a file of a board's output; OSError where it cannot be read."""
        self.stop()
        self._begin()
        with path.open("rb") as file:
            self._data = file.read(1_000_000)
        self._propose()

    def _begin(self) -> None:
        self._data, self._seconds, self._proposed_from = b"", 0.0, 0
        self.proposal, self.problem, self._edited = None, "", False

    def stop(self) -> None:
        """Close the port; what was collected stays."""
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    def follow(self) -> None:
        """Take what has come; propose again as long as nothing was edited."""
        if self._listener is None:
            return
        if self._listener.error is not None:
            error = self._listener.error
            self.stop()
            raise error
        self._data, self._seconds = self._listener.heard()
        new = len(self._data) - self._proposed_from
        settled = self.proposal is not None and self._seconds > _SETTLED_S
        if not (self._edited or settled) and new > max(AGAIN_BYTES, 0.2 * self._proposed_from):
            self._propose()

    def _propose(self) -> None:
        self._proposed_from, before = len(self._data), self.proposal
        try:
            self.proposal, self.problem = propose_any(self._data, self._seconds), ""
        except ProfileError as error:
            self.problem = f"{error.cause}: {error.remedy}"
            return
        if before is not None:
            stated = {key: getattr(before, key) for key in ("limits_kpa", "commands", "polarity")}
            self.proposal = replace(self.proposal, **stated)

    def raw(self) -> str:
        """Return the newest lines as they came, bytes that are no text as hexadecimal."""
        if self.proposal is not None and self.proposal.rx8:
            width = RAW_BYTES
            tail = self._data[-width * RAW_LINES :]
            return "\n".join(tail[at : at + width].hex(" ") for at in range(0, len(tail), width))
        text = self._data[-RAW_LINES * RAW_MAX :].decode("latin-1")
        lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")[-RAW_LINES - 1 :]
        return "\n".join("".join(c if c.isprintable() else "\u00b7" for c in line)[:RAW_MAX] for line in lines)

    def heard(self) -> str:
        """Return how much has come, as a line."""
        rate = f", {number(len(self._data) / self._seconds, 0)} bytes/s" if self._seconds else ""
        return f"{len(self._data)} bytes{rate}" if self._data else "Nothing has come yet."

    def set_field(self, at: int, **values: Any) -> None:
        """State meaning, unit or scale of a field."""
        if self.proposal is not None:
            self._edited = True
            self.proposal = self.proposal.with_field(at, **values)

    def set_scale(self, at: int, text: str) -> None:
        """State the scale of a field."""
        self.set_field(at, scale=_number(text, "the scale"))

    def set_device(self, key: str, text: str) -> None:
        """State a value of the device, one of `DEVICE`."""
        if self.proposal is None:
            return
        self._edited = True
        if key in ("low_kpa", "high_kpa"):
            low, high = self.proposal.limits_kpa
            value = _number(text, DEVICE[key][0].lower()) if text.strip() else None
            self.proposal = replace(self.proposal, limits_kpa=(value, high) if key == "low_kpa" else (low, value))
        else:
            value = _number(text or "0", DEVICE[key][0].lower())
            stated: dict[str, Any] = {key: value if key == "rate_hz" else round(value)}
            self.proposal = replace(self.proposal, **stated)

    def device_text(self, key: str) -> str:
        """Return a value of the device as text."""
        if self.proposal is None:
            return ""
        low, high = self.proposal.limits_kpa
        value = {"low_kpa": low, "high_kpa": high}.get(key, getattr(self.proposal, key, None))
        return "" if value in (None, 0) else f"{value:g}".replace("-", "\u2212")

    def set_falling(self, falling: bool) -> None:
        """State whether the voltage falls with light."""
        if self.proposal is not None:
            self.proposal = replace(self.proposal, polarity=-1 if falling else 1)

    def set_command(self, key: str, template: str) -> None:
        """State the template of a command; an empty one has none. Line ends are written as \\n and \\r."""
        if self.proposal is not None:
            commands = {**(self.proposal.commands or {}), key: _unescaped(template)}
            self.proposal = replace(self.proposal, commands={k: text for k, text in commands.items() if text})

    def set_rx8(self, line: str) -> None:
        """State the format of packets; variables of new names are extra channels."""
        if self.proposal is None:
            return
        self._edited = True
        known = {field.label: field for field in self.proposal.fields}
        names = [name for name, _ in parse_format(line).variables]
        fields = tuple(known.get(name, ProposedField(name, name)) for name in names)
        self.proposal = replace(self.proposal, rx8=" ".join(line.split()), fields=fields)

    def profile(self) -> TextProfile:
        """Return the profile as it stands."""
        if self.proposal is None:
            raise RequestError("there is no profile yet", self.problem or "Listen to the board first.")
        if self.proposal.missing:
            remedy = "Choose it among the fields: every recording needs a pressure and a signal."
            raise RequestError(self.proposal.missing, remedy)
        return load_profile(self.toml())

    def toml(self) -> str:
        """Return the profile as TOML."""
        return tomli_w.dumps(self.proposal.content(self.name)) if self.proposal is not None else ""

    def preview(self) -> Preview:
        """Return what the decoder makes of the newest bytes with the profile as it stands."""
        try:
            profile = self.profile()
        except (RequestError, ProfileError) as error:
            return Preview(remark=f"{error.cause}. {error.remedy[:1].upper()}{error.remedy[1:]}")
        link = TextConnection(profile)
        events = link.receive(self._data[-PREVIEW_BYTES:], 0)
        samples = [event.array for event in events if isinstance(event, Samples)]
        counts = link.statistics
        damaged = counts.malformed + counts.crc_errors + counts.oversize
        good = sum(map(len, samples))
        remark = f"{good} samples read, {damaged} lines not"
        fine = bool(samples) and good >= ENOUGH * (good + damaged)
        if not samples:
            return Preview(remark=remark)
        return Preview(*_table(np.concatenate(samples)[-PREVIEW_ROWS:], profile), remark, fine)

    def dry_run(self) -> dict[str, str]:
        """Return what would be sent for each command, with an example of its values; nothing is sent."""
        templates: Mapping[str, str] = (self.proposal.commands if self.proposal is not None else None) or {}
        shown = dict.fromkeys(COMMANDS, "")
        for key, text in templates.items():
            try:
                shown[key] = _shown(_compiled(key, text))
            except ProfileError as error:
                shown[key] = f"\u25b2 {error.cause}. {error.remedy[:1].upper()}{error.remedy[1:]}"
        return shown

    def save(self, path: Path) -> None:
        """Write the profile."""
        self.profile()
        write_whole(path, self.toml())


def _compiled(key: str, text: str) -> bytes:
    from protocol.text.profile import compile_template

    return compile_template(key, text)(COMMANDS[key])


def _shown(data: bytes) -> str:
    """Return bytes as text, with \\n for a line end."""
    return data.decode("ascii").encode("unicode_escape").decode("ascii")


def _unescaped(text: str) -> str:
    """Return a text with the characters that \\n, \\r and \\t stand for."""
    return text.replace("\\n", "\n").replace("\\r", "\r").replace("\\t", "\t")


def escaped(text: str) -> str:
    """Return a template as it is typed: line ends as \\n and \\r."""
    return text.replace("\n", "\\n").replace("\r", "\\r").replace("\t", "\\t")


def _number(text: str, what: str) -> float:
    try:
        return plain_number(text)
    except ValueError:
        raise RequestError(f"{what}: {text!r:.40} is not a number", "Type a number, such as 0.1.") from None


def _table(samples: Any, profile: TextProfile) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """Return headings and rows of samples: time, pressure, signals, channels."""
    headings, columns = ["Time (s)", "Pressure (kPa)"], [samples["time_us"] * 1e-6, samples["pressure_pa"] / 1000]
    decimals = [3, 2]
    fields = ("signal_mv",) if profile.sample_kind == "signal" else ("lit", "dark")
    for n in range(profile.n_sensors):
        for field in fields:
            signal = field == "signal_mv"
            headings.append(f"Sensor {n + 1} (mV)" if signal else f"Sensor {n + 1}, {field}")
            columns.append(samples[field][:, n].astype(float))
            decimals.append(1 if signal else 0)
    for n, channel in enumerate(profile.channels):
        headings.append(f"{channel.title} ({channel.unit})" if channel.unit else channel.title)
        columns.append(samples["channel"][:, n])
        decimals.append(2)
    rows = zip(*columns, strict=True)
    texts = (tuple(number(float(v), d) for v, d in zip(row, decimals, strict=True)) for row in rows)
    return tuple(headings), tuple(texts)
