"""The JSON file of a calibration: read again to the last bit, refused where it is another or damaged."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.calibration_export.calibration_file import MOST_BYTES, CalibrationFile, read_calibration
from protocol.base.errors import DataError, FileError
from tests.analysis.calibration_export.calibrations import expected, file_of, signals

CALIBRATION = file_of("sextic and falling spline")
CONTENT: dict[str, Any] = json.loads(CALIBRATION.text())


def stored(folder: Path, content: Any) -> Path:
    """Write a file."""
    (folder / "c.json").write_text(json.dumps(content), encoding="utf-8")
    return folder / "c.json"


def test_file_is_read_again_to_the_last_bit(tmp_path: Path) -> None:
    """Elongation, U and flags of what is read are those of what was written; and so is its text."""
    (tmp_path / "c.json").write_text(CALIBRATION.text(), encoding="utf-8")
    again = read_calibration(tmp_path / "c.json")
    given = signals(CALIBRATION, 500)
    for before, after in zip(expected(CALIBRATION, given), expected(again, given), strict=True):
        np.testing.assert_array_equal(before, after)
    assert again.text() == CALIBRATION.text()


def test_calibration_without_an_inverse_is_written_with_its_reason(tmp_path: Path) -> None:
    """Nothing converts with it, and the reason is given again."""
    void = CalibrationFile(CALIBRATION.head, CALIBRATION.sensors, None, "it turns at 1.2 mm")
    again = read_calibration(stored(tmp_path, json.loads(void.text())))
    with pytest.raises(DataError, match=r"it turns at 1\.2 mm"):
        again.reader()


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("format",), "other", "is not a calibration"),
        (("version",), 4, "version 4"),
        (("version",), True, "version True"),
        (("unit",), 3, "unit is missing"),
        (("simulated",), None, "simulated is missing"),
        (("sensors",), [], "sensors is not"),
        (("sensors", 0, "inverse"), None, "inverse of s1 is missing"),
        (("sensors", 0, "inverse", "powers"), [[1.0, 0.0]], "not monotone"),
        (("sensors", 0, "inverse", "powers"), [[1.0], [2.0]], "do not fit"),
        (("sensors", 0, "inverse", "range_mm"), [2.0, 1.0], "do not fit"),
        (("sensors", 1, "inverse", "starts"), "text", "not an array"),
        (("sensors", 1, "inverse", "noise_mm"), [None] * 129, "not finite"),
        (("sensors", 1, "inverse", "shared_mm"), [-1.0] * 129, "negative"),
        (("sensors", 1, "inverse", "half_division_mm"), -1, "half_division_mm"),
        (("correlation",), [[1.0, 9.0], [9.0, 1.0]], "correlation"),
        (("reference_u", "relative"), "x", "relative"),
    ],
)
def test_damaged_file_is_refused_by_name(tmp_path: Path, path: tuple[Any, ...], value: Any, message: str) -> None:
    """What is wrong is named, and what to do."""
    content = json.loads(json.dumps(CONTENT))
    place = content
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    with pytest.raises(FileError, match=message) as caught:
        read_calibration(stored(tmp_path, content))
    assert caught.value.remedy


def test_other_files_are_refused(tmp_path: Path) -> None:
    """None, a folder, no JSON, nested without end, larger than any."""
    for content in (b"", b"\xff\xfe", b"[" * 100_000, b" " * (MOST_BYTES + 1)):
        (tmp_path / "x.json").write_bytes(content)
        with pytest.raises(FileError):
            read_calibration(tmp_path / "x.json")
    for path in (tmp_path, tmp_path / "absent.json"):
        with pytest.raises(FileError):
            read_calibration(path)
