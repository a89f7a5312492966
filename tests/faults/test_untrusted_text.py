"""Text from files that a spreadsheet, browser, terminal, window or Python would interpret: it remains text."""

from __future__ import annotations

import csv
import io
import pickle
from pathlib import Path

import numpy as np
import pytest

from analysis import Options, analyse
from analysis.data.load import load_recording
from analysis.history.batch import write_table
from analysis.numbers import neutral
from analysis.reports.build import write_report
from analysis.shadow.model.table import read_table


@pytest.mark.fault(49, how="cells that begin with = + - @ TAB and CR, in a table written for a spreadsheet", times=6)
@pytest.mark.parametrize("start", ["=", "+", "-", "@", "\t", "\r"])
def test_text_cell_is_no_formula(tmp_path: Path, start: str) -> None:
    """Text gets an apostrophe; numbers, negative ones too, stay numbers."""
    import pandas as pd

    text = start + 'cmd|" /C calc"!A0'
    assert neutral(text) == "'" + text
    write_table(pd.DataFrame({"unit": [text], "drift": [-1.5]}), tmp_path / "table.csv")
    rows = list(csv.reader(io.StringIO((tmp_path / "table.csv").read_bytes().decode("utf-8-sig"))))
    assert rows[1][0].startswith("'")
    assert float(rows[1][1]) == -1.5


class CreatesFile:
    """Unpickling it would create a file."""

    def __init__(self, path: str) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[str, str]]:
        return open, (self.path, "w")


@pytest.mark.fault(50, how="a pickle in an array file, where a cached table is read", times=1)
def test_pickle_is_never_loaded(tmp_path: Path) -> None:
    """An array of objects in the shadow's cache is neither read nor executed."""
    mark = tmp_path / "exploded"
    np.savez(tmp_path / "table.npz", nodes=np.array([CreatesFile(str(mark))], dtype=object))
    assert read_table(tmp_path / "table.npz") is None
    (tmp_path / "raw.npz").write_bytes(pickle.dumps(CreatesFile(str(mark))))
    assert read_table(tmp_path / "raw.npz") is None
    assert not mark.exists()


@pytest.mark.fault(
    48, how="markup in the header, the comments and the name of an imported table, up to its report", times=4
)
def test_markup_of_a_table_is_text_in_its_report(tmp_path: Path) -> None:
    """Column names, operator, unit and note of a CSV are text in the HTML, which loads nothing."""
    bad = "<script src='//x'>alert(1)</script>"
    rows = [f"{0.05 * n:g},{50 * np.cos(n / 60):.4f},{1600 + 200 * np.cos(n / 60):.3f}" for n in range(800)]
    head = [f"# {key}: {bad}" for key in ("operator", "unit", "note")]
    path = tmp_path / "a&<b>.csv"
    path.write_text("\n".join([*head, f"time_s,pressure_kpa,{bad} s1 [mV]", *rows]) + "\n", encoding="utf-8")
    run = load_recording(path, columns={"s1_mv": "3"})
    write_report([analyse(run, options=Options(mcmc=False))], tmp_path / "report.html")
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<script" not in html
    assert "&lt;script" in html
    assert "a&<b>" not in html


# ---- text in a terminal and in tooltips ------------------------------------------------------------------------------

CONTROL_TEXT = "[/bold] [red]x[/red] :smile: \x1b[2J \x1b]0;title\x07 \x9b31m \r \u202egnp \udcff"


@pytest.mark.fault(48, how="markup, control characters and lone surrogates in text that a terminal prints", times=3)
def test_markup_and_control_characters_are_printed_as_text(capsys: pytest.CaptureFixture[str]) -> None:
    """Brackets remain, control characters become a replacement character; in a message, a line and a table."""
    from rich.table import Table

    from boat_daq.commands.terminal import PlainConsole

    console = PlainConsole(width=200)
    table = Table(CONTROL_TEXT, box=None)
    table.add_row(CONTROL_TEXT)
    for thing in (CONTROL_TEXT, table):
        console.print(thing)
    output = capsys.readouterr().out
    assert output.count("[/bold] [red]x[/red] :smile: \ufffd[2J") == 3
    assert not set(output) & set("\x1b\x07\x9b\r\u202e\udcff")


def test_markup_in_a_header_is_shown_in_the_preview(tmp_path: Path) -> None:
    """A header that looks like the end of markup is shown as text."""
    from typer.testing import CliRunner

    from boat_daq.cli import app

    (tmp_path / "a.csv").write_text("time_s,pressure_kpa,s1_mv,[/b] \x1b[2J\n0,1,2,3\n1,2,3,4\n", encoding="utf-8")
    shown = CliRunner().invoke(app, ["import", str(tmp_path / "a.csv"), "--preview"], env={"COLUMNS": "200"})
    assert shown.exit_code == 0, shown.exception
    assert "[/b]" in shown.stdout
    assert "\x1b" not in shown.stdout


def test_tooltip_escapes_tags() -> None:
    """Qt takes a text with a tag for rich text; tags from files are escaped in a tooltip."""
    from boat_daq.gui.widgets.controls import as_words

    bad = "SA1 <img src='file:///etc/passwd'> & <b>x"
    assert as_words("SA1 & 3 > 2") == "SA1 & 3 > 2"
    assert as_words(bad).count("<") == 2  # its own paragraph, begun and ended
    assert "&lt;img src=" in as_words(bad)


def test_name_that_is_not_utf_8_is_exported_escaped(tmp_path: Path) -> None:
    """An operator's name that is not UTF-8 can be exported."""
    from analysis.data.export import export

    run = load_recording(Path(__file__).parents[2] / "recordings" / "simulated_SA1_two_cycles.boat")
    run.meta["operator"] = "a\udcffb"
    export(run, tmp_path / "a.csv", "csv")
    assert r"a\udcffb" in (tmp_path / "a.json").read_text(encoding="utf-8")
