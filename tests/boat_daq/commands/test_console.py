"""Output of the commands: messages keep their lines, and leaving while loading."""

from __future__ import annotations

import io
import json
import runpy
import sys

import pytest

from boat_daq.commands import console


def test_long_message_stays_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """A cause of 200 characters is one line on standard error; no word or path is broken."""
    text = "error: " + "/a-folder/of-a-long-name" * 8 + " cannot be written"
    console.notify(text)
    assert capsys.readouterr().err == text + "\n"


@pytest.mark.fault(64, how="outputs of seven encodings", times=7)
@pytest.mark.parametrize("encoding", ["cp850", "cp437", "cp932", "gbk", "cp1252", "ascii", "utf-8"])
def test_output_of_any_encoding_is_written(encoding: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As after `> file.txt` on Windows: what the encoding lacks becomes ASCII, and JSON is read back as it was."""
    bytes_out = io.BytesIO()
    with io.TextIOWrapper(bytes_out, encoding) as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        console.prepare_output()
        print("b1 − 0.2 µm², 20 °C – Grün 日本")
        text = {"note": "χ² ≤ 3 µV 日本"}
        console.emit_json(text)
        stream.flush()
        line, content = bytes_out.getvalue().splitlines()
    assert json.loads(content) == text
    if encoding == "ascii":
        assert line.decode() == "b1 - 0.2 um^2, 20  degC - Grun ??"
    else:
        assert line.decode(encoding).startswith("b1 ")


def test_progress_bar_needs_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    """Standard error that is not a terminal gets messages only, not an empty line for each bar."""
    with console.progress_bar("working") as advance:
        advance(1, 2)
    assert capsys.readouterr() == ("", "")


def test_ctrl_c_while_loading_exits_130(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the modules half imported it exits with 130 and without a traceback, as later."""

    class PressedWhileLoading:
        @staticmethod
        def find_spec(name: str, *_: object) -> None:
            if name == "boat_daq.cli":
                raise KeyboardInterrupt

    monkeypatch.delitem(sys.modules, "boat_daq.cli", raising=False)
    monkeypatch.setattr(sys, "meta_path", [PressedWhileLoading, *sys.meta_path])
    with pytest.raises(SystemExit) as left:
        runpy.run_module("boat_daq", run_name="__main__")
    assert left.value.code == 130
