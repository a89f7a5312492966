"""Time and memory of the firmware on the chip: instructions that an emulated Cortex-M3 executed, one by one.

QEMU counts instructions, not cycles. Cycles are the upper bounds of the Cortex-M3's reference manual (ARM DDI 0337,
table of instruction timings; a taken branch refills the pipeline in three). Flash is slower than the processor: without
one hit in the PSoC's cache each other eight bytes of instructions, and each load as if it were from flash, cost another
five cycles at 67 MHz (`CyFlash_SetWaitCycles` of its library). The simulated actuator and the interrupts are left out;
they are not the firmware's.
"""

from __future__ import annotations

import itertools
import os
import re
import subprocess
import threading
from array import array
from collections import defaultdict
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import pytest

from protocol.link.messages import (
    ClearFault,
    Command,
    EventCode,
    Heartbeat,
    Identify,
    SetLimits,
    SetPressure,
    Start,
    Stop,
    Vent,
)
from tests.firmware.emulated_chip import ChipHost, EmulatedChip, compile_board, emulated, needs_chip, symbols

pytestmark = [needs_chip, pytest.mark.nightly]

CLOCK_HZ = 67e6
LOOP_S = 1e-3  # the main loop's longest pass
TICK_S = 10e-3
FLASH_BYTES, RAM_BYTES = 128 * 1024, 32 * 1024  # of the CY8C5667AXI-LP040
FLASH_LINE_BYTES, FLASH_WAIT_CYCLES = 8, 5
BRANCH_REFILL_CYCLES = 3
COMMANDS: list[Command] = [
    Identify(),
    Heartbeat(5000),
    SetLimits(-40_000, 50_000),
    Start(1000),
    SetPressure(50_000, 40_000),
    SetLimits(-40_000, 5_000),
    Vent(),
    ClearFault(),
    Stop(),
]


@dataclass(frozen=True, slots=True)
class Instruction:
    """One of the program: where the next one is, its cycles when it does not branch, and whether it loads."""

    next_address: int
    cycles: int
    loads: bool


def cycles_of(mnemonic: str, operands: str) -> int:
    """Return the most cycles of an instruction that does not branch."""
    name = mnemonic.split(".")[0]
    if name.startswith(("push", "pop", "ldm", "stm")):
        return 1 + operands.count(",") + 1 + 4 * operands.count("-")  # a range such as r4-r8 is at most five more
    if name.startswith(("ldrd", "strd")):
        return 3
    if name.startswith(("udiv", "sdiv")):
        return 12
    if name.startswith(("umlal", "smlal")):
        return 7
    if name.startswith(("umull", "smull")):
        return 5
    return 2 if name.startswith(("ldr", "str", "mla", "mls", "tbb", "tbh", "mrs", "msr")) else 1


def disassembled(program: Path) -> dict[int, Instruction]:
    """Return the instructions of a program by their addresses."""
    listing = subprocess.run(["arm-none-eabi-objdump", "-d", str(program)], capture_output=True, text=True, check=True)
    found = {}
    for line in listing.stdout.splitlines():
        part = re.match(r"\s*([0-9a-f]+):\t((?:[0-9a-f]{4} ?)+)\s*\t(\S+)\s*([^;@]*)", line)
        if part:
            address, size = int(part[1], 16), 2 * len(part[2].split())
            found[address] = Instruction(address + size, cycles_of(part[3], part[4]), part[3].startswith(("ld", "pop")))
    return found


def one_by_one() -> list[str]:
    """Return the options of an emulator that executes and logs one instruction at a time."""
    text = subprocess.run(["qemu-system-arm", "--version"], capture_output=True, text=True, check=True).stdout
    version = re.search(r"version (\d+)\.(\d+)", text)
    assert version is not None, text
    new = (int(version[1]), int(version[2])) >= (8, 1)
    return [*(("-accel", "tcg,one-insn-per-tb=on") if new else ("-singlestep",)), "-d", "exec,nochain"]


def traced(program: Path, folder: Path, drive: Callable[[EmulatedChip], None]) -> array[int]:
    """Return the address of every instruction executed while `drive` talks to the chip."""
    fifo, addresses = folder / "trace", array("L")
    os.mkfifo(fifo)

    def read() -> None:
        with fifo.open("rb") as lines:
            addresses.extend(int(line.split(b"/", 2)[1], 16) for line in lines if line.startswith(b"Trace"))

    reader = threading.Thread(target=read)
    reader.start()
    with emulated(program, options=["-icount", "shift=5", *one_by_one(), "-D", str(fifo)]) as chip:
        drive(chip)
    reader.join()
    return addresses


@dataclass(slots=True)
class Pass:
    """One call of `boat_poll` or `boat_receive`."""

    called: set[str]
    instructions: int = 0
    cycles: int = 0
    flash_reads: int = 0  # lines of instructions, each other than the one before, and loads

    @property
    def uncached_cycles(self) -> int:
        """Cycles without a hit in the flash's cache."""
        return self.cycles + FLASH_WAIT_CYCLES * self.flash_reads


