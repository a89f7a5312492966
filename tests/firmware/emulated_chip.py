"""The firmware on an emulated Cortex-M3 (QEMU's machine mps2-an385), its UART on TCP or a pseudo-terminal.

An instruction takes a fixed time of the chip's (`-icount`). The chip's time follows the wall's and is never ahead of
it; on a busy computer it falls behind and catches up, so that the program on the chip never finds itself late for a
reason that is the computer's. Tests take 8 ns an instruction: the emulator is hardly faster, so that the chip does not
catch up at a pace at which its host's heartbeat comes too late. 32 ns are 67 MHz at 2.1 cycles an instruction and need
a quarter of a processor.

`python -m tests.firmware.emulated_chip [HOST:PORT]` builds it and runs it until Ctrl-C.
"""

from __future__ import annotations

import itertools
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import pytest

from protocol.link.framing import FrameReader
from protocol.link.messages import (
    Ack,
    BoardEvent,
    BoardMessage,
    Command,
    EventCode,
    Hello,
    Identify,
    Sample,
    decode_message,
    encode_command,
)
from tests.firmware.firmware_build import FIRMWARE, HERE, PORTABLE, WARNINGS

CORTEX_M3 = ["-mcpu=cortex-m3", "-mthumb", "-Os", "-ffunction-sections", "-fdata-sections"]
START, SCRIPT, MACHINE = (FIRMWARE / "cortex_m3" / name for name in ("start.c", "mps2.ld", "mps2_main.c"))
TOOLS = {"arm-none-eabi-gcc": "gcc-arm-none-eabi", "qemu-system-arm": "qemu-system-arm"}  # program: Debian package
EMULATOR = ["qemu-system-arm", "-M", "mps2-an385", "-display", "none", "-monitor", "none"]
REAL_TIME = ["-icount", "shift=3,align=on"]
LITTLE_LOAD = ["-icount", "shift=5,align=on"]
STACK_UNUSED = bytes.fromhex("a5a5a5a5")

needs_chip = pytest.mark.skipif(
    any(shutil.which(tool) is None for tool in TOOLS),
    reason=f"the emulated chip needs {' and '.join(TOOLS)} (Debian: {' '.join(TOOLS.values())}, or `make chip`)",
)


def compile_chip(program: Path, *sources: Path, options: tuple[str, ...] = ()) -> Path:
    """Compile the firmware, the chip's start-up and `sources` for a Cortex-M3, warnings as errors; return `program`."""
    flags = [*WARNINGS, *CORTEX_M3, "-g", f"-I{FIRMWARE}", f"-I{HERE / 'c'}"]
    link = ["-nostartfiles", "-Wl,--gc-sections", "-Wl,--no-warn-rwx-segments", "-T", str(SCRIPT)]
    files = map(str, [*PORTABLE, START, *sources])
    subprocess.run(["arm-none-eabi-gcc", *flags, *link, *files, *options, "-o", str(program)], check=True)
    return program


def compile_board(folder: Path) -> Path:
    """Return the program of the board with the simulated actuator, compiled without a library."""
    return compile_chip(folder / "board.elf", MACHINE, options=("-ffreestanding", "-nostdlib", "-lgcc"))


def compile_pipe(folder: Path) -> Path:
    """Return the program that reads requests from the emulator's standard input (c/pipe_board.c)."""
    renamed = folder / "pipe_board.c"
    renamed.write_text(f'#define main pipe_main\n#include "{HERE / "c" / "pipe_board.c"}"\n', encoding="utf-8")
    sources = [HERE / "c" / "host.c", HERE / "c" / "chip_pipe.c", renamed]
    options = ("--specs=rdimon.specs", "-Wl,--defsym=ram_bytes=4M", "-Wno-conversion", "-lm")
    return compile_chip(folder / "pipe.elf", *sources, options=options)


def pipe_command(program: Path) -> list[str]:
    """Return the command that runs a program of `compile_pipe`."""
    return [*EMULATOR, "-serial", "none", "-semihosting-config", "enable=on,target=native", "-kernel", str(program)]


def symbols(program: Path) -> dict[str, int]:
    """Return the address of each name in a program."""
    lines = subprocess.run(["arm-none-eabi-nm", str(program)], capture_output=True, text=True, check=True).stdout
    return {name: int(address, 16) for address, _, name in (line.split() for line in lines.splitlines())}


