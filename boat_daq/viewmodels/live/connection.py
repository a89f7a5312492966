"""The link as text for the header; ports, profiles, connecting, the virtual board.

Rules: a board is identified by its own hello, never by the name of its port; the last port is listed first, but never
opened automatically. The virtual board runs in its own process and is reached through a port like any other.

A profile is TOML, the path of one, or the RX8 line of a Bridge Control Panel, which names its variables but not their
meaning. As in the profile that is shipped, S1, S2 .. are signals in counts, T is milliseconds, P is hundredths of a kPa
with a sign, I is the index; every other variable is an extra channel. Other units need a profile in TOML.
"""

from __future__ import annotations

import os
import re
import threading
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from boat_daq.engine.link.opening import PortIdentity, identify_known, listed_ports
from boat_daq.engine.link.ports import list_ports
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings, ServedBoard, serve
from boat_daq.engine.snapshot import LinkState, SessionSnapshot
from boat_daq.formatting import duration, number
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.workflows.jobs import Background
from protocol.base.errors import RequestError
from protocol.simulator.specimens import RISING_NAMES, SENSOR_COUNTS
from protocol.text.packets import parse_format
from protocol.text.profile import load_profile

LONGEST_PORT = 28
_DIGIT = "\u2007"  # a space as wide as a digit: a longer delay moves nothing
ENDED = (LinkState.CLOSED, LinkState.FAILED)  # a link that another one may replace
VIRTUAL_UNITS = RISING_NAMES
VIRTUAL_SENSORS = {"2": "", **{n: f"x{n}" for n in SENSOR_COUNTS if n != "2"}}  # -> ending of the unit's name
_SENSOR = re.compile(r"(?:s|sensor|ch)_?([1-4])(?:_?(signal|lit|dark|on|off))?", re.IGNORECASE)
_PARTS = {None: "signal", "signal": "signal", "lit": "lit", "on": "lit", "dark": "dark", "off": "dark"}
_OTHERS = (
    (re.compile(r"p|press(?:ure)?", re.IGNORECASE), '{ name = "pressure", unit = "kPa", scale = 0.01, signed = true }'),
    (re.compile(r"t|time|tick", re.IGNORECASE), '{ name = "time", unit = "ms" }'),
    (re.compile(r"i|index|count(?:er)?", re.IGNORECASE), '"index"'),
)


@dataclass(frozen=True, slots=True)
class LinkText:
    """The link as text: a state by which it is coloured, a shape and a word, never a colour alone."""

    state: str  # "ok", "warning", "fault", "off"
    shape: str
    word: str
    doing: str  # what the program does about it
    who: str
    figures: tuple[tuple[str, str], ...]  # (text, state) of rate, lost, errors, lag


_LINK_TEXT = {
    LinkState.CLOSED: ("off", "\u25cb", "not connected"),
    LinkState.OPENING: ("warning", "\u25d4", "opening \u2026"),
    LinkState.UP: ("ok", "\u25cf", "connected"),
    LinkState.SILENT: ("warning", "\u25b2", "no data"),
    LinkState.LOST: ("fault", "\u25a0", "disconnected"),
    LinkState.FAILED: ("fault", "\u25a0", "not connected"),
}


def link_text(snapshot: SessionSnapshot) -> LinkText:
    """Return the link as the header shows it."""
    state, shape, word = _LINK_TEXT[snapshot.link]
    who = snapshot.hello.board_id if snapshot.hello else short_port(snapshot.port or "")
    doing = ", searching" if snapshot.link is LinkState.LOST else ""
    return LinkText(state, shape, word, doing, who, _figures(snapshot))


def short_port(port: str) -> str:
    """Return a port shortened for the header: a long name by its end."""
    return port if len(port) <= LONGEST_PORT else f"\u2026{port[-LONGEST_PORT:]}"


def age_s(snapshot: SessionSnapshot) -> float | None:
    """Return the age of the last data, s, where none arrive any more; None while they do, or where there were none."""
    if snapshot.link is LinkState.UP or snapshot.health is None or snapshot.last is None:
        return None
    return snapshot.health.silent_s


def age_text(snapshot: SessionSnapshot) -> str:
    """Return the age of the last data as text, e.g. `0:12 ago`; empty while data arrive."""
    age = age_s(snapshot)
    return f"{duration(age)} ago" if age is not None else ""


