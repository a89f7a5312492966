"""Output of the commands: messages keep their lines, and leaving while loading."""

from __future__ import annotations

import runpy
import sys

import pytest

from boat_daq.commands import console


def test_long_message_stays_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """A cause of 200 characters is one line on standard error; no word or path is broken."""
    text = "error: " + "/a-folder/of-a-long-name" * 8 + " cannot be written"
    console.notify(text)
    assert capsys.readouterr().err == text + "\n"


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
