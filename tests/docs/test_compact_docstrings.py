"""Docstrings become what napoleon reads."""

from __future__ import annotations

import importlib.util

from tests.docs.pages import ROOT

_spec = importlib.util.spec_from_file_location("compact_docstrings", ROOT / "docs" / "_ext" / "compact_docstrings.py")
assert _spec and _spec.loader
compact_docstrings = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(compact_docstrings)


def test_entries_are_split_into_name_and_meaning() -> None:
    lines = ["Return it.", "", "Parameters", "----------", "x, y : of the data,", "    mm.", "n : number.", ""]
    assert compact_docstrings.rewrite(lines)[4:] == [
        "x",
        "    of the data,",
        "    mm.",
        "y",
        "    of the data,",
        "    mm.",
        "n",
        "    number.",
        "",
    ]


def test_an_indented_block_is_code_and_a_bar_is_escaped() -> None:
    lines = ["Return |y|, not `a | b`.", "", "    x = a | b", "", "More."]
    assert compact_docstrings.rewrite(lines) == [
        r"Return \|y\|, not `a | b`.",
        "",
        "::",
        "",
        "    x = a | b",
        "",
        "More.",
    ]


def test_what_is_returned_is_a_sentence() -> None:
    lines = [
        "Compute it.",
        "",
        "Returns",
        "-------",
        "The value in mV,",
        "NaN without data.",
        "",
        "Raises",
        "------",
        "ValueError : it is empty.",
        "",
    ]
    assert compact_docstrings.rewrite(lines)[2:7] == [
        "Returns",
        "-------",
        ":",
        "    The value in mV,",
        "    NaN without data.",
    ]