def _figures(snapshot: SessionSnapshot) -> tuple[tuple[str, str], ...]:
    health = snapshot.health
    if health is None or snapshot.link not in (LinkState.UP, LinkState.SILENT, LinkState.LOST):
        return ()
    counts = health.statistics
    off = health.asked_hz and health.rate_hz and abs(health.rate_hz / health.asked_hz - 1) > 0.05
    damaged = counts.crc_errors + counts.malformed
    rate = f"{number(health.rate_hz or None, 1)} Hz".ljust(len("100.0 Hz"), _DIGIT)  # what follows stays in its place
    age = age_text(snapshot)
    lag = f"{number(health.lag_ms, 0)} ms" if health.lag_ms < 1000 else f"{number(health.lag_ms / 1000, 1)} s"
    delay = "" if age else f"Delay {lag}".ljust(len("Delay 100 ms"), _DIGIT)
    return (
        (f"Last data {age}", "off") if age else (rate, "warning" if off else ""),
        (f"{counts.lost} lost", "warning" if counts.lost else ""),
        (f"{damaged} damaged", "warning" if damaged else ""),
        (delay, "warning" if health.late else ""),
    )


def profile_text(pasted: str) -> str:
    """Return the profile for the session: an RX8 line as TOML, any other text unchanged."""
    line = pasted.strip()
    if not line.lower().startswith("rx8"):
        return line
    variables = [name for name, _ in parse_format(line).variables]
    entries = {name: entry for name in variables if (entry := meaning(name))}
    sensors = {match[1] for name in variables if (match := _SENSOR.fullmatch(name))}
    if not sensors:
        cause = f"the RX8 line has no sensor: {', '.join(variables)}"
        raise RequestError(cause, "Name the signals S1 and S2 in the RX8 line.")
    if not any('"pressure"' in entry for entry in entries.values()):
        remedy = "Name its bytes P, such as @1P @0P: hundredths of a kPa, with a sign. Other units: a profile in TOML."
        raise RequestError("the RX8 line has no pressure, which every recording needs", remedy)
    rows = "\n".join(f"{name} = {entry}" for name, entry in entries.items())
    return f"""name = "Pasted RX8 line"
kind = "rx8"
device = {{ n_sensors = {len(sensors)}, rate_hz = 100, vref_mv = 3300, adc_bits = 12, polarity = -1 }}
rx8.format = "{line}"
[rx8.variables]
{rows}
"""


def meaning(variable: str) -> str:
    """Return the TOML entry of a variable by its name; empty for an unknown one."""
    match = _SENSOR.fullmatch(variable)
    if match is not None:
        part = _PARTS[match[2].lower() if match[2] else None]
        return f'{{ name = "s{match[1]}_{part}", unit = "counts" }}' if part == "signal" else f'"s{match[1]}_{part}"'
    return next((entry for pattern, entry in _OTHERS if pattern.fullmatch(variable)), "")


def _board_text(answer: PortIdentity) -> str:
    """Return how a board that was used before is listed: by its identity, where it has answered."""
    identity = f"\u25cf BOAT board {answer.hello.board_id}" if answer.hello is not None else "\u25cb board"
    return f"{identity} of {answer.unit}"


class VirtualBoardProcess:
    """A virtual board in its own process, started in the background; `url` is its port once it is ready."""

    def __init__(self, unit: str, speed: float) -> None:
        self._folder = TemporaryDirectory(prefix="boat-daq-")
        self._truth = Path(self._folder.name) / "truth.csv"
        port = "pty" if os.name == "posix" else "127.0.0.1:0"
        camera = 0 if find_spec("cv2") is not None else None
        self._settings = BoardSettings(port=port, speed=speed, unit=unit, truth=str(self._truth), mjpeg=camera)
        self._served: ServedBoard | None = None
        self.unit = unit
        self.error: Exception | None = None
        self._thread = threading.Thread(target=self._start, name="virtual board", daemon=True)
        self._thread.start()

    def _start(self) -> None:
        try:
            self._served = serve(self._settings)
        except Exception as error:  # noqa: BLE001 - raised by `ConnectionModel.tick`, on the window's thread
            self.error = error

    @property
    def url(self) -> str:
        """Return the port of the board; empty while it starts."""
        return self._served.url if self._served is not None else ""

    @property
    def camera_url(self) -> str:
        """Where its virtual camera is; empty while it starts."""
        return self._served.camera_url if self._served is not None else ""

    def grid_mm(self, division_mm: float = 0.5) -> float | None:
        """Return the elongation on the simulated grid now, to the nearest division; None if it is unknown."""
        try:
            with self._truth.open("rb") as file:
                file.seek(max(0, self._truth.stat().st_size - 512))
                line = file.read().decode().rpartition("\n")[0].rpartition("\n")[2]
            return round(float(line.split(",")[4]) / division_mm) * division_mm
        except (OSError, ValueError, IndexError):
            return None

    def close(self) -> None:
        self._thread.join()
        if self._served is not None:
            self._served.close()
        self._folder.cleanup()


