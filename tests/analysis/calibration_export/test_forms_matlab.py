"""The MATLAB function gives what `Fusion` gives, run by GNU Octave."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from analysis.calibration_export.forms import matlab_function
from tests.analysis.calibration_export.calibrations import SENSORS, expected, file_of, signals


@pytest.mark.nightly
@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="octave is not installed")
@pytest.mark.parametrize("name", SENSORS)
def test_octave_agrees_over_many_signals(name: str, tmp_path: Path) -> None:
    """1e5 signals of every set of sensors: elongation, U and every flag."""
    calibration = file_of(name)
    given = signals(calibration, 100_000)
    (tmp_path / "boat_elongation.m").write_text(matlab_function(calibration), encoding="ascii")
    given.T.tofile(tmp_path / "in.bin")
    script = (
        f"f = fopen('in.bin'); s = fread(f, [{len(given)}, Inf], 'double'); fclose(f);"
        "[x, u, flags] = boat_elongation(s); f = fopen('out.bin', 'w'); fwrite(f, [x u flags], 'double'); fclose(f);"
    )
    subprocess.run(["octave-cli", "--no-init-file", "--eval", script], cwd=tmp_path, check=True, timeout=120)
    found = np.fromfile(tmp_path / "out.bin").reshape(3, -1)
    x, u, flags = expected(calibration, given)
    np.testing.assert_array_equal(found[2], flags)
    np.testing.assert_allclose(found[0], x, atol=1e-9, rtol=0)
    np.testing.assert_allclose(found[1], u, rtol=1e-9)


def test_function_holds_every_number_of_the_calibration() -> None:
    """Each node, power and uncertainty with all its digits, and no line that MATLAB would not read."""
    calibration = file_of("sextic and falling spline", unit="b\u202e %{\n1")
    text = matlab_function(calibration)
    assert text.isascii()
    for inverse in calibration.reader().inverses:
        for values in (inverse.nodes, inverse.powers.ravel(), inverse.noise_mm, inverse.shared_mm, inverse.starts):
            assert all(repr(value) in text for value in values.tolist())
    assert "%   SIMULATED calibration of unit b? %{ 1" in text