class Actuator(NamedTuple):
    """The simulated actuator of mps2_main.c, in its order."""

    kept: int
    reset_by: int
    ms: int
    opened_ms: int
    heard_ms: int
    overruns: int
    estop: int
    sensor_broken: int
    conversion_ms: int
    pressure_mpa: int
    flow_pa_per_s: int
    permille: int
    vent: int


_ACTUATOR = struct.Struct("<9I3iI")


class Debugger:
    """The emulator's debugger: the chip stands still while one is open (GDB's remote serial protocol)."""

    def __init__(self, path: Path, names: dict[str, int]) -> None:
        self.names = names
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(20)
        self._socket.connect(str(path))
        self._send("qC")
        while not self._receive().startswith("QC"):  # before it comes the notice that the processor has halted
            pass

    def read(self, name: str, size: int) -> bytes:
        """Return `size` bytes of the variable `name`."""
        return self._read(self.names[name], size)

    def write(self, name: str, data: bytes, *, offset: int = 0) -> None:
        """Set bytes of the variable `name`."""
        self.write_at(self.names[name] + offset, data)

    def write_at(self, address: int, data: bytes) -> None:
        """Set memory."""
        for at in range(0, len(data), 1024):
            part = data[at : at + 1024]
            assert self._request(f"M{address + at:x},{len(part):x}:{part.hex()}") == "OK"

    def fault(self) -> None:
        """Have the processor continue where there is no memory: a fault from which it does not return."""
        self._request("qXfer:features:read:target.xml:0,1")  # without this the emulator sets no single register
        assert self._request("Pf=" + struct.pack("<I", 0xE0000000).hex()) == "OK"

    def run_to(self, name: str) -> None:
        """Let the chip run until it comes to the function `name`."""
        self._run_until(f"0,{self.names[name]:x},2")

    def run_to_write(self, address: int, *, times: int) -> None:
        """Let the chip run until it has written so many times to an address."""
        for _ in range(times):
            self._run_until(f"2,{address:x},4")
            assert self._request("s").startswith("T05")

    def _run_until(self, point: str) -> None:
        assert self._request("Z" + point) == "OK"
        assert self._request("c").startswith("T05")
        assert self._request("z" + point) == "OK"

    def reset(self) -> None:
        """Pull the reset pin; RAM keeps what it holds."""
        self._send("qRcmd," + b"system_reset".hex())
        while self._receive() != "OK":
            pass

    def actuator(self) -> Actuator:
        """Return the simulated actuator as it is."""
        return Actuator(*_ACTUATOR.unpack(self.read("actuator", _ACTUATOR.size)))

    def set_actuator(self, **values: int) -> None:
        """Set fields of the simulated actuator."""
        for name, value in values.items():
            self.write("actuator", struct.pack("<i", value), offset=4 * Actuator._fields.index(name))

    def deepest_stack(self) -> int:
        """Return how many bytes of the stack were ever used, and at least 64."""
        limit, top = self.names["_stack_limit"], self.names["_stack_top"]
        stack = b"".join(self._read(at, min(1024, top - at)) for at in range(limit, top, 1024))
        return top - limit - next(at for at in range(0, len(stack), 4) if stack[at : at + 4] != STACK_UNUSED)

    def _read(self, address: int, size: int) -> bytes:
        return bytes.fromhex(self._request(f"m{address:x},{size:x}"))

    def close(self) -> None:
        """Let the chip run on."""
        self._request("D")
        self._socket.close()

    def _request(self, text: str) -> str:
        self._send(text)
        return self._receive()

    def _send(self, text: str) -> None:
        self._socket.sendall(f"${text}#{sum(text.encode()) % 256:02x}".encode())

    def _receive(self) -> str:
        found = bytearray()
        while b"#" not in found[:-2]:
            found += self._socket.recv(1)
        self._socket.sendall(b"+")
        return found[found.index(b"$") + 1 : found.rindex(b"#")].decode()