class ConnectionModel:
    def __init__(self, session: Session, preferences: Preferences, units: UnitLibrary) -> None:
        self.session = session
        self._preferences, self._units = preferences, units
        self.board: VirtualBoardProcess | None = None
        self.starting = False  # whether the virtual board is
        self.answers: list[PortIdentity] = []  # of the last query
        self._query: Background[list[PortIdentity]] = Background("ports")

    @property
    def unit(self) -> str:
        """Return the unit under test: that of the virtual board while there is one, else the unit on the bench."""
        return self.board.unit if self.board is not None else self.bench_unit

    @property
    def bench_unit(self) -> str:
        """Return the unit on the bench, which no virtual board changes."""
        return str(self._preferences.get("unit", "SA1"))

    def ports(self) -> list[tuple[str, str]]:
        """Return the ports as (text, port), those of BOAT boards first, then the last one used."""
        found, last = {p.port: p.description for p in list_ports()}, self._preferences.get("port", "")
        known = {a.port: a for a in self.answers if a.port in found and a.unit}
        found |= {port: _board_text(answer) for port, answer in known.items()}
        order = sorted(found, key=lambda port: (port not in known, port != last, port))
        return [(f"{port}   {found[port]}".strip(), port) for port in order]

    def unit_at(self, port: str) -> str:
        """Return the unit that the board at a port was used with; empty for an unknown one, or for several units."""
        units = {answer.unit for answer in self.answers if answer.port == port}
        return next((unit for unit in units if ", " not in unit), "")

    def query_boards(self) -> None:
        """Query the boards used before, on a helper thread; other ports may be those of other instruments."""
        if not self._query.pending and self.session.snapshot().link is LinkState.CLOSED:
            self._query.call(lambda: identify_known(listed_ports(self._units.boards())))

    def take_answers(self) -> bool:
        """Take the answers once they have arrived; return whether they have."""
        answers = self._query.take()
        if answers is not None:
            self.answers = answers
        return answers is not None

    def set_unit(self, unit: str) -> None:
        if not unit.strip():
            raise RequestError("the unit has no name", "Enter the name on its label, such as SA1.")
        self._preferences.set("unit", unit.strip())

    def connect(self, port: str, profile: str = "") -> None:
        if not port.strip():
            raise RequestError("no port is selected", "Select a port, or start the virtual board.")
        text = profile_text(profile)
        if text:
            load_profile(text)  # refused here, before a port is opened with it
        if self.board is not None and port.strip() != self.board.url and self.session.snapshot().link in ENDED:
            self._end_board()
        self.session.connect(port.strip(), text or None, unit=self.unit)
        if self.board is None or port != self.board.url:
            self._preferences.set("port", port.strip())
        self._preferences.set("profile", profile)

    def disconnect(self) -> None:
        """Vent and close the link; end the virtual board."""
        self.starting = False
        self.session.disconnect()
        self._end_board()

    def start_virtual_board(self, unit: str = "SA1", speed: float = 1.0) -> None:
        """Start a virtual board; `tick` connects to it once its port is known. RequestError: a board is connected."""
        if self.starting or self.session.snapshot().link not in ENDED:
            raise RequestError("a board is connected", "Disconnect it, then start the virtual board.")
        self._end_board()
        self.board = VirtualBoardProcess(unit, speed)
        self.starting = True

    @property
    def virtual_camera(self) -> str:
        """Return where the camera of this window's virtual board is; empty without one."""
        return self.board.camera_url if self.board is not None and not self.starting else ""

    def simulated_mm(self) -> float | None:
        """Return the elongation on the simulated grid, mm; None without a virtual board of this window."""
        return self.board.grid_mm() if self.board is not None else None

    def tick(self) -> None:
        """Connect to the virtual board once it is ready; raise the error of one that did not start."""
        if not self.starting or self.board is None:
            return
        if self.board.error is not None:
            error, self.starting = self.board.error, False
            self._end_board()
            raise error
        if self.board.url:
            self.starting = False
            self.connect(self.board.url)

    def close(self) -> None:
        """End the helper thread and the virtual board."""
        self._query.close()
        self._end_board()

    def _end_board(self) -> None:
        if self.board is not None:
            self.board.close()
            self.board = None
