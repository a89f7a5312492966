"""How the commands speak: messages keep their lines."""

from __future__ import annotations

import runpy
import sys

import pytest

from boat_daq.commands import console


def test_a_long_message_stays_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """A cause of 200 characters is one line for whoever reads standard error by lines; no word or path is broken."""
    text = "error: " + "/a-folder/of-a-long-name" * 8 + " cannot be written"
    console.say(text)
    assert capsys.readouterr().err == text + "\n"


def test_no_bar_where_there_is_no_screen(capsys: pytest.CaptureFixture[str]) -> None:
    """Standard error that is no terminal gets messages alone, not an empty line for each bar."""
    with console.progress_bar("working") as advance:
        advance(1, 2)
    assert capsys.readouterr() == ("", "")


def test_ctrl_c_while_the_program_loads_is_no_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is open yet: the commands' modules are half imported, and it leaves with 130 as later."""

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