def passes(program: Path, addresses: array[int]) -> list[Pass]:
    """Cut a trace into the calls of the two functions that the main loop calls."""
    code, names = disassembled(program), symbols(program)
    entry = {names[name] & ~1: name for name in names if name.startswith(("boat_", "read_", "send", "tell", "answer"))}
    starts = sorted(address for name, address in names.items() if address < 0x20000000)
    main, end_of_main = names["main"], next(address for address in starts if address > names["main"])
    interrupts = [
        (names[name], next(address for address in starts if address > names[name]))
        for name in ("systick_handler", "uart_receive_handler", "nmi_handler")
    ]
    found: list[Pass] = []
    now: Pass | None = None
    line = -1
    own = [a for a in addresses if not any(begin <= a < end for begin, end in interrupts)]
    for address, following in itertools.pairwise(own):
        name = entry.get(address)
        if now is None and name in ("boat_poll", "boat_receive"):
            now = Pass({name})
            found.append(now)
        if now is None:
            continue
        if main <= address < end_of_main:
            now = None
            continue
        if name is not None:
            now.called.add(name)
        instruction = code[address]
        now.instructions += 1
        now.cycles += instruction.cycles + BRANCH_REFILL_CYCLES * (following != instruction.next_address)
        now.flash_reads += (address // FLASH_LINE_BYTES != line) + instruction.loads
        line = address // FLASH_LINE_BYTES
    return found[:-1]  # the last one is not whole


def converse(chip: EmulatedChip) -> None:
    """Send every command and wait for its answer; samples come at 1 kHz from START to STOP, one event in between."""
    with closing(ChipHost(chip)) as host:
        for command in COMMANDS:
            host.command(command)
            if isinstance(command, (Start, SetPressure)):
                host.samples(30)
            if isinstance(command, Vent):
                with chip.halted() as debugger:
                    debugger.set_actuator(estop=1)
                host.until_event(EventCode.ESTOP_PRESSED)
                with chip.halted() as debugger:
                    debugger.set_actuator(estop=0)
                host.until_event(EventCode.ESTOP_RELEASED)


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the program of the board."""
    return compile_board(tmp_path_factory.mktemp("cost"))


@pytest.fixture(scope="module")
def kinds(program: Path) -> dict[str, list[Pass]]:
    """Return the passes of a session by what was done in them."""
    found = defaultdict(list)
    commands = iter(COMMANDS)
    for one in passes(program, traced(program, program.parent, converse)):
        if "answer" in one.called:
            kind = type(next(commands)).__name__
        else:
            works = {"boat_receive": "bytes", "tell": "event", "read_light": "sample", "boat_control_tick": "tick"}
            kind = " and ".join(work for name, work in works.items() if name in one.called) or "nothing due"
        found[kind].append(one)
    assert next(commands, None) is None
    return found


def test_a_pass_with_everything_at_once_takes_half_of_its_millisecond(
    kinds: dict[str, list[Pass]], capsys: pytest.CaptureFixture[str]
) -> None:
    """At 67 MHz, without a hit in the flash's cache: tick, sample, event and the longest command added up."""
    worst = {kind: max(found, key=lambda one: one.uncached_cycles) for kind, found in kinds.items()}
    with capsys.disabled():
        for kind, one in worst.items():
            print(
                f"\n{kind} ({len(kinds[kind])} passes): {one.instructions} instructions, {one.cycles} cycles, "
                f"{one.uncached_cycles} without cache, {1e6 * one.uncached_cycles / CLOCK_HZ:.0f} us",
                end="",
            )
    assert len(kinds["sample"]) > 30
    command = max(worst[type(command).__name__].uncached_cycles for command in COMMANDS)
    at_once = command + sum(worst[kind].uncached_cycles for kind in ("tick", "sample", "event"))
    assert at_once < 0.5 * LOOP_S * CLOCK_HZ
    second = 1000 * worst["sample"].uncached_cycles + worst["tick"].uncached_cycles / TICK_S
    with capsys.disabled():
        print(f"\nat once: {at_once} cycles; 1 kHz: {100 * second / CLOCK_HZ:.1f} % of the processor")
    assert second < 0.25 * CLOCK_HZ


def test_stack_and_sections_fit_the_psoc(program: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A painted stack after every command, fault and interrupt; the linker script has the PSoC's sizes."""
    with emulated(program) as chip:
        converse(chip)
        with chip.halted() as debugger:
            deepest = debugger.deepest_stack()
            ram = debugger.names["_stack_limit"] - debugger.names["_data"]
    table = subprocess.run(["arm-none-eabi-size", str(program)], capture_output=True, text=True, check=True).stdout
    text, data, *_ = map(int, table.splitlines()[1].split()[:3])
    with capsys.disabled():
        print(f"\nflash {text + data}, RAM {ram} without stack, deepest stack {deepest} bytes")
    assert 64 < deepest < 512
    assert ram + deepest < RAM_BYTES / 4
    assert text + data < FLASH_BYTES / 16