@dataclass(frozen=True)
class EmulatedChip:
    """A running emulator: its process, the port of the chip's UART, and where its debugger listens."""

    process: subprocess.Popen[bytes]
    url: str
    debugger_path: Path
    names: dict[str, int]

    @contextmanager
    def halted(self) -> Iterator[Debugger]:
        """Halt the chip, its clocks included, and let it run on afterwards."""
        debugger = Debugger(self.debugger_path, self.names)
        try:
            yield debugger
        finally:
            debugger.close()


class ChipHost:
    """A host of the chip's: sends commands and keeps every message in order."""

    def __init__(self, chip: EmulatedChip) -> None:
        host, port = chip.url.removeprefix("socket://").split(":")
        self.socket = socket.create_connection((host, int(port)), timeout=20)
        self.reader = FrameReader()
        self.messages: list[BoardMessage] = []
        self._seq = itertools.count()

    def send(self, command: Command) -> None:
        """Send a command, and wait for nothing."""
        self.socket.sendall(encode_command(command, next(self._seq) % 256))

    def command(self, command: Command) -> BoardMessage:
        """Send a command and return its answer."""
        self.send(command)
        return self.until(lambda message: isinstance(message, Hello if command == Identify() else Ack))

    def until(self, wanted: Callable[[BoardMessage], bool], *, timeout_s: float = 30.0) -> BoardMessage:
        """Return the next message that is wanted."""
        end_s = time.monotonic() + timeout_s
        while time.monotonic() < end_s:
            new = [decode_message(frame, 2) for frame in self.reader.receive(self.socket.recv(4096))]
            self.messages += (known := [message for message in new if message is not None])
            for message in known:
                if wanted(message):
                    return message
        raise AssertionError(f"not received: {self.messages[-5:]}")

    def until_event(self, code: EventCode) -> BoardEvent:
        """Return the next event of that code."""
        found = self.until(lambda message: isinstance(message, BoardEvent) and message.code == code)
        assert isinstance(found, BoardEvent)
        return found

    def samples(self, n: int) -> list[Sample]:
        """Return the next `n` samples or more."""
        before = len(self.kept_samples)
        self.until(lambda _: len(self.kept_samples) >= before + n)
        return self.kept_samples[before:]

    @property
    def kept_samples(self) -> list[Sample]:
        """All samples so far."""
        return [message for message in self.messages if isinstance(message, Sample)]

    def close(self) -> None:
        """Leave the port."""
        self.socket.close()


@contextmanager
def emulated(program: Path, *, address: str = "", options: list[str] | None = None) -> Iterator[EmulatedChip]:
    """Run a program of `compile_board`; its UART listens on TCP.

    Parameters
    ----------
    address : "HOST:PORT" of the UART; any free port when empty.
    options : timing options of the emulator, in place of `REAL_TIME`.
    """
    place = address or f"127.0.0.1:{free_port()}"
    with tempfile.TemporaryDirectory() as folder:
        debugger = Path(folder) / "debugger"
        uart = ["-serial", f"tcp:{place},server=on,wait=off,nodelay=on"]
        stub = ["-chardev", f"socket,path={debugger},server=on,wait=off,id=debugger", "-gdb", "chardev:debugger"]
        command = [*EMULATOR, *(REAL_TIME if options is None else options), *uart, *stub, "-kernel", str(program)]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
            try:
                until_listening(process, place)
                yield EmulatedChip(process, f"socket://{place}", debugger, symbols(program))
            finally:
                process.kill()


def free_port() -> int:
    """Return a TCP port of this computer that nobody listens on."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def until_listening(process: subprocess.Popen[bytes], place: str) -> None:
    """Wait until the UART listens."""
    host, port = place.rsplit(":", 1)
    end_s = time.monotonic() + 10
    while True:
        try:
            socket.create_connection((host, int(port)), timeout=1).close()
        except OSError:
            assert process.poll() is None, f"the emulator has ended: is {place} free?"
            assert time.monotonic() < end_s, "the emulator does not listen"
            time.sleep(0.01)
        else:
            return


def main() -> None:
    """Build the board and run it until Ctrl-C or SIGTERM."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    with tempfile.TemporaryDirectory() as folder:
        program = compile_board(Path(folder))
        with emulated(program, address=sys.argv[1] if len(sys.argv) > 1 else "", options=LITTLE_LOAD) as chip:
            print(chip.url, flush=True)
            try:
                chip.process.wait()
            except KeyboardInterrupt:
                return


if __name__ == "__main__":
    main()
