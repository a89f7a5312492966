"""Memory of the firmware on the chip: less than 4 KiB of flash as compiled for its Cortex-M3, and no library."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.firmware.firmware_build import FIRMWARE, HERE, PORTABLE, WARNINGS

FLASH_MAX = 4096
RAM_MAX = 1024
CORTEX_M3 = ["-mcpu=cortex-m3", "-mthumb", "-Os", "-ffunction-sections", "-fdata-sections"]

pytestmark = pytest.mark.skipif(
    shutil.which("arm-none-eabi-gcc") is None,
    reason="arm-none-eabi-gcc is not on this computer (Debian: gcc-arm-none-eabi): flash is not measured",
)


@pytest.fixture(scope="module")
def sizes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, int]:
    """Sizes of the sections of a program that is the firmware and nothing else, and of its variables."""
    folder = tmp_path_factory.mktemp("flash")
    objects = []
    for source in [*PORTABLE, HERE / "c" / "flash_entry.c", HERE / "c" / "flash_hardware.c"]:
        objects.append(str(folder / f"{source.stem}.o"))
        command = ["arm-none-eabi-gcc", *WARNINGS, *CORTEX_M3, f"-I{FIRMWARE}", "-c", str(source), "-o", objects[-1]]
        subprocess.run(command, check=True)
    program = folder / "program.elf"
    link = ["-nostdlib", "-Wl,--gc-sections", "-Wl,-e,flash_entry", "-Wl,--no-warn-rwx-segments", *objects, "-lgcc"]
    subprocess.run(["arm-none-eabi-gcc", *CORTEX_M3, *link, "-o", str(program)], check=True)
    table = subprocess.run(["arm-none-eabi-size", "-A", str(program)], capture_output=True, text=True, check=True)
    rows = [line.split() for line in table.stdout.splitlines() if line.startswith(".")]
    return {row[0]: int(row[1]) for row in rows}


def test_firmware_fits_4_kib_of_flash(sizes: dict[str, int], capsys: pytest.CaptureFixture[str]) -> None:
    """Code, constants and what the compiler adds for 64-bit numbers fit; linking proves that nothing else is needed."""
    flash = sizes[".text"] + sizes.get(".rodata", 0) + sizes.get(".data", 0)
    with capsys.disabled():
        print(f"\nfirmware: {flash} bytes of flash, {sizes['.bss']} bytes of RAM (-Os, Cortex-M3)")
    assert 1000 < flash < FLASH_MAX


def test_state_takes_less_than_a_kilobyte(sizes: dict[str, int]) -> None:
    """A board's whole state is one variable of less than a kilobyte; the firmware has no other."""
    assert 0 < sizes[".bss"] < RAM_MAX
    assert sizes.get(".data", 0) == 0


def test_objects_have_no_variables_of_their_own(tmp_path: Path) -> None:
    """No source of the firmware keeps anything outside of the `boat` it is given."""
    for source in PORTABLE:
        made = tmp_path / "object.o"
        subprocess.run(
            ["arm-none-eabi-gcc", *CORTEX_M3, f"-I{FIRMWARE}", "-c", str(source), "-o", str(made)], check=True
        )
        table = subprocess.run(["arm-none-eabi-size", str(made)], capture_output=True, text=True, check=True).stdout
        _, data, bss, *_ = table.splitlines()[1].split()
        assert (data, bss) == ("0", "0")


def test_the_part_for_psoc_creator_compiles(tmp_path: Path) -> None:
    """psoc_main.c fits the firmware, and the functions that PSoC Creator generates as c/project.h declares them."""
    command = ["arm-none-eabi-gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", *CORTEX_M3, f"-I{FIRMWARE}"]
    source, made = FIRMWARE / "psoc_main.c", tmp_path / "main.o"
    subprocess.run([*command, f"-I{HERE / 'c'}", "-c", str(source), "-o", str(made)], check=True)
    assert made.stat().st_size > 0
