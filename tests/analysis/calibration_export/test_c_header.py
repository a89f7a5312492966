"""The C header gives what `Fusion` gives, in double and by tables, and compiles without a warning."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from analysis.calibration_export.c_header import c_header
from analysis.calibration_export.calibration_file import CalibrationFile
from tests.analysis.calibration_export.calibrations import SENSORS, expected, file_of, signals

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror")
MAIN = r"""
#include <stdio.h>
#include "boat_calibration.h"
int main(void)
{
    double signals[BOAT_SENSORS];
    while (fread(signals, sizeof signals, 1, stdin) == 1) {
        float single[BOAT_SENSORS], u_single;
        boat_real real[BOAT_SENSORS], u;
        double out[5];
        unsigned flags;
        int i;
        for (i = 0; i < BOAT_SENSORS; ++i) {
            single[i] = (float)signals[i];
            real[i] = (boat_real)signals[i];
        }
        out[0] = (double)boat_elongation(real, &u, &flags);
        out[1] = (double)u;
        out[2] = (double)flags;
        out[3] = (double)boat_elongation_mm(single, &u_single);
        out[4] = (double)u_single;
        fwrite(out, sizeof out, 1, stdout);
    }
    return 0;
}
"""
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")


def run_c(header: str, signal_mv: np.ndarray, folder: Path) -> np.ndarray:
    """Return elongation, U and flags, then elongation and U of the float function, [n, 5]."""
    (folder / "boat_calibration.h").write_text(header, encoding="ascii")
    (folder / "main.c").write_text(MAIN)
    subprocess.run(["gcc", *STRICT, "-O1", "main.c", "-o", "main"], cwd=folder, check=True, timeout=60)
    done = subprocess.run([folder / "main"], input=signal_mv.tobytes(), capture_output=True, check=True, timeout=60)
    return np.frombuffer(done.stdout).reshape(-1, 5)


def check_double(calibration: CalibrationFile, count: int, folder: Path) -> None:
    """Hold the header against `Fusion`."""
    given = signals(calibration, count)
    found = run_c(c_header(calibration), given, folder)
    x, u, flags = expected(calibration, given)
    np.testing.assert_array_equal(found[:, 2], flags)
    np.testing.assert_allclose(found[:, 0], x, atol=1e-9, rtol=0)
    np.testing.assert_allclose(found[:, 1], u, rtol=1e-9)
    np.testing.assert_allclose(found[:, 3], x, atol=1e-6, rtol=0)
    np.testing.assert_allclose(found[:, 4], u, rtol=1e-6)
    assert set(np.unique(flags)) >= {0, 1, 2}


@needs_gcc
def test_c_agrees_with_the_fusion(tmp_path: Path) -> None:
    """Two sensors, a sextic and a falling spline: elongation, U and every flag; the float function within 1e-6 mm."""
    check_double(file_of("sextic and falling spline"), 4000, tmp_path)


@needs_gcc
@pytest.mark.nightly
@pytest.mark.parametrize("name", SENSORS)
def test_c_agrees_over_many_signals(name: str, tmp_path: Path) -> None:
    """1e5 signals of every set of sensors."""
    check_double(file_of(name), 100_000, tmp_path)


@needs_gcc
@pytest.mark.nightly
@pytest.mark.parametrize("name", ["line", "falling cubic", "spline"])
@pytest.mark.parametrize("bound_mm", [0.05, 0.001])
def test_tables_in_single_precision_keep_to_their_bound(name: str, bound_mm: float, tmp_path: Path) -> None:
    """The elongation of a sensor by its table is within the bound, and U is that of an elongation so far away."""
    calibration = file_of(name)
    given = signals(calibration, 20_000)
    found = run_c(c_header(calibration, bound_mm), given, tmp_path)
    x, u, flags = expected(calibration, given)
    same = (found[:, 2] == flags) & np.isfinite(x)
    assert same.sum() > 0.99 * np.isfinite(x).sum()
    assert np.abs(found[same, 0] - x[same]).max() <= bound_mm
    np.testing.assert_allclose(found[same, 1], u[same], rtol=2 * bound_mm, atol=1e-5)


def test_text_of_a_recording_ends_no_comment_and_no_string() -> None:
    """A unit named by somebody else: comment marks, quotes, line ends, right-to-left marks, trigraphs."""
    name = 'a*/ "\\\n??/ \u202eb'
    text = c_header(file_of("line", unit=name))
    assert text.isascii()
    define = r'#define BOAT_UNIT "a*/ \"\\\?\?\?/ \?b"'
    assert define in text
    rest = text.replace(define, "")
    assert rest.count("*/") == rest.count("/*")
    assert "??" not in rest


LAYOUT = """SECTIONS { . = 0; .text : { KEEP(*(.vectors)) *(.text*) *(.rodata*) }
. = 0x20000000; .data : { *(.data*) } .bss : { *(.bss*) *(COMMON) } }"""
ONLY = """#include "boat_calibration.h"
float only(const float *signals_mv, float *u_mm);
float only(const float *signals_mv, float *u_mm) { return boat_elongation_mm(signals_mv, u_mm); }
"""
CROSS = ("arm-none-eabi-gcc", "-mcpu=cortex-m3", "-mthumb", "-Os", "-ffreestanding", "-nostartfiles", "-nostdlib")
TOOLS = ("gcc", "arm-none-eabi-gcc", "arm-none-eabi-size", "qemu-system-arm")


@pytest.mark.nightly
@pytest.mark.skipif(not all(map(shutil.which, TOOLS)), reason=f"not installed: one of {', '.join(TOOLS)}")
@pytest.mark.parametrize(("table_error_mm", "most_instructions"), [(None, 60_000), (0.001, 20_000)])
def test_cortex_m3_gives_what_the_host_gives(
    table_error_mm: float | None, most_instructions: int, tmp_path: Path
) -> None:
    """1e5 signals of two sensors under QEMU: the same bits; flash and instructions are printed and bounded."""
    header = c_header(file_of("sextic and falling spline"), table_error_mm)
    (tmp_path / "boat_calibration.h").write_text(header, encoding="ascii")
    (tmp_path / "layout.ld").write_text(LAYOUT)
    (tmp_path / "only.c").write_text(ONLY)
    source = str(Path(__file__).with_name("cortex_m3.c"))

    def run(*command: str) -> str:
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=200)
        return done.stdout + done.stderr

    run(*CROSS, *STRICT, "-c", "only.c", "-o", "only.o")
    run(*CROSS, "-Wl,-e,only", "-Wl,--gc-sections", "-Wl,-u,only", "only.o", "-lgcc", "-o", "only.elf")
    flash = int(run("arm-none-eabi-size", "only.elf").splitlines()[1].split()[0])
    run("gcc", "-std=c99", "-O1", "-DHOST", "-I.", source, "-o", "host")
    run(str(tmp_path / "host"))
    expected_results = np.fromfile(tmp_path / "results.bin", np.float32)
    run(*CROSS, "-std=gnu99", "-I.", source, "-T", "layout.ld", "-lgcc", "-o", "target.elf")
    (tmp_path / "results.bin").unlink()
    machine = ("-M", "mps2-an385", "-nographic", "-icount", "shift=0", "-monitor", "none", "-serial", "none")
    mean, most = map(int, run(
        "qemu-system-arm", *machine, "-semihosting-config", "enable=on,target=native", "-kernel", "target.elf"
    ).split())  # fmt: skip
    found = np.fromfile(tmp_path / "results.bin", np.float32)
    print(f"\nflash {flash} bytes; instructions {mean} on average, {most} at most")
    np.testing.assert_array_equal(found, expected_results)
    assert flash < 20_000
    assert mean < most < most_instructions
